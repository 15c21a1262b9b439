"""The vertical of the working frames."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.geometry.geodesy import Ellipsoid, Frame, GeocentricFrame, GeographicFrame, LocalFrame

ORIGIN = np.array([1_100_000.0, -5_900_000.0, 2_100_000.0])  # m, the Cayman Islands
PLACES = np.array([[[0.0, 0.0, 0.0], [900.0, -400.0, 80.0]], [[-2000.0, 10.0, 5.0], [3.0, 7000.0, -60.0]]])
FRAMES = [
    LocalFrame(np.array([500.0, 700.0, 10.0])),
    GeocentricFrame(ORIGIN, Ellipsoid("clrk66")),
    GeographicFrame(ORIGIN, Ellipsoid("clrk66")),
]


@pytest.mark.parametrize("frame", FRAMES, ids=lambda frame: type(frame).__name__)
def test_vertical_is_that_of_axes_and_height(frame: Frame):
    up, height = frame.vertical(PLACES)
    np.testing.assert_allclose(up, frame.axes(PLACES)[..., 2, :], rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(
        height, frame.height(PLACES), rtol=0.0, atol=5e-7
    )  # of PROJ, 17 km below the ellipsoid
    # a metre up is a metre of height: geocentric coordinates are good to a nanometre
    np.testing.assert_allclose(frame.height(PLACES + up), height + 1.0, rtol=0.0, atol=1e-8)


def test_vertical_by_components_of_places_whose_level_is_known():
    """From pole to pole, heights of 10 km to -10 km: to some nanometres, and to 1e-12 of the direction."""
    frame = GeocentricFrame(ORIGIN, Ellipsoid("clrk66"))
    latitude, height = (part.ravel() for part in np.mgrid[-1.57:1.57:41j, -1e4:1e4:9j])
    level = np.stack([latitude, np.linspace(-3.0, 3.0, latitude.size), height], axis=-1)
    up, found = frame.vertical_at(*frame.from_level(level).T)
    np.testing.assert_allclose(found, height, rtol=0.0, atol=4e-9)
    np.testing.assert_allclose(np.transpose(up), frame.axes_at(level)[:, 2], rtol=0.0, atol=1e-12)


def test_vertical_by_components_is_that_of_arrays():
    """Near the ellipsoid, by numbers and by arrays; at the pole it is the axis."""
    for frame in FRAMES:
        place = frame.from_level([0.33, -1.4, 25.0])
        up, height = frame.vertical(place)
        components, of_one = frame.vertical_at(*place.tolist())
        assert isinstance(of_one, float) and of_one == pytest.approx(float(height), abs=4e-9)
        np.testing.assert_allclose(components, up, rtol=0.0, atol=1e-15)
    pole = GeocentricFrame(np.zeros(3), Ellipsoid("clrk66")).vertical_at(0.0, 0.0, 6356583.8 + 10.0)
    np.testing.assert_allclose(pole[0], [0.0, 0.0, 1.0], rtol=0.0, atol=1e-15)
    assert pole[1] == pytest.approx(10.0, abs=0.01)


def test_vertical_at_the_pole_is_the_axis():
    frame = GeocentricFrame(np.zeros(3), Ellipsoid("clrk66"))
    up, height = frame.vertical([[0.0, 0.0, 6356583.8 + 10.0], [0.0, 0.0, -6356583.8]])
    np.testing.assert_allclose(up, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(height, [10.0, 0.0], rtol=0.0, atol=0.01)
