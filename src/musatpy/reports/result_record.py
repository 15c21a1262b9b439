"""The tables of the record that say what came of a run: solution, stations, points, control, what was measured."""

from __future__ import annotations

from musatpy.arrays import TextArray
from musatpy.model import (
    ControlKind,
    Iteration,
    LevelPairs,
    ObservationKind,
    Solution,
    StationPairs,
    WaterPass,
    WaterPrecision,
)
from musatpy.reports.encoding import names, plain
from musatpy.reports.fields import ENU, POSITION_UNIT, Each, Field, Group, Rows, same
from musatpy.reports.headings import along_axes
from musatpy.reports.table import unless_zero
from musatpy.statistics import PLATE_KINDS, Analysis, DifferenceStatistics, Statistics
from musatpy.units import ARC_SECOND

Table = Rows[Statistics, Statistics]

_K = ObservationKind


def _solution(statistics: Statistics) -> Solution:
    return statistics.solution


SOLUTION = Group[Statistics, Solution](
    "solution",
    "the result in short",
    _solution,
    (
        Field("converged", "boolean", "whether the limits were reached"),
        Field("reason", "string", "why not converged; empty when converged"),
        Field("warnings", "* string", "ill-determined unknowns and the like"),
        Field("sigma0", "number?", "standard deviation of unit weight, a posteriori"),
        Field("unit_sigma", "number?",
              "the same without what the errors of known water explain: it is tested, and scales the covariances"),
        Field("degrees_of_freedom", "integer", "observations minus unknowns"),
        Field("sum_of_squares", "number?", "weighted, of all residuals"),
        Field("observations", "map", "kind of observation -> number", lambda s: _counts(s.observations)),
        Field("unknowns", "map", "kind of unknown -> number", lambda s: _counts(s.unknowns)),
    ),
)  # fmt: skip


def _counts(counts: dict[str, int]) -> dict[str, int]:
    return {kind: int(count) for kind, count in counts.items()}


def _iterations(statistics: Statistics) -> list[tuple[Iteration, str, str]]:
    """Return the iterations with the photos of their largest rotation and translation."""
    ids = statistics.block.photos.ids
    return [(i, str(ids[i.rotation_photo]), str(ids[i.translation_photo])) for i in statistics.solution.iterations]


ITERATIONS = Each[Statistics, tuple[Iteration, str, str]](
    "iterations",
    "one row per iteration",
    _iterations,
    (
        Field("pass", "integer", "0 the first triangulation, 1.. the passes with refraction",
              lambda i: i[0].outer_pass, heading="Pass", edit="I4", is_id=True),
        Field("number", "integer", "iteration within the pass", lambda i: i[0].number, heading="Iteration",
              edit="I9", is_id=True),
        Field("rotation", "number?", "largest differential rotation", lambda i: i[0].rotation, "rad",
              heading="Largest rotation\narc sec", edit="F14.4"),
        Field("rotation_photo", "string", "its photo", lambda i: i[1], heading="Photo", edit="A8",
              shown=lambda t: unless_zero(t["rotation_photo"], "F14.4", t["rotation"] / ARC_SECOND)),
        Field("translation", "number?", "largest differential translation", lambda i: i[0].translation, "m",
              heading="Largest translation\nm", edit="F14.5"),
        Field("translation_photo", "string", "its photo", lambda i: i[2], heading="Photo", edit="A8",
              shown=lambda t: unless_zero(t["translation_photo"], "F14.5", t["translation"])),
        Field("sum_of_squares", "number?", "weighted, after the step", lambda i: i[0].sum_of_squares,
              heading="Sum of squares", edit="F16.2"),
        Field("damping", "number?", "of the step control, 0 for a full step", lambda i: i[0].damping,
              heading="Damping", edit="E10.2"),
    ),
)  # fmt: skip


def _passes(statistics: Statistics) -> list[tuple[WaterPass, str]]:
    """Return the passes with the points of their largest movements."""
    return [(p, str(statistics.block.points.ids[p.point])) for p in statistics.solution.passes]


