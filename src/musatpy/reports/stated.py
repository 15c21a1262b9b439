"""The answer in the words of SYS cards: in the record, and as columns of print that are made of its tables.

`said` is how an answer is stated, as `WORDS` have it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from operator import itemgetter
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model import CoordinateSystem
from musatpy.reports.editing import printed_unit
from musatpy.reports.fields import Field, FieldGroup, Rows, unrecorded
from musatpy.reports.pages import Section, labelled, wrapped
from musatpy.reports.table import Report
from musatpy.reports.values import Values, plain
from musatpy.statistics import Statistics, Words
from musatpy.statistics.quality import sigmas_of
from musatpy.units import ARC_SECOND, DEGREE, GON, AngleUnit

Said = Mapping[str, Any]
Columns = tuple[Field[Any], ...]

_SEXAGESIMAL = "D  M  S   "
# Of a unit of angles: its heading, in radians, and edit descriptors of places and of turns, by the decimals that
# are no less certain than those of metres (see `docs/extending.md`); what it is called in sentences.
_ANGLES = {
    AngleUnit.DMS: (_SEXAGESIMAL, 1.0, "S16.5", "S14.3", "degrees, minutes, seconds"),
    AngleUnit.DEGREES: ("deg", DEGREE, "F15.9", "F13.7", "degrees"),
    AngleUnit.GONS: ("gon", GON, "F15.9", "F13.7", "gons"),
    AngleUnit.RADIANS: ("rad", 1.0, "F15.11", "F13.9", "radians"),
}
# Names of the angles of an attitude, where it is no matrix.
_NAMES = {"OPK": ("Omega", "Phi", "Kappa"), "POK": ("Phi", "Omega", "Kappa"), "ATS": ("Azimuth", "Tilt", "Swing")}
_UNIT = 14  # characters of a unit in a heading: `US survey foot`

WORDS: tuple[Field[Words], ...] = (
    Field("kind", "enum", "kind of coordinate system", "spec.kind",
          choices=("GEOG", "GEOC", "LOCL", "TANG", "PROJ")),
    Field("definition", "string?", "code, PROJ string or WKT of a projected system",
          lambda w: w.spec.definition or None),
    Field("geoid", "string?", "grid file of the geoid model to which heights refer",
          lambda w: w.spec.geoid or None),
    Field("origin", "3 number or null", "latitude, longitude, height of the origin of a tangent plane",
          "spec.origin", unit="rad, rad, m"),
    Field("false_origin", "3 number or null", "coordinates of this origin; null: zeros", "spec.false", unit="m"),
    Field("axes", "enum", "what attitudes refer to", "spec.axes", choices=("VERT", "GRID", "GEOC")),
    Field("angles", "enum", "form of attitudes", "spec.angles", choices=("OPK", "POK", "ATS", "MATR")),
    Field("unit", "enum", "of angles on cards and in the listing", "spec.unit",
          choices=("DMS", "DEG", "GON", "RAD")),
    Field("sigmas", "enum", "what the sigmas of cards and listing are of", "spec.sigmas", choices=("LOCL", "SYST")),
    Field("text", "string", "all this in words", "statement.text"),
    Field("coordinates", "3 string", "names of the coordinates", "statement.system.names"),
    Field("coordinate_units", "3 string", "their units in this record", "statement.system.units"),
)  # fmt: skip
_COORDINATES = "that of the coordinates"


def _of_map(of: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return what takes a factor of the map at the stations, None of each where there is no map."""
    return lambda s: [None] * len(s.answer.tide) if s.answer.factors is None else plain(of(s.answer.factors))


