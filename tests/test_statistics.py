"""The statistics of a solution and its tests, against plain numpy, loops, scipy.stats and PROJ."""

import dataclasses
import math

import numpy as np
import pyproj
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from altered import altered
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import ControlKind, CoordinateSystem, ObservationKind, PlateResiduals
from musatpy.probability import probability_beyond, quantile
from musatpy.statistics import Statistics, difference_statistics, metric_differences
from musatpy.statistics.analyses import ellipses
from musatpy.statistics.quality import ALPHA, BETA, DETECTABLE, TEST_LIMIT, check_test, chi_square
from musatpy.units import ARC_SECOND, DEGREE
from sample_solutions import sample_solution

SYSTEMS = list(CoordinateSystem)
NUMBERS = st.lists(st.floats(-1e6, 1e6).filter(lambda x: x == 0 or abs(x) > 1e-6), min_size=2, max_size=50)


@settings(max_examples=40)
@given(NUMBERS)
def test_definitions_are_those_of_numpy(numbers):
    d = np.array(numbers)
    found = difference_statistics(d, [f"P{row}" for row in range(len(d))])
    # numpy adds pairwise where we add exactly: 50 numbers of 1e6 differ by less than 1e-8.
    assert found.size == len(d)
    assert found.sum == pytest.approx(d.sum(), abs=1e-8)
    assert found.mean == pytest.approx(d.mean(), abs=1e-8)
    assert found.rms == pytest.approx(np.sqrt(np.mean(d**2)), rel=1e-12)
    assert found.deviation == pytest.approx(d.std(ddof=1), rel=1e-9, abs=1e-8)
    # the first of those that are equal in six digits, which can differ by a unit of the last one
    assert abs(found.maximum) == pytest.approx(np.abs(d).max(), rel=1e-5)
    assert found.maximum == d[int(found.maximum_id[1:])]


@pytest.mark.parametrize(
    ("sample", "expected"),
    [
        ([1.0, -3.0, 2.0], {"maximum": -3.0, "maximum_id": "B"}),
        ([math.nan, 2.0, 4.0], {"size": 2, "sum": 6.0, "mean": 3.0, "maximum_id": "C"}),
        ([999999.5, 1000000.0, -5.0], {"maximum": 999999.5, "maximum_id": "A"}),
        ([2.0], {"mean": 2.0, "rms": 2.0, "deviation": math.nan}),
        (
            [],
            {"size": 0, "sum": 0.0, "maximum_id": "", "mean": math.nan, "rms": math.nan, "maximum": math.nan},
        ),
    ],
    ids=[
        "the maximum keeps its sign",
        "missing ones are left out",
        "the first of equal ones",
        "one has no deviation",
        "none",
    ],
)
def test_small_samples(sample, expected):
    found = difference_statistics(sample, list("ABC")[: len(sample)])
    for name, value in expected.items():
        got = getattr(found, name)
        assert got == value or (math.isnan(value) and math.isnan(got)), name


def test_attitude_differences_do_not_jump_at_half_a_turn():
    solution = sample_solution()
    photos = dataclasses.replace(solution.block.photos, attitude=np.full((10, 3), 179.99 * DEGREE))
    solution = altered(
        solution, block={"photos": photos}, stations={"attitude": np.full((10, 3), -179.98 * DEGREE)}
    )
    for found in Statistics(solution).station_attitudes.statistics:
        assert found.mean == pytest.approx(0.03 * DEGREE, abs=1e-14)  # rounding of pi
        assert found.size == 10


@pytest.mark.parametrize("system", SYSTEMS)
def test_station_positions_are_adjusted_minus_initial_in_the_system_of_the_job(system):
    solution = sample_solution(system)
    analysis = Statistics(solution).station_positions
    difference = solution.stations.position - solution.block.photos.position
    np.testing.assert_array_equal(analysis.differences, difference)
    units = ("rad", "rad", "m") if system is CoordinateSystem.GEOGRAPHIC else ("m", "m", "m")
    assert analysis.units == units
    assert [found.size for found in analysis.statistics] == [10, 10, 10]


@pytest.mark.parametrize("system", SYSTEMS)
def test_ground_points_sample_what_was_known(system):
    """Seven horizontal and 35 vertical points; the full point of the sample solution has no position."""
    analysis = Statistics(sample_solution(system)).ground_points
    assert [found.size for found in analysis.statistics] == [7, 7, 35]


def test_ground_points_include_full_control():
    solution = sample_solution()
    kind = solution.block.control.kind.copy()
    kind[40] = ControlKind.FULL
    position = solution.block.control.position.copy()
    position[40, :2] = solution.points.position[solution.block.control.point[40], :2]
    control = dataclasses.replace(solution.block.control, kind=kind, position=position)
    solution = altered(solution, block={"control": control})
    assert [found.size for found in Statistics(solution).ground_points.statistics] == [8, 8, 35]