PASSES = Each[Statistics, tuple[WaterPass, str]](
    "water_passes",
    "one row per pass of the water point correction",
    _passes,
    (
        Field("number", "integer", "pass", lambda p: p[0].number, heading="Pass", edit="I4", is_id=True),
        Field("movement", "number?", "largest movement of a submerged point since the pass before",
              lambda p: p[0].movement, "m", heading="Largest movement\nm", edit="F14.5"),
        Field("point", "string", "its point", lambda p: p[1], heading="Point", edit="A8",
              shown=lambda t: unless_zero(t["point"], "F14.5", t["movement"])),
        Field("rms_movement", "number?", "of all submerged points", lambda p: p[0].rms_movement, "m",
              heading="RMS movement\nm", edit="F14.5"),
        Field("rms_residual", "number?", "of the plate residuals of submerged points", lambda p: p[0].rms_residual,
              "mm", heading="RMS residual of\nsubmerged points um", edit="F10.2"),
    ),
)  # fmt: skip

Component = tuple[str, str, DifferenceStatistics]
_OF_ROW = "the row's"
_DIFFERENCES: tuple[Field[Component], ...] = (
    Field("component", "string", "name of the component", lambda c: c[0], heading="Component", edit="A10",
          is_id=True),
    Field("unit", "string", "unit of the numbers of the row", lambda c: c[1], choices=("rad", "m"), heading="Unit",
          edit="A4"),
    Field("size", "integer", "sample size N", lambda c: c[2].size, heading="Sample Size", edit="I8"),
    Field("sum", "number", "sum of differences", lambda c: c[2].sum, _OF_ROW),
    Field("mean", "number?", "sum / N", lambda c: c[2].mean, _OF_ROW),
    Field("rms", "number?", "root of the sum of squares / N", lambda c: c[2].rms, _OF_ROW),
    Field("deviation", "number?", "standard deviation from the mean, N - 1", lambda c: c[2].deviation, _OF_ROW),
    Field("maximum", "number?", "signed difference of the largest magnitude", lambda c: c[2].maximum, _OF_ROW),
    Field("maximum_id", "string?", "photo or point of the maximum", lambda c: c[2].maximum_id or None),
)  # fmt: skip


def _components(analysis: Analysis) -> list[Component]:
    return list(zip(analysis.components, analysis.units, analysis.statistics, strict=True))


_ANALYSES: tuple[Each[Statistics, Component], ...] = (
    Each(
        "camera_station_position", "adjusted minus initial positions of stations",
        lambda s: _components(s.station_positions), _DIFFERENCES, shared="analysis", length=3,
    ),
    Each(
        "camera_station_attitude", "adjusted minus given attitudes of stations",
        lambda s: _components(s.station_attitudes), _DIFFERENCES, shared="analysis", length=3,
    ),
    Each(
        "ground_point", "adjusted minus given positions of control points, in the components that were known",
        lambda s: _components(s.ground_points), _DIFFERENCES, shared="analysis", length=3,
    ),
    Each(
        "check_point", "adjusted minus given positions of check points", lambda s: _components(s.check_points),
        _DIFFERENCES, shared="analysis", length=3,
    ),
)  # fmt: skip
ANALYSIS = _ANALYSES[0]
ANALYSES = Group[Statistics, Statistics](
    "analyses", "the standard analyses, one row per component", same, _ANALYSES
)

FRAMES = Table(
    "frames",
    "one row per photo",
    same,
    (
        Field("photo", "string", "photo id", lambda s: s.block.photos.ids, heading="Photo", edit="A8", is_id=True),
        Field("count", "3 integer", "points of each kind", lambda s: s.plates.count),
        Field("rms", "3x2 number?", "x and y of each kind", lambda s: s.plates.rms, "mm"),
    ),
)  # fmt: skip


def _largest(statistics: Statistics) -> list[str | None]:
    ids = statistics.block.photos.ids
    return [str(ids[photo]) if photo >= 0 else None for photo in statistics.plates.largest]


PLATE_STATISTICS = Group[Statistics, Statistics](
    "plate_statistics",
    "RMS plate residuals",
    same,
    (
        Field("kinds", "3 string", "order of the kinds in count, rms, largest and the totals",
              lambda s: PLATE_KINDS, heading="Points", edit="A16", is_id=True),
        FRAMES,
        Field("largest", "3 string?", "photo of the largest root of x^2 + y^2 of each kind", _largest),
        Field("total_count", "3 integer", "points of each kind in the job", lambda s: s.plates.total_count,
              heading="Number", edit="I8"),
        Field("total_rms", "3x2 number?", "x and y of each kind in the job", lambda s: s.plates.total_rms, "mm",
              heading=("RMS x\num", "RMS y\num"), edit="F10.2"),
    ),
)  # fmt: skip


