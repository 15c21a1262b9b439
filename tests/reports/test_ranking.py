"""Rounding errors order no table: rows whose numbers print alike stand in their own order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from musatpy.model import ObservationKind
from musatpy.model.ranking import falling, largest
from musatpy.reports.statistical_tests import OBSERVATIONS
from musatpy.statistics import Statistics
from sample_solutions import sample_solution

ROUNDING = 1e-13


@pytest.mark.parametrize("decimals", [None, 2])
@pytest.mark.parametrize("error", [-ROUNDING, 0.0, ROUNDING])
def test_rows_that_print_alike_keep_their_order(decimals: int | None, error: float) -> None:
    size = np.array([1.0, 3.55, 4.0, 3.55 + error, np.nan, np.inf, 0.0])
    assert falling(size, decimals).tolist() == [5, 2, 1, 3, 0, 6, 4]
    assert largest([0.5, 3.55, 3.55 + error, 1.0]) == 1


def test_what_prints_as_something_else_is_ordered() -> None:
    assert falling([3.54, 3.56, 3.55], 2).tolist() == [1, 2, 0]
    assert falling([3.541, 3.544, 3.542], 2).tolist() == [0, 1, 2]
    assert falling([1.23456e-9, 1.23457e-9, -1e9]).tolist() == [1, 0, 2]  # of any size


def test_as_many_rows_as_there_are() -> None:
    assert falling([]).tolist() == []


@pytest.mark.parametrize("error", [-ROUNDING, ROUNDING])
def test_the_worst_observations_stand_in_the_same_order_with_other_rounding_errors(error: float) -> None:
    """Two images of the same residual, redundancy and sigma: which comes first must not depend on the kernels."""
    solution = sample_solution()
    observed = solution.observed
    assert observed is not None
    first, second = np.flatnonzero((observed.kind == ObservationKind.PLATE) & (observed.redundancy > 0.1))[:2]
    columns = {name: getattr(observed, name).copy() for name in ("residual", "redundancy", "sigma")}
    for column in columns.values():
        column[second] = column[first]
    orders = []
    for factor in (1.0, 1.0 + error):
        columns["residual"][second] = columns["residual"][first] * factor
        statistics = Statistics(replace(solution, observed=replace(observed, **columns)))
        rows = OBSERVATIONS.rows
        assert rows is not None
        orders.append(rows(statistics).tolist())
    assert orders[0] == orders[1]
    assert orders[0].index(first) < orders[0].index(second)
