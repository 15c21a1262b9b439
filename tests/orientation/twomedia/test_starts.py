"""Where orientations start, the truth where the water does not refract, and the directions of their steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from musatpy.geometry.rotations import attitude_matrix
from musatpy.orientation.twomedia.inner import directions
from musatpy.orientation.twomedia.rays import PHOTO
from musatpy.orientation.twomedia.sights import Plane
from musatpy.orientation.twomedia.single import lifted, trial_levels
from orientation.twomedia.geometries import HOUSE, KINDS, A, B, geometry, points_of, sights_of, truth_of
from orientation.twomedia.methods import METHODS, control_of
from orientation.twomedia.test_diagnosis import straight


@pytest.mark.parametrize("method", METHODS)
def test_starts_are_the_truth_where_the_water_does_not_refract(method):
    """To the rounding of robust refinements, whose least error is 1e-7 (1e-6 of the extent of the control)."""
    true, truth = geometry("lab", method), truth_of(geometry("lab", method))
    starts = METHODS[method].starts(straight("lab", method), Plane(index=1.0), KINDS["lab"].B)
    photos = PHOTO * len(true.stations)
    errors = np.abs(starts.vector[:, :photos] - truth.vector[:, :photos]).max(axis=1)
    assert (errors < 1e-5).any()
    lowest = (true.stations * HOUSE)[:, 2].min()
    assert (starts.level[errors < 1e-5] < lowest).all()


def test_trial_planes_of_a_pair_lie_between_points_and_stations():
    """Over a plane bottom also along it: its slopes are those of the water, and it is found to rounding."""
    method = "PAIR-SUCCESSIVE"
    true = geometry("lab", method)
    flat = true.points.copy()
    flat[:, 2] = -(A * flat[:, 0] + B * flat[:, 1] + true.d) + 0.8
    at, sights = truth_of(true), straight("lab", method)
    gap = (flat * HOUSE)[sights.point] - at.station[0, sights.photo]
    inside = np.einsum("nij,nj->ni", attitude_matrix(at.attitude[0])[sights.photo], gap)
    sights = replace(sights, image=-inside[:, :2] / inside[:, 2:])
    starts = METHODS[method].starts(sights, Plane(index=1.0), true.kind.B)
    right = np.abs(starts.station - at.station).max(axis=(1, 2)) < 1e-5
    along = right & (np.abs(starts.slope - [A, -B]).max(axis=1) < 1e-5)
    bottom = float(at.level[0]) - 0.8
    heights = at.station[0, :, 2] - at.station[0, :, :2] @ [A, -B]
    shares = (starts.level[along] - bottom) / (heights.min() - bottom)
    np.testing.assert_allclose(np.unique(shares.round(4)), [0.1, 0.35, 0.7], atol=1e-4)


def test_control_is_lifted_to_where_it_seems_to_be():
    """From the nadir, by depth over index under the tilted water; trial levels lie over all of it, by its size."""
    kind = KINDS["lab"]
    control, wet = points_of(kind, 11) * HOUSE, np.arange(20) > 4
    level = float(truth_of(geometry("lab", "SINGLE-RAY")).level[0])
    seeming = lifted(control, wet, level, Plane(slope=(A, -B)))
    depth = level + control[:, 0] * A - control[:, 1] * B - control[:, 2]
    rise = np.where(wet, depth * (1.0 - 1.0 / 1.34), 0.0)
    np.testing.assert_allclose(seeming - control, rise[:, None] * [0.0, 0.0, 1.0], atol=1e-15)
    levels, top = np.array(trial_levels(control, wet, Plane())), control[wet, 2].max()
    assert (levels > top).all()
    np.testing.assert_allclose(trial_levels(100.0 * control, wet, Plane()), 100.0 * levels, rtol=1e-12)


def test_photos_turn_about_the_apparent_bottom():
    """Where the axis meets it stays, in first order, whatever angle of the photo changes."""
    true = geometry("lab", "TRIPLET")
    at, unknown = truth_of(true), np.ones(PHOTO * 3 + 4, dtype=bool)
    bottom = (true.points.mean(axis=0) * HOUSE)[None]
    T = directions(at, unknown, bottom)[0]
    water = float(at.water_at(bottom[:, None, :2])[0, 0])
    apparent = water - (water - bottom[0, 2]) / at.index[0]

    def footprint(vector: np.ndarray, photo: int) -> np.ndarray:
        attitude, station = np.split(vector[PHOTO * photo : PHOTO * (photo + 1)], 2)
        axis = attitude_matrix(attitude)[2]
        return station[:2] + (apparent - station[2]) * axis[:2] / axis[2]

    for photo in range(3):
        for column in range(PHOTO * photo, PHOTO * photo + 3):
            step = 1e-5 * T[:, column]
            ends = [footprint(at.vector[0] + sign * step, photo) for sign in (1.0, -1.0)]
            assert np.abs(ends[0] - ends[1]).max() < 1e-12  # third order, of 1e-15


@pytest.mark.parametrize("method", METHODS)
def test_unknowns_in_their_units_do_not_know_the_metre(method):
    at = truth_of(geometry("lab", method))[0]
    other = replace(at, station=100.0 * at.station, level=100.0 * at.level)
    np.testing.assert_allclose(other.vector / other.units, at.vector / at.units, rtol=1e-12)


@pytest.mark.parametrize("method", ["TRIPLET"])
def test_an_approach_uses_images_that_exist(method):
    sights = sights_of(geometry("lab", method), control_of(METHODS[method]))
    seen = (sights.point >= 3) | (sights.photo != sights.point)
    images = {name: getattr(sights, name)[seen] for name in ("photo", "point", "image", "image_sigma")}
    approach = METHODS[method].approach
    assert approach is not None
    groups = approach(replace(sights, **images))
    assert all((group.images >= 0).all() for group in groups)
    assert [len(group.images) for group in groups] == [28, 28, 28]