def _pairs(statistics: Statistics) -> tuple[TextArray, StationPairs] | None:
    pairs = statistics.solution.pairs
    return None if pairs is None else (statistics.block.photos.ids, pairs)


PAIRS = Rows[Statistics, tuple[TextArray, StationPairs]](
    "station_pairs",
    "one row per pair of photos that share a point",
    _pairs,
    (
        Field("photos", "2 string", "photo ids", lambda p: p[0][p[1].photo]),
        Field(
            "covariance",
            "6x6 number?",
            "a posteriori, of east, north, up, X-tilt, Y-tilt, heading of the first with those of the second",
            lambda p: p[1].covariance,
            "m2, m rad, rad2",
        ),
    ),
)


def _level_pairs(statistics: Statistics) -> tuple[TextArray, LevelPairs] | None:
    pairs = statistics.solution.level_pairs
    return None if pairs is None else (statistics.block.photos.ids, pairs)


LEVEL_PAIRS = Rows[Statistics, tuple[TextArray, LevelPairs]](
    "level_pairs",
    "levels that photos have of their own as unknowns: one row per pair of photos that share a point, and of each "
    "alone; empty where there are none",
    _level_pairs,
    (
        Field("photos", "2 string", "photo ids", lambda p: p[0][p[1].photo]),
        Field("of_first", "6 number?",
              "a posteriori, of east, north, up, X-tilt, Y-tilt, heading of the first with the level of the second",
              lambda p: p[1].of_first, "m2, m rad"),
        Field("of_second", "6 number?", "of the first's level with those of the second", lambda p: p[1].of_second,
              "m2, m rad"),
        Field("level", "number?", "of both levels", lambda p: p[1].level, "m2"),
    ),
)  # fmt: skip
WATER_PRECISION = Rows[Statistics, WaterPrecision](
    "water_precision",
    "one row per quantity of the water that is adjusted or considered, but unknown levels of single photos",
    lambda s: s.solution.water_precision,
    (
        Field("quantity", "string", "level, tilt, index or parameter of a wave", lambda w: w.names),
        Field("covariance", "* number?", "a posteriori, with all of them in this order", unit="m, rad"),
        Field("stations", "* number?",
              "a posteriori, with east, north, up, X-tilt, Y-tilt, heading of each station, one after the other",
              lambda w: w.stations.reshape(-1, len(w.names)).T, "m, rad"),
        Field("levels", "* number?",
              "a posteriori, with the unknown level of each photo; empty where there are none",
              lambda w: w.levels.T, "m", exact=True),
    ),
)  # fmt: skip


CONTROL = Table(
    "control",
    "one row per control card",
    same,
    (
        Field("point", "string", "point id", lambda s: s.block.points.ids[s.block.control.point], heading="Point",
              edit="A8", is_id=True),
        Field("kind", "string", "components that are known", lambda s: names(ControlKind, s.block.control.kind),
              choices=("full", "horizontal", "vertical", "check"), heading="Kind", edit="A10", is_id=True),
        Field("fixed", "boolean", "held without error", lambda s: s.block.control.fixed, heading="Fixed", edit="A5",
              words={True: "X", False: ""}),
        Field("given_position", "3 number?", "of the deck, null where blank", lambda s: s.block.control.position,
              POSITION_UNIT),
        Field("given_sigma", "3 number?", f"of the deck, {ENU}", lambda s: s.block.control.sigma, "m",
              heading=along_axes("Sigma ")),
        Field("difference", "3 number?", f"adjusted minus given, {ENU}", lambda s: s.control_difference, "m",
              heading=along_axes()),
        Field("used", "3 boolean", "the component took part in the adjustment", lambda s: s.block.control.known),
        Field("adjusted_sigma", "3 number?", f"of the adjusted position, {ENU}",
              lambda s: s.point_sigmas[s.block.control.point], "m", heading=along_axes("Sigma ")),
        Field("test", "3 number?", f"test values of the components, {ENU}, as `normal_test` of the observations",
              lambda s: s.control_tests, heading=along_axes("Test\n", edit="F6.1", unit="")),
    ),
)  # fmt: skip


def _members(statistics: Statistics) -> list[list[str]]:
    """Return the points of each group of equal elevations."""
    groups = statistics.block.equal_elevations
    ids = statistics.block.points.ids[groups.point]
    return [ids[groups.group == group].tolist() for group in range(len(groups.ids))]


