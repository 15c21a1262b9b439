"""Soundings over plane bottoms: depths, sigmas with their parts, and every reason why one does not count."""

from __future__ import annotations

import datetime
from dataclasses import replace

import numpy as np
import pytest

from musatpy.arrays import FloatArray
from musatpy.compilation.joined_surfaces import BottomPoints, Surface
from musatpy.compilation.sounded import DRY, STEEP, UNDATED, Matching, sounded
from musatpy.soundings.sounding_files import Soundings
from musatpy.surfaces.tin import FEW, LONG_EDGE, OUTSIDE, REASONS, Tin

SLOPE, WATER = 0.1, 1.0  # the datum is 1 m above the water


def surface(shift: float = 0.0, sigma: float = 0.2, longest: float = np.inf) -> Surface:
    """Return a bottom that falls towards east from 0 to 10 m below the datum, x and y 0 to 100 m."""
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(0.0, 100.0, 11), np.linspace(0.0, 100.0, 11)))
    points = BottomPoints(
        xy=np.column_stack([x, y]), depth=SLOPE * x + shift, sigma=np.full(121, sigma), water=np.full(121, WATER)
    )
    tin = Tin.of(np.column_stack([points.xy, points.depth]), points.sigma, longest)
    return Surface(models=("M",), points=points, tin=tin, plan=None)


def soundings(place: FloatArray, depth: FloatArray, dates: list[str] | None = None) -> Soundings:
    n = len(depth)
    return Soundings(
        names=np.arange(n).astype(np.str_),
        place=place,
        angular=False,
        depth=depth,
        sigma=np.full(n, np.nan),
        date=np.array(dates or ["NaT"] * n, dtype="datetime64[D]"),
    )


@pytest.mark.parametrize("radius", [np.inf, 25.0])
def test_depths_and_sigmas_of_triangles_and_of_planes(radius: float) -> None:
    place = np.array([[50.0, 50.0], [30.0, 70.0]])
    how = Matching(datum=0.3, datum_sigma=0.04, sigma=0.1, plan_sigma=2.0, radius=radius)
    compared = sounded([surface()], soundings(place, np.array([4.5, 3.2])), how)
    differences = compared.differences
    np.testing.assert_allclose(differences.compiled, [5.0, 3.0])
    np.testing.assert_allclose(differences.difference, [5.0 - 4.8, 3.0 - 3.5])
    points = 21 if np.isfinite(radius) else 1  # within 25 m of a point of a net of 10 m, or the point itself
    np.testing.assert_allclose(differences.sigma, np.sqrt(0.04 / points + 0.01 + (2.0 * SLOPE) ** 2 + 0.04**2))
    np.testing.assert_array_equal(compared.xy, place)


def test_what_is_above_the_water_is_dry() -> None:
    """The water is 1 m below the datum: at x 10."""
    place = np.array([[9.0, 50.0], [11.0, 50.0]])
    compared = sounded([surface()], soundings(place, np.array([0.9, 1.1])), Matching())
    assert compared.reasons == {0: DRY} and compared.rows.tolist() == [1]
    covered = sounded([surface(), surface(2.0, 0.5)], soundings(place, np.array([0.9, 1.1])), Matching())
    assert not covered.reasons
    np.testing.assert_allclose(covered.differences.compiled, [2.9, 1.1])  # the surer one where both are


def test_every_reason() -> None:
    place = np.array([[500.0, 0.0], [5.0, 50.0], [50.0, 50.0], [60.0, 50.0], [70.0, 50.0]])
    data = soundings(place, np.full(5, 5.0), ["1985-01-01", "1985-01-01", "1979-12-31", "NaT", "1980-01-01"])
    how = Matching(not_before=datetime.date(1980, 1, 1))
    compared = sounded([surface()], data, how)
    assert compared.reasons == {0: REASONS[OUTSIDE], 1: DRY, 2: "older than 1980-01-01", 3: UNDATED}
    assert compared.rows.tolist() == [4]
    assert sounded([surface()], data, Matching(steepest=0.05)).reasons[2] == STEEP
    assert sounded([surface(longest=9.0)], data, Matching()).reasons[2] == REASONS[LONG_EDGE]
    assert sounded([surface()], data, Matching(radius=5.0)).reasons[2] == REASONS[FEW]
    none = [replace(surface(), tin=None)]
    assert set(sounded(none, data, Matching()).reasons.values()) == {REASONS[OUTSIDE]}


def test_the_reason_of_the_model_that_covers_a_place_counts() -> None:
    far = surface()
    shifted = replace(far.points, xy=far.points.xy + 5000.0)
    far = replace(far, points=shifted, tin=Tin.of(np.column_stack([shifted.xy, shifted.depth]), shifted.sigma))
    place = np.array([[5.0, 50.0], [50.0, 50.0]])
    for surfaces in ([surface(), far], [far, surface()]):
        assert sounded(surfaces, soundings(place, np.full(2, 5.0)), Matching()).reasons == {0: DRY}
