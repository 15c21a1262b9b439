"""Which unknowns depend on which, and what nothing determines, in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from musatpy.geometry.rotations import attitude_matrix
from musatpy.orientation.twomedia.oriented import Verdict, orient
from musatpy.orientation.twomedia.sights import Plane, Sights
from orientation.twomedia.geometries import HOUSE, KINDS, geometry, sights_of, truth_of
from orientation.twomedia.methods import METHODS, control_of


def straight(name: str, method: str) -> Sights:
    """Return the sights of a geometry through water that does not refract."""
    true, at = geometry(name, method), truth_of(geometry(name, method))
    sights = sights_of(true, control_of(METHODS[method]))
    gap = (true.points * HOUSE)[sights.point] - at.station[0, sights.photo]
    inside = np.einsum("nij,nj->ni", attitude_matrix(at.attitude[0])[sights.photo], gap)
    return replace(sights, image=-inside[:, :2] / inside[:, 2:])


def test_weakest_directions_of_one_photo_from_the_air():
    """Tilts of the photo against its place, and against the tilt of the water; as the correlations near 1 say."""
    result = orient(sights_of(geometry("aerial", "SINGLE-RAY"), 20), METHODS["SINGLE-RAY"], Plane())
    assert [direction.words for direction in result.weakest] == [
        "phi with omega with X0 with Y0",
        "omega with phi with Y0 with X0",
    ]
    correlations = result.correlations[:9, :9]
    assert result.inflation[:9] == pytest.approx(np.diagonal(np.linalg.inv(correlations)), rel=1e-3)
    assert np.isnan(result.inflation[9])
    assert 0.0 < result.weakest[0].eigenvalue < result.weakest[1].eigenvalue < 1e-4
    assert not result.free


def test_photos_are_named_where_there_are_several():
    result = orient(sights_of(geometry("aerial", "PAIR-SUCCESSIVE")), METHODS["PAIR-SUCCESSIVE"], Plane())
    assert result.weakest[0].words == "phi of P1 with level with Z0 of P1 with omega of P1"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "equal"),
    [(name, False) for name in METHODS if name != "SINGLE-FERMAT"]
    + [("SINGLE-RAY", True), ("PAIR-SUCCESSIVE", True)],
)
def test_water_that_does_not_refract_leaves_its_plane_free(method, equal):
    """Three directions, of tilts and level alone: the photos keep the orientation of straight rays."""
    sights = straight("lab", method)
    result = orient(sights, METHODS[method], Plane(index=1.0), KINDS["lab"].B, equal)
    free = np.array([direction.parts for direction in result.free])
    assert len(free) == 3
    assert np.abs(free[:, :-4]).max() < 1e-6  # of 1: rounding of normals of condition 1e3
    assert all({"tilt along X", "tilt along Y", "level"} >= set(d.words.split(" with ")) for d in result.free)
    assert result.verdict() == (Verdict.NOT, np.inf)
    unknown = result.problem.unknown[:-4]
    errors = (result.at.vector - truth_of(geometry("lab", method)).vector[0])[:-4][unknown]
    assert np.abs(errors).max() < 1e-9


def test_a_prior_holds_what_the_images_leave_free():
    sights = straight("lab", "PAIR-SUCCESSIVE")
    prior = Plane(index=1.0, level=-2.0, level_sigma=0.01, slope_sigma=0.01)
    result = orient(sights, METHODS["PAIR-SUCCESSIVE"], prior, KINDS["lab"].B)
    assert not result.free
    assert result.verdict()[0] is Verdict.BY_PRIOR
