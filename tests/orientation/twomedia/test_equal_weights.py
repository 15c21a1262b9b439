"""EQUAL weights as printed: what is said of the estimate goes by the sigmas of the images all the same."""

from dataclasses import replace

import numpy as np
import pytest

from musatpy.model.options import PlaneTreatment
from musatpy.orientation.twomedia.helmert import adjust
from musatpy.orientation.twomedia.oriented import OrientationError, Oriented, PlaneVerdict, orient
from musatpy.orientation.twomedia.sights import WaterPlane, without
from orientation.twomedia.geometries import METHODS, control_of, geometry, sights_of, truth_of
from orientation.twomedia.test_methods import noisy


def oriented(method: str, *, equal: bool, seed: int = 1) -> Oriented:
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
    equal, full = (oriented(method, equal=weights) for weights in (True, False))
    assert (equal.sigma >= 0.95 * full.sigma).all() and (equal.sigma < 50.0 * full.sigma + 1e-12).all()
    assert equal.verdict(np.inf)[0] is full.verdict(np.inf)[0] is PlaneVerdict.DETERMINED
    if not equal.sights.is_control.any():
        assert np.nansum(equal.image_redundancy) == pytest.approx(equal.redundancy, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["PAIR-INDEPENDENT", "TRIPLET", "COMBINED"])
def test_squares_are_as_large_as_expected(method):
    """The mean of 30 draws within four of its standard deviations; those of the triplet have 3.7 degrees."""
    draws = [oriented(method, equal=True, seed=seed) for seed in range(30)]
    deviation = np.sqrt(2.0 / draws[0].expected[1] / len(draws))
    assert np.mean([result.sigma0**2 for result in draws]) == pytest.approx(1.0, abs=4.0 * deviation)
    assert np.mean([result.fits for result in draws]) > 0.95
