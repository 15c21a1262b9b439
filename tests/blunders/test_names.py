"""Names that are exchanged: of photos by their places, of images by the points that they lie on."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.blocks import simulated
from musatpy.adjustment import kernels
from musatpy.adjustment.unknowns import State
from musatpy.blunders import exchanges, names
from musatpy.blunders.scene import Effort, Scene, staged


@pytest.mark.parametrize(("share", "named"), [(0.0, True), (0.25, True), (0.35, False), (0.6, False)])
def test_exchanged_photos_stand_near_the_card_of_the_other_one(
    share: float, named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two stations far from their own cards, and a share of that from those of each other; a third in its place."""
    monkeypatch.setattr(exchanges, "flying_height", lambda scene, state: 2000.0)
    given = np.array([[0.0, 0.0, 1500.0], [1000.0, 0.0, 1500.0], [9000.0, 0.0, 1500.0]])
    block = SimpleNamespace(photos=SimpleNamespace(position=given))
    scene = SimpleNamespace(network=SimpleNamespace(frame=SimpleNamespace(working=np.asarray)))
    place = given[[1, 0, 2]] + 1000.0 * share / (1.0 + share) * np.array([[-1.0, 0, 0], [1.0, 0, 0], [0, 0, 0]])
    pairs = exchanges.exchanged_photos(block, scene, SimpleNamespace(position=place))  # type: ignore[arg-type]
    assert pairs == ([(0, 1)] if named else [])


@cache
def scene() -> tuple[Scene, State]:
    """A block of two strips over land and water up to 60 m deep, from 1,500 m."""
    return staged(simulated(18, submerged=0.5, seed=4, depth=60.0)[0], None, None, Effort(left=math.inf))


def by_kernels(
    of: Scene, state: State, rows: np.ndarray, covariance: np.ndarray, determined: np.ndarray
) -> np.ndarray:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(kernels.VARIABLE, kernels.NUMBA)
        return names._perhaps_near(of, state, rows, determined, covariance, 1.0)


def imagined(of: Scene, state: State, covariance: np.ndarray) -> names._Imagined:
    """Return what all photos would show."""
    photos, network = np.arange(of.network.photos), of.network
    every = np.ones(network.points, dtype=bool)
    near, rims = names._near(network, photos), names._rims(network, photos)
    return names._imagined(of, state, photos, near, rims, every, covariance)


def drawn(draws: np.random.Generator, points: int, size: float) -> np.ndarray:
    """Return covariances (p, 3, 3) m2 with one, two or three large axes of about `size`, in any direction."""
    axes = np.linalg.qr(draws.normal(size=(points, 3, 3)))[0]
    sigma = size * draws.uniform(0.5, 1.0, (points, 3)) * draws.choice([1e-3, 1.0], (points, 3))
    return axes @ (np.square(sigma)[:, :, None] * np.swapaxes(axes, 1, 2))


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    size=st.sampled_from([0.01, 0.3, 10.0]),
    tide=st.floats(-70.0, 70.0),
    tilt=st.floats(-0.02, 0.02),
)
def test_no_image_near_a_point_is_left_out(seed: int, size: float, tide: float, tilt: float) -> None:
    """Each image is taken 5.9 sigmas from the predicted one of its point, and named as another one.

    Points lie as deep below the water as above it; all of those flagged as submerged are seen through it.
    """
    of, state = scene()
    draws, network = np.random.default_rng(seed), of.network
    state = replace(state, tide=state.tide + tide, tilt=np.array([tilt, -tilt]))
    covariance = drawn(draws, network.points, size)
    seen = imagined(of, state, covariance)
    at = {
        (photo, int(seen.point[k])): k
        for photo in range(network.photos)
        for k in range(seen.start[photo], seen.start[photo + 1])
    }
    labels = zip(network.photo.tolist(), network.point.tolist(), strict=True)
    rows, found = np.array([(row, at[label]) for row, label in enumerate(labels) if label in at]).T
    assert len(rows) > 0.8 * len(network.photo)
    spread = seen.covariance[found] + np.eye(2) / network.weight[rows][:, None]
    way = draws.normal(size=(len(rows), 2, 1))
    off = np.linalg.cholesky(spread) @ (5.9 * way / np.linalg.norm(way, axis=1, keepdims=True))
    xy, point = network.xy.copy(), network.point.copy()
    xy[rows] = seen.xy[found] + off[..., 0]
    point[rows] = np.roll(point[rows], 1)
    renamed = replace(of, network=replace(network, xy=xy, point=point))
    every = np.ones(network.points, dtype=bool)
    rows = rows[np.argsort(network.photo[rows], kind="stable")]
    np.testing.assert_array_equal(by_kernels(renamed, state, rows, covariance, every), rows)


@pytest.mark.slow
def test_images_far_from_other_points_are_left_out() -> None:
    """With a centimetre on the ground: 60 um of the image, a few of a thousand."""
    of, state = scene()
    network = of.network
    covariance = np.full((network.points, 1, 1), 1e-4) * np.eye(3)
    rows = np.argsort(network.photo, kind="stable")
    dry = rows[~of.block.points.bathymetric[network.point[rows]]]
    left = by_kernels(of, state, dry, covariance, ~of.block.points.bathymetric)
    assert len(left) < 0.02 * len(dry)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_both_find_the_same_names(seed: int) -> None:
    """Of a tenth of the images exchanged on their photos, by any of the points, known to a few decimetres."""
    of, state = scene()
    draws, network = np.random.default_rng(seed), of.network
    rows = np.sort(draws.choice(len(network.photo), len(network.photo) // 10, replace=False))
    point = network.point.copy()
    for photo in range(network.photos):
        on = rows[network.photo[rows] == photo]
        point[on] = np.roll(point[on], 1)
    of = replace(of, network=replace(network, point=point))
    out = np.zeros(len(point), dtype=bool)
    out[rows] = True
    covariance = drawn(draws, network.points, 0.3)
    both = []
    for kind in (kernels.NUMPY, kernels.NUMBA):
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv(kernels.VARIABLE, kind)
            both.append(names.lookalikes(of, state, out, rows, covariance, 1.0))
    a, b = both
    assert a.certain.any()
    for found in ("row", "point", "certain"):
        np.testing.assert_array_equal(getattr(a, found), getattr(b, found))
    np.testing.assert_allclose(a.distance, b.distance, rtol=0.0, atol=1e-12)  # sums of other arrays at a time
