"""Coordinate systems of PROJ, frames, similarities and vectors."""

import numpy as np
import pyproj
import pytest

from musatpy.errors import SystemsError
from musatpy.geometry.collinearity import attitude_matrix, wrapped
from musatpy.geometry.crs import LongitudeLatitude, local_map, own_ellipsoid, system_of
from musatpy.geometry.geodesy import Ellipsoid, Frame, GeocentricFrame, GeographicFrame, LocalFrame
from musatpy.geometry.similarity import Similarity, fit, fit_robust
from musatpy.geometry.systems import Geocentric, moved
from musatpy.units import DEGREE

PLACES = np.array([[0.32, -1.1333, 12.5], [-0.9, 3.0, -40.0], [0.85, 0.04, 2000.0]])


@pytest.mark.parametrize(
    "definition", ["EPSG:4326", "EPSG:4979", "EPSG:4267", "EPSG:4807", "+proj=longlat +ellps=clrk66"]
)
def test_longitude_and_latitude_are_those_of_proj(definition: str) -> None:
    """Grads east of Paris too (EPSG:4807); x is the longitude whatever order the register has."""
    system = system_of(definition, own_ellipsoid(definition))
    crs = pyproj.CRS(definition)
    angle, meridian = crs.axis_info[0].unit_conversion_factor, crs.prime_meridian
    given = system.coordinates(PLACES)
    east = PLACES[:, 1] - meridian.longitude * meridian.unit_conversion_factor
    np.testing.assert_allclose(given[:, 0], east / angle, atol=1e-9)
    np.testing.assert_allclose(given[:, 1], PLACES[:, 0] / angle, atol=1e-12)
    np.testing.assert_array_equal(given[:, 2], PLACES[:, 2])
    assert system.decimals == (9, 9, 4)
    np.testing.assert_allclose(system.level(given), PLACES, atol=1e-12)


def test_its_rates_are_those_of_its_coordinates() -> None:
    ellipsoid = Ellipsoid("WGS84")
    system = LongitudeLatitude(ellipsoid)
    step = 10.0
    sides = [
        [system.coordinates(moved(ellipsoid, PLACES, sign * step * axis)) for sign in (1.0, -1.0)]
        for axis in np.eye(3)
    ]
    rates = np.stack([(there - back) / (2.0 * step) for there, back in sides], axis=-1)
    np.testing.assert_allclose(system.jacobian(PLACES), rates, rtol=1e-6, atol=1e-12)


def test_a_local_map_has_the_lengths_of_the_ground() -> None:
    """East, north and 1 km: to 1e-8 of it."""
    ellipsoid = Ellipsoid("clrk66")
    middle = np.array([0.32, -1.1333, 0.0])
    plan = local_map(ellipsoid, middle)
    ends = np.array([moved(ellipsoid, middle, metres) for metres in ([1000.0, 0.0, 7.0], [0.0, 1000.0, -3.0])])
    np.testing.assert_allclose(plan.coordinates(middle), [0.0, 0.0, 0.0], atol=1e-4)  # 1e-9 degrees in its words
    np.testing.assert_allclose(plan.coordinates(ends), [[1000.0, 0.0, 7.0], [0.0, 1000.0, -3.0]], atol=0.03)


@pytest.mark.parametrize(
    ("definition", "ellipsoid", "message"),
    [
        ("EPSG:4326", "clrk66", "the job on another"),
        ("EPSG:4978", "GRS80", "the job on another"),
        ("EPSG:5703", "GRS80", "is a Vertical CRS"),
        ('LOCAL_CS["lagoon"]', "GRS80", "is a Engineering CRS"),
        ("nowhere", "GRS80", "is no coordinate system: give its code"),
        ("EPSG:6347+5703", "GRS80", r"has NAVD88 height: the grid file of its geoid model is needed \(--geoid\)"),
        ("+proj=longlat +ellps=clrk66 +towgs84=1,2,3", "clrk66", "asks for a datum shift"),
    ],
)
def test_what_is_refused(definition: str, ellipsoid: str, message: str) -> None:
    with pytest.raises(SystemsError, match=message):
        system_of(definition, Ellipsoid(ellipsoid))


def test_heights_in_feet_and_of_geocentric_systems_are_refused() -> None:
    with pytest.raises(SystemsError, match="in US survey foot: metres are needed"):
        system_of("EPSG:6347+6360", Ellipsoid("GRS80"), "any.gtx")
    with pytest.raises(SystemsError, match="has no heights: a geoid model has no use"):
        system_of("EPSG:4978", Ellipsoid("WGS84"), "any.gtx")
    assert isinstance(system_of("EPSG:4978", Ellipsoid("WGS84")), Geocentric)


def test_coordinates_that_are_no_angles_are_told() -> None:
    with pytest.raises(
        SystemsError, match=r"degrees, ellipsoidal heights: x 294994\.9798, y 2029326\.295 are none"
    ):
        LongitudeLatitude(Ellipsoid("WGS84")).level(np.array([[294994.9798, 2029326.295, -3.0]]))


