"""A job and its answer in the words of any system; decks of them are in `test_system_decks`."""

from functools import lru_cache

import numpy as np
import pytest

from musatpy.adjustment import adjust
from musatpy.geometry.rotations import attitude_matrix
from musatpy.geometry.systems import Geocentric
from musatpy.model import Solution
from musatpy.systems import Statement, entered, own_statement, stated, stated_solution
from reference.earth import earth_of
from systems.stated_jobs import CLARKE, coordinates, job, rays, reference_axes, statements, told

RAYS = 1e-9  # rad
POINTS = 1e-5  # m
NAMES = pytest.mark.parametrize(
    "name",
    [
        "geographic, matrices",
        "geocentric",
        "geocentric, azimuth",
        "tangent plane",
        "tangent plane, vertical",
        "UTM",
        "UTM, matrices",
        "UTM above a geoid",
        "feet",
    ],
)


@lru_cache
def answer() -> Solution:
    solution = adjust(job())
    assert solution.converged
    return solution


@NAMES
def test_stated_in_a_system(name, tmp_path):
    words = statements(tmp_path)[name]
    out, expected = stated(job(), words.statement), told(job(), words)
    # metres (feet): rounding of coordinates of 6e6; radians: the axes of the grid by differences
    np.testing.assert_allclose(out.block.photos.position, expected.block.photos.position, rtol=0, atol=5e-8)
    np.testing.assert_allclose(out.block.control.position, expected.block.control.position, rtol=0, atol=5e-8)
    np.testing.assert_allclose(out.block.photos.tide, expected.block.photos.tide, rtol=0, atol=1e-9)
    if words.statement.form is None:
        np.testing.assert_allclose(out.matrices, expected.matrices, rtol=0, atol=RAYS)
    else:
        turn = np.exp(1j * out.block.photos.attitude) - np.exp(1j * expected.block.photos.attitude)
        # tilts of a degree or two make azimuth and swing fifty times less sure than the rotation
        assert np.abs(turn).max() < 50.0 * RAYS
    assert out.warnings == ()


def test_a_geocentric_job_adjusts_as_it_is():
    solution = adjust(stated(job(), Statement(system=Geocentric(CLARKE))).block)
    assert solution.converged
    assert solution.sigma0 == pytest.approx(answer().sigma0, rel=1e-7)  # of residuals that agree to 1e-9 of a plate
    found, expected = (
        (
            rays(one.block, one.stations.position, one.stations.attitude, one.plates.residual),
            earth_of(one.block).cartesian(earth_of(one.block).native(one.points.position))
            + earth_of(one.block).origin,
        )
        for one in (solution, answer())
    )
    for values, wanted, most in zip(found, expected, (RAYS, POINTS), strict=True):
        np.testing.assert_allclose(values, wanted, rtol=0, atol=most)


def test_geocentric_jobs_are_stated_like_geographic_ones(tmp_path):
    geocentric = stated(job(), Statement(system=Geocentric(CLARKE))).block
    statement = statements(tmp_path)["UTM"].statement
    out, expected = stated(geocentric, statement).block, stated(job(), statement).block
    # steps of geocentric coordinates, and these over the radius of the earth
    np.testing.assert_allclose(out.photos.position, expected.photos.position, rtol=0, atol=5e-9)
    np.testing.assert_allclose(out.control.position, expected.control.position, rtol=0, atol=5e-9)
    np.testing.assert_allclose(out.photos.attitude, expected.photos.attitude, rtol=0, atol=1e-14)
    assert out.options.system == expected.options.system == job().options.system


@NAMES
def test_solution_in_a_system(name, tmp_path):
    """Positions by PROJ, attitudes by scipy's axes, and the points come back."""
    words = statements(tmp_path)[name]
    solution = answer()
    out = stated_solution(solution, words.statement)
    np.testing.assert_allclose(out.points, coordinates(job(), words, solution.points.position), rtol=0, atol=5e-8)
    np.testing.assert_allclose(
        out.position, coordinates(job(), words, solution.stations.position), rtol=0, atol=5e-8
    )
    for found, given in ((out.apparent, "apparent"), (out.predicted, "predicted")):
        expected = coordinates(job(), words, getattr(solution.bathymetric, given))
        np.testing.assert_allclose(found, expected, rtol=0, atol=5e-8)
    np.testing.assert_allclose(out.tide + words.undulation, solution.water.tide, rtol=0, atol=1e-12)
    axes = reference_axes(job(), words, solution.stations.position)
    M = attitude_matrix(solution.stations.attitude) @ earth_of(job()).frame(solution.stations.position)
    np.testing.assert_allclose(out.matrix, M @ axes.swapaxes(1, 2), rtol=0, atol=RAYS)


def test_the_own_words_of_a_job_change_nothing():
    block = job()
    again, warnings = entered(stated(block, own_statement(block)), own_statement(block))
    assert warnings == ()
    np.testing.assert_array_equal(again.photos.position, block.photos.position)
    np.testing.assert_allclose(again.photos.attitude, block.photos.attitude, rtol=0, atol=1e-15)  # one rounding
    own = stated_solution(answer(), own_statement(block))
    np.testing.assert_allclose(own.angles, answer().stations.attitude, rtol=0, atol=1e-15)
    # latitudes have 1.6e-7 rad to the metre
    sigma = np.sqrt(np.diagonal(own.covariance, axis1=1, axis2=2))
    ours = np.sqrt(np.diagonal(answer().stations.covariance, axis1=1, axis2=2))
    np.testing.assert_allclose(sigma[:, 2:], ours[:, 2:], rtol=1e-12)
    np.testing.assert_allclose(sigma[:, :2] * 6.37e6, ours[:, [1, 0]] * [1.0, 1.0 / np.cos(0.337)], rtol=0.01)
