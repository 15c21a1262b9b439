"""The random streams: fixed for ever, independent by name, and of the right distribution."""

import numpy as np
import pytest
from scipy.stats import kstest

from musatpy.draws import Draws


def test_streams_are_fixed():
    """The odd multiples of 2^-53 that PCG64 seeded with (1, crc32 of the name) gives: a change breaks old decks."""
    ticks = Draws(1).uniform("noise", 3) * 2.0**53
    assert [int(tick) for tick in ticks] == [523372235525975, 1260930369451103, 75577409678649]
    assert all(tick == int(tick) and int(tick) % 2 for tick in ticks)


def test_streams_go_on_and_do_not_depend_on_each_other():
    together, apart = Draws(3), Draws(3)
    apart.uniform("other", 5)
    first = [*apart.uniform("noise", 2), *apart.uniform("noise", 2)]
    np.testing.assert_array_equal(together.uniform("noise", 4), first)
    assert together.uniform("other", 1) != together.uniform("another", 1)


def test_normal_deviates_are_normal():
    assert kstest(Draws(2).normal("noise", 20000), "norm").pvalue > 0.01  # a fixed sample: it passes or never does


def test_pick_takes_different_rows_in_order():
    rows = Draws(4).pick("rows", 50, 20)
    assert len(set(rows.tolist())) == 20 and np.all(np.diff(rows) > 0) and rows.max() < 50


@pytest.mark.parametrize("shape", [(0,), (3,), (2, 3)])
def test_shapes_and_signs(shape):
    signs = Draws(5).signs("signs", *shape)
    assert signs.shape == shape and np.all(np.abs(signs) == 1.0)
