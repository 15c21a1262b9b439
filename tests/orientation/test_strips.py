"""Models joined over any flying pattern, and the mosaic of vertical photos."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.adjustment.placing import sights_of, tangent_sigma
from musatpy.geometry import similarity
from musatpy.geometry.rotations import attitude_matrix
from musatpy.orientation.mosaic import mosaics
from musatpy.orientation.strips import Model, joined_models, oriented_pairs
from orientation.flights import HEIGHT, Flight, fly, strip


def flight(strips: list[tuple[np.ndarray, np.ndarray]], tilt: float = 0.03, **keys: float) -> Flight:
    C, heading = (np.concatenate(parts) for parts in zip(*strips, strict=True))
    rng = np.random.default_rng(len(C))
    attitude = np.column_stack([rng.normal(0.0, tilt, (len(C), 2)), heading])
    return fly(C, attitude, **keys)  # type: ignore[arg-type]


def joined(truth: Flight) -> list[Model]:
    sigma = tangent_sigma(truth.block)
    sights = sights_of(truth.block)
    return joined_models(oriented_pairs(sights, sigma), sigma)


def errors(model: Model, truth: Flight) -> tuple[float, float]:
    """Return the largest errors of stations (m) and attitudes (rad) after a fit of the model to the truth."""
    x = np.concatenate([model.X, model.C])
    y = np.concatenate([truth.X[model.point], truth.C[model.photo]])
    move = similarity.fit(x, y, np.ones(len(x)))
    true = attitude_matrix(truth.attitude[model.photo])
    turn = np.linalg.norm(move.turn(model.M) - true, axis=(1, 2)) / np.sqrt(2.0)
    return float(np.linalg.norm(move.apply(model.C) - truth.C[model.photo], axis=1).max()), float(turn.max())


PATTERNS = {
    "one strip": [strip(8, 0.3, (0.0, 0.0))],
    "to and fro": [strip(6, row % 2 * np.pi, (0.0, 3000.0 * row)) for row in range(3)],
    "crossing strips": [strip(7, 0.2, (0.0, 0.0)), strip(7, 1.7, (0.0, 0.0))],
    "cross flights": [
        *(strip(5, 0.0, (0.0, 3000.0 * row)) for row in range(3)),
        *(strip(5, np.pi / 2.0, (3000.0 * row - 3000.0, 3000.0)) for row in range(3)),
    ],
    "loop": [strip(6, turn * np.pi / 3.0, (5000.0 * np.sin(turn), -5000.0 * np.cos(turn))) for turn in range(6)],
}


@pytest.mark.parametrize("name", PATTERNS)
@pytest.mark.slow
def test_exact_images_join_to_one_exact_model(name: str) -> None:
    truth = flight(PATTERNS[name], noise=0.0, per_photo=15)
    models = joined(truth)
    assert [len(model.photo) for model in models] == [len(truth.C)]
    place, turn = errors(models[0], truth)
    assert place < 1e-6 * HEIGHT  # the pairs are exact to about 1e-8
    assert turn < 1e-6


@pytest.mark.parametrize("name", PATTERNS)
@pytest.mark.slow
def test_noise_and_gross_errors_leave_one_good_model(name: str) -> None:
    truth = flight(PATTERNS[name], blunders=0.02, per_photo=15)
    models = joined(truth)
    assert [len(model.photo) for model in models] == [len(truth.C)]
    place, turn = errors(models[0], truth)
    assert place < 0.02 * HEIGHT  # far below what an adjustment needs, far above what a false join leaves
    assert turn < 0.02


def test_models_that_nothing_connects_stay_apart() -> None:
    truth = flight([strip(4, 0.0, (0.0, 0.0)), strip(3, 0.0, (0.0, 50000.0))], noise=0.0)
    assert sorted(sorted(model.photo.tolist()) for model in joined(truth)) == [[0, 1, 2, 3], [4, 5, 6]]


def test_the_mosaic_of_vertical_photos_over_flat_ground_is_exact() -> None:
    truth = flight(PATTERNS["cross flights"], tilt=0.0, relief=0.0, noise=0.0, per_photo=8)
    (model,) = mosaics(sights_of(truth.block))
    assert sorted(model.photo.tolist()) == list(range(len(truth.C)))
    place, turn = errors(model, truth)
    assert place < 1e-6 * HEIGHT  # the normal equations are raised by 1e-9 of themselves
    assert turn < 1e-6


def test_the_mosaic_of_tilted_photos_is_a_start() -> None:
    truth = flight(PATTERNS["to and fro"], tilt=0.03, per_photo=8, blunders=0.02)
    (model,) = mosaics(sights_of(truth.block))
    place, turn = errors(model, truth)
    assert place < 0.3 * HEIGHT  # tilts of 2 degrees displace the nadirs by a few per cent, and add up
    assert turn < 0.25
