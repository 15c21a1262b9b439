"""Orientation in air: absolute, relative, of one photo, and strips of models."""

import numpy as np
import pytest

from musatpy.geometry import collinearity, similarity
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.similarity import Similarity
from musatpy.orientation.absolute import Targets, absolute_orientation
from musatpy.orientation.mosaic import mosaics
from musatpy.orientation.relative import coplanarity, relative_orientations
from musatpy.orientation.resection import image_errors, resection
from musatpy.orientation.strips import PhotoModel, joined_models, oriented_pairs, sights_of, tangent_sigma
from orientation.flights import HEIGHT, Flight, fly, strip

TRUE = Similarity(
    scale=1800.0, rotation=attitude_matrix([0.05, -0.08, 2.0]), shift=np.array([5000.0, -3000.0, 120.0])
)
UP = TRUE.rotation.T @ [0.06, -0.04, 1.0] / np.linalg.norm([0.06, -0.04, 1.0])  # a few degrees off


def targets(known: list[str], seed: int = 1) -> Targets:
    """Return targets over a block of 12 by 8 km with little relief; F full, H horizontal, V vertical."""
    rng = np.random.default_rng(seed)
    place = rng.uniform([-6000.0, -4000.0, 0.0], [6000.0, 4000.0, 80.0], (len(known), 3))
    mask = np.array([[kind in "FH"] * 2 + [kind in "FV"] for kind in known])
    return Targets(
        model=TRUE.inverse().apply(place),
        position=np.where(mask, place, 0.0),
        known=mask,
        weight=np.ones(len(known)),
    )


@pytest.mark.parametrize("kinds", ["FFFF", "HHHVVV", "FFV", "HHHHVVVVV", "FHVVV"])
def test_exact_control_of_any_kind_gives_the_exact_similarity(kinds: str) -> None:
    found = absolute_orientation(targets(list(kinds)), UP, 10.0)
    assert found is not None
    move, _ = found
    # the level ground holds with 1/400 of a component of 10 m: a few centimetres over the arms of kilometres
    assert move.scale == pytest.approx(TRUE.scale, rel=1e-4)
    np.testing.assert_allclose(move.rotation, TRUE.rotation, atol=1e-3)
    corner = np.array([1.0, -1.0, 0.0])
    np.testing.assert_allclose(move.apply(corner), TRUE.apply(corner), atol=1.0)


@pytest.mark.parametrize("kinds", ["F", "HH", "VVV", "HV"])
def test_too_little_control_gives_nothing(kinds: str) -> None:
    assert absolute_orientation(targets(list(kinds)), UP, 10.0) is None


NOISE = 7e-5  # tangent: 10 micrometres at 152 mm
PAIRS = 60


