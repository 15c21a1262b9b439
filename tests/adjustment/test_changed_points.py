"""What one network has of points is kept by the next one, but for those whose rays or heights it changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from adjustment.water_jobs import shore
from altered import with_options
from musatpy.adjustment import kernels
from musatpy.adjustment.ground import settle
from musatpy.adjustment.job import prepared
from musatpy.adjustment.network import Network
from musatpy.adjustment.simultaneous import Simultaneous
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.waterline import refracted, water_line
from musatpy.model import Program


def networks() -> tuple[Network, Network, State, np.ndarray]:
    """A network of straight rays, the same with wet ones, two heights held and an image moved, and who differs."""
    job, state = prepared(with_options(shore(12), program=Program.IIA), None)
    before = job.network
    line = water_line(before, state, job.bathymetric)
    loose = before.pass_groups[0].point[:2]
    line.level[loose] = before.frame.height(state.ground[loose]) + 0.1
    xy = before.xy.copy()
    xy[before.pass_groups[1].rays[0, 0]] += 0.02
    after, _ = refracted(before.with_plates(xy, before.refracted), line, state)
    moved = np.unique(np.concatenate([before.point[line.wet], loose, before.pass_groups[1].point[:1]]))
    return before, after, state, moved


def test_points_differ_by_their_rays_images_and_heights() -> None:
    before, after, _, moved = networks()
    np.testing.assert_array_equal(np.flatnonzero(after.changed(before)), moved)
    assert not after.changed(after).any()


@pytest.mark.parametrize("kind", [kernels.NUMPY, pytest.param(kernels.NUMBA, marks=pytest.mark.slow)])
def test_points_that_are_at_their_optimum_are_left_there(monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    """All that are not come to the same places, with the same squares, as if all were settled."""
    monkeypatch.setenv(kernels.VARIABLE, kind)
    before, after, state, _ = networks()
    state = settle(before, state)
    again, expected = settle(after, state, before), settle(after, state)
    # what Gauss-Newton leaves of a step below 10 um
    np.testing.assert_allclose(again.ground, expected.ground, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(again.squares, expected.squares, atol=1e-9)
    still = ~after.changed(before)
    np.testing.assert_array_equal(again.ground[still], state.ground[still])


def test_squares_are_taken_anew_of_points_that_differ() -> None:
    before, after, state, _ = networks()
    problem = Simultaneous(network=after, options=with_options(shore(12)).options)
    old = replace(problem, network=before).with_squares(state)
    some, every = problem.with_squares(old, before), problem.with_squares(state)
    np.testing.assert_allclose(some.squares, every.squares, rtol=1e-12)
    assert not np.allclose(old.squares, every.squares)
