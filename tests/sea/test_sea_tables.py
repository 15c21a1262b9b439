"""The table of the study of docs/waves_from_stereo.md is what the study computes."""

from __future__ import annotations

import numpy as np

from drivers import sea_tables
from studies.stereo import Setup, run


def rows() -> list[list[str]]:
    return [line.split(",") for line in sea_tables.TABLE.read_text(encoding="utf-8").splitlines()]


def test_a_line_of_the_study_stands_in_docs() -> None:
    outcome = run(Setup(surface_points=100, **sea_tables.SEAS["swell of 92 m"]), sea_tables.SEEDS)
    computed = np.array(sea_tables.row("points", "swell of 92 m", 100, outcome).split(",")[2:], dtype=float)
    swell, chop, _ = (np.array(row[2:], dtype=float) for row in rows() if row[0] == "points" and row[2] == "100")
    # the last digit, where another machine rounds otherwise; honesty and cover have two decimals
    np.testing.assert_allclose(computed, swell, atol=0.011)
    assert not np.allclose(computed, chop, atol=0.011)


def test_the_table_is_whole() -> None:
    head, *body = rows()
    assert head == sea_tables.HEAD.split(",") and {len(row) for row in body} == {len(head)}
    series = {"noise": sea_tables.NOISE, "period": sea_tables.PERIODS, "points to L": sea_tables.POINTS_PER_LENGTH}
    keys = [("points", f"{count:g}") for _ in sea_tables.SEAS for count in sea_tables.COUNTS]
    keys += [(varied, f"{value:g}") for varied, values in series.items() for value in values]
    assert [(row[0], row[2]) for row in body] == keys
