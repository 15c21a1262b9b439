"""The tables of docs/waves_from_stereo.md are what the study computes."""

from __future__ import annotations

import re

import numpy as np

import sea_tables
from studies.stereo import Setup, run


def numbers(line: str) -> np.ndarray:
    return np.array([float(text) for text in re.findall(r"[\d.]+", line)])


def test_a_line_of_the_study_stands_in_the_manual() -> None:
    page = sea_tables.PAGE.read_text(encoding="utf-8")
    outcome = run(Setup(surface_points=100, **sea_tables.SEAS["swell of 92 m"]), sea_tables.SEEDS)
    computed = numbers(sea_tables.row("100", outcome))
    printed = [numbers(line) for line in page.splitlines() if line.startswith("| 100 |")]
    assert len(printed) == len(sea_tables.SEAS)
    # the last digit, where another machine rounds otherwise; honesty and cover have two decimals
    np.testing.assert_allclose(computed, printed[0], atol=0.011)
    assert not np.allclose(computed, printed[1], atol=0.011)


def test_all_tables_are_there() -> None:
    page = sea_tables.PAGE.read_text(encoding="utf-8")
    before, _, rest = page.partition(sea_tables.BEGIN)
    body = rest.partition(sea_tables.END)[0]
    lines = len(sea_tables.SEAS) * len(sea_tables.COUNTS) + len(sea_tables.NOISE) + len(sea_tables.PERIODS)
    lines += len(sea_tables.POINTS_PER_LENGTH)
    heads = len(sea_tables.SEAS) + 3
    assert body.count("\n| ") == lines + heads
    assert sea_tables.with_tables(page, body.strip()) == page
    assert before.startswith("# Waves from simultaneous stereo")