def test_metric_differences_are_those_of_proj():
    ellipsoid = Ellipsoid("clrk66")
    block = sample_solution().block
    given = np.array([[19.3 * DEGREE, -81.2 * DEGREE, 12.0]])
    adjusted = np.array([[19.3001 * DEGREE, -81.1999 * DEGREE, 15.0]])
    topocentric = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +proj=cart +ellps=clrk66 "
        "+step +proj=topocentric +ellps=clrk66 +lat_0=19.3 +lon_0=-81.2 +h_0=12"
    )
    east, north, up = topocentric.transform(-81.1999 * DEGREE, 19.3001 * DEGREE, 15.0, radians=True)
    found = metric_differences(block, given, adjusted)
    np.testing.assert_allclose(found, [[east, north, up]], atol=1e-8)  # 1e-9 m in coordinates of 6e6 m
    moved = ellipsoid.geocentric(adjusted) - ellipsoid.geocentric(given)
    assert np.linalg.norm(found) == pytest.approx(np.linalg.norm(moved), rel=1e-12)


def test_a_component_that_is_not_given_takes_no_part():
    block = sample_solution().block
    here = np.array([19.3 * DEGREE, -81.2 * DEGREE, 12.0])
    adjusted = np.tile(here, (2, 1)) + np.array([ARC_SECOND, ARC_SECOND, 500.0])
    found = metric_differences(block, np.array([[*here[:2], np.nan], [np.nan, np.nan, here[2]]]), adjusted)
    # One arc second at the height of the adjusted point: (M + h) and (N + h) cos(latitude) of Clarke 1866.
    e2 = 0.006768657997291
    W = math.sqrt(1.0 - e2 * math.sin(here[0]) ** 2)
    north = (6378206.4 * (1.0 - e2) / W**3 + 512.0) * ARC_SECOND
    east = (6378206.4 / W + 512.0) * math.cos(here[0]) * ARC_SECOND
    np.testing.assert_allclose(found[0, :2], [east, north], rtol=1e-5)  # curvature over 30 m
    assert np.isnan(found[0, 2])
    assert np.isnan(found[1, :2]).all()
    assert found[1, 2] == pytest.approx(500.0, abs=1e-8)


def test_plate_statistics_against_a_loop():
    solution = sample_solution()
    plates = Statistics(solution).plates
    photo, residual = solution.block.plates.photo, solution.plates.residual
    for frame in range(10):
        for kind, keep in enumerate(((True,), (False,), (True, False))):
            rows = [
                row
                for row in range(len(photo))
                if photo[row] == frame
                and solution.plates.triangulated[row] in keep
                and residual[row, 0] == residual[row, 0]
            ]
            assert plates.count[frame, kind] == len(rows)
            if not rows:
                assert np.isnan(plates.rms[frame, kind]).all()
                continue
            rms = [math.sqrt(sum(residual[row, axis] ** 2 for row in rows) / len(rows)) for axis in (0, 1)]
            np.testing.assert_allclose(plates.rms[frame, kind], rms, rtol=1e-12)  # order of summation
    assert np.isnan(residual).any()  # the sample has a point without position
    np.testing.assert_array_equal(plates.total_count, plates.count.sum(axis=0))
    size = np.hypot(*np.moveaxis(plates.rms, -1, 0))
    assert plates.largest == tuple(np.nanargmax(size, axis=0))


def test_a_kind_without_points_has_no_largest_frame():
    solution = sample_solution()
    m = len(solution.plates.residual)
    residual = np.where(solution.block.plates.photo[:, None] == 4, 0.02, 0.01) * np.ones((m, 2))
    plates = PlateResiduals(residual=residual, triangulated=np.ones(m, dtype=bool), correction=np.zeros((m, 2)))
    found = Statistics(dataclasses.replace(solution, plates=plates)).plates
    assert found.largest == (4, -1, 4)
    assert np.isnan(found.total_rms[1]).all()


@pytest.mark.parametrize(
    "of", [lambda one: one.check_points.differences, lambda one: one.bathymetric_xyz], ids=["metres", "XYZ"]
)
def test_metres_are_the_same_in_every_system(of):
    """The same ground in geographic and geocentric coordinates; bathymetric points are geocentric in both."""
    systems = (CoordinateSystem.GEOGRAPHIC, CoordinateSystem.GEOCENTRIC)
    geographic, geocentric = (of(Statistics(sample_solution(system))) for system in systems)
    np.testing.assert_allclose(geographic, geocentric, atol=1e-8)  # 1e-9 m in coordinates of 6e6 m


@pytest.mark.parametrize("system", SYSTEMS)
def test_level_differences_are_heights_minus_the_level(system):
    solution = sample_solution(system)
    heights = solution.points.position[solution.block.equal_elevations.point]
    if system is CoordinateSystem.GEOCENTRIC:
        heights = Ellipsoid("clrk66").geographic(heights)
    np.testing.assert_array_equal(Statistics(solution).level_differences, heights[:, 2] - 0.113)


