"""The study of waves as unknowns: its picture is drawn, and its table in docs is what it computes."""

from __future__ import annotations

import io

import numpy as np
import pytest

import unknown_waves_study as study

pytest.importorskip("matplotlib")

from matplotlib import image

from studies.pictures import unknown_waves
from studies.strip import Strip
from studies.unknown_waves import Guess, cells


@pytest.mark.slow
def test_the_picture_is_drawn_and_stands_in_docs() -> None:
    drawn = unknown_waves(study.made_up())
    assert drawn == unknown_waves(study.made_up())
    pixels = image.imread(io.BytesIO(drawn), format="png")
    assert len(np.unique(pixels[..., :3].sum(axis=2))) > 20  # not an empty sheet
    # another version of matplotlib sets letters elsewhere, but the sheet has its size
    assert image.imread(study.PICTURE).shape == pixels.shape


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
