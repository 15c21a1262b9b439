"""Which tables of the listing the page of a run has, chapter by chapter, and which of their rows come first."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from musatpy.page.stated import Shown
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
    solution_summary,
    stations,
    statistical_tests,
    titles,
    waves_page,
)
from musatpy.reports.table import Report
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
FINDINGS: Report[Any] = Report(
    title=answer.BLUNDERS.title,
    table=quality_record.FINDINGS,
    worst=lambda t: np.abs(t["test"]),
    columns=(*answer.BLUNDERS.columns, "note"),
)
TIDES = (Shown(report=echo.card("TID"), listed=PHOTOS),)
LEFT_OUT = (
    Shown(report=ground_points.NO_PART, folded=False),
    Shown(report=FINDINGS, folded=False),
)
CONTROL = (
    Shown(
        report=control.RESIDUALS,
        listed=_CONTROL,
        folded=False,
        note=control.NOTE,
    ),
    Shown(report=control.DIFFERENCES, listed=_CONTROL, folded=False),
    Shown(report=statistical_tests.CHECKS, listed=_CONTROL),
)
ACCURACY = (
    Shown(
        report=bathymetric.DEPTHS,
        note="No refr.: where straight rays of the adjusted stations meet; predicted: that times the index.",
    ),
    Shown(report=solution_summary.PLATE_RESIDUALS, folded=False),
    Shown(
        report=statistical_tests.COMPONENTS,
        folded=False,
        note="The factor of a group is v'Pv over its redundancy, 1 where its sigmas are right; limits of 95 %.",
    ),
)
CAMERA = (
    Shown(report=echo.card("CAM"), folded=False),
    *(Shown(report=report) for report in map(echo.card, ("DST", "LNS", "FID", "FDS"))),
)
WATER = (
    Shown(report=flags.TABLE, folded=False),
    Shown(report=adjusted_water.CORRECTIONS, listed=PHOTOS),
    Shown(report=adjusted_water.CONSIDERED, folded=False),
    Shown(report=waves_page.SEA),
    Shown(report=adjusted_water.WAVES, folded=False),
    Shown(
        report=adjusted_water.PARAMETERS_OF_WAVES,
        heads={"": "Determined"},
    ),
    Shown(report=adjusted_water.CORRELATIONS, listed=_FEW),
    Shown(report=statistical_tests.WATER, folded=False),
    Shown(report=statistical_tests.CORRELATIONS, listed=2 * _FEW),
)
OBSERVATIONS = (
    Shown(
        report=statistical_tests.OBSERVATIONS,
        listed=_FEW,
        folded=False,
        note=f"* beyond {TEST_LIMIT:.2f}. The smallest detectable error is found with a probability of 0.80; its "
        "effect is on the own position.",
        heads={"": "Beyond"},
    ),
    Shown(
        report=statistical_tests.HIDDEN_ERRORS,
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
    Shown(report=stations.POSITIONS, listed=PHOTOS),
    Shown(report=stations.ATTITUDES, listed=PHOTOS),
    Shown(report=ground_points.GROUND_POINTS),
    Shown(report=plate_rms.BY_PHOTO, listed=PHOTOS),
    Shown(report=statistical_tests.STATION_ELLIPSES, listed=PHOTOS),
    Shown(report=statistical_tests.POINT_ELLIPSES, listed=_FEW),
    Shown(report=statistical_tests.STATION_INFLATION, listed=PHOTOS),
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