def test_limits_of_a_variance_factor() -> None:
    found = chi_square(31.0, 24.0)
    assert found.factor == pytest.approx(31.0 / 24.0)
    np.testing.assert_allclose([found.low, found.high], stats.chi2.ppf([0.025, 0.975], 24.0) / 24.0)
    assert found.accepted
    assert not chi_square(60.0, 24.0).accepted
    assert not chi_square(5.0, 24.0).accepted


def test_baardas_constants() -> None:
    assert pytest.approx(stats.norm.ppf(1.0 - ALPHA / 2.0), abs=1e-12) == TEST_LIMIT
    assert pytest.approx(TEST_LIMIT + stats.norm.ppf(BETA), abs=1e-12) == DETECTABLE
    assert pytest.approx(4.13, abs=5e-3) == DETECTABLE  # as printed by Baarda (1968)


@pytest.mark.parametrize("freedom", [0.05, 0.5, 1.0, 2.0, 3.0, 7.3, 24.0, 171.0, 2500.0, 130000.0])
def test_chi_square_is_that_of_the_library(freedom: float) -> None:
    for p in (1e-3, 0.025, 0.3, 0.5, 0.9, 0.975, 0.999):
        # near 1e-12 the logarithms of large numbers have no more digits
        assert quantile(p, freedom) == pytest.approx(stats.chi2.ppf(p, freedom), rel=1e-9)
        squares = float(stats.chi2.ppf(p, freedom))
        assert probability_beyond(squares, freedom) == pytest.approx(1.0 - p, rel=1e-9)
    assert probability_beyond(0.0, freedom) == 1.0


def test_test_values_are_students_of_the_residual_without_itself() -> None:
    quality = Statistics(sample_solution())
    f = quality.solution.degrees_of_freedom
    tau = quality.standardised / quality.solution.sigma0
    np.testing.assert_allclose(quality.test, tau * np.sqrt((f - 1) / (f - tau**2)))
    assert np.isnan(quality.test[0])  # of no redundancy
    order = np.abs(quality.test[quality.worst_first])
    assert (np.diff(np.round(order[np.isfinite(order)], 2)) <= 0.0).all()  # as they are printed
    assert np.isnan(order[-1])


def test_variance_components_share_out_the_squares() -> None:
    quality = Statistics(sample_solution())
    observed = quality.observed
    squares = np.square(observed.residual / observed.sigma).sum()
    total = sum(one.factor * one.redundancy for one in quality.components.values())
    assert total == pytest.approx(squares)


def test_check_points_against_their_covariance() -> None:
    rng = np.random.default_rng(2)
    root = rng.normal(size=(4000, 3, 3))
    covariance = root @ np.swapaxes(root, 1, 2)
    difference = np.einsum("cij,cj->ci", root, rng.normal(size=(4000, 3)))
    difference[::2, 2] = np.nan
    found = check_test(np.arange(4000), difference, covariance)
    assert found.components.tolist() == [2, 3] * 2000
    # right probabilities are evenly spread; the limit is that of a sample of 4000 at one in a thousand
    assert stats.kstest(found.probability, "uniform").pvalue > 1e-3
    assert found.total is not None and found.total.accepted
    assert not check_test(np.arange(4000), 2.0 * difference, covariance).total.accepted
    covariance[3] = np.nan
    assert check_test(np.arange(4000), difference, covariance).components[3] == 0


def test_ellipses_have_the_axes_of_the_covariance() -> None:
    angle, a, b = 0.7, 3.0, 1.0  # bearing from north
    along = np.array([np.sin(angle), np.cos(angle), 0.0])
    across = np.array([np.cos(angle), -np.sin(angle), 0.0])
    C = a**2 * np.outer(along, along) + b**2 * np.outer(across, across)
    C[2, 2] = 4.0
    found = ellipses(C[None])
    np.testing.assert_allclose([found.major[0], found.minor[0], found.bearing[0]], [a, b, angle])
    assert found.vertical[0] == 2.0
    assert np.isnan(ellipses(np.full((1, 3, 3), np.nan)).major[0])


def test_control_has_the_tests_of_its_observations() -> None:
    statistics = Statistics(sample_solution())
    observed, rows = statistics.observed, statistics.control_tests
    control = np.flatnonzero(observed.kind == ObservationKind.CONTROL)
    assert len(control) and np.count_nonzero(np.isfinite(rows)) == len(control)
    for row in control.tolist():
        test = rows[observed.row[row], observed.component[row]]
        share = observed.residual[row] / observed.sigma[row] / np.sqrt(observed.redundancy[row])
        assert np.sign(test) == np.sign(share) and abs(test) >= abs(share) - 1e-12


def test_an_estimated_error_is_what_the_others_say_of_an_observation() -> None:
    """An observation that is left out has the residual v / r, with the sign of adjusted minus observed."""
    statistics = Statistics(sample_solution())
    observed, error = statistics.observed, statistics.estimated_error
    known = statistics.testable
    np.testing.assert_allclose(error[known], -observed.residual[known] / observed.redundancy[known])
    assert np.isnan(error[~known]).all()
