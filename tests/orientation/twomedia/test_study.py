"""Studies of orientations through water: precision, diagnosis, starts, other solutions."""

from dataclasses import replace

import numpy as np
import pytest

from musatpy.draws import Draws
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.orientation.twomedia.helmert import adjust
from musatpy.orientation.twomedia.oriented import Oriented, PlaneVerdict, orient
from musatpy.orientation.twomedia.precision import inflation
from musatpy.orientation.twomedia.rays import WATER, Orientation, image_rays, images_of
from musatpy.orientation.twomedia.sights import Sights, WaterPlane
from musatpy.orientation.twomedia.study import NOWHERE, SOLUTION, basins_of, precision_of
from orientation.twomedia.geometries import (
    HOUSE,
    KINDS,
    METHODS,
    A,
    B,
    control_of,
    geometry,
    level_of,
    scene,
    sights_of,
    truth_of,
)
from orientation.twomedia.test_methods import oriented


def level_sigma(result: Oriented) -> float:
    """Return the sigma of the level over the middle of the wet points, in heights of the cameras."""
    middle = np.append(result.points[result.sights.wet & ~result.outliers, :2].mean(axis=0), 1.0)
    return float(np.sqrt(middle @ result.covariance[-WATER:-1, -WATER:-1] @ middle)) / float(result.at.height)


def test_images_are_the_inverse_of_rays_where_the_water_is_higher() -> None:
    sights, rise = sights_of(geometry("lab", "COMBINED")), np.repeat([0.1, -0.2], 20)
    at, wet = truth_of(geometry("lab", "COMBINED")), sights.wet[sights.point]
    rays = image_rays(at, sights.photo, sights.image[None], wet, rise)
    images = images_of(at, sights.photo, rays.origin + 0.7 * rays.direction, wet, rise)
    np.testing.assert_allclose(images[0], sights.image, atol=1e-13)  # tangents: rounding


@pytest.mark.parametrize("method", ["SINGLE-FERMAT", "PAIR-INDEPENDENT", "COMBINED", "TRIPLET"])
def test_precision_of_the_geometry_at_hand_is_that_of_its_adjustment(method: str) -> None:
    result = oriented("lab", method)
    height = float(result.at.height)
    depth = result.at.water_at(result.points[None, :, :2])[0] - result.points[:, 2]
    precision = precision_of(result, np.array([depth.mean() / height]), np.zeros(1))
    assert precision.depth == pytest.approx(precision.depths[0])
    assert precision.at_hand == pytest.approx(level_sigma(result), rel=1e-6)  # normals of condition 1e5
    assert precision.sigma[0, 0] == pytest.approx(precision.at_hand, rel=1e-6)


def test_precision_at_another_depth_is_that_of_photos_taken_there() -> None:
    """Twice the depth under the same places, photographed anew."""
    true, result = geometry("lab", "SINGLE-RAY"), oriented("lab", "SINGLE-RAY")
    deeper = true.points.copy()
    deeper[:, 2] += true.points @ [A, B, 1.0] + level_of(true.kind)
    again = orient(
        sights_of(scene(true.kind, deeper, true.stations, true.angles), 20), METHODS["SINGLE-RAY"], WaterPlane()
    )
    at_hand = precision_of(result, np.ones(1), np.zeros(1))
    precision = precision_of(result, np.array([2.0 * at_hand.depth]), np.zeros(1))
    assert precision.sigma[0, 0] == pytest.approx(level_sigma(again), rel=1e-6)


def test_precision_with_dry_control_is_that_of_photos_of_it() -> None:
    """Six of twenty points raised over the same places, photographed anew; these six stand dry in every design."""
    true, result = geometry("lab", "SINGLE-RAY"), oriented("lab", "SINGLE-RAY")
    six = np.argsort(Draws(1).uniform("dry", 20))[:6]
    depth = true.points @ [A, B, 1.0] + level_of(true.kind)
    raised = true.points.copy()
    raised[six, 2] -= depth[six] + np.linspace(0.02, 0.25, 6) * min(float(result.at.height), 3.0 * depth.max())
    again = orient(
        sights_of(scene(true.kind, raised, true.stations, true.angles), 20), METHODS["SINGLE-RAY"], WaterPlane()
    )
    at_hand = precision_of(result, np.ones(1), np.zeros(1))
    precision = precision_of(result, np.array([at_hand.depth]), np.array([0.0, 0.3]))
    np.testing.assert_array_equal(precision.shares, [0.0, 0.3])
    assert precision.sigma[0, 1] == pytest.approx(level_sigma(again), rel=1e-6)
    assert (
        precision.sigma[0, 0] > 5.0 * precision.sigma[0, 1]
    )  # six dry ones in other places made d 13 times better
    of_dry = precision_of(
        again, np.array([depth[again.sights.wet].mean()]) / float(again.at.height), np.array([0.0, 0.5])
    )
    np.testing.assert_array_equal(of_dry.shares, [0.3, 0.5])
    assert of_dry.sigma[0, 0] == pytest.approx(of_dry.at_hand, rel=1e-6)