def pairs(
    points: int, tilt: float, relief: float, noise: float, blunders: float, oblique: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return tangents of `PAIRS` pairs at flying height 1, base 0.6 and any headings, and their true R and b."""
    rng = np.random.default_rng(points)
    attitude = np.concatenate(
        [rng.normal(0.0, tilt, (2, PAIRS, 2)), rng.uniform(-np.pi, np.pi, (2, PAIRS, 1))], axis=2
    )
    attitude[..., 0] += oblique
    M1, M2 = attitude_matrix(attitude)
    flight = rng.uniform(-np.pi, np.pi, PAIRS)
    base = np.stack([0.6 * np.cos(flight), 0.6 * np.sin(flight), rng.normal(0.0, 0.03, PAIRS)], axis=1)
    X = np.empty((PAIRS, points, 3))
    X[..., :2] = rng.uniform(-0.45, 0.45, (PAIRS, points, 2)) + 0.5 * base[:, None, :2]
    X[..., 1] += np.tan(oblique)
    X[..., 2] = relief * rng.uniform(-1.0, 1.0, (PAIRS, points)) - 1.0
    one, origin = np.ones((PAIRS, points)), np.zeros(2)
    x1 = collinearity.image(X, M1[:, None], one, origin) + rng.normal(0.0, noise, (PAIRS, points, 2))
    x2 = collinearity.image(X - base[:, None], M2[:, None], one, origin)
    x2 = x2 + rng.normal(0.0, noise, x2.shape)
    wrong = rng.random((PAIRS, points)) < blunders
    x2[wrong] += rng.uniform(-0.03, 0.03, (int(wrong.sum()), 2))  # to 5 mm
    b = np.einsum("kij,kj->ki", M1, base)
    return x1, x2, M2 @ np.swapaxes(M1, 1, 2), b / np.linalg.norm(b, axis=1, keepdims=True)


def angles(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Return the angles between rotations (k, 3, 3)."""
    return np.linalg.norm(found - true, axis=(1, 2)) / np.sqrt(2.0)


@pytest.mark.parametrize("relief", [0.0, 0.05])
@pytest.mark.parametrize("oblique", [0.0, 0.5])
def test_gross_errors_do_not_draw_the_orientation(relief: float, oblique: float) -> None:
    x1, x2, R, b = pairs(30, 0.03, relief, NOISE, 0.05, oblique)
    found = relative_orientations(x1, x2, np.ones(x1.shape[:2]), NOISE)
    assert found.is_sound.all()
    # five times the size of the error that the orientation says of itself (no pair of 60 beyond five sigmas)
    assert (angles(found.rotation, R) < 5.0 * found.sigma).all()
    assert (np.linalg.norm(found.base - b, axis=1) < 5.0 * found.sigma).all()
    assert np.median(found.sigma) < 2e-3


def test_absent_points_do_not_count() -> None:
    x1, x2, R, _ = pairs(20, 0.03, 0.02, 0.0, 0.0)
    weight = np.ones(x1.shape[:2])
    weight[:, 12:] = 0.0
    x1[:, 12:], x2[:, 12:] = 0.0, 0.7
    found = relative_orientations(x1, x2, weight, NOISE)
    assert angles(found.rotation, R).max() < 1e-6
    assert (found.weight[:, 12:] == 0.0).all()


def test_five_points_are_trusted_only_over_level_ground() -> None:
    x1, x2, R, _ = pairs(5, 0.03, 0.02, 0.0, 0.0)
    found = relative_orientations(x1, x2, np.ones(x1.shape[:2]), NOISE)
    wrong = angles(found.rotation, R) > 0.3
    assert not (found.is_sound & (found.sigma < 0.02) & wrong).any()
    assert (found.is_sound & ~wrong).mean() > 0.5


def test_the_partials_of_the_coplanarity() -> None:
    """The weighting is held, as the docstring says: the partials are those of the volume over its size."""
    x1, x2, R, b = pairs(8, 0.1, 0.1, 1e-3, 0.0)
    residual, partials = coplanarity(x1, x2, R, b)
    u1 = np.concatenate([x1, -np.ones((*x1.shape[:2], 1))], axis=2)
    v = np.concatenate([x2, -np.ones((*x2.shape[:2], 1))], axis=2) @ R

    def volume(w: np.ndarray, base: np.ndarray) -> np.ndarray:
        return np.einsum("ki,kmi->km", base, np.cross(u1, v + np.cross(w, v)))

    size = volume(np.zeros(3), b) / residual
    for column in range(6):
        step = 1e-6 * np.eye(6)[column]
        high = volume(step[:3], b + step[3:])
        low = volume(-step[:3], b - step[3:])
        # the volume is bilinear: a central difference has rounding only, 1e-16 / 1e-6
        np.testing.assert_allclose(partials[..., column], (high - low) / 2e-6 / size, atol=1e-8)


UPWARDS = np.array([0.0, 0.0, 1.0])
C = np.array([1000.0, 2000.0, 3000.0])
CORNERS = np.array([[-0.6, -0.5], [0.55, -0.6], [0.6, 0.6], [-0.5, 0.6], [0.0, 0.1]])


def photo(points: int, tilt: float, relief: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return tangents, ground points and M of a photo at C; the first points are spread over the plate."""
    rng = np.random.default_rng(seed)
    M = attitude_matrix([*rng.uniform(-tilt, tilt, 2), rng.uniform(-np.pi, np.pi)])
    x = np.concatenate([CORNERS, rng.uniform(-0.6, 0.6, (max(points - 5, 0), 2))])[:points]
    ray = np.concatenate([x, -np.ones((points, 1))], axis=1) @ M
    X = C + ray * ((relief * rng.normal(size=points) - 1.0) * 3000.0 / ray[:, 2])[:, None]
    return collinearity.image(X - C, M, np.ones(points), np.zeros(2)), X, M


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("points", "tilt"), [(3, 0.02), (4, 0.1), (5, 0.35), (12, 0.35)])
@pytest.mark.parametrize("relief", [0.0, 0.05])
def test_exact_images_give_the_station(points: int, tilt: float, relief: float, seed: int) -> None:
    x, X, M = photo(points, tilt, relief, seed)
    found = resection(x, X, UPWARDS, 7e-5)
    assert found is not None
    np.testing.assert_allclose(found.C, C, atol=1e-4)  # m: rounding, times the worst condition of three points
    np.testing.assert_allclose(found.M, M, atol=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_gross_errors_do_not_draw_the_station(seed: int) -> None:
    x, X, _ = photo(20, 0.3, 0.02, seed)
    rng = np.random.default_rng(seed)
    x = x + rng.normal(0.0, 7e-5, x.shape)
    wrong = rng.choice(20, 4, replace=False)
    x[wrong] += rng.choice([-1.0, 1.0], (4, 2)) * rng.uniform(0.01, 0.3, (4, 2))
    found = resection(x, X, UPWARDS, 7e-5)
    assert found is not None
    assert (found.weight[wrong] < 0.1).all()
    assert np.linalg.norm(found.C - C) < 5.0 * found.sigma  # no station beyond five sigmas


def test_too_few_points_or_points_on_a_line_give_no_sure_station() -> None:
    x, X, _ = photo(2, 0.02, 0.0, 1)
    assert resection(x, X, UPWARDS, 7e-5) is None
    line = np.stack([np.linspace(-0.5, 0.5, 5), np.zeros(5)], axis=1)
    ground = np.column_stack([3000.0 * line, np.zeros(5)])
    found = resection(line, ground, UPWARDS, 7e-5)
    assert found is None or found.sigma > 1000.0


def test_the_partials_of_the_images() -> None:
    x, X, M = photo(6, 0.3, 0.05, 3)
    _, J = image_errors(x, X, M, C)
    for column in range(6):
        step = np.eye(6)[column]
        size = 1e-2 if column < 3 else 1e-6  # m, rad
        ends = []
        for sign in (1.0, -1.0):
            w = sign * size * step[3:]
            turn = np.eye(3) + np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
            ends.append(image_errors(x, X, turn @ M, C + sign * size * step[:3])[0])
        numerical = (ends[0] - ends[1]) / (2.0 * size)
        np.testing.assert_allclose(J[..., column], numerical, atol=1e-9)  # rounding 1e-16 / size, and size squared


def flight(strips: list[tuple[np.ndarray, np.ndarray]], tilt: float = 0.03, **keys: float) -> Flight:
    C, heading = (np.concatenate(parts) for parts in zip(*strips, strict=True))
    rng = np.random.default_rng(len(C))
    attitude = np.column_stack([rng.normal(0.0, tilt, (len(C), 2)), heading])
    return fly(C, attitude, **keys)  # type: ignore[arg-type]


def joined(truth: Flight) -> list[PhotoModel]:
    sigma = tangent_sigma(truth.block)
    sights = sights_of(truth.block)
    return joined_models(oriented_pairs(sights, sigma), sigma)


def errors(model: PhotoModel, truth: Flight) -> tuple[float, float]:
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
@pytest.mark.parametrize(
    ("wrong", "metres", "radians"),
    [
        ({"noise": 0.0}, 1e-6 * HEIGHT, 1e-6),  # the pairs are exact to about 1e-8
        # far below what an adjustment needs, far above what a false join leaves
        ({"blunders": 0.02}, 0.02 * HEIGHT, 0.02),
    ],
    ids=["exact images", "noise and gross errors"],
)
@pytest.mark.slow
def test_images_join_to_one_model(name: str, wrong: dict[str, float], metres: float, radians: float) -> None:
    truth = flight(PATTERNS[name], per_photo=15, **wrong)
    models = joined(truth)
    assert [len(model.photo) for model in models] == [len(truth.C)]
    place, turn = errors(models[0], truth)
    assert place < metres
    assert turn < radians


@pytest.mark.parametrize(
    ("name", "keys", "metres", "radians"),
    [
        # the normal equations are raised by 1e-9 of themselves
        ("cross flights", {"tilt": 0.0, "relief": 0.0, "noise": 0.0}, 1e-6 * HEIGHT, 1e-6),
        # tilts of 2 degrees displace the nadirs by a few per cent, and add up
        ("to and fro", {"tilt": 0.03, "blunders": 0.02}, 0.3 * HEIGHT, 0.25),
    ],
)
def test_the_mosaic_of_vertical_photos_is_exact_and_that_of_tilted_ones_a_start(
    name: str, keys: dict[str, float], metres: float, radians: float
) -> None:
    truth = flight(PATTERNS[name], per_photo=8, **keys)
    (model,) = mosaics(sights_of(truth.block))
    assert sorted(model.photo.tolist()) == list(range(len(truth.C)))
    place, turn = errors(model, truth)
    assert place < metres and turn < radians