STATIONS: Rows[Statistics, Statistics] = Rows(
    "stations", "one row per photo; null where the system does not reach",
    of=lambda s: None if s.answer is None else s, fields=(
        Field("photo", "string", "photo id", "block.photos.ids"),
        Field("position", "3 number?", "adjusted", "answer.position", unit=_COORDINATES, exact=True),
        Field("angles", "3 number?", "adjusted, in the order of the form; null where attitudes are matrices",
              "answer.angles", unit="rad"),
        Field("matrix", "3x3 number?", "adjusted, from the axes of attitudes to the photo", "answer.matrix",
              exact=True),
        Field("covariance", "6x6 number?",
              "a posteriori, of position and angles (of small rotations about the axes where attitudes are "
              "matrices); null for angles that turn about one line", "answer.covariance",
              unit="those of position and angles", exact=True),
        Field("tide", "number?",
              "height of the water surface, adjusted where that is unknown, in heights of the system",
              "answer.tide", unit="m"),
        Field("undulation", "number?", "height of the geoid above the ellipsoid; 0 without one",
              "answer.undulation", unit="m"),
        Field("convergence", "number?", "from true to grid north, clockwise; null where there is no map",
              _of_map(lambda f: f.convergence), unit="rad"),
        Field("scale", "2 number? or null", "map over ellipsoid, along meridian and parallel",
              _of_map(lambda f: np.stack([f.meridian_scale, f.parallel_scale], axis=1))),
    ),
)  # fmt: skip
POINTS: Rows[Statistics, Statistics] = Rows(
    "points", "one row per ground point; null where not determined or not reached",
    of=lambda s: None if s.answer is None else s, fields=(
        Field("point", "string", "point id", "block.points.ids"),
        Field("position", "3 number?", "adjusted", "answer.points", unit=_COORDINATES, exact=True),
        Field("covariance", "3x3 number?", "a posteriori", "answer.point_covariance",
              unit=f"{_COORDINATES}, squared", exact=True),
    ),
)  # fmt: skip
STATED = FieldGroup[Statistics, Statistics](
    "stated",
    "the answer in the words of SYS cards; null in a job without any",
    of=lambda s: None if s.answer_words is None else s,
    fields=(
        FieldGroup[Statistics, Words](
            "input",
            "how the deck is stated; null: in the system of the options",
            of=lambda s: s.given_words,
            fields=WORDS,
            optional=True,
        ),
        FieldGroup[Statistics, Words](
            "answer", "how the answer is stated", of=lambda s: s.answer_words, fields=WORDS
        ),
        STATIONS,
        POINTS,
    ),
    optional=True,
)


def said_of(words: Words) -> Said:
    """Return how an answer is stated as a record has it."""
    return {field.name: field.json(words) for field in WORDS}


def with_answer(table: Rows[Any, Any], stated: Rows[Any, Any]) -> Rows[Any, Any]:
    """Return a table in which what the answer says stands for what the job's own system does: see `answered`."""
    return replace(table, fields=(*stated.fields, *table.fields))


def answered(content: Mapping[str, Any], *names: str) -> dict[str, Any]:
    """Return tables of a record with what its answer says in their stead."""
    return {name: {**content[name], **content["stated"][name]} for name in names}


def place_columns(said: Said, column: str, decimals: int) -> Columns:
    """Return the columns of a `column` (n, 3) of coordinates, lengths with `decimals`."""
    names, units = said["coordinates"], said["coordinate_units"]
    names = [
        name.capitalize() if len(name) > 1 else name for name in names
    ]  # h above the ellipsoid, H above a geoid
    headings = [f"{name}\n{unit[:_UNIT]}" for name, unit in zip(names, units, strict=True)]
    edits, sizes = [f"F15.{decimals}"] * 3, [1.0] * 3
    if said["kind"] == CoordinateSystem.GEOGRAPHIC:
        unit, size, edit, *_ = _ANGLES[said["unit"]]
        headings[:2] = [f"{name}\n{unit}" for name in names[:2]]
        edits[:2], sizes[:2] = [edit] * 2, [size] * 2
    return _vector(headings, edits, lambda t: t[column], sizes)


def place_sigma_columns(said: Said, local: str) -> Columns:
    """Return the columns of sigmas (n, 3), of the coordinates (arc seconds where angles), or `local` ones."""
    of_system, edits, sizes = said["sigmas"] == "SYST", ["F9.3"] * 3, [1.0] * 3
    if not of_system and said["kind"] != CoordinateSystem.LOCAL:  # its axes are east, north, up by other names
        headings = ["Sigma East\nm", "Sigma North\nm", "Sigma Up\nm"]
    elif said["kind"] != CoordinateSystem.GEOGRAPHIC:
        pairs = zip(said["coordinates"], said["coordinate_units"], strict=True)
        headings = [f"Sigma {name}\n{unit[:_UNIT]}" for name, unit in pairs]
    else:
        headings = ["Sigma Lat\narc sec", "Sigma Long\narc sec", "Sigma h\nm"]
        edits[:2], sizes[:2] = ["F9.5"] * 2, [ARC_SECOND] * 2
    return _vector(headings, edits, lambda t: sigmas_of(t["covariance"])[:, :3] if of_system else t[local], sizes)


