"""Parts of strips against dense formulations: covariances of triplets, joins, the chain with one plane, control."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from musatpy.arrays import FloatArray
from musatpy.geometry.similarity import Similarity
from musatpy.orientation.twomedia.joins import Join, joined
from musatpy.orientation.twomedia.sights import Plane, Sights
from musatpy.orientation.twomedia.strip import control_tests, orient_strip
from musatpy.orientation.twomedia.strip_chain import Chain, chain_of
from musatpy.orientation.twomedia.strip_triplets import triplets
from musatpy.orientation.twomedia.triplet_models import TripletModel, shared_covariance
from orientation.twomedia.strip_scenes import corners, strip_scene, strip_sights


def influence(model: TripletModel, sights: Sights) -> FloatArray:
    """Return the partials (3 r, 2 n) of all quantities of a triplet by all images of the strip."""
    every = np.zeros((3 * len(model.value), sights.image.size))
    every[:, model.columns] = model.influence(np.arange(len(model.value))).reshape(len(every), -1)
    return every


def five_photos(noise: float = 0.0) -> Sights:
    return strip_sights(strip_scene("lab", 5, 24), noise=noise)[0]


def test_triplets_depend_on_each_other_by_the_images_that_both_have() -> None:
    sights = five_photos()
    models = list(triplets(sights, [Plane()] * 3))
    variance = np.square(sights.image_sigma).ravel()
    for first, second in [(0, 0), (0, 1), (1, 0), (0, 2)]:
        one, other = models[first], models[second]
        rows = (np.arange(len(model.value)) for model in (one, other))
        shared = shared_covariance(one, next(rows), other, next(rows))
        dense = (influence(one, sights) * variance) @ influence(other, sights).T
        np.testing.assert_allclose(shared, dense, rtol=0.0, atol=1e-10 * np.abs(dense).max())


def test_a_join_is_the_similarity_of_least_squares() -> None:
    """Its gain, and its sigma0 by squares of residuals over those that all covariances let expect."""
    sights = five_photos(noise=1e-4)
    before, after = triplets(sights, [Plane()] * 2)
    join = joined(before, after)
    rows_before, rows_after = (
        (3 * rows[:, None] + np.arange(3)).ravel() for rows in (join.rows_before, join.rows_after)
    )
    there = after.moved(join.move, join.rows_after)
    count, variance = len(join.rows_after), np.square(sights.image_sigma).ravel()
    turned = there.by_old @ influence(after, sights)[rows_after].reshape(count, 3, -1)
    B, A = influence(before, sights)[rows_before], turned.reshape(3 * count, -1)
    G = there.by_change.reshape(-1, 7)
    V = (B * variance) @ B.T + (A * variance) @ A.T
    W = np.linalg.inv(V + np.trace(V) / np.sum(np.square(G)) * G @ G.T)
    gain = np.linalg.solve(G.T @ W @ G, G.T @ W)
    np.testing.assert_allclose(join.gain, gain, rtol=0.0, atol=1e-3 * np.abs(gain).max())  # weights of the start
    weight = W - W @ G @ gain
    r = (before.value[join.rows_before] - there.value).ravel()
    expected = np.trace(weight @ ((B - A) * variance) @ (B - A).T)
    assert join.sigma0 == pytest.approx(np.sqrt(r @ weight @ r / expected), rel=1e-3)
    assert np.abs(gain @ r).max() < 1e-3 * np.abs(r).max()


def changes(before: Chain, after: Chain) -> FloatArray:
    """Return the changes (N, 10) of the states of a chain."""
    moves = [new.after(old.inverse()).change for old, new in zip(before.moves, after.moves, strict=True)]
    return np.concatenate([np.array(moves), after.plane - before.plane], axis=1)


def test_a_chain_over_one_plane_changes_with_its_images_as_its_links_say() -> None:
    sights = five_photos()
    errors = 1e-7 * np.random.default_rng(1).normal(size=sights.image.shape)
    chains = []
    for image in (sights.image, sights.image + errors):
        models = list(triplets(replace(sights, image=image), [Plane()] * 3))
        joins: list[Join] = [joined(*models[row : row + 2]) for row in range(2)]
        start = Similarity(scale=1.0, rotation=np.eye(3), shift=np.zeros(3))
        variance = np.square(sights.image_sigma).ravel()
        chains.append(chain_of(models, joins, start, variance, common_plane=True))
    state, told = np.zeros(10), []
    for link in chains[0].links:
        state = link.transition @ state + link.by_image @ errors.ravel()[link.columns]
        told.append(state)
    moved = changes(*chains)
    for part in (moved[:, :7] - np.array(told)[:, :7], moved[:, 7:] - np.array(told)[:, 7:]):
        assert np.abs(part).max() < 3e-3 * np.abs(moved).max()  # weights and gains change with the triplets


@pytest.mark.slow
def test_tests_of_control_are_one_in_the_mean() -> None:
    """Squares of three coordinates over their covariances, of draws of images and control."""
    true = strip_scene("lab", 4, 24)
    sights, _ = strip_sights(true, control=corners(true))
    sights = replace(sights, control_sigma=np.full_like(sights.control_sigma, 2e-3))
    draws, squares = np.random.default_rng(3), []
    for _ in range(12):
        drawn = {
            name: getattr(sights, name) + sigma * draws.normal(size=sigma.shape)
            for name, sigma in (("image", sights.image_sigma), ("control", sights.control_sigma))
        }
        strip = orient_strip(replace(sights, **drawn), Plane())
        assert strip.known is not None and strip.placed is not None
        squares.append(control_tests(strip.known, strip.placed, strip.drift) / 3.0)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.3)  # 132 free squares: three deviations are 0.37


def test_points_are_those_of_the_triplets_that_show_them_most_often() -> None:
    sights = five_photos()
    strip = orient_strip(sights, Plane())
    rays = np.zeros((len(strip.models), len(sights.points)), dtype=int)
    for number in range(len(strip.models)):
        here = (sights.photo >= number) & (sights.photo < number + 3)
        rays[number] = np.bincount(sights.point[here], minlength=len(sights.points))
    assert (rays[strip.of_point, np.arange(len(sights.points))] == rays.max(axis=0)).all()
    assert rays.max(axis=0).min() == 2 and rays.max() == 3
