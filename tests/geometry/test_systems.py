"""Coordinate systems: published points, both ways, and their rates against differences."""

import struct

import numpy as np
import pyproj
import pytest
from pyproj.network import is_network_enabled, set_network_enabled

from musatpy.errors import SystemsError
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.projected import Geoid, Projected
from musatpy.geometry.systems import Geocentric, Geographic, LocalRectangular, TangentPlane
from musatpy.units import DEGREE, radians_from_dms
from reference.earth import EllipsoidalEarth

WGS84 = Ellipsoid("WGS84")
CLARKE = Ellipsoid("clrk66")
PLACE = np.array([19.3 * DEGREE, -81.2 * DEGREE, 0.0])

# A definition, its ellipsoid, and a point in latitude and longitude (degrees) where it is used.
PROJECTED = {
    "UTM": ("EPSG:26717", "clrk66", 19.3, -81.2),
    "UTM by a string": ("+proj=utm +zone=17 +ellps=clrk66", "clrk66", 19.3, -81.9),
    "northing before easting": ("EPSG:2193", "GRS80", -41.0, 174.0),
    "US feet": ("EPSG:2263", "GRS80", 40.7, -73.9),
    "west and south": ("EPSG:2048", "WGS84", -30.0, 19.5),
    "grads from Paris": ("EPSG:27561", "clrk80ign", 49.0, 2.5),
    "oblique conic": ("EPSG:5514", "bessel", 50.0, 15.0),
    "equal area, PROJ's inverse 0.3 mm off": ("EPSG:3035", "GRS80", 51.0, 12.0),
    "polar": ("EPSG:3031", "WGS84", -75.0, 30.0),
    "across 180 degrees": ("+proj=utm +zone=60 +ellps=WGS84", "WGS84", -17.0, 179.9999),
    "not conformal": ("+proj=poly +lon_0=-81 +ellps=clrk66", "clrk66", 40.0, -80.0),
}
KINDS = ("geographic", "geocentric", "tangent plane", "projected", "orthometric")
CASES = pytest.mark.parametrize("name", [*PROJECTED, *KINDS])


def projected(name):
    definition, ellipsoid, *_ = PROJECTED[name]
    return Projected(definition, Ellipsoid(ellipsoid))


def system_at(name, tmp_path):
    """Return a system by its name, and places where it is used."""
    if name in KINDS:
        return systems_at_sea(tmp_path)[name], around(19.3, -81.2)
    return projected(name), around(*PROJECTED[name][2:])


def around(latitude, longitude, number=20):
    """Places within 5 km, from below the sea to a flying height."""
    rng = np.random.default_rng(7)
    place = np.array([latitude, longitude, 0.0]) * [DEGREE, DEGREE, 1.0]
    return (
        place
        + rng.uniform(-1.0, 1.0, (number, 3)) * [8e-4, 8e-4, 0.0]
        + rng.uniform(0, 1, (number, 3)) * [0, 0, 6e3]
    )


def metres(ellipsoid, difference, level):
    """Differences of level coordinates in metres, roughly."""
    return difference * [ellipsoid.axes[0], ellipsoid.axes[0] * np.cos(level[0, 0]), 1.0]


def write_geoid(path, undulation=lambda latitude, longitude: 10.0 + 0.2 * (latitude - 15) + 0.4 * (longitude + 85)):
    """A grid in NOAA's GTX format over 15-25 N, 85-75 W, half a degree apart."""
    latitude, longitude = np.meshgrid(np.arange(15, 25.1, 0.5), np.arange(-85, -74.9, 0.5), indexing="ij")
    values = undulation(latitude, longitude).astype(">f4")
    path.write_bytes(struct.pack(">ddddii", 15.0, -85.0, 0.5, 0.5, *values.shape) + values.tobytes())
    return str(path)


def systems_at_sea(tmp_path):
    """Every kind of system, over the same sea."""
    geoid = Geoid(write_geoid(tmp_path / "a geoid.gtx"))
    return {
        "geographic": Geographic(CLARKE),
        "geocentric": Geocentric(CLARKE),
        "tangent plane": TangentPlane(CLARKE, PLACE, (5000.0, 2000.0, 100.0)),
        "projected": Projected("EPSG:26717", CLARKE),
        "orthometric": Projected("EPSG:26717", CLARKE, geoid),
    }