def turn_columns(said: Said) -> Columns:
    """Return the columns of photos with their attitudes and sigmas: a line for each, three of matrices."""
    angles, of_system = _NAMES.get(said["angles"]), said["sigmas"] == "SYST"
    sigmas = (lambda t: sigmas_of(t["covariance"])[:, 3:]) if of_system else itemgetter("attitude_sigma")
    if angles is None:
        axes = ("First axis", "Second axis", "Third axis")
        return (
            unrecorded("Photo", "A8", lambda t: np.repeat(t["photo"], 3), is_id=True),
            unrecorded("Row", "I3", lambda t: np.tile([1, 2, 3], len(t["photo"]))),
            *_vector(axes, ("F13.9",) * 3, lambda t: t["matrix"].reshape(-1, 3), (1.0,) * 3),
            unrecorded("Sigma\narc sec", "F9.2", lambda t: sigmas(t).ravel()),
        )
    unit, size, _, edit, _ = _ANGLES[said["unit"]]
    names = angles if of_system else ("X-T", "Y-T", "Hdg")
    return (
        unrecorded("Photo", "A8", lambda t: t["photo"], is_id=True),
        *_vector([f"{name}\n{unit}" for name in angles], (edit,) * 3, lambda t: t["angles"], (size,) * 3),
        *_vector([f"Sigma {name}\narc sec" for name in names], ("F9.2",) * 3, sigmas, (ARC_SECOND,) * 3),
    )


def map_columns(said: Said) -> Columns:
    """Return the columns of what the map of the answer does at the stations; none where it is on no map."""
    if said["kind"] != "PROJ":
        return ()
    unit, size, _, edit, _ = _ANGLES[said["unit"]]
    columns: Columns = (
        unrecorded("Photo", "A8", lambda t: t["photo"], is_id=True),
        *_vector([f"Convergence\n{unit}"], [edit], lambda t: t["convergence"][:, None], [size]),
        unrecorded("Scale along\nmeridian", "F11.7", lambda t: t["scale[0]"]),
        unrecorded("Scale along\nparallel", "F11.7", lambda t: t["scale[1]"]),
    )
    return (*columns, unrecorded("Geoid\nm", "F9.3", lambda t: t["undulation"])) if said["geoid"] else columns


def _vector(
    headings: Sequence[str], edits: Sequence[str], values: Callable[[Values], FloatArray], sizes: Sequence[float]
) -> Columns:
    """Return one column for each component of `values` (n, k), printed in units of these `sizes`."""

    def component(axis: int, size: float) -> Callable[[Values], FloatArray]:
        return lambda t: values(t)[:, axis] / size

    return tuple(
        unrecorded(heading, edit, component(axis, size / printed_unit(heading)))
        for axis, (heading, edit, size) in enumerate(zip(headings, edits, sizes, strict=True))
    )


# What the map of the answer does at the stations: the record has it in words of its own.
MAP: Report[Statistics] = Report(title="Adjusted Exposure Stations: The Map There", columns=())


def systems(statistics: Statistics) -> list[Section]:
    """Return how the deck and the answer are stated; nothing for a job without such cards."""
    texts: dict[str, str] = {}
    for what, words in (("Input", statistics.given_words), ("Answer", statistics.answer_words)):
        if words is not None:
            texts |= {
                f"{what}, coordinates": words.statement.system.text,
                f"{what}, attitudes": words.statement.attitudes_text,
                f"{what}, angles in": _ANGLES[words.spec.unit][-1],
                f"{what}, sigmas": words.statement.sigmas_text,
            }
    lines = [line for label, text in texts.items() for line in wrapped([text], lead=labelled({label: ""})[0])]
    return [Section(title="Coordinate Systems", lines=lines)] if lines else []


def notes(statistics: Statistics, words: Words) -> list[Section]:
    """Return what the columns of the stations cannot say."""
    answer, ids = statistics.answer, statistics.block.photos.ids
    if answer is None:
        return []
    lost = "first and third angle turn about one line; the first is set to zero, and they have no sigmas"
    far = f"{words.statement.system.text} does not reach the station"
    rows = ((lost, answer.lost), (far, answer.far_stations))
    lines = wrapped([f"Photo {name}: {text}." for text, which in rows for name in ids[which].tolist()])
    return [Section(title="Notes On The Stations", lines=lines)] if lines else []


def far_points(statistics: Statistics, words: Words) -> list[Section]:
    """Return the points that have a position, which the system of the answer does not reach."""
    answer = statistics.answer
    if answer is None or not answer.far_points.any():
        return []
    names = ", ".join(statistics.block.points.ids[answer.far_points].tolist())
    text = f"{words.statement.system.text} does not reach these points: {names}."
    return [Section(title="Points Without Coordinates In The System", lines=wrapped([text]))]
