"""The equations of the paper: partials, axes, and what is wrong as printed."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from adjustment.case_decks import load_case
from musatpy.geometry.collinearity import scale_restraint
from musatpy.orientation.twomedia.axes import from_paper, paper_partials, paper_vector
from musatpy.orientation.twomedia.conditions import Misclosure
from musatpy.orientation.twomedia.helmert import Group, adjust
from musatpy.orientation.twomedia.oriented import orient
from musatpy.orientation.twomedia.rays import PHOTO, WATER, Orientation, image_rays
from musatpy.orientation.twomedia.sights import Method, Plane, PlaneTreatment, Sights, problem_of
from orientation.twomedia.geometries import (
    ANGLES,
    KINDS,
    METHODS,
    A,
    B,
    N,
    control_of,
    geometry,
    points_of,
    scaled_errors,
    scene,
    sights_of,
    truth_of,
)


def refracted(
    ray: np.ndarray, C: np.ndarray, d: float, plane: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the point of the water Q and the refracted direction of a ray from C in the paper: (2) to (9)."""
    gradient = np.array([*plane, 1.0])
    normal, ray = gradient / np.linalg.norm(gradient), ray / np.linalg.norm(ray)
    cosine = ray @ normal
    bent = (ray - normal * (cosine - np.sqrt(N * N - 1.0 + cosine**2))) / N
    return C - (gradient @ C + d) / (gradient @ ray) * ray, bent


def test_a_triplet_of_collinear_stations_is_regular():
    kind = KINDS["lab"]
    angles = ANGLES * [[1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]
    stations = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0)])
    true = scene(kind, points_of(kind, 13, 30, kind.B / 2, 3), stations, angles)
    result = orient(sights_of(true), METHODS["TRIPLET"], Plane(), kind.B)
    assert scaled_errors(result.at, true).max() < 1e-9
    other = orient(sights_of(geometry("lab", "TRIPLET")), METHODS["TRIPLET"], Plane(), kind.B)
    assert result.condition < 2.0 * other.condition


def test_a_point_on_the_flight_line_is_regular_in_the_dot_form():
    """In components of X and Y it is 0/0, where the rays lie in one vertical plane along X."""
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


@pytest.mark.parametrize(("name", "digit"), [("mikhail", 1e-5), ("dewitt", 1e-4)])
def test_with_an_index_of_one_it_is_the_resection_in_air(name, digit):
    """All points a hundred metres deep in water of index 1, to the last printed digit of two examples."""
    case = load_case("resections")[name]
    rows = case["points_id_x_y_X_Y_Z"]
    count, control = len(rows), np.array([row[3:] for row in rows])
    sights = Sights(
        photos=np.array(["A"]),
        points=np.array([row[0] for row in rows]),
        photo=np.zeros(count, dtype=int),
        point=np.arange(count),
        image=np.array([row[1:3] for row in rows]) / case["f_mm"],
        image_sigma=np.full((count, 2), 0.02 / case["f_mm"]),
        wet=np.ones(count, dtype=bool),
        control=control,
        control_sigma=np.zeros((count, 3)),
    )
    water = Plane(treatment=PlaneTreatment.KNOWN, level=float(control[:, 2].max()) + 100.0, index=1.0)
    result = orient(sights, METHODS["SINGLE-RAY"], water)
    np.testing.assert_allclose(result.at.station[0], case["expected_XYZ"], atol=digit)


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
    water = Plane(treatment=PlaneTreatment.KNOWN, slope=slope, level=float(at.level[0]))
    problem = problem_of(sights, METHODS[method], water)
    start = Orientation.of(
        at.vector + 1e-3 * np.random.default_rng(1).normal(size=at.vector.shape) * problem.unknown
    )
    adjusted = adjust(problem, start)
    assert adjusted.converged[0]
    assert scaled_errors(adjusted.at[0], true).max() < 1e-9


_STEP = 1e-6


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_partials_by_the_unknowns(method: Method) -> None:
    """Those by images and control have what the referee says, IIIA."""
    true = geometry("tank", method.name)
    problem = problem_of(sights_of(true, control_of(method)), method, Plane())
    x = truth_of(true).vector + 0.01 * np.random.default_rng(2).normal(size=truth_of(true).vector.shape)
    for group in problem.groups:

        def conditions(x: np.ndarray, group: Group = group) -> Misclosure:
            at = Orientation.of(x)
            rays = image_rays(at, problem.photo, problem.image[None], problem.wet, problem.rise)
            points = np.zeros((1, 0, 3)) if group.control is None else problem.control[None, group.control]
            return group.condition(rays[group.images], points, at)

        by_rays, by_unknown = conditions(x).by_rays, 0.0
        for ray, photo in enumerate(group.photos):
            of_photo = np.eye(x.shape[1])[[*range(PHOTO * photo, PHOTO * (photo + 1)), *range(-WATER, 0)]]
            by_unknown = by_unknown + by_rays[..., ray, : PHOTO + WATER] @ of_photo
        sides = [[conditions(x + side * row).value for side in (_STEP, -_STEP)] for row in np.eye(x.shape[1])]
        numeric = np.stack([(one - other) / (2.0 * _STEP) for one, other in sides], axis=-1)
        np.testing.assert_allclose(by_unknown, numeric, atol=5e-9 * np.abs(by_rays).max())


def test_axes_of_the_paper_both_ways():
    rng = np.random.default_rng(3)
    photos, slope_level = rng.uniform(-1.2, 1.2, (5, 12)), rng.uniform(-0.2, 0.2, (5, 3))
    x = np.concatenate([photos, slope_level, np.full((5, 1), N)], axis=1)
    at = Orientation.of(x)
    np.testing.assert_allclose(from_paper(paper_vector(at)).vector, x, atol=1e-14)
    J = paper_partials(at)
    for column, change in enumerate(_STEP * np.eye(16)):
        numeric = paper_vector(Orientation.of(x + change)) - paper_vector(Orientation.of(x - change))
        np.testing.assert_allclose(J[..., column], numeric / (2.0 * _STEP), atol=1e-8)


def test_only_wet_rays_need_water_below_them():
    """A photo turned to the sky shows dry points as any other, and no wet ones."""
    at = truth_of(geometry("lab", "SINGLE-RAY"))
    at = replace(at, attitude=at.attitude + np.radians([120.0, 0.0, 0.0]))
    wet = np.array([True, False])
    rays = image_rays(at, np.zeros(2, dtype=int), np.zeros((1, 2, 2)), wet, np.zeros(2))
    np.testing.assert_array_equal(rays.real, [~wet])
