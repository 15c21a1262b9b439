"""Rays and conditions of Okamoto and Mori (1974): partials, the axes of the paper, and limits."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.optimize import brentq

from musatpy.geometry.collinearity import scale_restraint
from musatpy.orientation.twomedia.helmert import HelmertProblem, adjust
from musatpy.orientation.twomedia.oriented import orient
from musatpy.orientation.twomedia.rays import (
    IMAGE,
    PHOTO,
    WATER,
    ConditionGroup,
    Orientation,
    image_rays,
    paper_partials,
    paper_vector,
)
from musatpy.orientation.twomedia.sights import PlaneTreatment, WaterPlane, problem_of
from orientation.twomedia.geometries import (
    ANGLES,
    HOUSE,
    KINDS,
    METHODS,
    A,
    B,
    N,
    Scene,
    control_of,
    geometry,
    points_of,
    rotation,
    scaled_errors,
    scene,
    sights_of,
    truth_of,
)

# --- the equations as they are printed, in the paper's own axes: Z down, (x, y, c) ---

Ray = tuple[np.ndarray, np.ndarray]


def refracted(ray: np.ndarray, C: np.ndarray, d: float, plane: tuple[float, float] = (A, B), n: float = N) -> Ray:
    """Return the point of the water Q and the refracted direction of a ray from C: (2) to (9)."""
    gradient = np.array([*plane, 1.0])
    normal, ray = gradient / np.linalg.norm(gradient), ray / np.linalg.norm(ray)
    cosine = ray @ normal
    bent = (ray - normal * (cosine - np.sqrt(n * n - 1.0 + cosine**2))) / n
    return C - (gradient @ C + d) / (gradient @ ray) * ray, bent


def ray_of(scene: Scene, photo: int, point: int) -> Ray:
    xy = scene.images[photo, point]
    return refracted(rotation(*scene.angles[photo]) @ [*xy, scene.kind.c], scene.stations[photo], scene.d)


def test_a_triplet_of_collinear_stations_is_regular():
    kind = KINDS["lab"]
    angles = ANGLES * [[1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]
    stations = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0)])
    true = scene(kind, points_of(kind, 13, 30, kind.B / 2, 3), stations, angles)
    result = orient(sights_of(true), METHODS["TRIPLET"], WaterPlane(), kind.B)
    assert scaled_errors(result.at, true).max() < 1e-9
    other = orient(sights_of(geometry("lab", "TRIPLET")), METHODS["TRIPLET"], WaterPlane(), kind.B)
    assert result.condition < 2.0 * other.condition


def test_a_point_on_the_flight_line_is_regular_in_the_dot_form():
    """Where components of X and Y, as printed, are 0/0: the rays lie in one vertical plane along X."""
    point, level = np.array([0.9, 0.0, 2.8]), 2.0
    rays = []
    for X in (0.0, 1.0, 2.0):
        C = np.array([X, 0.0, 0.0])

        def miss(tangent: float, C: np.ndarray = C) -> float:
            Q, bent = refracted(np.array([tangent, 0.0, 1.0]), C, -level, (0.0, 0.0))
            return float(Q[0] + (point[2] - level) * bent[0] / bent[2] - point[0])

        tangent = brentq(miss, -2.0, 2.0, xtol=1e-15)
        rays.append(refracted(np.array([tangent, 0.0, 1.0]), C, -level, (0.0, 0.0)))
    value, partials = scale_restraint(np.array([[ray[0] for ray in rays]]), np.array([[ray[1] for ray in rays]]))
    assert abs(value[0]) < 1e-12  # of 1 m over the sine of a parallax of a third of a radian
    assert np.isfinite(partials).all()
    assert np.abs(partials).max() < 100.0


@pytest.mark.parametrize("method", ["SINGLE-RAY", "PAIR-INDEPENDENT", "PAIR-SUCCESSIVE", "TRIPLET"])
def test_water_without_depth_is_none(method):
    """Points on the plane, flagged wet: the straight rays of their images meet there, and give the truth.

    (18)' has no way in water then, and says nothing.
    """
    base = geometry("lab", method)
    points = base.points.copy()
    points[:, 2] = -(A * points[:, 0] + B * points[:, 1] + base.d)
    true = scene(base.kind, points, base.stations, base.angles)
    at, sights = truth_of(true), sights_of(true, 20 if method == "SINGLE-RAY" else 0)
    sights = replace(sights, wet=np.ones(len(points), dtype=bool))
    slope = (float(at.slope[0, 0]), float(at.slope[0, 1]))
    water = WaterPlane(treatment=PlaneTreatment.KNOWN, slope=slope, level=float(at.level[0]))
    problem = problem_of(sights, METHODS[method], water)
    start = Orientation.of(
        at.vector + 1e-3 * np.random.default_rng(1).normal(size=at.vector.shape) * problem.unknown
    )
    adjusted = adjust(problem, start)
    assert adjusted.converged[0]
    assert scaled_errors(adjusted.at[0], true).max() < 1e-9


_STEP = 1e-6
_ROUNDING = 5e-9  # relative, of central differences with that step


def misclosures(
    problem: HelmertProblem, group: ConditionGroup, x: np.ndarray, image: np.ndarray, control: np.ndarray
):
    """Return the conditions of a group at some values."""
    at = Orientation.of(x)
    rays = image_rays(at, problem.photo, image, problem.wet, problem.rise)
    points = np.zeros((1, len(group.images), 3)) if group.control is None else control[:, group.control]
    return group.condition(rays[group.images], points, at)


def differences(function, x: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Return the central difference of a function of an array for a change of it."""
    return (function(x + _STEP * change).value - function(x - _STEP * change).value) / (2.0 * _STEP)


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_partials_of_the_conditions(method):
    rng = np.random.default_rng(2)
    scene = geometry("tank", method.name)
    problem = problem_of(sights_of(scene, control_of(method)), method, WaterPlane())
    wet = problem.wet.copy()
    if method.name != "SINGLE-FERMAT":  # of wet rays only
        wet[::5] = False
    problem = replace(problem, wet=wet, rise=0.02 * rng.normal(size=len(wet)))
    x = truth_of(scene).vector
    x = x + 0.01 * rng.normal(size=x.shape)
    image = problem.image[None] + 0.01 * rng.normal(size=problem.image.shape)
    control = problem.control[None] + 0.01 * rng.normal(size=problem.control.shape)
    for group in problem.groups:
        at = misclosures(problem, group, x, image, control)
        size = np.abs(at.by_rays).max()
        by_unknown = np.zeros((*at.value.shape, x.shape[1]))
        for ray, photo in enumerate(group.photos):
            by_unknown[..., PHOTO * photo : PHOTO * (photo + 1)] += at.by_rays[..., ray, :PHOTO]
            by_unknown[..., -WATER:] += at.by_rays[..., ray, PHOTO : PHOTO + WATER]
        by = partial(misclosures, problem, group)
        for column, change in enumerate(np.eye(x.shape[1])):
            numeric = differences(partial(by, image=image, control=control), x, change)
            np.testing.assert_allclose(by_unknown[..., column], numeric, atol=_ROUNDING * size)
        for ray in range(len(group.photos)):
            for axis in range(2):
                change = np.zeros_like(image)
                change[0, group.images[:, ray], axis] = 1.0
                numeric = differences(lambda v, by=by: by(x, v, control), image, change)
                by_image = at.by_rays[..., ray, IMAGE][..., axis]
                np.testing.assert_allclose(by_image, numeric, atol=_ROUNDING * size)
        for axis in range(3) if group.control is not None else ():
            change = np.broadcast_to(np.eye(3)[axis], control.shape)
            numeric = differences(partial(by, x, image), control, change)
            np.testing.assert_allclose(at.by_control[..., axis], numeric, atol=_ROUNDING * size)