class TestPublished:
    def test_geocentric_and_topocentric_of_guidance_note_7_2(self):
        """IOGP 373-7-2, Geographic/topocentric conversions (EPSG methods 9836, 9837): printed to a millimetre."""
        latitude, longitude = radians_from_dms([53, 2], [48, 7], [33.820, 46.380])
        place = [latitude, longitude, 73.0]
        xyz = Geocentric(WGS84).coordinates(place)
        np.testing.assert_allclose(xyz, [3771793.968, 140253.342, 5124304.349], rtol=0, atol=5.1e-4)
        plane = TangentPlane(WGS84, [55.0 * DEGREE, 5.0 * DEGREE, 200.0])
        np.testing.assert_allclose(
            plane.coordinates(place), [-189013.869, -128642.040, -4220.171], rtol=0, atol=5.1e-4
        )

    def test_national_grid_of_great_britain(self):
        """The worked example of the Ordnance Survey's guide to coordinate systems, annexe C: to a millimetre."""
        latitude, longitude = radians_from_dms([52, 1], [39, 43], [27.2531, 4.5177])
        grid = Projected("EPSG:27700", Ellipsoid("airy"))
        expected = [651409.903, 313177.270, 12.0]
        np.testing.assert_allclose(grid.coordinates([latitude, longitude, 12.0]), expected, rtol=0, atol=5.1e-4)

    def test_scale_of_the_transverse_mercator(self):
        """Snyder, Map Projections - A Working Manual (USGS PP 1395), numerical example of the ellipsoid."""
        grid = Projected("+proj=tmerc +lon_0=-75 +k=0.9996 +ellps=clrk66", CLARKE)
        place = np.array([[40.5, -73.5, 0.0]]) * [DEGREE, DEGREE, 1.0]
        np.testing.assert_allclose(grid.coordinates(place)[0, :2], [127106.5, 4484124.4], rtol=0, atol=0.051)
        assert grid.factors(place).meridian_scale == pytest.approx(0.9997989, abs=5.1e-8)


class TestBothWays:
    @CASES
    def test_every_system(self, name, tmp_path):
        system, level = system_at(name, tmp_path)
        there = system.coordinates(level)
        back = system.level(there)
        difference = np.remainder(back - level + np.pi, 2.0 * np.pi) - np.pi
        difference[:, 2] = (back - level)[:, 2]
        # geocentric coordinates of 6e6 m have steps of 1e-9 m, and longitudes of maps of 3e-9 m; PROJ's own inverse
        # would leave 1e-7
        ellipsoid = getattr(system, "ellipsoid", CLARKE)
        assert np.abs(metres(ellipsoid, difference, level)).max() < (4e-9 if name in KINDS else 8e-9)
        if name in PROJECTED:
            assert np.abs(system.coordinates(back) - there).max() * system.unit < 8e-9

    def test_what_is_not_known_stays_so(self, tmp_path):
        level = np.array([[19.3 * DEGREE, -81.2 * DEGREE, np.nan], [np.nan, np.nan, 7.0]])
        for name in ("geographic", "projected"):
            system = systems_at_sea(tmp_path)[name]
            there = system.coordinates(level)
            np.testing.assert_array_equal(np.isnan(there), np.isnan(level))
            np.testing.assert_allclose(system.level(there), level, rtol=1e-14)  # rounding of radians

    def test_local_rectangular_is_itself(self):
        xyz = np.array([[1.0, 2.0, 3.0]])
        system = LocalRectangular()
        np.testing.assert_array_equal(system.level(system.coordinates(xyz)), xyz)
        np.testing.assert_array_equal(system.jacobian(xyz), [np.eye(3)])


def shifted(ellipsoid, level, enu):
    """Level positions moved by metres, by the radii of the reference adjustment."""
    a, b = ellipsoid.axes
    cart = pyproj.Transformer.from_pipeline(f"+proj=cart {ellipsoid.definition}")
    earth = EllipsoidalEarth(a=a, es=1.0 - (b / a) ** 2, geocentric=False, transformer=cart, origin=np.zeros(3))
    return earth.shift(level, np.asarray(enu))


