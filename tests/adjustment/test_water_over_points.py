"""The height of the water against which flags are held: tides, tilt and waves, in closed form in a local job."""

from __future__ import annotations

import numpy as np
import pytest

import wave_strip
from altered import altered
from musatpy import adjust
from musatpy.arrays import FloatArray
from musatpy.model import Block, CoordinateSystem
from reference.networks import Plan, simulate

TILT = (3e-4, -5e-4)  # of the water towards east and north


def waves(block: Block, xyz: FloatArray, time: FloatArray) -> FloatArray:
    """Return the sum (m,) of H/2 cos k (s - crest - c t), s counted along azimuths clockwise from north."""
    assert block.wave_origin is not None
    east, north, _ = (xyz - block.wave_origin.position).T
    height = np.zeros(len(xyz))
    length, speed = (wave_strip.swell_length(), 24.7), (wave_strip.swell_length() / 10.0, 6.17)
    for H, L, c, azimuth, crest in zip((1.1, 0.3), length, speed, (60.0, 115.0), (12.5, -4.0), strict=True):
        s = east * np.sin(np.radians(azimuth)) + north * np.cos(np.radians(azimuth))
        height += H / 2.0 * np.cos(2.0 * np.pi / L * (s - crest - c * time))
    return height


def lowest_and_highest(block: Block, water: FloatArray) -> FloatArray:
    """Return (p, 2) of the water (m,) over the points of measurements; NaN over points without."""
    out = np.full((2, len(block.points.ids)), np.nan)
    np.fmin.at(out[0], block.plates.point, water)
    np.fmax.at(out[1], block.plates.point, water)
    return out.T


def test_tides_and_waves_over_points() -> None:
    """Waves of a metre: with their sign turned the water is off by as much."""
    block, _ = wave_strip.strip(CoordinateSystem.LOCAL)
    points = adjust(block).points
    photo, xyz = block.plates.photo, points.position[block.plates.point]
    expected = block.photos.tide[photo] + waves(block, xyz, block.photos.time[photo])
    assert np.nanmax(points.water[:, 1] - points.water[:, 0]) > 0.5
    np.testing.assert_allclose(points.water, lowest_and_highest(block, expected), rtol=0.0, atol=1e-4)


def test_a_tilt_lifts_the_water_to_its_side() -> None:
    """The water over points is a plane through their tides, and rises as the tilt says."""
    plan = Plan(submerged=True, noise=0.0)
    block = altered(simulate(plan).block, water={"tilt_east": TILT[0], "tilt_north": TILT[1]})
    points, tide = adjust(block).points, block.photos.tide
    known = np.isfinite(points.water[:, 0])
    xy = points.position[known, :2] - block.photos.position[:, :2].mean(axis=0)
    assert known.sum() > 8 and (np.ptp(xy, axis=0) > 1000.0).all()
    of_tides = lowest_and_highest(block, tide[block.plates.photo])[known]
    for lifted in (points.water[known] - of_tides).T:
        plane = np.column_stack([xy, np.ones(len(xy))])
        rise, _, rank, _ = np.linalg.lstsq(plane, lifted, rcond=None)
        assert rank == 3 and rise[:2] == pytest.approx(TILT, rel=1e-6)
        np.testing.assert_allclose(plane @ rise, lifted, rtol=0.0, atol=1e-9)