def test_elements_in_the_axes_of_the_paper():
    """Those that a scene is made with; with partial derivatives by those of the house."""
    true = geometry("lab", "TRIPLET")
    true = replace(true, angles=np.random.default_rng(3).uniform(-1.2, 1.2, (3, 3)))
    at = truth_of(true)
    photos = np.concatenate([true.angles, true.stations], axis=1).ravel()
    np.testing.assert_allclose(paper_vector(at)[0], [*photos, A, B, true.d, N], atol=1e-14)
    J = paper_partials(at)
    for column, change in enumerate(_STEP * np.eye(22)):
        numeric = paper_vector(Orientation.of(at.vector + change)) - paper_vector(
            Orientation.of(at.vector - change)
        )
        np.testing.assert_allclose(J[..., column], numeric / (2.0 * _STEP), atol=1e-8)


def test_a_ray_as_the_paper_prints_it():
    """(2) to (9) in the paper's own axes against the ray of the house."""
    scene = geometry("lab", "PAIR-SUCCESSIVE")
    sights = sights_of(scene)
    rays = image_rays(truth_of(scene), sights.photo, sights.image[None], sights.wet[sights.point], np.zeros(40))
    for row, (photo, point) in enumerate(zip(sights.photo, sights.point, strict=True)):
        Q, bent = ray_of(scene, photo, point)
        np.testing.assert_allclose(rays.origin[0, row] * HOUSE, Q, atol=1e-12)
        np.testing.assert_allclose(rays.direction[0, row] * HOUSE, bent, atol=1e-12)


def test_only_wet_rays_need_water_below_them():
    """A photo turned to the sky shows dry points as any other, and no wet ones."""
    at = truth_of(geometry("lab", "SINGLE-RAY"))
    at = replace(at, attitude=at.attitude + np.radians([120.0, 0.0, 0.0]))
    wet = np.array([True, False])
    rays = image_rays(at, np.zeros(2, dtype=int), np.zeros((1, 2, 2)), wet, np.zeros(2))
    np.testing.assert_array_equal(rays.real, [~wet])