def by_differences(system, level, step=20.0):
    """d(coordinates)/d(east, north, up) by central differences; 20 m leave 1e-10 of rounding."""
    columns = []
    for enu in step * np.eye(3):
        ends = [system.coordinates(shifted(system.ellipsoid, level, sign * enu)) for sign in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.stack(columns, axis=-1)


class TestRates:
    @CASES
    def test_every_system(self, name, tmp_path):
        system, level = system_at(name, tmp_path)
        want = by_differences(system, level)
        # of each coordinate: angles have rates of 1e-7, feet three times those of metres
        scale = 1.0 / system.unit if name in PROJECTED else np.abs(want).max(axis=2, keepdims=True)
        np.testing.assert_allclose(system.jacobian(level) / scale, want / scale, rtol=0, atol=5e-10)

    def test_heights_above_a_geoid_know_its_slope(self, tmp_path):
        """0.2 m a degree of latitude, 0.4 m a degree of longitude."""
        system = systems_at_sea(tmp_path)["orthometric"]
        level = around(19.3, -81.2)
        degree = CLARKE.axes[0] * DEGREE
        slope = system.jacobian(level)[:, 2]
        np.testing.assert_allclose(slope[:, 1], -0.2 / degree, rtol=0.01)  # meridians are not circles of radius a
        np.testing.assert_allclose(slope[:, 0], -0.4 / degree / np.cos(19.3 * DEGREE), rtol=0.01)
        np.testing.assert_array_equal(slope[:, 2], 1.0)

    @pytest.mark.parametrize("name", sorted(PROJECTED.keys() - {"west and south", "grads from Paris"}))
    def test_factors_are_those_of_proj(self, name):
        """Where PROJ's own factors hold: east and north, from Greenwich. They are good to about 1e-9."""
        system = projected(name)
        level = around(*PROJECTED[name][2:])
        mine = system.factors(level)
        theirs = pyproj.Proj(PROJECTED[name][0]).get_factors(*np.degrees(level[:, [1, 0]]).T)
        np.testing.assert_allclose(np.degrees(mine.convergence), theirs.meridian_convergence, rtol=0, atol=1e-7)
        np.testing.assert_allclose(mine.meridian_scale, theirs.meridional_scale, rtol=0, atol=2e-9)
        np.testing.assert_allclose(mine.parallel_scale, theirs.parallel_scale, rtol=0, atol=2e-9)

    @pytest.mark.parametrize("name", ["UTM", "US feet", "west and south", "grads from Paris", "polar"])
    def test_grid_axes_point_where_the_grid_does(self, name):
        """A short way along each grid axis changes that coordinate only, on a conformal map."""
        system = projected(name)
        level = around(*PROJECTED[name][2:])
        level[:, 2] = 0.0
        axes = system.axes(level)
        for along in range(2):
            step = 10.0 * axes[:, along]
            ends = [system.coordinates(shifted(system.ellipsoid, level, way)) for way in (step, -step)]
            way = (ends[0] - ends[1])[:, :2] * system.unit / 20.0
            # 20 m with coordinates rounded at 1e-9 m
            np.testing.assert_allclose(way[:, 1 - along], 0.0, atol=5e-10)
            scale = system.factors(level).meridian_scale
            np.testing.assert_allclose(way[:, along], scale, rtol=0, atol=5e-10)
        np.testing.assert_array_equal(axes[:, 2], np.tile([0.0, 0.0, 1.0], (len(level), 1)))

    def test_axes_of_plane_and_geocentric_systems_are_where_their_coordinates_grow(self):
        level = around(19.3, -81.2)
        for system in (TangentPlane(CLARKE, PLACE), Geocentric(CLARKE)):
            np.testing.assert_allclose(system.axes(level), by_differences(system, level), rtol=0, atol=5e-10)


class TestRefused:
    @pytest.mark.parametrize(
        ("definition", "why"),
        [
            ("EPSG:99999", "is no coordinate system that PROJ knows"),
            ("+init=epsg:26717", "is no coordinate system: give its code"),
            ("+proj=utm +zone=17 +ellps=clrk66 +towgs84=-8,160,176", "asks for a datum shift"),
            ("+proj=utm +zone=17 +ellps=clrk66 +lat_O=3", r"pass over in silence: lat_O=3$"),
            ("+proj=utm +zone=17 +ellps=clrk66 +vunits=us-ft", "has three axes"),
            ("EPSG:7405", "has heights of its own"),
            ("+proj=utm +zone=17 +ellps=clrk66 +geoidgrids=egm96_15.gtx", "has heights of its own"),
            ("EPSG:4267", "is no projected system but a Geographic 2D CRS"),
            ("EPSG:32617", "on the ellipsoid WGS 84"),
        ],
    )
    def test_what_is_no_plain_projected_system_of_the_job(self, definition, why):
        with pytest.raises(SystemsError, match=why):
            Projected(definition, CLARKE)

    def test_a_bare_code_is_one_of_epsg(self):
        level = around(19.3, -81.2)
        coordinates = [Projected(text, CLARKE).coordinates(level) for text in ("26717", "EPSG:26717", "epsg:26717")]
        np.testing.assert_array_equal(coordinates[0], coordinates[1])
        np.testing.assert_array_equal(coordinates[0], coordinates[2])

    def test_wkt_is_told_by_its_name(self):
        system = Projected(pyproj.CRS("EPSG:26717").to_wkt(), CLARKE)
        assert system.text == "NAD27 / UTM zone 17N, ellipsoidal heights"
        with pytest.raises(SystemsError) as error:
            Projected(pyproj.CRS("EPSG:32617").to_wkt(), CLARKE)
        assert len(error.value.problems[0].message) < 300

    def test_words_about_a_string_are_no_parameters(self):
        plain = Projected("+proj=utm +zone=17 +ellps=clrk66", CLARKE).coordinates(PLACE)
        for text in (
            "+proj=utm +zone=17 +ellps=clrk66 +units=m +no_defs +type=crs",
            "proj=utm zone=17 ellps=clrk66",
        ):
            np.testing.assert_array_equal(Projected(text, CLARKE).coordinates(PLACE), plain)

    def test_ellipsoids_that_differ_by_a_tenth_of_a_millimetre(self):
        with pytest.raises(SystemsError, match="no datum is shifted"):
            Projected("EPSG:32617", Ellipsoid("GRS80"))

    def test_places_beyond_the_map(self):
        lambert = Projected("EPSG:3034", Ellipsoid("GRS80"))
        with pytest.raises(SystemsError, match=r"does not reach 1 of the places, the first at -90\.0"):
            lambert.coordinates([PLACE, [-90.0 * DEGREE, 30.0 * DEGREE, 0.0]])
        with pytest.raises(SystemsError, match="does not reach"):
            Projected("EPSG:3035", Ellipsoid("GRS80")).level([[4e8, 3e6, 0.0]])

    def test_area_of_use(self):
        """That of EPSG:26717 is 84 to 78 degrees west, that of EPSG:3460 lies across 180 degrees."""
        level = np.array([PLACE, PLACE * [1.0, -1.0, 1.0], [19.3 * DEGREE, np.nan, 0.0]])
        assert Projected("EPSG:26717", CLARKE).outside(level).tolist() == [False, True, False]
        fiji = Projected("EPSG:3460", Ellipsoid("WGS72"))
        places = np.array([[-17.0, -179.0, 0.0], [-17.0, 178.0, 0.0], [-17.0, 170.0, 0.0]]) * DEGREE
        assert fiji.outside(places).tolist() == [False, False, True]
        assert not Projected("+proj=utm +zone=17 +ellps=clrk66", CLARKE).outside(level).any()

    def test_left_handed_axes_have_no_attitudes(self):
        krovak = Projected("EPSG:5513", Ellipsoid("bessel"))
        level = around(50.0, 15.0)
        assert np.isfinite(krovak.coordinates(level)).all()
        with pytest.raises(SystemsError, match="left-handed"):
            krovak.axes(level)

    def test_geographic_axes(self):
        with pytest.raises(SystemsError, match="no axes"):
            Geographic(CLARKE).axes([PLACE])

    @pytest.mark.parametrize("origin", [[1.6, 0.0, 0.0], [0.1, 0.2], [0.1, np.nan, 0.0]])
    def test_origins_that_are_none(self, origin):
        with pytest.raises(SystemsError, match="tangent plane needs"):
            TangentPlane(CLARKE, origin)


class TestGeoids:
    def test_undulation_is_interpolated(self, tmp_path):
        geoid = Geoid(write_geoid(tmp_path / "g.gtx"))
        found = geoid.undulation(np.array([18.25, 60.0]) * DEGREE, np.array([-80.1, -80.1]) * DEGREE)
        assert found[0] == pytest.approx(10.0 + 0.2 * 3.25 + 0.4 * 4.9, abs=2e-6)  # the file has single precision
        assert np.isnan(found[1])

    def test_heights_are_above_it(self, tmp_path):
        system = systems_at_sea(tmp_path)["orthometric"]
        level = [18.25 * DEGREE, -80.1 * DEGREE, 100.0]
        assert system.coordinates(level)[2] == pytest.approx(100.0 - 12.61, abs=2e-6)
        assert "a geoid.gtx" in system.text

    def test_nothing_is_downloaded_when_the_network_is_on(self):
        before = is_network_enabled()
        set_network_enabled(True)
        try:
            with pytest.raises(SystemsError, match="no such file"):
                Geoid("us_nga_egm96_15.tif")
            Projected("EPSG:26717", CLARKE)
            assert is_network_enabled()
        finally:
            set_network_enabled(before)

    def test_places_outside_the_grid(self, tmp_path):
        with pytest.raises(SystemsError, match=r"geoid model a geoid\.gtx does not reach "):
            systems_at_sea(tmp_path)["orthometric"].coordinates([PLACE, [40.0 * DEGREE, -80.0 * DEGREE, 0.0]])