ORIGIN = np.array([1_100_000.0, -5_900_000.0, 2_100_000.0])  # m, the Cayman Islands
AT = np.array([[[0.0, 0.0, 0.0], [900.0, -400.0, 80.0]], [[-2000.0, 10.0, 5.0], [3.0, 7000.0, -60.0]]])
FRAMES = [
    LocalFrame(np.array([500.0, 700.0, 10.0])),
    GeocentricFrame(ORIGIN, Ellipsoid("clrk66")),
    GeographicFrame(ORIGIN, Ellipsoid("clrk66")),
]


@pytest.mark.parametrize("frame", FRAMES, ids=lambda frame: type(frame).__name__)
def test_vertical_is_that_of_axes_and_height(frame: Frame):
    up, height = frame.vertical(AT)
    np.testing.assert_allclose(up, frame.axes(AT)[..., 2, :], rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(height, frame.height(AT), rtol=0.0, atol=5e-7)  # of PROJ, 17 km below the ellipsoid
    # a metre up is a metre of height: geocentric coordinates are good to a nanometre
    np.testing.assert_allclose(frame.height(AT + up), height + 1.0, rtol=0.0, atol=1e-8)


def test_vertical_at_the_pole_is_the_axis():
    frame = GeocentricFrame(np.zeros(3), Ellipsoid("clrk66"))
    up, height = frame.vertical([[0.0, 0.0, 6356583.8 + 10.0], [0.0, 0.0, -6356583.8]])
    np.testing.assert_allclose(up, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(height, [10.0, 0.0], rtol=0.0, atol=0.01)


TRUE = Similarity(scale=2.5, rotation=attitude_matrix([0.4, -0.7, 2.9]), shift=np.array([10.0, -20.0, 5.0]))


def cloud(count: int, flat: bool = False) -> np.ndarray:
    x = np.random.default_rng(count).normal(size=(count, 3))
    return x * [1.0, 1.0, 0.0] if flat else x


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("count", [3, 4, 20])
def test_exact_points_give_the_exact_similarity(count: int, flat: bool) -> None:
    x = cloud(count, flat)
    found = fit(x, TRUE.apply(x), np.ones(count))
    assert found.scale == pytest.approx(TRUE.scale, rel=1e-12)  # rounding
    np.testing.assert_allclose(found.rotation, TRUE.rotation, atol=1e-12)
    np.testing.assert_allclose(found.shift, TRUE.shift, atol=1e-12)


def test_a_mirror_image_is_not_a_rotation() -> None:
    x = cloud(10)
    found = fit(x, x * [1.0, 1.0, -1.0], np.ones(10))
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)


def test_weights_are_repetitions() -> None:
    rng = np.random.default_rng(3)
    x = cloud(6)
    y = TRUE.apply(x) + rng.normal(0.0, 0.1, x.shape)
    weight = np.array([1, 2, 3, 1, 1, 2])
    weighted = fit(x, y, weight.astype(float))
    repeated = fit(np.repeat(x, weight, axis=0), np.repeat(y, weight, axis=0), np.ones(weight.sum()))
    np.testing.assert_allclose(weighted.apply(x), repeated.apply(x), atol=1e-12)  # rounding


@pytest.mark.parametrize("count", [6, 10, 50])
def test_gross_errors_do_not_draw_it(count: int) -> None:
    x, rng = cloud(count), np.random.default_rng(count)
    y = TRUE.apply(x)
    wrong = rng.choice(count, count // 4, replace=False)
    y[wrong] += rng.choice([-1.0, 1.0], (len(wrong), 3)) * rng.uniform(1.0, 100.0, (len(wrong), 3))
    found, weight = fit_robust(x, y, np.ones(count), 1e-3)
    assert (weight[wrong] < 0.01).all()
    np.testing.assert_allclose(found.apply(x), TRUE.apply(x), atol=1e-3)  # the least error that counts


def test_inverse_and_composition() -> None:
    other = Similarity(scale=0.3, rotation=attitude_matrix([1.0, 0.2, 0.1]), shift=np.array([1.0, 2.0, 3.0]))
    x = cloud(5)
    np.testing.assert_allclose(TRUE.inverse().apply(TRUE.apply(x)), x, atol=1e-12)  # rounding
    np.testing.assert_allclose(other.after(TRUE).apply(x), other.apply(TRUE.apply(x)), atol=1e-12)
    M = attitude_matrix([0.1, 0.2, 0.3])
    np.testing.assert_allclose(
        TRUE.turn(M) @ (TRUE.apply(x[0]) - TRUE.apply(x[1])), TRUE.scale * M @ (x[0] - x[1]), atol=1e-12
    )


@pytest.mark.parametrize(
    ("angle", "expected"),
    [(0.1, 0.1), (-np.pi, -np.pi), (np.pi, np.pi), (359.0 * DEGREE, -DEGREE), (-350 * DEGREE, 10 * DEGREE)],
)
def test_angles_within_half_a_turn(angle, expected):
    # A turn added and taken away costs a few units in the last place of 2 pi.
    assert wrapped(np.array([angle]))[0] == pytest.approx(expected, abs=4e-15)
    near = wrapped(np.array([angle]), 20.0)[0]
    assert abs(near - 20.0) <= np.pi
    assert np.cos(near - expected) == pytest.approx(1.0, abs=4e-15)
