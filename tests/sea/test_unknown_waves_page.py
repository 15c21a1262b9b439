"""The page on waves as unknowns: its table is that of the study."""

from __future__ import annotations

import pytest

import unknown_waves_study as study
from studies.strip import Strip
from studies.unknown_waves import Guess, cells


def test_every_cell_stands_on_the_page() -> None:
    rows = study.rows_of(study.PAGE.read_text())
    every = cells(Strip(), Guess())
    assert set(rows) == {(cell.varied, float(cell.value)) for cell in every}
    made = study.rows_of(study.with_table(study.PAGE.read_text(), study.made_up()))
    assert {len(row) for row in made.values()} == {len(row) for row in rows.values()}


@pytest.mark.slow
def test_a_cell_of_the_page_is_what_the_study_computes() -> None:
    cell = next(one for one in cells(Strip(), Guess()) if one.varied == "guess" and one.value == 0.3)
    (line,) = list(study.lines([(cell, study.result(cell))]))[2:]
    printed = study.rows_of(study.PAGE.read_text())["guess", 0.3]
    # other kernels of linear algebra may move the last printed digit, not more
    for got, want in zip([one.strip() for one in line.strip("|").split("|")][2:8], printed[:6], strict=True):
        assert float(got) == pytest.approx(float(want), abs=1.1e-3)
