"""Which tables of the listing the page of a run has, chapter by chapter, and which of their rows come first."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model import ObservationKind
from musatpy.page.accuracy import control_badness
from musatpy.page.stated import Row, Shown
from musatpy.plots.tables import numbers
from musatpy.reports import (
    adjusted_water,
    answer,
    bathymetric,
    common_errors,
    constraints,
    control,
    echo,
    flags,
    ground_points,
    iterations,
    plate_rms,
    quality_record,
    reduction,
    result_record,
    solution_summary,
    stations,
    statistical_tests,
    titles,
    waves_page,
)
from musatpy.reports.table import Column, Report, key
from musatpy.statistics.quality import TEST_LIMIT

Columns = Mapping[str, Any]  # of a table: field -> values
PHOTOS = 250  # rows of tables of photos
_CONTROL = 500
_FEW = 20
OPTION_WORDS: Mapping[str, Mapping[Any, str]] = {
    "system": titles.SYSTEMS,
    "initial": titles.INITIAL,
    "refraction": titles.REFRACTION,
    "weights": titles.WEIGHTS,
    "water_level": titles.WATER_LEVEL,
    "editing": titles.EDITING,
}
_UNITS = {kind.name.lower(): kind.unit for kind in ObservationKind}


def _unit(row: Row) -> str:
    return _UNITS.get(str(row["kind"]), "")


def _star(row: Row) -> str:
    return "*" if abs(row.get("test") or 0.0) > TEST_LIMIT else ""


def _factor_test(row: Row) -> str:
    if row["accepted"] or row["factor"] is None:
        return ""
    return "too low" if row["factor"] < row["low"] else "TOO HIGH"


def _fails(row: Row) -> str:
    return "*" if any(abs(test or 0.0) > TEST_LIMIT for test in row.get("test", ())) else ""


def by_size(name: str, *shape: int) -> Callable[[Columns], FloatArray]:
    """Return the badness of rows by the size of a field, the length where it is a vector."""

    def badness(table: Columns) -> FloatArray:
        values = np.abs(numbers(table, name, *shape))
        return np.asarray(values if not shape else np.linalg.norm(values, axis=1))

    return badness


def _by_rms(table: Columns) -> FloatArray:
    return np.linalg.norm(np.nan_to_num(numbers(table, "rms", 3, 2))[:, 2], axis=1)


def _by_shift(table: Columns) -> FloatArray:
    sigmas = numbers(table, "sigmas")
    return np.where(np.isnan(sigmas), np.inf, sigmas)


def _by_probability(table: Columns) -> FloatArray:
    return -numbers(table, "probability")


def _by_inflation(table: Columns) -> FloatArray:
    return np.nan_to_num(numbers(table, "inflation", 6)).max(axis=1, initial=0.0)


def _waves_units(row: Row) -> str:
    return str(adjusted_water.PARAMETERS_OF_WAVES.words["parameter"].get(row["parameter"], row["parameter"]))


NO_PART: Report[Any] = Report(
    title=ground_points.NO_PART.title,
    table=result_record.POINTS,
    take=ground_points.NO_PART.take,
    words=ground_points.NO_PART.words,
    columns=(
        key("Point", "A8", "point"),
        Column("Status", "A14", shows="status"),
        Column("Reason", "A80", shows="reason"),
    ),
)
FINDINGS: Report[Any] = Report(
    title=answer.BLUNDERS.title,
    table=quality_record.FINDINGS,
    columns=(*answer.BLUNDERS.columns, Column("Note", "A80", shows="note")),
)
TIDES = (Shown(report=echo.TIDES, listed=PHOTOS),)
LEFT_OUT = (
    Shown(report=NO_PART, folded=False),
    Shown(report=FINDINGS, badness=by_size("test"), folded=False),
)
CONTROL = (
    Shown(
        report=control.RESIDUALS,
        badness=control_badness,
        listed=_CONTROL,
        folded=False,
        note=control.NOTE,
        values={"Fails": _fails},
    ),
    Shown(report=control.DIFFERENCES, badness=control_badness, listed=_CONTROL, folded=False),
    Shown(report=statistical_tests.CHECKS, badness=_by_probability, listed=_CONTROL),
)
ACCURACY = (
    Shown(
        report=bathymetric.DEPTHS,
        badness=by_size("depth_sigma"),
        note="No refr.: where straight rays of the adjusted stations meet; predicted: that times the index.",
    ),
    Shown(report=solution_summary.PLATE_RESIDUALS, folded=False),
    Shown(
        report=statistical_tests.COMPONENTS,
        folded=False,
        note="The factor of a group is v'Pv over its redundancy, 1 where its sigmas are right; limits of 95 %.",
        values={"Test": _factor_test},
    ),
)
CAMERA = (
    Shown(report=echo.CAMERAS, folded=False),
    *(Shown(report=report) for report in (echo.DISTORTION, echo.LENSES, echo.FIDUCIALS, echo.MARK_DISTANCES)),
)
WATER = (
    Shown(report=flags.TABLE, folded=False),
    Shown(report=adjusted_water.CORRECTIONS, listed=PHOTOS, badness=by_size("correction")),
    Shown(report=adjusted_water.CONSIDERED, folded=False),
    Shown(report=waves_page.SEA),
    Shown(report=adjusted_water.WAVES, folded=False),
    Shown(
        report=adjusted_water.PARAMETERS_OF_WAVES,
        heads={"": "Determined"},
        values={"Parameter": _waves_units},
    ),
    Shown(report=adjusted_water.CORRELATIONS, badness=by_size("correlation"), listed=_FEW),
    Shown(report=statistical_tests.WATER, badness=by_size("inflation"), folded=False),
    Shown(report=statistical_tests.CORRELATIONS, badness=by_size("correlation"), listed=2 * _FEW),
)
OBSERVATIONS = (
    Shown(
        report=statistical_tests.OBSERVATIONS,
        badness=by_size("test"),
        listed=_FEW,
        folded=False,
        note=f"* beyond {TEST_LIMIT:.2f}. The smallest detectable error is found with a probability of 0.80; its "
        "effect is on the own position.",
        heads={"": "Beyond"},
        values={"Unit": _unit, "": _star},
    ),
    Shown(
        report=statistical_tests.HIDDEN_ERRORS,
        badness=_by_shift,
        listed=_FEW,
        heads={"": "Limit"},
        note="By an error of one image or control component which its own test does not find.",
    ),
    Shown(
        report=common_errors.TESTS,
        folded=False,
        heads={"": "Test"},
        note="Movements are those by the reference error; no test: residuals show no error that may be.",
    ),
    Shown(report=common_errors.HIDDEN),
)
RESULTS = (
    Shown(report=stations.POSITIONS, badness=by_size("position_sigma", 3), listed=PHOTOS),
    Shown(report=stations.ATTITUDES, badness=by_size("attitude_sigma", 3), listed=PHOTOS),
    Shown(report=ground_points.GROUND_POINTS, badness=by_size("sigma", 3)),
    Shown(report=plate_rms.BY_PHOTO, badness=_by_rms, listed=PHOTOS),
    Shown(report=statistical_tests.STATION_ELLIPSES, badness=by_size("position_sigma", 3), listed=PHOTOS),
    Shown(report=statistical_tests.POINT_ELLIPSES, badness=by_size("sigma", 3), listed=_FEW),
    Shown(report=statistical_tests.STATION_INFLATION, badness=_by_inflation, listed=PHOTOS),
    *(Shown(report=report, listed=PHOTOS) for report in constraints.STATED),
)
COMPUTED = (
    Shown(report=iterations.ITERATIONS),
    Shown(report=iterations.PASSES),
    Shown(report=reduction.PLATES, listed=PHOTOS),
    Shown(report=reduction.MARKS),
    Shown(report=reduction.DISTANCES),
    Shown(report=reduction.SPREADS),
)
