"""The table of the study of waves as unknowns in docs is what the study computes."""

from __future__ import annotations

import pytest

from drivers import unknown_waves_study as study
from studies.strip import Strip
from studies.unknown_waves import Guess, cells


def test_every_cell_stands_in_the_table() -> None:
    rows = study.printed()
    assert list(rows) == [(cell.varied, float(cell.value)) for cell in cells(Strip(), Guess())]
    assert {len(row) for row in rows.values()} == {len(study.row(*study.made_up()[0])) - 2}


@pytest.mark.slow
def test_a_cell_of_the_table_is_what_the_study_computes() -> None:
    cell = next(one for one in cells(Strip(), Guess()) if one.varied == "guess" and one.value == 0.3)
    # other kernels of linear algebra may move the last printed digit, not more
    row = study.row(cell, study.result(cell))[2:8]
    for got, want in zip(row, study.printed()["guess", 0.3][:6], strict=True):
        assert float(got) == pytest.approx(float(want), abs=1.1e-3)
