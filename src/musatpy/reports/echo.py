"""Echo of the input: every table of the block as it was read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.model import Block, ComparatorSpec, ControlKind, EqualElevations
from musatpy.reports.columns import (
    Columns,
    attitude_columns,
    attitude_sigma_columns,
    camera_column,
    metric_columns,
    photo_column,
    point_column,
    position_columns,
    vector,
)
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Table
from musatpy.reports.wording import Values, place_columns, place_sigma_columns, turn_columns
from musatpy.statistics import Statistics
from musatpy.units import ARC_SECOND, DEGREE, MICROMETRE

CONTROL_KINDS = {
    ControlKind.FULL: "full",
    ControlKind.HORIZONTAL: "horizontal",
    ControlKind.VERTICAL: "vertical",
    ControlKind.CHECK: "check",
}

_XY = ("x\nmm", "y\nmm")
_UV = ("u\nunit", "v\nunit")
_SIGMA_UV = ("Sigma u\nunit", "Sigma v\nunit")
_SIGMA_XY = ("sigma x\num", "sigma y\num")

CAMERAS: Columns = (
    Column("Camera", "A6", lambda s: s.block.cameras.ids),
    Column("Focal length\nmm", "F12.5", lambda s: s.block.cameras.focal_length),
    *vector(("xp\nmm", "yp\nmm"), ("F10.5", "F10.5"), lambda s: s.block.cameras.principal_point),
    *vector(("Format x\nmm", "Format y\nmm"), ("F8.2", "F8.2"), lambda s: s.block.cameras.format_size),
)
DISTORTION: Columns = (
    camera_column(lambda s: s.block.distortion.camera),
    Column("Kind", "A4", lambda s: s.block.distortion.kind),
    *vector(
        ("K1, P1\nor radius mm", "K2, P2\nor distortion mm", "K3, P3"),
        ("E17.9", "E17.9", "E17.9"),
        lambda s: s.block.distortion.values,
    ),
)
FIDUCIALS: Columns = (
    camera_column(lambda s: s.block.fiducials.camera),
    Column("Mark", "A4", lambda s: s.block.fiducials.ids),
    *vector(_XY, ("F11.5", "F11.5"), lambda s: s.block.fiducials.xy),
    *vector(_SIGMA_XY, ("F7.2", "F7.2"), lambda s: s.block.fiducials.sigma, unit=MICROMETRE),
)
COMPARATOR: Columns = (
    Column("Scale u\nmm/unit", "F12.9", lambda s: [_comparator(s).scale_u]),
    Column("Scale v\nmm/unit", "F12.9", lambda s: [_comparator(s).scale_v]),
    Column("Lean\narc sec", "F9.2", lambda s: [_comparator(s).non_orthogonality / ARC_SECOND]),
    Column("Rotation\nD  M  S   ", "S14.3", lambda s: [_comparator(s).rotation]),
    Column("Left-handed", "A11", lambda s: ["L" if _comparator(s).left_handed else ""]),
    Column("Sigma of\none reading", "F11.5", lambda s: [_comparator(s).reading_sigma]),
    Column("Limit of\nrepeated ones", "F13.5", lambda s: [_comparator(s).repeat_limit]),
)
LENSES: Columns = (
    camera_column(lambda s: s.read.lenses.camera),
    *vector(("Best symmetry x\nmm", "y\nmm"), ("F15.5", "F10.5"), lambda s: s.read.lenses.centre),
    Column("K0", "E17.9", lambda s: s.read.lenses.k0),
)
MARK_DISTANCES: Columns = (
    camera_column(lambda s: s.read.mark_distances.camera),
    Column("Mark", "A4", lambda s: s.read.mark_distances.marks[:, 0]),
    Column("Mark", "A4", lambda s: s.read.mark_distances.marks[:, 1]),
    Column("Distance\nmm", "F11.5", lambda s: s.read.mark_distances.distance),
    Column("Sigma\num", "F7.2", lambda s: s.read.mark_distances.sigma / MICROMETRE),
    Column("Axis", "A4", lambda s: s.read.mark_distances.axis),
)
RESEAU: Columns = (
    camera_column(lambda s: s.read.reseau.camera),
    Column("Cross", "A8", lambda s: s.read.reseau.ids),
    Column("Row", "I3", lambda s: s.read.reseau.row),
    Column("Column", "I3", lambda s: s.read.reseau.column),
    *vector(_XY, ("F11.5", "F11.5"), lambda s: s.read.reseau.xy),
)
TIDES: Columns = (
    Column("Photo", "A8", lambda s: s.block.photos.ids),
    Column("Tide\nm", "F10.4", lambda s: _block(s).photos.tide),
    Column("Sigma\nm", "F8.4", lambda s: s.block.photos.tide_sigma),
)
TIMES: Columns = (Column("Time\ns", "F10.3", lambda s: s.block.photos.time),)
TIDE_LABELS: Columns = (
    Column("Group", "A8", lambda s: s.block.photos.tide_group),
    Column("Day", "A8", lambda s: s.block.photos.tide_day),
)
WAVES: Columns = (
    Column("Wave", "A4", lambda s: s.block.waves.ids),
    Column("Shape", "A5", lambda s: s.block.waves.shape),
    Column("Period\ns", "F8.3", lambda s: s.block.waves.period),
    Column("Depth\nm", "F8.2", lambda s: s.block.waves.depth),
    Column("Length\nm", "F9.3", lambda s: s.block.waves.length),
    Column("Speed\nm/s", "F8.3", lambda s: s.block.waves.speed),
    Column("Height\nm", "F8.3", lambda s: s.block.waves.height),
    Column("Towards\ndegrees", "F9.3", lambda s: s.block.waves.azimuth / DEGREE),
    Column("Crest\nm", "F10.3", lambda s: s.block.waves.crest),
)
WAVE_SIGMAS: Columns = (
    WAVES[0],
    Column("Length\nm", "F9.3", lambda s: s.block.waves.length_sigma),
    Column("Height\nm", "F8.3", lambda s: s.block.waves.height_sigma),
    Column("Towards\ndegrees", "F9.3", lambda s: s.block.waves.azimuth_sigma / DEGREE),
    Column("Crest\nm", "F10.3", lambda s: s.block.waves.crest_sigma),
)
FIDUCIAL_MEASUREMENTS: Columns = (
    Column("Photo", "A8", lambda s: s.read.photos.ids[s.read.fiducial_measurements.photo]),
    Column("Mark", "A4", lambda s: s.read.fiducial_measurements.ids),
    *vector(_XY, ("F12.7", "F12.7"), lambda s: s.read.fiducial_measurements.xy),
    *vector(_SIGMA_XY, ("F7.2", "F7.2"), lambda s: s.read.fiducial_measurements.sigma, unit=MICROMETRE),
)
FIDUCIAL_READINGS: Columns = (
    *FIDUCIAL_MEASUREMENTS[:2],
    *vector(_UV, ("F15.7", "F15.7"), lambda s: s.read.fiducial_measurements.xy),
    *vector(_SIGMA_UV, ("F11.5", "F11.5"), lambda s: s.read.fiducial_measurements.sigma),
)
PLATES: Columns = (
    photo_column(lambda s: s.block.plates.photo),
    point_column(lambda s: s.block.plates.point),
    *vector(_XY, ("F12.7", "F12.7"), lambda s: s.block.plates.xy),
    *vector(_SIGMA_XY, ("F7.2", "F7.2"), lambda s: s.plate_sigmas, unit=MICROMETRE),
    Column("Bath", "A4", lambda s: np.where(s.submerged_plates, "B", "")),
    Column("Trig", "A4", lambda s: np.where(s.block.plates.triangulated, "", "N")),
)
EQUAL_ELEVATIONS: Columns = (
    Column("Group", "A8", lambda s: _groups(s).ids[_groups(s).group]),
    Column("Sigma\nm", "F8.4", lambda s: _groups(s).sigma[_groups(s).group]),
    point_column(lambda s: s.block.equal_elevations.point),
)
AIR_BASES: Columns = (
    photo_column(lambda s: s.block.air_bases.photo[:, 0]),
    photo_column(lambda s: s.block.air_bases.photo[:, 1]),
    Column("Length\nm", "F12.4", lambda s: s.block.air_bases.length),
    Column("Sigma\nm", "F8.4", lambda s: s.block.air_bases.sigma),
)
DISTANCES: Columns = (
    point_column(lambda s: s.block.distances.point[:, 0]),
    point_column(lambda s: s.block.distances.point[:, 1]),
    Column("Length\nm", "F12.4", lambda s: s.block.distances.length),
    Column("Sigma\nm", "F8.4", lambda s: s.block.distances.sigma),
)
HEIGHT_DIFFERENCES: Columns = (
    point_column(lambda s: s.block.height_differences.point[:, 0]),
    point_column(lambda s: s.block.height_differences.point[:, 1]),
    Column("Difference\nm", "F12.4", lambda s: s.block.height_differences.difference),
    Column("Sigma\nm", "F8.4", lambda s: s.block.height_differences.sigma),
)


def _wide(statistics: Statistics) -> bool:
    """Tell whether readings need more room than millimetres do: those of a comparator in micrometres."""
    read = statistics.read
    tables = (read.plates, read.fiducial_measurements, read.cross_measurements)
    return any(bool((np.abs(table.xy) >= 1000.0).any()) for table in tables)


def _cross_measurements(wide: bool) -> Columns:
    edit = "F15.7" if wide else "F12.7"
    return (
        Column("Photo", "A8", lambda s: s.read.photos.ids[s.read.cross_measurements.photo]),
        Column("Cross", "A8", lambda s: s.read.cross_measurements.ids),
        *vector(_UV, (edit, edit), lambda s: s.read.cross_measurements.xy),
    )


def _readings(wide: bool) -> Columns:
    edit, sigma = ("F15.7", "F11.5") if wide else ("F12.7", "F7.5")
    return (
        Column("Photo", "A8", lambda s: s.read.photos.ids[s.read.plates.photo]),
        Column("Point", "A8", lambda s: s.read.points.ids[s.read.plates.point]),
        *vector(_UV, (edit, edit), lambda s: s.read.plates.xy),
        *vector(_SIGMA_UV, (sigma, sigma), lambda s: s.read.plates.sigma),
    )


def _comparator(statistics: Statistics) -> ComparatorSpec:
    return statistics.read.comparator or ComparatorSpec()


def sections(statistics: Statistics) -> list[Section]:
    """Return the echo of every table of the block that has rows."""
    block = statistics.block
    tides = np.isnan(block.photos.tide).all() and np.isnan(block.photos.tide_sigma).all()
    labels = any("".join(column) for column in (block.photos.tide_group, block.photos.tide_day))
    timed = bool(np.isfinite(block.photos.time).any())
    raw, compared = statistics.solution.reduced is not None, statistics.read.comparator is not None
    wide = raw and _wide(statistics)
    tables: Sequence[tuple[str, Columns, bool]] = (
        ("Cameras", CAMERAS, True),
        ("Comparator", COMPARATOR, compared),
        ("Distortion", DISTORTION, True),
        ("Principal Points Of Best Symmetry", LENSES, True),
        ("Calibrated Fiducial Marks", FIDUCIALS, True),
        ("Distances Between Fiducial Marks", MARK_DISTANCES, True),
        ("Calibrated Reseau", RESEAU, True),
        ("Exposure Stations, Initial Positions", _positions(statistics), True),
        ("Exposure Stations, Given Attitudes", _attitudes(statistics), True),
        ("Tides", TIDES + (TIDE_LABELS if labels else ()) + (TIMES if timed else ()), not tides),
        ("Waves", WAVES, True),
        ("Sigmas Of Waves", WAVE_SIGMAS, bool(block.waves.unknown.any())),
        ("Origin Of The Waves", _origin(statistics), block.wave_origin is not None),
        ("Control", _control(statistics), True),
        ("Equal Elevations", EQUAL_ELEVATIONS, True),
        ("Air Bases", AIR_BASES, True),
        ("Distances", DISTANCES, True),
        ("Height Differences", HEIGHT_DIFFERENCES, True),
        ("Fiducial Measurements", FIDUCIAL_READINGS if wide else FIDUCIAL_MEASUREMENTS, True),
        ("Reseau Measurements", _cross_measurements(wide), True),
        ("Plate Readings", _readings(wide), raw),
        ("Plate Measurements, Refined" if raw else "Plate Measurements", PLATES, True),
    )
    echoed: list[Section] = []
    for title, columns, wanted in tables:
        table = Table(columns)
        lines = table.lines(statistics) if wanted else []
        if lines:
            echoed.append(Section(title=f"Input: {title}", head=table.head(), lines=lines, new_page=not echoed))
    return echoed


def _block(statistics: Statistics) -> Block:
    """Return the block as the deck states it."""
    return statistics.block if statistics.given is None else statistics.given.block


def _places(statistics: Statistics, positions: Values, sigmas: Values) -> Columns:
    """Return the columns of coordinates and sigmas in the words of the deck."""
    words = statistics.given_words
    if words is not None:
        return (*place_columns(words, positions, 4), *place_sigma_columns(words, sigmas))
    block = statistics.block
    return (*position_columns(block, positions, 4), *metric_columns(block, sigmas, sigma=True))


def _positions(statistics: Statistics) -> Columns:
    return (
        Column("Photo", "A8", lambda s: s.block.photos.ids),
        camera_column(lambda s: s.block.photos.camera),
        *_places(statistics, lambda s: _block(s).photos.position, lambda s: _block(s).photos.position_sigma),
    )


def _origin(statistics: Statistics) -> Columns:
    def place(source: Statistics) -> FloatArray:
        origin = _block(source).wave_origin
        return np.array([] if origin is None else [origin.position]).reshape(-1, 3)

    words = statistics.given_words
    return position_columns(statistics.block, place, 4) if words is None else place_columns(words, place, 4)


def _attitudes(statistics: Statistics) -> Columns:
    words = statistics.given_words
    if words is not None:
        return turn_columns(
            words,
            lambda s: _block(s).photos.attitude,
            _given_matrices,
            lambda s: _block(s).photos.attitude_sigma,
        )
    return (
        Column("Photo", "A8", lambda s: s.block.photos.ids),
        *attitude_columns(lambda s: s.block.photos.attitude, 4),
        *attitude_sigma_columns(lambda s: s.block.photos.attitude_sigma),
    )


def _given_matrices(statistics: Statistics) -> FloatArray:
    none = np.full((len(statistics.block.photos.ids), 3, 3), np.nan)
    given = statistics.given
    return none if given is None or given.matrices is None else given.matrices


def _control(statistics: Statistics) -> Columns:
    return (
        point_column(lambda s: s.block.control.point),
        Column("Kind", "A10", lambda s: [CONTROL_KINDS[ControlKind(kind)] for kind in s.block.control.kind]),
        Column("Fixed", "A5", lambda s: np.where(s.block.control.fixed, "X", "")),
        Column("Bath", "A4", lambda s: np.where(_bathymetric_control(s), "B", "")),
        *_places(statistics, lambda s: _block(s).control.position, lambda s: _block(s).control.sigma),
    )


def _bathymetric_control(statistics: Statistics) -> BoolArray:
    block = statistics.block
    return block.points.bathymetric[block.control.point]


def _groups(statistics: Statistics) -> EqualElevations:
    return statistics.block.equal_elevations
