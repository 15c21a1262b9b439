"""Systems of PROJ's register for files of points: order, units, prime meridians, and what is refused."""

from __future__ import annotations

import numpy as np
import pyproj
import pytest

from musatpy.errors import SystemsError
from musatpy.geometry.crs import LongitudeLatitude, local_map, own_ellipsoid, system_of
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.systems import Geocentric, moved

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
