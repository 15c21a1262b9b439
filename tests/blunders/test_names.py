"""Names that are exchanged: of photos by their places, of images by the points that they lie on."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.blocks import simulated
from musatpy.adjustment.iteration import State
from musatpy.blunders import names
from musatpy.blunders.scene import Effort, StagedBlock, staged


@pytest.mark.parametrize(("share", "named"), [(0.0, True), (0.25, True), (0.35, False), (0.6, False)])
def test_exchanged_photos_stand_near_the_card_of_the_other_one(
    share: float, named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two stations far from their own cards, and a share of that from those of each other; a third in its place."""
    monkeypatch.setattr(names, "flying_height", lambda scene, state: 2000.0)
    given = np.array([[0.0, 0.0, 1500.0], [1000.0, 0.0, 1500.0], [9000.0, 0.0, 1500.0]])
    block = SimpleNamespace(photos=SimpleNamespace(position=given))
    scene = SimpleNamespace(network=SimpleNamespace(frame=SimpleNamespace(working=np.asarray)))
    place = given[[1, 0, 2]] + 1000.0 * share / (1.0 + share) * np.array([[-1.0, 0, 0], [1.0, 0, 0], [0, 0, 0]])
    pairs = names.exchanged_photos(block, scene, SimpleNamespace(position=place))  # type: ignore[arg-type]
    assert pairs == ([(0, 1)] if named else [])


@cache
def scene() -> tuple[StagedBlock, State]:
    """A block of two strips over land and water up to 60 m deep, from 1,500 m."""
    return staged(simulated(18, submerged=0.5, seed=4, depth=60.0)[0], None, None, Effort(left=math.inf))


def drawn(draws: np.random.Generator, points: int, size: float) -> np.ndarray:
    """Return covariances (p, 3, 3) m2 with one, two or three large axes of about `size`, in any direction."""
    axes = np.linalg.qr(draws.normal(size=(points, 3, 3)))[0]
    sigma = size * draws.uniform(0.5, 1.0, (points, 3)) * draws.choice([1e-3, 1.0], (points, 3))
    return axes @ (np.square(sigma)[:, :, None] * np.swapaxes(axes, 1, 2))


@pytest.mark.parametrize("seed", range(3))
def test_exchanged_images_get_their_names_back(seed: int) -> None:
    """Two images of each photo, by points known to a few decimetres."""
    of, state = scene()
    draws, network = np.random.default_rng(seed), of.network
    pairs = [draws.choice(np.flatnonzero(network.photo == n), 2, replace=False) for n in range(network.photos)]
    rows, point = np.concatenate(pairs), network.point.copy()
    point[rows] = point[np.stack(pairs)[:, ::-1].reshape(-1)]
    of, out = replace(of, network=replace(network, point=point)), np.isin(np.arange(len(point)), rows)
    judgement = SimpleNamespace(covariance=drawn(draws, network.points, 0.3), sigma0=1.0)
    last = SimpleNamespace(scene=of, state=state, rows_out=lambda kind: out, judgement=judgement)
    found = names.lookalikes(last)  # type: ignore[arg-type]
    certain = [one for one in found if one.certain]
    assert len(certain) > 0.5 * len(rows)
    assert [one.point for one in certain] == network.point[[one.row for one in certain]].tolist()
