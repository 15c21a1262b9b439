"""Statistics of one sample: every real sample is consistent as printed, and implied ranges hold the truth."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.listings.audit.samples import consistent, implied, sizes_implied

NAMES = ("sum", "mean", "rms", "deviation", "maximum")


def statistics_of(d):
    N, mean = len(d), d.mean()
    found = {"sum": d.sum(), "mean": mean, "rms": np.sqrt((d**2).mean()), "maximum": d[np.abs(d).argmax()]}
    if N > 1:
        found["deviation"] = np.sqrt(((d - mean) ** 2).sum() / (N - 1))
    return found


def printed(statistics, decimals):
    half = 0.5 * 10.0**-decimals
    rounded = {name: round(float(value), decimals) for name, value in statistics.items()}
    return {name: (value - half, value + half) for name, value in rounded.items()}


def samples():
    random = np.random.default_rng(6)
    for N in (1, 2, 3, 7, 10, 35, 500):
        for scale in (1e-3, 0.05, 1.0, 300.0):
            for offset in (0.0, 1.0, -5.0):
                yield scale * (random.standard_normal(N) + offset)
                yield scale * np.full(N, offset)  # all alike: every bound is reached


@pytest.mark.parametrize("decimals", [2, 3])
def test_no_real_sample_is_contradictory(decimals):
    for d in samples():
        truth = statistics_of(d)
        cells = printed(truth, decimals)
        assert consistent(len(d), cells), d
        for name in cells:
            bounds = implied(len(d), name, cells)
            if bounds is not None:
                slack = 1e-9 * abs(truth[name]) + 1e-12  # rounding of the arithmetic
                assert bounds[0] - slack <= truth[name] <= bounds[1] + slack, (name, d)


def test_a_statistic_that_is_far_off_is_a_contradiction():
    d = np.random.default_rng(1).standard_normal(10) + 0.4
    cells = printed(statistics_of(d), 3)
    for name, (low, high) in cells.items():
        for factor in (0.1, 10.0):
            middle = 0.5 * (low + high) * factor
            spoiled = cells | {name: (middle - 5e-4, middle + 5e-4)}
            assert not consistent(10, spoiled), (name, factor)


def test_the_maximum_is_bounded_on_both_sides():
    base = {"sum": (-0.01, 0.01), "rms": (0.99, 1.01)}
    assert not consistent(4, base | {"maximum": (0.9, 0.95)})  # below the RMS
    # Of four numbers with sum 0 and RMS 1 the largest is sqrt(3) at most, with the others at -1 / sqrt(3).
    assert consistent(4, base | {"maximum": (1.72, 1.74)})
    assert not consistent(4, base | {"maximum": (1.79, 1.81)})
    assert consistent(4, base | {"maximum": (-1.74, -1.72)})


def test_the_sign_of_the_maximum_matters():
    # Three of four at 1 and one at 1.2 or -1.2: sums of 4.2 and 1.8.
    cells = {"sum": (4.19, 4.21), "rms": (1.04, 1.06)}
    assert consistent(4, cells | {"maximum": (1.19, 1.21)})
    assert not consistent(4, cells | {"maximum": (-1.21, -1.19)})


def test_sizes_that_sum_and_mean_allow():
    assert list(sizes_implied({"sum": (9.99, 10.01), "mean": (0.999, 1.001)})) == [10]
    assert list(sizes_implied({"sum": (0.99, 1.01), "mean": (-0.001, 0.001)})) == []
    assert list(sizes_implied({"sum": (-10.01, -9.99), "mean": (0.999, 1.001)})) == []
