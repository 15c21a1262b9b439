"""The vertical of the working frames."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.geometry.frames import Frame, GeocentricFrame, GeographicFrame, LocalFrame
from musatpy.geometry.geodesy import Ellipsoid

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
    np.testing.assert_allclose(frame.vertical(PLACES + up)[1], height + 1.0, rtol=0.0, atol=1e-8)


def test_vertical_of_places_whose_level_is_known():
    """From pole to pole, heights of 10 km to -10 km: to a nanometre or two, a third of one of the direction."""
    frame = GeocentricFrame(ORIGIN, Ellipsoid("clrk66"))
    latitude, height = (part.ravel() for part in np.mgrid[-1.57:1.57:41j, -1e4:1e4:9j])
    level = np.stack([latitude, np.linspace(-3.0, 3.0, latitude.size), height], axis=-1)
    up, found = frame.vertical(frame.from_level(level))
    np.testing.assert_allclose(found, height, rtol=0.0, atol=4e-9)
    np.testing.assert_allclose(up, frame.axes_at(level)[:, 2], rtol=0.0, atol=1e-12)


def test_vertical_by_numbers_is_that_of_arrays():
    for frame in FRAMES:
        up, height = frame.vertical(PLACES[1, 1])
        x, y, z = PLACES[1, 1].tolist()
        components, of_one = frame.vertical_at(x, y, z)
        assert isinstance(of_one, float) and of_one == pytest.approx(float(height), abs=2e-9)
        np.testing.assert_allclose(components, up, rtol=0.0, atol=1e-15)


def test_vertical_at_the_pole_is_the_axis():
    frame = GeocentricFrame(np.zeros(3), Ellipsoid("clrk66"))
    up, height = frame.vertical([[0.0, 0.0, 6356583.8 + 10.0], [0.0, 0.0, -6356583.8]])
    np.testing.assert_allclose(up, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]], rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(height, [10.0, 0.0], rtol=0.0, atol=0.01)
