"""Strips through water: truth without errors, joins, control, order of the photos."""

import numpy as np
import pytest

from musatpy.geometry.similarity import fit
from musatpy.model.options import PlaneTreatment
from musatpy.orientation.twomedia.oriented import OrientationError
from musatpy.orientation.twomedia.sights import WaterPlane
from musatpy.orientation.twomedia.strip import joined, orient_strip, triplets
from orientation.twomedia.geometries import Scene, corners, strip_scene, strip_sights, strip_truth

LEVEL = WaterPlane(treatment=PlaneTreatment.LEVEL)


def known(true: Scene) -> WaterPlane:
    return WaterPlane(treatment=PlaneTreatment.KNOWN, level=true.d)


def test_a_wrong_point_is_left_out_of_a_join() -> None:
    sights, _ = strip_sights(strip_scene("lab", 4, 30), noise=1.0)
    first, second = triplets(sights, WaterPlane().index)
    common = np.intersect1d(first.points, second.points)
    wrong = int(np.searchsorted(second.points, common[4]))
    second.place[wrong] += [0.0, 0.05, 0.0]
    join = joined(first, second)
    assert join.points[join.left_out].tolist() == [common[4]]
    rest = np.sqrt(np.mean(np.square(join.residual[~join.left_out])))
    assert join.residual[4, 1] == pytest.approx(-0.05 * join.move.scale, abs=5.0 * rest)


def test_the_misclosures_of_a_join_are_those_of_its_planes_and_stations() -> None:
    """Without errors all close; a water plane of one triplet that is moved shows as it was moved."""
    sights, _ = strip_sights(strip_scene("lab", 4, 30))
    first, second = triplets(sights, WaterPlane().index)
    join = joined(first, second)
    assert max(np.abs(part).max() for part in (join.residual, join.station, join.plane)) < 1e-8
    at = first.oriented.adjusted.at
    at.level[0] += 0.01
    at.slope[0] += [0.002, -0.001]
    np.testing.assert_allclose(joined(first, second).plane, [0.002, -0.001, 0.01], rtol=0.0, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lab", "aerial"])
@pytest.mark.parametrize("plane", ["model", "free", "level", "known"])
def test_a_strip_without_errors_is_the_truth(name: str, plane: str) -> None:
    true = strip_scene(name, 6, 30)
    sights, rows = strip_sights(true, control=None if plane == "model" else corners(true))
    strip = orient_strip(sights, {"level": LEVEL, "known": known(true)}.get(plane, WaterPlane()))
    at, points = strip_truth(true)
    station, place = strip.orientation().station, strip.points
    if plane == "model":
        move = fit(place, points[rows], np.ones(len(rows)))
        station, place = move.apply(station), move.apply(place)
    assert np.abs(station - at.station).max() < 1e-9 * true.kind.H
    assert np.abs(place - points[rows]).max() < 1e-9 * true.kind.H
    assert not strip.outliers.any()


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2])
def test_control_that_does_not_hold_a_strip(count: int) -> None:
    true = strip_scene("lab", 4, 30)
    sights, _ = strip_sights(true, control=corners(true)[:count])
    with pytest.raises(OrientationError, match=r"two control points|leave (tilt|heading|scale)"):
        orient_strip(sights, WaterPlane())
    if count == 2:  # a level plane holds the tilts
        at = orient_strip(sights, LEVEL).orientation()
        assert np.abs(at.station - strip_truth(true)[0].station).max() < 1e-8
