"""The listing and the record of a compilation (`musat as11 compile`)."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model import Verdict
from musatpy.reports import compilation_bottom, compilation_comparisons, compilation_points, iterations, job_record
from musatpy.reports.answer import MARKS, USE
from musatpy.reports.editing import position
from musatpy.reports.fields import POSITION_UNIT, Document, Each, Field, Group, identity, same
from musatpy.reports.pages import Section, labelled, print_titled, wrapped
from musatpy.reports.table import Report, Texts, sentences_at
from musatpy.reports.values import Json

if TYPE_CHECKING:  # a reader of listings knows the tables by their statements alone
    from musatpy.compilation.against_run import AgainstRun
    from musatpy.compilation.bottom import Bottom
    from musatpy.compilation.compiled import Compiled, CompiledModel
    from musatpy.compilation.profiles import CompiledProfile, ProfileScan
    from musatpy.model.compilation import ContourSpec

_ABOUT = (
    "Points compiled in stereomodels of a run, in metres and radians; positions are in the system of the job, "
    "sigmas along east, north, up (X, Y, Z in LOCL jobs). A number that does not exist is null"
)

JOB: Group[Compiled, Compiled] = Group(
    "job",
    "what was compiled",
    (
        Field("titles", "* string", "titles of the deck", "deck.titles"),
        Field("system", "string", "coordinate system of the run", "run.block.options.system"),
        job_record.part("ellipsoid", "ellipsoid", lambda c: c.run.block.ellipsoid),
        Field("caution", "string?", "to be known of the run, on every page", lambda c: c.run.caution or None),
        Field(
            "index", "number?", "refractive index of the water", lambda c: getattr(c.run.block.water, "index", None)
        ),
        Field("datum", "string?", "sounding datum", lambda c: c.deck.datum.name if c.deck.datum else None),
        Field("datum_height", "number", "of it, above its grid if it has one", "datum.height", unit="m"),
        Field(
            "datum_grid",
            "string?",
            "grid file of its heights",
            lambda c: getattr(c.deck.datum, "geoid", None) or None,
        ),
        Field("datum_sigma", "number", "of that", "datum.sigma", unit="m"),
    ),
)
VERDICT: Group[Verdict, Verdict] = Group("verdict", "what it is worth", iterations.VERDICT.fields)
MODELS: Each[Compiled, CompiledModel] = Each(
    "models",
    "one row per stereomodel",
    of=lambda c: c.models,
    fields=(
        identity("model", "name"),
        Field("photos", "2 string", "left and right",
              lambda m: m.stereo.run.block.photos.ids[list(m.stereo.photos)], ("Left", "Right"), "A8"),
        Field("mode", "string", "IMAGE or PRINTED", heading="Mode", edit="A7"),
        Field("vertical", "string", "POINT or MODEL", lambda m: "MODEL" if m.printed.model_vertical else "POINT",
              "Vert.", "A5"),
        Field("tide", "string", "PHOTO or MEAN", lambda m: "MEAN" if m.printed.mean_tide else "PHOTO", "Tide",
              "A5"),
        Field("rays", "string", "OWN or SHARED", lambda m: "SHARED" if m.printed.shared_point else "OWN", "Rays",
              "A6"),
        Field("pointing", "number", "sigma of a pointing", heading="Pointing\num", edit="F8.2"),
        Field("limit", "number", "of differences of re-measured points", unit="mm"),
        Field("base", "number", "length of the base", "stereo.base", "Base\nm", "F9.2"),
        Field("height", "number", "of the stations over the origin", "stereo.height", "Height\nm", "F9.2"),
        Field("scale", "number", "scale number of the photographs at the origin", "stereo.scale", "Scale\n1 to",
              "F9.0"),
        Field("tides", "2 number?", "of the photos", "stereo.tides", ("Tide L\nm", "Tide R\nm"), "F7.3"),
        Field("origin", "3 number", "of the model axes, working", "stereo.origin",
              ("Origin X\nm", "Origin Y\nm", "Origin Z\nm"), "F11.3", exact=True),
        Field("axes", "3x3 number", "X, Y, Z of the model in working axes", "stereo.axes", exact=True),
        Field("origin_position", "3 number", "of the model axes, in the system of the job",
              lambda m: m.stereo.run.frame.system(m.stereo.origin[None])[0], position(4), unit=POSITION_UNIT,
              exact=True),
        Field("working_origin", "3 number", "of the working axes", "stereo.run.frame.origin", unit="m", exact=True),
        Field("points", "integer", "readings", lambda m: len(m.rows), "Points", "I6"),
        Field("compiled", "integer", "of these with a position", lambda m: len(m.rows) - len(m.points.reasons)),
        Field("y_parallax", "number?", "root mean square of all points", lambda m: _rms(m.points.y_parallax),
              "RMS py\num", "F7.2"),
    ),
)  # fmt: skip
SHORELINES: Each[Compiled, tuple[str, FloatArray]] = Each(
    "shoreline",
    "one row per model with points of the shoreline: their heights over the mean tide",
    of=lambda c: _shorelines(c),
    fields=(
        identity("model", lambda s: s[0]),
        Field("points", "integer", "on the shoreline", lambda s: len(s[1]), "Points", "I6"),
        Field("mean", "number", "of the heights", lambda s: s[1].mean(), "Mean\nm", "F8.3"),
        Field("rms", "number", "root mean square", lambda s: _rms(s[1]), "RMS\nm", "F8.3"),
        Field("largest", "number", "signed, of the largest magnitude", lambda s: s[1][np.abs(s[1]).argmax()],
              "Largest\nm", "F8.3"),
    ),
)  # fmt: skip
RECOVERED: Each[tuple[Compiled, list[AgainstRun]], AgainstRun] = Each(
    "recovered",
    "one row per model: readings of class R less what the points of the run predict",
    of=lambda s: s[1],
    fields=(
        identity("model", "model.name"),
        Field("points", "integer", "read again", lambda a: int(a.again.sum()), "Points", "I6"),
        Field("rms", "2x2 number?", "left and right, x and y", unit="mm"),
        Field("largest", "number?", "of a coordinate", lambda a: a.largest[0], "Largest\num", "F9.2"),
        Field("point", "string?", "of the largest", lambda a: a.largest[1], "at Point", "A8"),
        Field("limit", "number", "of the root mean squares", "model.limit", "Limit\num", "F8.2"),
        Field("recovered", "boolean?", "none is over it; null without points", heading="Recovered", edit="A9",
              words={True: "yes", False: "NO", None: "NO"}),
    ),
)  # fmt: skip
DOCUMENT: Document[Compiled] = Document(
    name="compilation_version",
    version="2.0",
    title="musatpy compilation",
    about=_ABOUT,
    nodes=(
        *(VERDICT, JOB, MODELS, compilation_points.POINTS, compilation_points.ANSWER, SHORELINES, RECOVERED),
        *compilation_comparisons.RECORD,
        *(compilation_points.PROFILES, compilation_points.SCANS),
        *compilation_bottom.RECORD,
        Field("warnings", "* string", "what is odd about the readings", same),
    ),
)


def record_of(
    compiled: Compiled,
    verdict: Verdict,
    against: list[AgainstRun],
    profiles: list[CompiledProfile],
    scans: list[ProfileScan],
    bottoms: Sequence[Bottom],
    warnings: Sequence[str],
) -> dict[str, Json]:
    """Return the record of a compilation, with its points beside those of the run, and the bottom."""
    return DOCUMENT.record(
        compiled,
        verdict=verdict,
        **dict.fromkeys(("recovered", "against_run", "analysis"), (compiled, against)),
        profiles=profiles,
        scans=scans,
        **dict.fromkeys((node.name for node in compilation_bottom.RECORD), bottoms),
        warnings=list(warnings),
    )


def _options(compiled: Compiled) -> dict[str, str]:
    """Return what run and deck ask for, label by label."""
    deck, datum, stated = compiled.deck, compiled.datum, compiled.run.stated
    options, water = compiled.run.block.options, compiled.run.block.water
    known = {"water_level": "level", "water_tilt": "tilt", "water_index": "index"}
    adjusted = [word for name, word in known.items() if getattr(options, name) != "KNOWN"]
    index = "none" if water is None else f"{water.index:.6f}"
    of_datum = f"{datum.title}, {datum.height:.4f} m, sigma {datum.sigma:.4f} m"
    words = {
        "Run": f"{options.program}, {options.system}, sigma0 {compiled.run.unit_sigma:.4f}",
        **({"Answer stated in": f"{stated.kind} {stated.definition}".strip()} if stated else {}),
        "Refractive index of the water": index,
        "Water adjusted by the run": ", ".join(adjusted) or "nothing",
        "Depths below": of_datum + (f" above {deck.datum.geoid}" if deck.datum and deck.datum.geoid else ""),
    }
    for label, spec in (("Contours of depth", deck.contours), ("Contours of height", deck.heights)):
        if spec is not None:
            words[label] = _contours(spec)
    return words


def _contours(spec: ContourSpec) -> str:
    """Return which contours are asked for."""
    texts = [f"every {spec.interval:g} m, one in {spec.index} thick"] if np.isfinite(spec.interval) else []
    listed = sorted({*spec.listed, *spec.listed_index})
    texts += [f"at {', '.join(f'{level:g}' for level in listed)} m"] if listed else []
    texts += [f"of grid {spec.grid}"] if spec.grid else []
    texts += [f"edges up to {spec.longest_edge:g} m"] if np.isfinite(spec.longest_edge) else []
    texts += [f"pieces from {spec.shortest:g} m"] if spec.shortest > 0.0 else []
    texts += [f"foreshore up to {spec.drying:g} m"] if np.isfinite(spec.drying) else []
    return ", ".join(texts)


def _shorelines(compiled: Compiled) -> list[tuple[str, FloatArray]]:
    of_models = (
        (model.name, compiled.over_water[(compiled.model_ids == model.name) & compiled.on_shore])
        for model in compiled.models
    )
    return [(name, heights) for name, heights in of_models if len(heights)]


def _rms(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(np.square(known)))) if len(known) else np.nan


# --- the listing ---

MODEL_TABLE = Report(
    "Model Set-Up", MODELS, "model photos mode vertical tide rays pointing base height tides points y_parallax"
)
RECOVERED_TABLE = Report(
    "Recoverability: Points Read Again, Less What The Run Predicts",
    RECOVERED,
    (
        "model points",
        *(
            RECOVERED.column(f"rms[{i}][{j}]", f"RMS {side} {axis}\num", "F9.2")
            for i, side in enumerate(("L", "R"))
            for j, axis in enumerate("xy")
        ),
        "largest point limit recovered",
    ),
)
SHORE_TABLE = Report("Shoreline: Heights Over The Tide", SHORELINES)
WARNINGS = Texts("Warnings Of Run And Readings", lambda r: sentences_at(r, "warnings"), "warnings")
STATED = (WARNINGS, MODEL_TABLE, SHORE_TABLE, RECOVERED_TABLE, compilation_comparisons.RUN_TABLE)


def sections_of(
    compiled: Compiled,
    verdict: Verdict,
    against: list[AgainstRun],
    profiles: list[CompiledProfile],
    scans: list[ProfileScan],
    bottoms: Sequence[Bottom],
    warnings: Sequence[str],
) -> list[Section]:
    """Return what the listing says, section by section."""
    names = zip(compiled.deck.stages.ids[compiled.rows], compiled.model_ids, compiled.reasons, strict=True)
    reasons = [f"Point {point} of model {model}: {reason}." for point, model, reason in names if reason]
    against_it = wrapped([reason.text for reason in verdict.reasons], lead="- ")
    return [
        Section(title="Verdict", lines=[f"{verdict.grade}: {USE[verdict.grade]}", *against_it]),
        *model_sections(compiled, against, warnings),
        *([Section(title="Points Without Coordinates", lines=wrapped(reasons))] if reasons else []),
        *compilation_points.point_sections(compiled),
        *([SHORE_TABLE.section(compiled)] if _shorelines(compiled) else []),
        *compilation_points.profile_sections(profiles, scans),
        *compilation_bottom.sections_of(bottoms),
        *compilation_comparisons.sections_of(compiled, against),
    ]


def model_sections(compiled: Compiled, against: list[AgainstRun], warnings: Sequence[str]) -> list[Section]:
    """Return what the listing says of run, deck and models, warnings included."""
    read = any(part.again.any() for part in against)
    return [
        Section(title="Options", lines=labelled(_options(compiled))),
        MODEL_TABLE.section(compiled, _of_waves(compiled)),
        *([RECOVERED_TABLE.section((compiled, against))] if read else []),
        *([Section(title=WARNINGS.title, lines=wrapped(warnings, lead="- "))] if warnings else []),
    ]


def _of_waves(compiled: Compiled) -> str:
    """Return the note that rays go through the waves of the run, where it has some."""
    sea = compiled.run.sea
    if sea is None:
        return ""
    names = f" ({', '.join(sea.names)})" if sea.names else ""
    return f"Through the waves of the run{names}, as they stood at each exposure. Depths count from the tides."


def listing_of(
    compiled: Compiled,
    sections: list[Section],
    *,
    verdict: Verdict | None = None,
    carriage_control: bool = False,
    date: datetime.date | None = None,
) -> str:
    """Return the listing of a compilation from its sections, on pages of 60 lines of 132 columns."""
    title = compiled.deck.titles[0] if compiled.deck.titles else ""
    mark = MARKS.get(verdict.grade, "") if verdict else ""
    left = f"MUSATPY  COMPILATION  {title:<60.60}{'  ' * bool(mark)}{mark}"
    return print_titled(left, sections, compiled.run.caution, carriage_control=carriage_control, date=date)
