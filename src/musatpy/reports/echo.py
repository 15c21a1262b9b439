"""Echo of the input: every table of the block as it was read."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model import Block
from musatpy.reports import brevity, constraints, job_record, result_record, stations, waves_page
from musatpy.reports.columns import (
    Columns,
    attitude_columns,
    attitude_sigma_columns,
    metric_columns,
    position_columns,
    vector,
)
from musatpy.reports.fields import Group, Rows
from musatpy.reports.origin import Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Choice, Column, Report, key
from musatpy.reports.wording import Values, place_columns, place_sigma_columns, turn_columns
from musatpy.statistics import Statistics

_XY = ("x\nmm", "y\nmm")
_UV = ("u\nunit", "v\nunit")
_SIGMA_UV = ("Sigma u\nunit", "Sigma v\nunit")
_SIGMA_XY = ("sigma x\num", "sigma y\num")
_CAMERA: Column[Statistics] = key("Camera", "A6", "camera")
_PHOTO: Column[Statistics] = key("Photo", "A8", "photo")


def _echo(
    title: str,
    table: Rows[Statistics, Any] | Group[Statistics, Any],
    *columns: Column[Statistics] | Choice[Statistics],
    **more: Any,
) -> Report[Statistics]:
    """Return the echo of a table; `more` is what else its report has."""
    return Report(title=f"Input: {title}", table=table, columns=columns, **more)


CAMERAS = _echo(
    "Cameras",
    job_record.CAMERAS,
    _CAMERA,
    Column("Focal length\nmm", "F12.5", shows="focal_length"),
    *vector(("xp\nmm", "yp\nmm"), ("F10.5", "F10.5"), shows="principal_point"),
    *vector(("Format x\nmm", "Format y\nmm"), ("F8.2", "F8.2"), shows="format_size"),
)
DISTORTION = _echo(
    "Distortion",
    job_record.DISTORTION,
    _CAMERA,
    key("Kind", "A4", "kind"),
    *vector(
        ("K1, P1\nor radius mm", "K2, P2\nor distortion mm", "K3, P3"), ("E17.9", "E17.9", "E17.9"), shows="values"
    ),
)
FIDUCIALS = _echo(
    "Calibrated Fiducial Marks",
    job_record.FIDUCIALS,
    _CAMERA,
    key("Mark", "A4", "mark"),
    *vector(_XY, ("F11.5", "F11.5"), shows="xy"),
    *vector(_SIGMA_XY, ("F7.2", "F7.2"), shows="sigma"),
)
COMPARATOR = _echo(
    "Comparator",
    job_record.COMPARATOR,
    Column("Scale u\nmm/unit", "F12.9", shows="scale_u"),
    Column("Scale v\nmm/unit", "F12.9", shows="scale_v"),
    Column("Lean\narc sec", "F9.2", shows="non_orthogonality"),
    Column("Rotation\nD  M  S   ", "S14.3", shows="rotation"),
    Column("Left-handed", "A11", shows=Origin(field="left_handed", true="L")),
    Column("Sigma of\none reading", "F11.5", shows="reading_sigma"),
    Column("Limit of\nrepeated ones", "F13.5", shows="repeat_limit"),
)
LENSES = _echo(
    "Principal Points Of Best Symmetry",
    job_record.LENSES,
    _CAMERA,
    *vector(("Best symmetry x\nmm", "y\nmm"), ("F15.5", "F10.5"), shows="centre"),
    Column("K0", "E17.9", shows="k0"),
)
MARK_DISTANCES = _echo(
    "Distances Between Fiducial Marks",
    job_record.MARK_DISTANCES,
    _CAMERA,
    key("Mark", "A4", "marks[0]"),
    key("Mark", "A4", "marks[1]"),
    Column("Distance\nmm", "F11.5", shows="distance"),
    Column("Sigma\num", "F7.2", shows="sigma"),
    Column("Axis", "A4", shows="axis"),
)
RESEAU = _echo(
    "Calibrated Reseau",
    job_record.RESEAU,
    _CAMERA,
    key("Cross", "A8", "cross"),
    Column("Row", "I3", shows="row"),
    Column("Column", "I3", shows="column"),
    *vector(_XY, ("F11.5", "F11.5"), shows="xy"),
)
_TIDE: Columns = (
    _PHOTO,
    Column("Tide\nm", "F10.4", lambda s: _block(s).photos.tide, "tide"),
    Column("Sigma\nm", "F8.4", shows="tide_sigma"),
)
_TIDE_LABELS: Columns = (Column("Group", "A8", shows="tide_group"), Column("Day", "A8", shows="tide_day"))
_TIME: Columns = (Column("Time\ns", "F10.3", shows="time"),)
TIDES = _echo(
    "Tides",
    stations.STATIONS,
    *_TIDE,
    Choice((_TIDE_LABELS,), lambda s: _TIDE_LABELS if _has_labels(s.block) else ()),
    Choice((_TIME,), lambda s: _TIME if np.isfinite(s.block.photos.time).any() else ()),
)
_WAVE: Column[Statistics] = key("Wave", "A4", "wave")
WAVES = _echo(
    "Waves",
    waves_page.WAVES,
    _WAVE,
    Column("Shape", "A5", lambda s: s.block.waves.shape, Origin(field="shape", blank=True)),
    Column("Period\ns", "F8.3", shows="given_period"),
    Column("Depth\nm", "F8.2", shows="depth"),
    Column("Length\nm", "F9.3", shows="given_length"),
    Column("Speed\nm/s", "F8.3", shows="given_speed"),
    Column("Height\nm", "F8.3", shows="height"),
    Column("Towards\ndegrees", "F9.3", shows="azimuth"),
    Column("Crest\nm", "F10.3", shows="crest"),
    words={"shape": {"sinusoidal": "SINU", "stokes": "STOK", "trochoidal": "TROC"}},
)
WAVE_SIGMAS = _echo(
    "Sigmas Of Waves",
    waves_page.WAVES,
    _WAVE,
    Column("Length\nm", "F9.3", shows="length_sigma"),
    Column("Height\nm", "F8.3", shows="height_sigma"),
    Column("Towards\ndegrees", "F9.3", shows="azimuth_sigma"),
    Column("Crest\nm", "F10.3", shows="crest_sigma"),
)
_READINGS: Columns = vector(_UV, ("F15.7", "F15.7"), shows="xy")
_READING_SIGMAS: Columns = vector(_SIGMA_UV, ("F11.5", "F11.5"), shows="sigma")
_MEASURED: Columns = (
    *vector(_XY, ("F12.7", "F12.7"), shows="xy"),
    *vector(_SIGMA_XY, ("F7.2", "F7.2"), shows="sigma"),
)
_NARROW: Columns = vector(_UV, ("F12.7", "F12.7"), shows="xy")
_NARROW_SIGMAS: Columns = vector(_SIGMA_UV, ("F7.5", "F7.5"), shows="sigma")
FIDUCIAL_MEASUREMENTS = _echo(
    "Fiducial Measurements",
    job_record.FIDUCIAL_MEASUREMENTS,
    _PHOTO,
    key("Mark", "A4", "mark"),
    Choice((_MEASURED,), lambda s: (*_READINGS, *_READING_SIGMAS) if _is_wide(s) else _MEASURED),
)
CROSS_MEASUREMENTS = _echo(
    "Reseau Measurements",
    job_record.CROSS_MEASUREMENTS,
    _PHOTO,
    key("Cross", "A8", "cross"),
    Choice((_NARROW,), lambda s: _READINGS if _is_wide(s) else _NARROW),
)
PLATE_READINGS: Report[Statistics] = Report(
    title="Input: Plate Readings",
    path="reduction.readings",
    columns=(
        key("Photo", "A8", "photo", lambda s: s.read.photos.ids[s.read.plates.photo]),
        key("Point", "A8", "point", lambda s: s.read.points.ids[s.read.plates.point]),
        Choice(((*_NARROW, *_NARROW_SIGMAS),), lambda s: _plate_readings(_is_wide(s))),
    ),
)
PLATES: Report[Statistics] = Report(
    title="Input: Plate Measurements",
    pattern="Input: Plate Measurements(, Refined)?",
    table=result_record.PLATES,
    columns=(
        _PHOTO,
        key("Point", "A8", "point"),
        *_MEASURED,
        Column("Bath", "A4", lambda s: s.block.points.letters[s.block.plates.point]),
        Column("Trig", "A4", lambda s: np.where(s.block.plates.triangulated, "", "N")),
    ),
)
EQUAL_ELEVATIONS = _echo(
    "Equal Elevations",
    result_record.EQUAL_ELEVATIONS,
    key("Group", "A8", "group"),
    Column("Sigma\nm", "F8.4", shows="given_sigma"),
    key("Point", "A8", "points", lambda s: s.block.points.ids[s.block.equal_elevations.point]),
    rows=lambda s: s.block.equal_elevations.group,
    expand=("points",),
)


def _between(title: str, table: result_record.Table, ends: str, heading: str, what: str) -> Report[Statistics]:
    return constraints.between(
        f"Input: {title}",
        table,
        ends,
        heading,
        Column(f"{what.capitalize()}\nm", "F12.4", shows=f"given_{what}"),
        Column("Sigma\nm", "F8.4", shows="given_sigma"),
    )


def _places(shows: str, values: Values) -> Choice[Statistics]:
    """Return the columns of coordinates in the words of the deck."""
    native = position_columns(shows, 4, values)
    return replace(
        native, of=lambda s: native.of(s) if s.given_words is None else place_columns(s.given_words, values, 4)
    )


def _sigmas(shows: str, values: Values) -> Choice[Statistics]:
    """Return the columns of the sigmas of coordinates in the words of the deck."""
    native = metric_columns(shows, "Sigma ", values)
    return replace(
        native, of=lambda s: native.of(s) if s.given_words is None else place_sigma_columns(s.given_words, values)
    )


STATIONS = _echo(
    "Exposure Stations, Initial Positions",
    stations.STATIONS,
    _PHOTO,
    Column("Camera", "A6", shows="camera"),
    _places("given_position", lambda s: _block(s).photos.position),
    _sigmas("given_position_sigma", lambda s: _block(s).photos.position_sigma),
)
_ATTITUDES: Columns = (
    _PHOTO,
    *attitude_columns("given_attitude", 4),
    *attitude_sigma_columns("given_attitude_sigma"),
)
ATTITUDES = _echo(
    "Exposure Stations, Given Attitudes",
    stations.STATIONS,
    Choice((_ATTITUDES,), lambda s: _attitudes(s)),
)
ORIGIN: Report[Statistics] = Report(
    title="Input: Origin Of The Waves",
    path=waves_page.ORIGIN.name,
    columns=(_places("value", lambda s: _origin(s)),),
)
CONTROL = _echo(
    "Control",
    result_record.CONTROL,
    key("Point", "A8", "point"),
    key("Kind", "A10", "kind"),
    Column("Fixed", "A5", shows=Origin(field="fixed", true="X")),
    Column("Bath", "A4", lambda s: s.block.points.letters[s.block.control.point]),
    _places("given_position", lambda s: _block(s).control.position),
    _sigmas("given_sigma", lambda s: _block(s).control.sigma),
)
STATED = (
    CAMERAS,
    COMPARATOR,
    DISTORTION,
    LENSES,
    FIDUCIALS,
    MARK_DISTANCES,
    RESEAU,
    STATIONS,
    ATTITUDES,
    TIDES,
    WAVES,
    WAVE_SIGMAS,
    ORIGIN,
    CONTROL,
    EQUAL_ELEVATIONS,
    *(_between(*kind) for kind in constraints.BETWEEN),
    FIDUCIAL_MEASUREMENTS,
    CROSS_MEASUREMENTS,
    PLATE_READINGS,
    PLATES,
)
brief = brevity.note


def sections(statistics: Statistics) -> list[Section]:
    """Return the echo of every table of the block that has rows."""
    photos, raw = statistics.block.photos, statistics.solution.reduced is not None
    unwanted = {
        TIDES: bool(np.isnan(photos.tide).all() and np.isnan(photos.tide_sigma).all()),
        WAVE_SIGMAS: not statistics.block.waves.unknown.any(),
        PLATE_READINGS: not raw,
    }
    titles = {PLATES: f"{PLATES.title}, Refined" if raw else PLATES.title}
    echoed: list[Section] = []
    for report in STATED:
        if not unwanted.get(report, False):
            title = titles.get(report, report.title)
            section = report.section(statistics, title=title, new_page=not echoed)
            echoed += [section] if section.lines else []
    return echoed


def _is_wide(statistics: Statistics) -> bool:
    """Tell whether readings need more room than millimetres do: those of a comparator in micrometres."""
    read = statistics.read
    tables = (read.plates, read.fiducial_measurements, read.cross_measurements)
    raw = statistics.solution.reduced is not None
    return raw and any(bool((np.abs(table.xy) >= 1000.0).any()) for table in tables)


def _plate_readings(wide: bool) -> Columns:
    edit, sigma = ("F15.7", "F11.5") if wide else ("F12.7", "F7.5")
    return (
        *vector(_UV, (edit, edit), lambda s: s.read.plates.xy, shows="xy"),
        *vector(_SIGMA_UV, (sigma, sigma), lambda s: s.read.plates.sigma, shows="sigma"),
    )


def _has_labels(block: Block) -> bool:
    return any("".join(column) for column in (block.photos.tide_group, block.photos.tide_day))


def _origin(statistics: Statistics) -> FloatArray:
    origin = _block(statistics).wave_origin
    return np.array([] if origin is None else [origin.position]).reshape(-1, 3)


def _block(statistics: Statistics) -> Block:
    """Return the block as the deck states it."""
    return statistics.block if statistics.given is None else statistics.given.block


def _attitudes(statistics: Statistics) -> Any:
    words = statistics.given_words
    if words is not None:
        return turn_columns(
            words,
            lambda s: _block(s).photos.attitude,
            _given_matrices,
            lambda s: _block(s).photos.attitude_sigma,
        )
    return _ATTITUDES


def _given_matrices(statistics: Statistics) -> FloatArray:
    none = np.full((len(statistics.block.photos.ids), 3, 3), np.nan)
    given = statistics.given
    return none if given is None or given.matrices is None else given.matrices
