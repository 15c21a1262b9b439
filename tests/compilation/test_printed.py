"""The formulas of ETL-0306, section 5: exact with own rays, and what each shortcut of 1983 costs."""

from __future__ import annotations

import numpy as np
import pytest

from compilation.scenes import at_depth, curved_images, flat_images, grid, pair
from musatpy.arrays import FloatArray
from musatpy.compilation.printed import AS_1983, Printed, printed_points
from musatpy.compilation.stereomodels import Stereomodel, off_plate, set_up
from musatpy.compilation.true_points import Readings, true_points
from musatpy.errors import CompilationError

PLACES = grid((200.0, 1600.0), 1700.0)


def errors(model: Stereomodel, points: FloatArray, xy: FloatArray, mode: Printed) -> FloatArray:
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
    assert np.abs(errors(model, points, xy, Printed())).max() < 1e-10


def test_one_model_point_for_both_rays_is_wrong_by_centimetres() -> None:
    """Largest .083, mean .0155 m at 30 m: the apparent rays do not meet."""
    model, points, xy = flat((0.0, 0.0), 30.0)
    error = np.linalg.norm(errors(model, points, xy, Printed(shared_point=True)), axis=1)
    assert error.max() == pytest.approx(0.083, rel=0.05) and error.mean() == pytest.approx(0.0155, rel=0.05)
    assert errors(model, points, xy, AS_1983) == pytest.approx(
        errors(model, points, xy, Printed(shared_point=True))
    )


@pytest.mark.parametrize(("depth", "parallax"), [(1, 1.0), (5, 5.1), (10, 10.1), (20, 20.2), (30, 30.1)])
def test_the_y_parallax_of_the_apparent_model(depth: float, parallax: float) -> None:
    """Largest, um in the photo, at the height without x-parallax."""
    model, _, xy = flat((0.0, 0.0), depth)
    reach = model.base / (xy[:, 0, 0] - xy[:, 1, 0])
    off = (xy[:, 0, 1] - xy[:, 1, 1]) * reach * 152.4 / 3000.0
    assert 1e3 * np.abs(off).max() == pytest.approx(parallax, abs=0.1)


def test_a_mean_tide_is_wrong_by_a_decimetre() -> None:
    """Tides of .4 and -.3 m: largest .13, mean .07 m on these places, whatever the depth."""
    for depth in (2.0, 30.0):
        model, points, xy = flat((0.4, -0.3), depth)
        error = np.linalg.norm(errors(model, points, xy, Printed(mean_tide=True)), axis=1)
        assert error.max() == pytest.approx(0.13, abs=0.01) and error.mean() == pytest.approx(0.07, abs=0.005)


@pytest.mark.parametrize(
    ("height", "base", "half", "largest", "rms"),
    [(2400.0, 1500.0, 1300.0, 0.092, 0.038), (6100.0, 3600.0, 3200.0, 0.536, 0.225)],
)
def test_one_vertical_for_a_model_is_wrong_at_its_edge(
    height: float, base: float, half: float, largest: float, rms: float
) -> None:
    """Errors (m) on 15 x 15 places as long as the base and 2 `half` wide, whatever the depth: the water falls away.

    By the verticals of the points exact to .13 mm, what the curvature of the water does within a ray.
    """
    model = set_up(pair(height, base, sphere=True), "1", "2")
    places = grid((0.0, base), half)
    for depth in (2.0, 25.0):
        points, xy = curved_images(model, places, depth)
        assert np.abs(errors(model, points, xy, Printed())).max() < 1.3e-4
        error = np.linalg.norm(errors(model, points, xy, Printed(model_vertical=True)), axis=1)
        assert error.max() == pytest.approx(largest, rel=0.05)
        assert np.sqrt(np.mean(np.square(error))) == pytest.approx(rms, rel=0.05)
        readings = Readings(
            ids=np.arange(len(xy)).astype(np.str_),
            submerged=np.ones(len(xy), dtype=bool),
            xy=xy,
            sigma=np.full(xy.shape, 0.005),
        )
        image = true_points(model.run, model.photos, readings)
        assert np.abs(model.run.frame.working(image.position) - points).max() < 1.3e-4


def test_axes_of_a_model() -> None:
    model = set_up(pair(2400.0, 1500.0, (0.4, -0.3), sphere=True), "1", "2")
    np.testing.assert_allclose(model.stations[:, 1], 0.0, atol=1e-9)
    assert model.stations[1, 0] == pytest.approx(-model.stations[0, 0]) and model.stations[0, 0] < 0.0
    x = np.array([[100.0, -2000.0, 3.0], [5.0, 7.0, -11.0]])
    np.testing.assert_allclose(model.model(model.working(x)), x, rtol=0.0, atol=1e-9)
    assert model.run.frame.height(model.origin) == pytest.approx(0.05, abs=1e-6)


@pytest.mark.parametrize(("photos", "message"), [(("1", "9"), "no photo 9"), (("1", "1"), "no base across")])
def test_photos_that_make_no_model(photos: tuple[str, str], message: str) -> None:
    with pytest.raises(CompilationError, match=message):
        set_up(pair(3000.0, 1810.0), *photos)


def test_readings_off_the_plate() -> None:
    model = set_up(pair(3000.0, 1810.0), "1", "2")
    xy = np.zeros((2, 2, 2))
    xy[1, 0, 1] = -5001.0
    assert off_plate(model, xy).tolist() == [[False, False], [True, False]]


def test_sigmas_of_two_thousand_pointings() -> None:
    """Errors over told sigmas in each coordinate within 5 %: three deviations of 2,000 draws; stations exact."""
    run = pair(3000.0, 1810.0, (0.4, -0.3))
    draws = np.random.default_rng(7)
    places = np.column_stack([draws.uniform(200.0, 1600.0, 2000), draws.uniform(-1700.0, 1700.0, 2000)])
    points = np.column_stack([places, -draws.uniform(1.0, 30.0, 2000)])
    xy = flat_images(run, points)
    sigma = np.full(xy.shape, 0.005)
    readings = Readings(
        ids=np.arange(2000).astype(np.str_),
        submerged=np.ones(2000, dtype=bool),
        xy=xy + sigma * draws.normal(size=xy.shape),
        sigma=sigma,
    )
    compiled = true_points(run, (0, 1), readings)
    scaled = (compiled.position - points) / np.sqrt(np.diagonal(compiled.covariance, axis1=1, axis2=2))
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(scaled), axis=0)), 1.0, atol=0.05)
    depth = (compiled.depth - (0.05 - points[:, 2])) / compiled.depth_sigma
    assert np.sqrt(np.mean(np.square(depth))) == pytest.approx(1.0, abs=0.05)
    parallax = compiled.y_parallax / compiled.y_parallax_sigma
    assert np.sqrt(np.mean(np.square(parallax))) == pytest.approx(1.0, abs=0.05)