def _level_differences(statistics: Statistics) -> list[list[float | None]]:
    groups = statistics.block.equal_elevations
    return [plain(statistics.level_differences[groups.group == group]) for group in range(len(groups.ids))]


EQUAL_ELEVATIONS = Table(
    "equal_elevations",
    "one row per group",
    same,
    (
        Field("group", "string", "group id", lambda s: s.block.equal_elevations.ids, heading="Group", edit="A8",
              is_id=True),
        Field("given_sigma", "number", "of a point about the level", lambda s: s.block.equal_elevations.sigma, "m",
              heading="Sigma given\nm", edit="F9.4"),
        Field("level", "number?", "adjusted", lambda s: s.solution.levels, "m", heading="Level\nm", edit="F11.4"),
        Field("level_sigma", "number?", "a posteriori", lambda s: s.solution.level_sigmas, "m", heading="Sigma\nm",
              edit="F9.4"),
        Field("points", "* string", "point ids", _members, heading="Point", edit="A8", is_id=True),
        Field("difference", "* number?", "adjusted elevation of each point minus the level", _level_differences,
              "m", heading="Point minus level\nm", edit="F11.4"),
    ),
)  # fmt: skip


def _between(name: str, text: str, ends: str, what: str, kind: ObservationKind) -> Table:
    """Return what was measured between two photos or points: `what` of the table of the deck, and as adjusted."""
    end = ends.removesuffix("s")

    def ids(statistics: Statistics) -> TextArray:
        block = statistics.block
        return getattr(block, ends).ids[getattr(getattr(block, name), end)]

    return Table(
        name,
        text,
        same,
        (
            Field(ends, "2 string", f"{end} ids", ids, heading=(end.capitalize(),) * 2, edit="A8", is_id=True),
            Field(f"given_{what}", "number", "of the deck", lambda s: getattr(getattr(s.block, name), what), "m",
                  heading="Given\nm", edit="F13.4"),
            Field("given_sigma", "number", "of the deck", lambda s: getattr(s.block, name).sigma, "m",
                  heading="Sigma given\nm", edit="F9.4"),
            Field(what, "number?", "adjusted", lambda s: s.solution.measured[kind], "m", heading="Adjusted\nm",
                  edit="F13.4"),
        ),
    )  # fmt: skip


AIR_BASES = _between("air_bases", "one row per air base", "photos", "length", _K.AIR_BASE)
DISTANCES = _between("distances", "one row per measured distance", "points", "length", _K.DISTANCE)
HEIGHT_DIFFERENCES = _between(
    "height_differences", "one row per measured height difference, second point minus first", "points",
    "difference", _K.HEIGHT_DIFFERENCE,
)  # fmt: skip
PLATES = Table(
    "plates",
    "one row per plate measurement",
    same,
    (
        Field("photo", "string", "photo id", lambda s: s.block.photos.ids[s.block.plates.photo], heading="Photo",
              edit="A8", is_id=True),
        Field("point", "string", "point id", lambda s: s.block.points.ids[s.block.plates.point], heading="Point",
              edit="A8", is_id=True),
        Field("xy", "2 number", "measured", lambda s: s.block.plates.xy, "mm", exact=True,
              heading=("x\nmm", "y\nmm"), edit="F10.4"),
        Field("sigma", "2 number", "a priori", lambda s: s.block.plate_sigmas, "mm",
              heading=("Sigma x\num", "Sigma y\num"), edit="F8.2"),
        Field("triangulated", "boolean", "took part in the solution", lambda s: s.solution.plates.triangulated,
              heading="Trig", edit="A4", words={True: "", False: "N"}),
        Field("residual", "2 number?", "adjusted minus measured", lambda s: s.solution.plates.residual, "mm",
              heading=("Resid. x\num", "Resid. y\num"), edit="F9.2"),
        Field("refraction", "2 number?", "adjusted straight image minus adjusted refracted image; 0 on land",
              lambda s: s.solution.plates.correction, "mm", heading=("Refr. x\num", "Refr. y\num"), edit="F9.2",
              blank=True),
    ),
    of_images=True,
)  # fmt: skip
UNEDITED = Field[Statistics](
    "unedited", "string", "why EDIT has edited nothing; empty where it has, or was not asked to",
    lambda s: s.solution.unedited,
)  # fmt: skip
