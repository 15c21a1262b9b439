"""What the studies of seas rest on, and that their tables and pictures in docs are what they compute."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from drivers import collocation_tables, sea_tables
from drivers import okamoto_tables as tables
from drivers import unknown_waves_study as study
from musatpy.sea.interpolation.correlation import SignalKind
from musatpy.sea.interpolation.prediction import Collocation
from studies import okamoto
from studies.collocation import Case, Outcome, SeaState, isotropic, outcome, simulated
from studies.stereo import Setup, run
from studies.strip import Strip
from studies.unknown_waves import Guess, cells


@pytest.fixture(scope="module")
def outcomes() -> dict[Case, Outcome]:
    """Some cheap cases: a swell by few points, a confused sea by too few and by enough."""
    chosen = [
        Case(number=12),
        Case(number=25),
        Case(state=SeaState.CONFUSED, number=12),
        Case(state=SeaState.CONFUSED, number=100),
    ]
    return {case: outcome(case) for case in chosen}


@pytest.mark.slow
def test_a_swell_is_taken_out_by_few_points_and_other_seas_by_many(outcomes: dict[Case, Outcome]) -> None:
    swell, few, many = (
        outcomes[case]
        for case in (Case(number=25), *(Case(state=SeaState.CONFUSED, number=number) for number in (12, 100)))
    )
    assert swell.found.best.family == SignalKind.SWELL and swell.removed > 0.7
    assert 2.0 * few.spacing / few.wave_length > 2.0 and few.removed < 0.1
    assert 2.0 * many.spacing / many.wave_length < 1.1 and many.removed > 0.5
    assert many.removed_by_theory > many.removed > many.removed_by_gaussian


@pytest.mark.slow
def test_theory_is_what_comes_of_waves_from_all_directions() -> None:
    """Sums of forty plane waves of one length, without any mapping: errors are as large as theory says."""
    rng, data = np.random.default_rng(8), simulated(Case(number=40))
    length, size, noise = 92.0, 0.3, 0.05
    known = isotropic(data, length, size, noise)
    places, ratio = np.vstack([data.control.place, data.place]), []
    for _ in range(200):
        azimuth, phase = rng.uniform(0.0, 2.0 * np.pi, (2, 40))
        turn = 2.0 * np.pi / length * places @ np.stack([np.cos(azimuth), np.sin(azimuth)])
        field = size * np.sqrt(2.0 / 40.0) * np.cos(turn + phase).sum(axis=1)
        value = field[:40] + rng.normal(0.0, noise, 40)
        told = Collocation(replace(data.control, value=value), known.covariance).predict(data.place)
        ratio.append(np.mean((field[40:] - told.value) ** 2) / np.mean(told.sigma**2))
    # one field scatters by a quarter, two hundred by a fiftieth
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.08)


@pytest.mark.slow
def test_the_table_in_docs_shows_the_outcomes(outcomes: dict[Case, Outcome]) -> None:
    printed = collocation_tables.printed()
    for case, computed in outcomes.items():
        cells, now = (
            line.split(",")
            for line in (
                printed[collocation_tables.key("number", case)],
                collocation_tables.row("number", computed),
            )
        )
        assert cells[:5] == now[:5] and cells[-1] == now[-1]
        # an optimiser stops elsewhere on another machine: a hundredth of a metre, two parts in a hundred
        assert [float(cell) for cell in cells[5:10]] == pytest.approx([float(cell) for cell in now[5:10]], abs=0.01)
        assert [float(cell) for cell in cells[10:-1]] == pytest.approx(
            [float(cell) for cell in now[10:-1]], abs=2.0
        )


def rows() -> list[list[str]]:
    return [line.split(",") for line in sea_tables.TABLE.read_text(encoding="utf-8").splitlines()]


def test_a_line_of_the_study_stands_in_docs() -> None:
    outcome = run(Setup(surface_points=100, **sea_tables.SEAS["swell of 92 m"]), sea_tables.SEEDS)
    computed = np.array(sea_tables.row("points", "swell of 92 m", 100, outcome).split(",")[2:], dtype=float)
    swell, chop, _ = (np.array(row[2:], dtype=float) for row in rows() if row[0] == "points" and row[2] == "100")
    # the last digit, where another machine rounds otherwise; honesty and cover have two decimals
    np.testing.assert_allclose(computed, swell, atol=0.011)
    assert not np.allclose(computed, chop, atol=0.011)


@pytest.mark.slow
def test_a_cell_of_the_table_is_what_the_study_computes() -> None:
    cell = next(one for one in cells(Strip(), Guess()) if one.varied == "guess" and one.value == 0.3)
    # other kernels of linear algebra may move the last printed digit, not more
    row = study.row(cell, study.result(cell))[2:8]
    for got, want in zip(row, study.printed()["guess", 0.3][:6], strict=True):
        assert float(got) == pytest.approx(float(want), abs=1.1e-3)


printed_cells = cache(tables.cells)


def test_printed_and_computed_cells_agree_within_a_centimetre() -> None:
    """98 % are asked for; it is 98.9 % of maxima and sigmas, misprints counted as failures."""
    printed = printed_cells()
    assert len(printed) == 178
    assert sum(cell.maximum_agrees for cell in printed) == sum(cell.sigma_agrees for cell in printed) == 176
    off = {cell.key for cell in printed if not (cell.maximum_agrees and cell.sigma_agrees)}
    assert off - {*tables.MISPRINTED_NUMBER, *tables.MISPRINTED_SIGMA} == {(8, 500, 20, "B", "Z")}
    assert max(tables.largest_difference(printed)) < 0.02  # what the errata say of all but misprints
    assert sum(cell.largest > cell.printed_maximum + tables.WITHIN for cell in printed) == 14


def test_misprints_agree_once_they_are_corrected() -> None:
    error = tables.errors_of(6, 1500, 20, "A").error
    assert abs(abs(error[147 - 1, 1]) - 0.40) < 0.005 < abs(abs(error[140 - 1, 1]) - 0.40)  # as printed
    by_key = {cell.key: cell for cell in printed_cells()}
    assert round(by_key[8, 1500, 20, "B", "X"].sigma, 2) == 0.16
    assert round(by_key[8, 500, 5, "B", "Z"].sigma, 2) == 0.60


def test_phases_are_those_printed() -> None:
    for row in tables.printed_rows():
        height, depth, simultaneous = int(row["height"]), int(row["h"]), row["mode"] == "A"
        for period in okamoto.WAVES[int(row["table"])]:
            kind = "beta" if period == okamoto.SHORT else "alpha"
            assert okamoto.PHASE[period][depth] == float(row[f"xw1_{kind}"])
            assert okamoto.second_phase(period, depth, height, simultaneous) == float(row[f"xw2_{kind}"])


def test_every_ray_of_the_paper_has_one_refraction_point() -> None:
    for table in okamoto.WAVES:
        errors = tables.errors_of(table, 500, 20, "B")
        assert (errors.number == 1).all() and errors.complete.all()


def test_the_page_and_its_table_are_up_to_date() -> None:
    """`python -m drivers.okamoto_tables` writes them."""
    assert tables.PAGE.read_text(encoding="utf-8") == tables.page() + "\n"
    assert tables.TABLE.read_text(encoding="utf-8") == tables.table()