@pytest.mark.slow
def test_starts_near_the_solution_lead_to_it() -> None:
    """In axes whose origin is far away too: the error of the level is one over the points."""
    shift = np.array([300.0, -200.0, 5.0])
    true = geometry("lab", "SINGLE-RAY")
    sights = sights_of(true, 20)
    for moved in (sights, replace(sights, control=sights.control + shift)):
        basins = basins_of(orient(moved, METHODS["SINGLE-RAY"], WaterPlane()), np.array([0.0, 1.0]), 100)
        np.testing.assert_array_equal(basins.shares[0], [1.0, 0.0, 0.0])
        assert basins.shares[1, 0] >= 0.99
        assert not basins.errors[0].any()
        # 100 starts: 5 degrees, a tenth of the height and slopes of .05, +- three sigmas of a standard deviation
        spread = basins.errors[1].std(axis=0) / np.array([np.radians(5.0)] * 3 + [0.1] * 3 + [0.05, 0.05, 0.1, 1.0])
        np.testing.assert_allclose(spread, [1.0] * 9 + [0.0], atol=0.22)


def test_the_solution_is_the_truth_of_its_study_whatever_noise_and_priors_are() -> None:
    """A prior beside the truth, of the weight of the images: what fits it does not fit images without errors."""
    true = geometry("lab", "SINGLE-RAY")
    sights = sights_of(true, 20)
    noise = np.random.default_rng(3).normal(size=sights.image.shape) * sights.image_sigma
    plane = WaterPlane(level=float(truth_of(true).level[0]) + 0.003, level_sigma=0.003)
    result = orient(replace(sights, image=sights.image + noise), METHODS["SINGLE-RAY"], plane)
    np.testing.assert_array_equal(basins_of(result, np.zeros(1), 1).shares, [[1.0, 0.0, 0.0]])


@pytest.mark.slow
def test_other_solutions_are_told_apart() -> None:
    result = oriented("lab", "PAIR-INDEPENDENT")
    basins = basins_of(result, np.array([3.0]), 100)
    np.testing.assert_allclose(basins.shares.sum(axis=1), 1.0)
    assert basins.shares[0].min() > 0.0
    assert set(np.unique(basins.outcomes)) == {NOWHERE, SOLUTION, *range(1, len(basins.roots) + 1)}
    assert (basins.squares > 1.0).all()  # minima that do not fit, of images without errors
    exact = replace(result.problem, image=result.adjusted.image[0])
    again = adjust(exact, Orientation.of(basins.roots))
    assert again.converged.all()
    # the sigmas are those of the solution, the roots settle by their own
    assert (np.abs(again.at.vector - basins.roots) <= 1e-4 * result.sigma + 1e-9).all()


def straight(name: str, method: str) -> Sights:
    """Return the sights of a geometry through water that does not refract."""
    true, at = geometry(name, method), truth_of(geometry(name, method))
    sights = sights_of(true, control_of(METHODS[method]))
    gap = (true.points * HOUSE)[sights.point] - at.station[0, sights.photo]
    inside = np.einsum("nij,nj->ni", attitude_matrix(at.attitude[0])[sights.photo], gap)
    return replace(sights, image=-inside[:, :2] / inside[:, 2:])


def test_weakest_directions_of_one_photo_from_the_air():
    """Tilts of the photo against its place, and against the tilt of the water; as the correlations near 1 say."""
    result = orient(sights_of(geometry("aerial", "SINGLE-RAY"), 20), METHODS["SINGLE-RAY"], WaterPlane())
    assert [direction.words for direction in result.weakest] == [
        "phi with omega with X0 with Y0",
        "omega with phi with Y0 with X0",
    ]
    correlations = result.covariance[:9, :9] / np.outer(result.sigma[:9], result.sigma[:9])
    factors = inflation(result.adjusted, result.problem.unknown)
    assert factors[:9] == pytest.approx(np.diagonal(np.linalg.inv(correlations)), rel=1e-3)
    assert np.isnan(factors[9])
    assert 0.0 < result.weakest[0].eigenvalue < result.weakest[1].eigenvalue < 1e-4
    assert not result.free


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "equal"),
    [(name, False) for name in METHODS if name != "SINGLE-FERMAT"]
    + [("SINGLE-RAY", True), ("PAIR-SUCCESSIVE", True)],
)
def test_water_that_does_not_refract_leaves_its_plane_free(method, equal):
    """Three directions, of tilts and level alone: the photos keep the orientation of straight rays."""
    sights = straight("lab", method)
    result = orient(sights, METHODS[method], WaterPlane(index=1.0), KINDS["lab"].B, equal)
    free = np.array([direction.parts for direction in result.free])
    assert len(free) == 3
    assert np.abs(free[:, :-4]).max() < 1e-6  # of 1: rounding of normals of condition 1e3
    assert all({"tilt along X", "tilt along Y", "level"} >= set(d.words.split(" with ")) for d in result.free)
    assert result.verdict() == (PlaneVerdict.NOT, np.inf)
    unknown = result.problem.unknown[:-4]
    errors = (result.at.vector - truth_of(geometry("lab", method)).vector[0])[:-4][unknown]
    assert np.abs(errors).max() < 1e-9


def test_a_prior_holds_what_the_images_leave_free():
    sights = straight("lab", "PAIR-SUCCESSIVE")
    prior = WaterPlane(index=1.0, level=-2.0, level_sigma=0.01, slope_sigma=0.01)
    result = orient(sights, METHODS["PAIR-SUCCESSIVE"], prior, KINDS["lab"].B)
    assert not result.free
    assert result.verdict()[0] is PlaneVerdict.BY_PRIOR
