"""The methods of Okamoto and Mori (1974) on their geometries: the truth from nothing, sigmas, what is known."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from musatpy.geometry.similarity import fit
from musatpy.model.options import PlaneTreatment
from musatpy.orientation.twomedia.helmert import adjust, refined
from musatpy.orientation.twomedia.oriented import OrientationError, Oriented, PlaneVerdict, orient
from musatpy.orientation.twomedia.rays import paper_partials
from musatpy.orientation.twomedia.sights import (
    Sights,
    WaterPlane,
    problem_of,
    without,
)
from musatpy.units import ARC_SECOND
from orientation.twomedia.geometries import (
    HOUSE,
    KINDS,
    METHODS,
    control_of,
    geometry,
    scaled_errors,
    scene,
    sights_of,
    truth_of,
)

CASES = [
    pytest.param(name, method, marks=pytest.mark.slow) if name == "tank" else (name, method)
    for name in KINDS
    for method in METHODS
]


@cache
def oriented(name: str, method: str, treatment: PlaneTreatment = PlaneTreatment.ADJUST) -> Oriented:
    """Return the orientation of a noise-free geometry from nothing; what is held of the water is true."""
    true = geometry(name, method)
    at = truth_of(true)
    level = None if treatment is PlaneTreatment.ADJUST else float(at.level[0])
    slope = (0.0, 0.0) if level is None else (float(at.slope[0, 0]), float(at.slope[0, 1]))
    plane = WaterPlane(treatment=treatment, slope=slope, level=level)
    return orient(sights_of(true, control_of(METHODS[method])), METHODS[method], plane, true.kind.B)


def paper_sigmas(result: Oriented) -> np.ndarray:
    """Return the sigmas of phi, omega, kappa, X0, Y0, Z0 of each photo, a, b, d, N."""
    J = paper_partials(result.at)
    return np.sqrt(np.diagonal(J @ result.covariance @ J.T))


def noisy(sights: Sights, seed: int) -> Sights:
    """Return sights with errors of their sigmas."""
    rng = np.random.default_rng(seed)
    return replace(sights, image=sights.image + rng.normal(size=sights.image.shape) * sights.image_sigma)


@pytest.mark.parametrize(("name", "method"), CASES)
def test_the_truth_from_nothing(name, method):
    """No starting value: 1e-9 of the height and rad, the rounding of the weakest plane (from the air) included."""
    result, true = oriented(name, method), geometry(name, method)
    assert scaled_errors(result.at, true).max() < 1e-9
    np.testing.assert_allclose(result.points, true.points * HOUSE, atol=1e-9 * true.kind.H)
    # a sum of a hundred numbers whose normals have a condition of up to 1e6
    assert np.nansum(result.image_redundancy) == pytest.approx(result.redundancy, abs=1e-5)
    assert not result.outliers.any()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "method"),
    [(name, method) for name in KINDS for method in METHODS if name != "aerial" or not method.startswith("PAIR")],
)
def test_other_points_give_the_truth_from_nothing(name, method):
    """In all of five draws of the points, to 1e-9 of the height and rad, where the plane is determined."""
    for draw in range(1, 6):
        true = geometry(name, method, draw)
        result = orient(sights_of(true, control_of(METHODS[method])), METHODS[method], WaterPlane(), true.kind.B)
        assert scaled_errors(result.at, true).max() < 1e-9, draw


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "method", "treatment", "printed"),
    [
        ("lab", "SINGLE-RAY", "ADJUST", {"phi": 17.7, "X0": 0.000235, "Z0": 0.00080, "a": 0.000279, "d": 0.00279}),
        (
            "lab",
            "SINGLE-FERMAT",
            "ADJUST",
            {"phi": 17.7, "X0": 0.000235, "Z0": 0.00080, "a": 0.000279, "d": 0.00279},
        ),
        ("lab", "SINGLE-RAY", "KNOWN", {"phi": 14.8, "Z0": 0.0000635}),
        ("lab", "SINGLE-RAY", "LEVEL", {"Z0": 0.00060, "d": 0.00206}),
        ("lab", "PAIR-INDEPENDENT", "ADJUST", {"phi": 239.0, "d": 0.049}),
        ("lab", "PAIR-INDEPENDENT", "KNOWN", {"phi": 26.0}),
        ("lab", "PAIR-SUCCESSIVE", "ADJUST", {"phi2": 453.0, "d": 0.0407}),
        ("lab", "TRIPLET", "ADJUST", {"d": 0.0125}),
        ("aerial", "SINGLE-RAY", "ADJUST", {"phi": 269.0, "X0": 3.95, "d": 5.9}),
        ("aerial", "SINGLE-RAY", "KNOWN", {"phi": 21.0, "X0": 0.32, "Z0": 0.108}),
        ("aerial", "PAIR-INDEPENDENT", "ADJUST", {"d": 161.0}),
        ("aerial", "PAIR-SUCCESSIVE", "ADJUST", {"d": 88.0}),
        ("aerial", "COMBINED", "ADJUST", {"d": 9.7}),
        ("aerial", "TRIPLET", "ADJUST", {"d": 15.0}),
    ],
)
def test_sigmas_of_the_geometries(name, method, treatment, printed):
    """Sigmas for 5 um from another implementation, with numerical derivatives: within 5 %, as they are rounded."""
    sigmas = paper_sigmas(oriented(name, method, PlaneTreatment(treatment)))
    place = {"phi": 0, "X0": 3, "Z0": 5, "phi2": 6, "a": -4, "d": -2}
    for symbol, value in printed.items():
        unit = ARC_SECOND if symbol.startswith("phi") else 1.0
        assert sigmas[place[symbol]] / unit == pytest.approx(value, rel=0.05), symbol


@pytest.mark.parametrize("name", KINDS)
def test_fermat_is_the_refracted_ray(name):
    sights = noisy(sights_of(geometry(name, "SINGLE-RAY"), 20), 1)
    ray, path = (orient(sights, METHODS[method], WaterPlane()) for method in ("SINGLE-RAY", "SINGLE-FERMAT"))
    unknown = ray.sigma > 0.0
    difference = (ray.at.vector - path.at.vector)[unknown] / ray.sigma[unknown]
    assert np.abs(difference).max() < 1e-7  # the images settle to 1e-7 of their sigmas, at a fourth a step
    np.testing.assert_allclose(ray.sigma, path.sigma, rtol=1e-6)


def test_both_pairs_are_one_model():
    sights = noisy(sights_of(geometry("lab", "PAIR-SUCCESSIVE")), 5)
    first, second = (
        orient(sights, METHODS[method], WaterPlane()) for method in ("PAIR-INDEPENDENT", "PAIR-SUCCESSIVE")
    )
    similarity = fit(first.points, second.points, np.ones(20))
    sigma = np.sqrt(np.diagonal(second.point_covariance(), axis1=1, axis2=2))
    assert np.abs((similarity.apply(first.points) - second.points) / sigma).max() < 1e-6
    assert first.adjusted.squares[0] == pytest.approx(second.adjusted.squares[0], rel=1e-9)


def test_verdicts():
    assert oriented("lab", "SINGLE-RAY").verdict()[0] is PlaneVerdict.DETERMINED
    assert oriented("lab", "SINGLE-RAY", PlaneTreatment.LEVEL).verdict()[0] is PlaneVerdict.DETERMINED
    assert oriented("lab", "SINGLE-RAY", PlaneTreatment.KNOWN).verdict()[0] is PlaneVerdict.HELD
    for method in ("PAIR-INDEPENDENT", "PAIR-SUCCESSIVE", "TRIPLET"):
        assert oriented("aerial", method).verdict()[0] is PlaneVerdict.NOT
    level = float(truth_of(geometry("aerial", "SINGLE-RAY")).level[0])
    prior = WaterPlane(level=level, level_sigma=0.1, slope_sigma=0.0001, slope=(0.03, 0.02))
    result = orient(sights_of(geometry("aerial", "SINGLE-RAY"), 20), METHODS["SINGLE-RAY"], prior)
    assert result.verdict()[0] is PlaneVerdict.BY_PRIOR


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_sigmas_are_those_of_the_errors_of_all_images(method):
    """Solutions of perfect images but one, each off by a hundredth of its sigma: squares add up to the variances.

    Those of the residuals add up to the redundancy. The second order of so small errors is 5e-6 of the sigmas.
    """
    true = geometry("lab", method)
    problem = problem_of(sights_of(true, control_of(METHODS[method])), METHODS[method], WaterPlane())
    truth, unknown = refined(problem, truth_of(true)), problem.unknown
    T = truth.directions[0]
    sigma = np.sqrt(np.diagonal(T @ np.linalg.inv(truth.normals[0]) @ T.T)[unknown])
    changes, squares = [], 0.0
    for image, axis in np.ndindex(problem.image.shape):
        off = problem.image.copy()
        off[image, axis] += 0.01 * problem.image_sigma[image, axis]
        result = refined(replace(problem, image=off), truth.at)
        assert result.converged[0]
        changes.append((result.at.vector - truth.at.vector)[0, unknown] / 0.01)
        squares += result.squares[0] / 0.01**2
    np.testing.assert_allclose(np.sqrt(np.sum(np.square(changes), axis=0)), sigma, rtol=1e-5)
    assert squares == pytest.approx(oriented("lab", method).redundancy, rel=1e-5)


def test_tides_under_the_photos_are_levels_of_their_own():
    """Two photos whose water stands .1 m higher or .2 m lower than the level: the level comes back, not theirs."""
    true, tides = geometry("lab", "COMBINED"), np.array([0.1, -0.2])
    at, sights = truth_of(true), sights_of(true, 20)
    images = sights.image.copy()
    for photo, tide in enumerate(tides):
        raised = scene(replace(true.kind, H=true.kind.H - tide), true.points, true.stations, true.angles)
        images[sights.photo == photo] = sights_of(raised).image[sights.photo == photo]
    result = orient(replace(sights, image=images), METHODS["COMBINED"], WaterPlane(rise=tides))
    assert np.abs(result.at.vector - at.vector[0]).max() < 1e-9


def test_a_prior_of_the_level_is_one_more_observation():
    """It pulls the level by the share of the variances, and leaves its squares; the shift is small, so linear."""
    sights = sights_of(geometry("lab", "SINGLE-RAY"), 20)
    free = oriented("lab", "SINGLE-RAY")
    sigma, level = float(free.sigma[-2]), float(free.at.level)
    result = orient(sights, METHODS["SINGLE-RAY"], WaterPlane(level=level + 0.1 * sigma, level_sigma=sigma))
    assert float(result.at.level) - level == pytest.approx(0.05 * sigma, rel=1e-3)
    assert result.adjusted.squares[0] == pytest.approx(0.1**2 / 2.0, rel=1e-3)
    assert result.redundancy == free.redundancy + 1


@pytest.mark.parametrize(
    ("method", "unseen", "redundancy"),
    [
        ("COMBINED", ((0, 1), (1, 0)), 4 * 3 + 2 * 2 + 15 - 15),
        ("TRIPLET", ((0, 1), (1, 0), (2, 2)), 3 * 27 + 3 - 14),
    ],
)
def test_points_that_not_all_photos_show_count_where_they_are_seen(method, unseen, redundancy):
    """Points 0, 1, ... hidden on a photo each; of COMBINED control, five points of which both photos show three."""
    true = geometry("lab", method)
    sights = sights_of(true, 5 if method == "COMBINED" else 0)
    seen = ~np.any([(sights.point == point) & (sights.photo == photo) for point, photo in unseen], axis=0)
    images = {name: getattr(sights, name)[seen] for name in ("photo", "point", "image", "image_sigma")}
    result = orient(replace(sights, **images), METHODS[method], WaterPlane(), true.kind.B)
    assert result.redundancy == redundancy
    assert scaled_errors(result.at, true).max() < 1e-9


def test_residuals_and_test_values_of_a_small_error():
    """Adjusted less measured: an error goes into it by its redundancy number, into the test value by the root."""
    true, image, axis = geometry("lab", "COMBINED"), 7, 1
    clean = sights_of(true, 8)
    error = np.zeros_like(clean.image)
    error[image, axis] = 0.01 * clean.image_sigma[image, axis]
    result = orient(replace(clean, image=clean.image + error), METHODS["COMBINED"], WaterPlane())
    r = result.image_redundancy[image, axis]
    assert 0.1 < r < 0.9
    assert result.image_residuals[image, axis] == pytest.approx(-r * error[image, axis], rel=1e-3)
    assert result.normalised_residuals[image, axis] == pytest.approx(-0.01 * np.sqrt(r), rel=1e-3)


def of_noise(method: str, *, equal: bool, seed: int = 1) -> Oriented:
    """Return the orientation of noisy sights, from nothing."""
    true = geometry("lab", method)
    sights = noisy(sights_of(true, control_of(METHODS[method])), seed)
    return orient(sights, METHODS[method], WaterPlane(), true.kind.B, equal=equal)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["SINGLE-RAY", "PAIR-SUCCESSIVE"])
def test_equal_weights_propagate_the_errors_of_the_images(method):
    """The covariance against that of solutions with each image moved by a tenth of its sigma, one by one."""
    true = geometry("lab", method)
    sights = without(sights_of(true, control_of(METHODS[method])), np.arange(20) >= 10)
    result = orient(sights, METHODS[method], WaterPlane(), true.kind.B, equal=True)
    changes = []
    for image, axis in np.ndindex(sights.image.shape):
        error = np.zeros_like(sights.image)
        error[image, axis] = 0.1 * sights.image_sigma[image, axis]
        ends = [
            adjust(replace(result.problem, image=sights.image + sign * error), truth_of(true)).at.vector[0]
            for sign in (1.0, -1.0)
        ]
        changes.append((ends[0] - ends[1]) / 0.2)
    np.testing.assert_allclose(result.sigma, np.sqrt(np.sum(np.square(changes), axis=0)), rtol=1e-3, atol=1e-12)


def test_equal_weights_have_no_measure_for_what_is_known_of_the_water():
    true = geometry("lab", "SINGLE-RAY")
    sights = sights_of(true, 20)
    slope = (float(truth_of(true)[0].slope[0]), float(truth_of(true)[0].slope[1]))
    tide = WaterPlane(treatment=PlaneTreatment.LEVEL, slope=slope, level=true.d, level_sigma=1e-3)
    with pytest.raises(OrientationError, match=r"EQUAL weights of conditions .* \(TID, WTR\): FULL has"):
        orient(sights, METHODS["SINGLE-RAY"], tide, equal=True)
    held = replace(tide, treatment=PlaneTreatment.KNOWN, slope_sigma=1e-4)
    assert orient(sights, METHODS["SINGLE-RAY"], held, equal=True).sigma.any()


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_no_weights_are_better_than_those_of_the_images(method):
    """Gauss and Markov: no sigma is smaller, but for solutions that are sigmas apart; and all is said of them."""
    equal, full = (of_noise(method, equal=weights) for weights in (True, False))
    assert (equal.sigma >= 0.95 * full.sigma).all() and (equal.sigma < 50.0 * full.sigma + 1e-12).all()
    assert equal.verdict(np.inf)[0] is full.verdict(np.inf)[0] is PlaneVerdict.DETERMINED
    if not equal.sights.is_control.any():
        assert np.nansum(equal.image_redundancy) == pytest.approx(equal.redundancy, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["PAIR-INDEPENDENT", "TRIPLET", "COMBINED"])
def test_squares_are_as_large_as_expected(method):
    """The mean of 15 draws within four of its standard deviations; those of the triplet have 3.7 degrees."""
    draws = [of_noise(method, equal=True, seed=seed) for seed in range(15)]
    deviation = np.sqrt(2.0 / draws[0].expected[1] / len(draws))
    assert np.mean([result.sigma0**2 for result in draws]) == pytest.approx(1.0, abs=4.0 * deviation)
    assert np.mean([result.fits for result in draws]) > 0.95
