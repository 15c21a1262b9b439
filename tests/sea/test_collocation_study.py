"""The study of simulated seas: what it rests on, what it shows, and that its page shows it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers import collocation_tables
from musatpy.sea.interpolation.correlation import Family
from musatpy.sea.interpolation.prediction import Collocation
from musatpy.sea.theory import linear_wave
from studies.collocation import AREA, Case, Outcome, SeaState, cases, isotropic, outcome, sea, simulated


@pytest.mark.parametrize("state", SeaState)
def test_seas_are_as_high_as_each_other(state: SeaState) -> None:
    waves = sea(Case(state=state))
    rng = np.random.default_rng(1)
    height = waves.relief(rng.uniform(0.0, 20000.0, (20000, 2)), 0.0).height
    one = float(linear_wave(10.0, 10.0, deep_height=1.0).height) / 2.0
    # a mean square of twenty thousand heights, waves of like periods beating over the area
    assert np.mean(np.square(height)) == pytest.approx(one**2 / 2.0, rel=0.1)


def test_control_points_have_the_errors_of_mapping_and_noise() -> None:
    quiet, noisy = (simulated(Case(number=300, noise=noise)) for noise in (0.0, 0.2))
    assert np.array_equal(quiet.control.place, noisy.control.place)
    noise = noisy.control.value - quiet.control.value
    assert np.std(noise) == pytest.approx(0.2, rel=0.15)  # 300 values: 4 % of standard error
    assert np.array_equal(quiet.error, noisy.error)
    inside = (quiet.control.place > AREA[0] - 1.0) & (quiet.control.place < AREA[1] + 1.0)
    assert inside.all()
    again = simulated(Case(number=300, noise=0.2))
    assert np.array_equal(again.control.value, noisy.control.value)


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
    assert swell.found.best.family == Family.SWELL and swell.removed > 0.7
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


def test_the_table_in_docs_has_every_case() -> None:
    assert collocation_tables.TABLE.read_text(encoding="utf-8").startswith(collocation_tables.table({}))
    assert list(collocation_tables.printed()) == [
        collocation_tables.key(name, case)
        for state in SeaState
        for name, varied in cases(state).items()
        for case in varied
    ]
