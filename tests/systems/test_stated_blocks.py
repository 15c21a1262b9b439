"""What is refused, what is said, and what becomes of sigmas and covariances when a job is stated elsewhere."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from altered import altered, put
from musatpy import model
from musatpy.adjustment import adjust
from musatpy.errors import SystemsError
from musatpy.geometry.collinearity import AngleForm, matrix_of
from musatpy.geometry.projected import Geoid, Projected
from musatpy.geometry.systems import Geocentric, Geographic, LocalRectangular, TangentPlane
from musatpy.systems import Axes, Sigmas, Stated, Statement, entered, stated, stated_solution
from musatpy.systems.statement import attitudes_in, attitudes_out
from musatpy.units import DEGREE
from systems.stated_jobs import CLARKE, ORIGIN, coordinates, job, level_geoid, statements, told

UTM = Projected("EPSG:26717", CLARKE)
PLANE = TangentPlane(CLARKE, ORIGIN)


def with_control(block, **changes):
    return replace(block, control=replace(block.control, **changes))


def with_photos(block, **changes):
    return replace(block, photos=replace(block.photos, **changes))


def blank(array, *places):
    out = np.array(array)
    for place in places:
        out[place] = np.nan
    return out


class TestSigmas:
    def test_of_the_system_come_back(self):
        """Equal sigmas in the plane stay uncorrelated in the grid; those of attitudes nearly so."""
        statement = Statement(system=UTM, axes=Axes.SYSTEM, sigmas=Sigmas.SYSTEM)
        out = stated(job(), statement)
        scale = UTM.jacobian(job().control.position)[:, :2, :2]
        expected = 0.05 * np.linalg.norm(scale, axis=2)  # conformal: each coordinate by its own row
        np.testing.assert_allclose(out.block.control.sigma[:, :2], expected, rtol=1e-9)
        np.testing.assert_array_equal(out.block.control.sigma[:, 2], 0.05)
        back, _ = entered(out, statement)
        # correlations of the attitudes of up to 0.1 are left out twice: 1 percent each
        np.testing.assert_allclose(back.photos.attitude_sigma, job().photos.attitude_sigma, rtol=0.02)
        # the rates of a map are differences, good to some 1e-12
        np.testing.assert_allclose(back.photos.position_sigma, job().photos.position_sigma, rtol=2e-11)
        np.testing.assert_allclose(back.control.sigma, job().control.sigma, rtol=2e-11)

    def test_equal_ones_stay_in_a_plane_and_unequal_lean_a_little(self):
        statement = Statement(system=PLANE, sigmas=Sigmas.SYSTEM)
        equal = stated(job(), statement)
        np.testing.assert_allclose(equal.block.control.sigma, 0.05, rtol=1e-12)
        assert equal.warnings == ()
        poor = with_control(job(), sigma=np.full(job().control.sigma.shape, 0.05) * [1.0, 1.0, 30.0])
        out = stated(poor, statement)
        assert [str(warning) for warning in out.warnings] and "are left out" in str(out.warnings[0])

    def test_what_is_not_observed_stays_so(self):
        block = with_control(job(), sigma=blank(job().control.sigma, (0, 2), (1, slice(0, 2)), 2))
        block = with_photos(block, position_sigma=blank(block.photos.position_sigma, 0))
        for system in (UTM, Geographic(CLARKE)):
            statement = Statement(system=system, sigmas=Sigmas.SYSTEM)
            out = stated(block, statement)
            np.testing.assert_array_equal(np.isnan(out.block.control.sigma), np.isnan(block.control.sigma))
            back, _ = entered(out, statement)
            # the rates of a map are differences, good to some 1e-12
            np.testing.assert_allclose(back.control.sigma, block.control.sigma, rtol=2e-11)
            np.testing.assert_allclose(back.photos.position_sigma, block.photos.position_sigma, rtol=2e-11)

    def test_local_ones_are_left_alone(self):
        out = stated(job(), Statement(system=Geocentric(CLARKE), axes=Axes.GEOCENTRIC))
        np.testing.assert_array_equal(out.block.control.sigma, job().control.sigma)
        np.testing.assert_array_equal(out.block.photos.attitude_sigma, job().photos.attitude_sigma)


@lru_cache
def answer():
    return adjust(job())


@pytest.mark.parametrize("name", ["geocentric, azimuth", "tangent plane", "UTM", "feet", "UTM above a geoid"])
def test_covariances_of_stations(name, tmp_path):
    """The derivatives of the whole statement, made by PROJ and scipy, by central differences."""
    words, solution = statements(tmp_path)[name], answer()
    stations = solution.stations
    at = with_photos(job(), position=stations.position, attitude=stations.attitude)
    rates = np.zeros((len(stations.position), 6, 6))
    a, b = CLARKE.axes
    latitude = stations.position[:, 0]
    w2 = 1.0 - (1.0 - (b / a) ** 2) * np.sin(latitude) ** 2
    height = stations.position[:, 2]
    per_metre = np.zeros((3, len(latitude), 3))
    per_metre[0, :, 1] = 1.0 / ((a / np.sqrt(w2) + height) * np.cos(latitude))
    per_metre[1, :, 0] = 1.0 / (b * b / a / w2**1.5 + height)
    per_metre[2, :, 2] = 1.0
    for i in range(3):
        ends = [coordinates(job(), words, stations.position + sign * 20.0 * per_metre[i]) for sign in (1, -1)]
        rates[:, :3, i] = (ends[0] - ends[1]) / 40.0
        turn = 1e-5 * np.eye(3)[i]
        ends = [told(with_photos(at, attitude=stations.attitude + sign * turn), words).block for sign in (1, -1)]
        change = ends[0].photos.attitude - ends[1].photos.attitude
        rates[:, 3:, 3 + i] = np.remainder(change + np.pi, 2.0 * np.pi) - np.pi
        rates[:, 3:, 3 + i] /= 2e-5
    expected = rates @ stations.covariance @ rates.swapaxes(1, 2)
    out = stated_solution(solution, words.statement)
    sigma = np.sqrt(np.diagonal(expected, axis1=1, axis2=2))
    scale = sigma[:, :, None] * sigma[:, None, :]
    # differences of azimuths of photos tilted by 0.03 bend by 1e-5 / 0.03 squared
    np.testing.assert_allclose(out.covariance / scale, expected / scale, rtol=0, atol=2e-6)


def test_covariances_of_points_and_of_matrices(tmp_path):
    words = statements(tmp_path)["geocentric"]
    out, solution = stated_solution(answer(), words.statement), answer()
    frame = CLARKE.frame(solution.points.position)
    expected = frame.swapaxes(1, 2) @ solution.points.covariance @ frame
    np.testing.assert_allclose(out.point_covariance, expected, rtol=1e-12, atol=1e-18)
    # what turns a photo turns it by the same angle whatever the axes
    axes = np.trace(out.covariance[:, 3:, 3:], axis1=1, axis2=2)
    own = stated_solution(solution, Statement(system=Geographic(CLARKE), form=None))
    np.testing.assert_allclose(axes, np.trace(own.covariance[:, 3:, 3:], axis1=1, axis2=2), rtol=1e-12)


@pytest.mark.parametrize(("name", "ground"), [("geocentric", 20.0), ("UTM", 20.0), ("UTM above a geoid", 32.5)])
def test_the_ground_of_a_reduction_is_as_high_as_before(name, ground, tmp_path):
    statement = statements(tmp_path)[name].statement
    block = replace(job(), reduction=model.ReductionOptions(plates=model.Plates.RAW, ground_height=20.0))
    out = stated(block, statement)
    assert out.block.reduction.ground_height == pytest.approx(ground, abs=1e-6)  # the geoid's file has float32
    back, _ = entered(out, statement)
    assert back.reduction.ground_height == pytest.approx(20.0, abs=1e-6)


@pytest.mark.parametrize("name", ["geocentric", "tangent plane", "UTM above a geoid"])
def test_points_without_position_stay_without(name, tmp_path):
    points = answer().points
    lost = replace(points, position=blank(points.position, 3), covariance=blank(points.covariance, 3))
    out = stated_solution(replace(answer(), points=lost), statements(tmp_path)[name].statement)
    assert np.isnan(out.points[3]).all() and np.isnan(out.point_covariance[3]).all()
    rest = np.arange(len(points.position)) != 3
    assert np.isfinite(out.points[rest]).all() and np.isfinite(out.point_covariance[rest]).all()


@pytest.mark.parametrize("name", ["geocentric, azimuth", "tangent plane", "UTM", "UTM, matrices", "geocentric"])
def test_partials_of_attitudes_that_are_entered(name, tmp_path):
    """Of omega, phi, kappa by the stated angles, or by small rotations of the stated matrix."""
    statement = statements(tmp_path)[name].statement
    job_, level = stated(job(), statement), job().photos.position
    given = job_.block.photos.attitude if job_.matrices is None else job_.matrices

    def entering(turn):
        if job_.matrices is None:
            return attitudes_in(statement, level, given + turn).angles
        return attitudes_in(statement, level, given @ Rotation.from_rotvec(turn).as_matrix().T).angles

    step = 1e-5
    sides = [(entering(step * e), entering(-step * e)) for e in np.eye(3)]
    change = np.stack([np.remainder(a - b + np.pi, 2.0 * np.pi) - np.pi for a, b in sides], axis=-1)
    partials = attitudes_in(statement, level, given).partials
    np.testing.assert_allclose(partials, change / (2.0 * step), rtol=0, atol=1e-9)  # h squared, and rounding / h


class TestPartlyKnown:
    def test_control_in_a_projected_system(self):
        block = with_control(job(), position=blank(job().control.position, (0, 2), (1, slice(0, 2))))
        statement = Statement(system=UTM)
        out = stated(block, statement)
        np.testing.assert_array_equal(np.isnan(out.block.control.position), np.isnan(block.control.position))
        back, _ = entered(out, statement)
        np.testing.assert_allclose(back.control.position, block.control.position, rtol=1e-15, atol=1e-9)

    def test_heights_above_a_geoid_need_their_place(self, tmp_path):
        system = Projected("EPSG:26717", CLARKE, Geoid(level_geoid(tmp_path)))
        control = blank(job().control.position, (1, slice(0, 2)))
        block = with_photos(with_control(job(), position=control), position=blank(job().photos.position, 0))
        with pytest.raises(SystemsError) as error:
            stated(block, Statement(system=system))
        messages = [problem.message for problem in error.value.problems]
        assert len(messages) == 2
        assert "its height needs its horizontal position" in messages[0]
        assert f"photo {job().photos.ids[0]}: its tide needs the position" in messages[1]
        horizontal = with_control(job(), position=blank(job().control.position, (0, 2)))
        assert np.isnan(stated(horizontal, Statement(system=system)).block.control.position[0]).tolist() == [
            0,
            0,
            1,
        ]

    def test_stations_to_be_computed(self):
        block = with_photos(
            job(), position=blank(job().photos.position, 1), attitude=blank(job().photos.attitude, 1)
        )
        statement = Statement(system=UTM, axes=Axes.SYSTEM, form=None)
        out = stated(block, statement)
        assert np.isnan(out.block.photos.position[1]).all() and np.isnan(out.matrices[1]).all()
        back, _ = entered(out, statement)
        assert np.isnan(back.photos.attitude[1]).all() and np.isfinite(back.photos.attitude[2]).all()


def entering(block, statement):
    return entered(Stated(block=block, matrices=None), statement)


NO_HEIGHT = {"control": {"position": put((0, 2), np.nan)}}
REFUSED = [
    (
        stated,
        {"control": {"sigma": lambda sigma: np.full(sigma.shape, 0.05) * [1.0, 1.0, 5.0]}},
        Statement(system=Geocentric(CLARKE), sigmas=Sigmas.SYSTEM),
        r"control point \S+: the sigmas of its coordinates would be correlated",
    ),
    (
        entering,
        {"control": {"sigma": put((0, 0), np.nan)}},
        Statement(system=Geographic(CLARKE), sigmas=Sigmas.SYSTEM),
        "some of the sigmas of its coordinates are not given",
    ),
    *(
        (way, NO_HEIGHT, Statement(system=system), "all three coordinates are needed")
        for system in (Geocentric(CLARKE), PLANE)
        for way in (stated, entering)
    ),
    (
        entering,
        {"control": {"position": put((0, 0), np.nan)}},
        Statement(system=UTM),
        "one of two horizontal coordinates is missing",
    ),
    (
        entering,
        {"photos": {"position": put(1, np.nan)}},
        Statement(system=UTM, axes=Axes.SYSTEM),
        f"photo {job().photos.ids[1]}: the axes of its attitude",
    ),
    (stated, {"ellipsoid": model.EllipsoidSpec(name="WGS84")}, Statement(system=UTM), "no datum is shifted"),
]


@pytest.mark.parametrize(("way", "changes", "statement", "message"), REFUSED)
def test_what_cannot_be_stated_or_entered_is_refused(way, changes, statement, message):
    with pytest.raises(SystemsError, match=message):
        way(altered(job(), **changes), statement)


class TestRefused:
    def test_an_ellipsoid_by_its_numbers_is_none_other(self):
        numbers = model.EllipsoidSpec(semi_major_axis=6378206.4, inverse_flattening=294.978698214)
        stated(replace(job(), ellipsoid=numbers), Statement(system=UTM))

    def test_matrices_that_are_none(self):
        statement = Statement(system=UTM, form=None)
        with pytest.raises(SystemsError, match="none are given"):
            entered(Stated(block=job(), matrices=None), statement)
        out = stated(job(), statement)
        bad = np.array(out.matrices)
        bad[1] *= -1.0
        bad[2, 0, 0] += 0.01
        with pytest.raises(SystemsError) as error:
            entered(replace(out, matrices=bad), statement)
        assert [p.message.split(":")[0] for p in error.value.problems] == [
            f"photo {i}" for i in job().photos.ids[1:3]
        ]
        rounded, _ = entered(replace(out, matrices=np.round(out.matrices, 8)), statement)
        expected, _ = entered(out, statement)
        np.testing.assert_allclose(rounded.photos.attitude, expected.photos.attitude, rtol=0, atol=2e-8)

    def test_height_differences_above_a_geoid(self, tmp_path):
        system = Projected("EPSG:26717", CLARKE, Geoid(level_geoid(tmp_path)))
        difference = model.HeightDifferences(point=[[0, 1]], difference=[3.0], sigma=[0.1])
        with pytest.raises(SystemsError, match="height differences"):
            stated(replace(job(), height_differences=difference), Statement(system=system))
        stated(replace(job(), height_differences=difference), Statement(system=UTM))


class TestSaid:
    def test_equal_elevations_above_a_geoid(self, tmp_path):
        system = Projected("EPSG:26717", CLARKE, Geoid(level_geoid(tmp_path)))
        shore = model.EqualElevations(ids=["A"], sigma=[0.1], group=[0, 0], point=[0, 1])
        out = stated(replace(job(), equal_elevations=shore), Statement(system=system))
        assert ["the geoid is taken as level" in str(warning) for warning in out.warnings] == [True]

    def test_places_outside_the_area_of_a_system(self):
        out = stated(job(), Statement(system=Projected("EPSG:26718", CLARKE)))
        number = len(job().photos.ids) + len(job().control.point)
        assert f"{number} of the {number} stations and control points lie outside" in str(out.warnings[0])

    def test_a_truly_vertical_photo_has_no_azimuth(self):
        block = with_photos(job(), attitude=job().photos.attitude * [[0.0, 0.0, 1.0]] + [[0.0, 0.0, 0.3]])
        statement = Statement(system=UTM, form=AngleForm.AZIMUTH_TILT_SWING)
        out = stated(block, statement)
        assert len(out.warnings) == len(block.photos.ids)
        assert "gimbal lock" in str(out.warnings[0])
        back, _ = entered(out, statement)
        # an arc cosine near a tilt of zero: the limit of a gimbal case is 1e-10
        np.testing.assert_allclose(
            np.exp(1j * back.photos.attitude), np.exp(1j * block.photos.attitude), atol=1e-10
        )


def test_headings_beyond_half_a_turn_stay_there():
    heading = job().photos.attitude * [1.0, 1.0, 0.0] + [0.0, 0.0, 350.0 * DEGREE]
    block = with_photos(job(), attitude=heading)
    for form in (AngleForm.OMEGA_PHI_KAPPA, AngleForm.PHI_OMEGA_KAPPA):
        statement = Statement(system=UTM, axes=Axes.SYSTEM, form=form)
        out = stated(block, statement)
        # convergence and the order of tilts of 3 degrees move a kappa by less than a degree
        assert np.abs(out.block.photos.attitude[:, 2] - heading[:, 2]).max() < DEGREE
        back, _ = entered(out, statement)
        np.testing.assert_allclose(back.photos.attitude, heading, rtol=0, atol=1e-14)


@pytest.mark.parametrize("form", [None, *AngleForm])
@pytest.mark.parametrize("off", [0.0, 1e-9, -1e-9, 1e-6, -1e-6, 1e-3, -1e-3])
def test_attitudes_keep_their_rotation_where_angles_are_singular(form, off):
    """Phi, or omega, of 90 degrees, and truly vertical photographs, stated in each form and read again."""
    statement = Statement(system=LocalRectangular(), form=form)
    right = np.pi / 2
    singular = np.array([[0.3, right, 0.4], [2.0, -right, -0.3], [right, 0.2, 0.5], [-right, 0.0, 1.0]])
    singular = np.concatenate([singular, [[0.0, 0.0, 0.7]]])
    attitude = singular + np.where(np.abs(singular) == right, np.radians(off), 0.0)
    attitude[-1, 0] += np.radians(off)
    level = np.zeros((len(attitude), 3))
    out = attitudes_out(statement, level, attitude)
    back = attitudes_in(statement, level, out.matrix if form is None else out.angles)
    np.testing.assert_allclose(back.matrix, out.matrix, rtol=0, atol=1e-9)
    found = matrix_of(back.angles, AngleForm.OMEGA_PHI_KAPPA)
    expected = matrix_of(attitude, AngleForm.OMEGA_PHI_KAPPA)
    np.testing.assert_allclose(found, expected, rtol=0, atol=np.radians(1e-6))
