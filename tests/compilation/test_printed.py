"""The formulas of ETL-0306, section 5: exact with own rays (docs/as11_of_1983.md: what each shortcut costs).

(5.1) to (5.17) stand here once more, by scalars, misprints put right, with the least squares of their equations by
numpy: what the formulas of arrays say must be the same.
"""

import math

import numpy as np
import pytest

from compilation.scenes import at_depth, curved_images, flat_images, grid, pair, readings_at
from musatpy.arrays import FloatArray
from musatpy.compilation.printed import AS_1983, Shortcuts, printed_points, true_coordinates
from musatpy.compilation.stereomodels import Stereomodel, set_up
from musatpy.compilation.true_points import true_points

PLACES = grid((200.0, 1600.0), 1700.0)


def errors(model: Stereomodel, points: FloatArray, xy: FloatArray, mode: Shortcuts) -> FloatArray:
    """Return the errors (k, 3) of compiled points against working coordinates."""
    return np.asarray(model.working(printed_points(model, xy, mode)) - points)


def flat(tides: tuple[float, float], depth: float) -> tuple[Stereomodel, FloatArray, FloatArray]:
    """Return a model, working coordinates of points, and their images; H 3000 m, f 152.4 mm, base 1810 m."""
    run = pair(3000.0, 1810.0, tides)
    points = at_depth(PLACES, depth)
    return set_up(run, "1", "2"), run.frame.working(points), flat_images(run, points)


@pytest.mark.parametrize("tides", [(0.0, 0.0), (0.4, -0.3)])
@pytest.mark.parametrize("depth", [0.0, 1.0, 30.0])
def test_own_rays_give_the_truth(tides: tuple[float, float], depth: float) -> None:
    """To 1e-10 m, tides of their own included: rounding of coordinates of some kilometres."""
    model, points, xy = flat(tides, depth + 0.5)
    assert np.abs(errors(model, points, xy, Shortcuts())).max() < 1e-10


def test_verticals_of_the_points_are_exact_over_a_sphere() -> None:
    """To .13 mm, what the curvature of the water does within a ray; so are the rays of the images."""
    model = set_up(pair(2400.0, 1500.0, sphere=True), "1", "2")
    points, xy = curved_images(model, grid((0.0, 1500.0), 1300.0), 25.0)
    assert np.abs(errors(model, points, xy, Shortcuts())).max() < 1.3e-4
    image = true_points(model.run, model.photos, readings_at(xy))
    assert np.abs(model.run.frame.working(image.position) - points).max() < 1.3e-4


def true_point(B: FloatArray, P: FloatArray, water: FloatArray, n: float) -> FloatArray:
    """Return X, Y, Z by (5.1) to (5.17), photo by photo, and the least squares of their four equations.

    (5.4) with By2, each photo with its own factor in (5.11) and (5.12), and c3 = Q in (5.23), which is not 0.
    """
    A, a = [], []
    for (Bx, By, Bz), (Px, Py, Pz), Zw in zip(B, P, water, strict=True):
        part = (Bz - Zw) / (Bz - Pz)
        Xw, Yw = Bx + part * (Px - Bx), By + part * (Py - By)  # (5.1) to (5.4)
        D = math.hypot(Xw - Bx, Yw - By)  # (5.5), (5.6)
        i = math.atan(D / (Bz - Zw))  # (5.7), (5.8)
        k = math.tan(math.asin(math.sin(i) / n)) / D if D else 0.0  # (5.9) to (5.12)
        for axis, (W, b) in enumerate(((Xw, Bx), (Yw, By))):
            r = -k * (W - b)  # (5.17a) to (5.17d)
            A.append([1.0 - axis, float(axis), -r])
            a.append(W - r * Zw)
    return np.linalg.lstsq(np.array(A), np.array(a), rcond=None)[0]


def test_the_formulas_of_arrays_are_those_of_the_report() -> None:
    """Of 300 pairs of rays, of which neither meets the other: to the rounding of some kilometres.

    The last point is below a camera: D is zero, by which the formulas divide, and the ray goes straight down.
    """
    draws = np.random.default_rng(51)
    B = draws.uniform([-100.0, -100.0, 2900.0], [100.0, 100.0, 3100.0], (300, 2, 3))
    B[:, 1, 0] += 1800.0
    P = draws.uniform([200.0, -1500.0, -30.0], [1600.0, 1500.0, -1.0], (300, 1, 3)) + draws.normal(size=(300, 2, 3))
    P[..., 2] = P[:, :1, 2]
    P[-1, 0, :2] = B[-1, 0, :2]
    water, n = draws.uniform(-0.5, 0.5, (300, 2)), 1.34
    expected = [true_point(*of, n) for of in zip(B, P, water, strict=True)]
    np.testing.assert_allclose(true_coordinates(B, P, water, n), expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize("tides", [(0.0, 0.0), (0.4, -0.3)])
def test_the_program_of_1983_to_the_letter(tides: tuple[float, float]) -> None:
    """One model point, one vertical and one height of water, over a sphere."""
    stereo = set_up(pair(2400.0, 1500.0, tides, sphere=True), "1", "2")
    _, xy = curved_images(stereo, grid((0.0, 1500.0), 1300.0, 5), 20.0)
    water = np.full(2, np.mean(tides) - stereo.run.frame.height(stereo.origin[None])[0])
    expected = [true_point(stereo.stations, [point, point], water, 1.34) for point in stereo.half_way(xy)]
    np.testing.assert_allclose(printed_points(stereo, xy, AS_1983), expected, rtol=0, atol=1e-8)
