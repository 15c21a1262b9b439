"""Every partial derivative of the plate reduction, by complex step or central differences; and every inverse.

A complex step of 1e-30 is exact to rounding, 1e-12 of the largest element. Iterated and looked-up functions take
central differences instead: with h = 1e-4 mm they lose 1e-16 * 100 mm / h = 1e-10, and as much to the third
derivatives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from musatpy.reduction.atmosphere import Refraction
from musatpy.reduction.comparator import Comparator
from musatpy.reduction.curvature import Curvature
from musatpy.reduction.distortion import Side
from musatpy.reduction.planar import Kind, Plane
from reduction import plates

PLANES = {
    "similarity": Plane(kind=Kind.SIMILARITY, parameters=np.array([0.99, 0.3, 4.0, -7.0])),
    "affine": Plane(kind=Kind.AFFINE, parameters=np.array([0.99, 0.01, -0.02, 1.02, 4.0, -7.0])),
    "projective": Plane(
        kind=Kind.PROJECTIVE, parameters=np.array([0.99, 0.01, 4.0, -0.02, 1.02, -7.0, 2e-5, -3e-5])
    ),
}
STEPS = {
    **PLANES,
    "comparator": plates.comparator(),
    "reseau": plates.reseau(),
    "lens, measured side": plates.lens(Side.MEASURED),
    "lens, ideal side": plates.lens(Side.IDEAL),
    "refraction, tilted": Refraction(view=plates.view(), K=9e-5),
    "curvature, tilted": Curvature(view=plates.view(), height=6000.0),
}


def central(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray, size: float) -> np.ndarray:
    """Return derivatives (..., k) of function(at (..., k)), differences of steps of a size."""
    steps = size * np.eye(at.shape[-1])
    return np.stack([(function(at + step) - function(at - step)) / (2.0 * size) for step in steps], axis=-1)


@pytest.mark.parametrize("name", STEPS)
def test_partials_by_coordinates(name):
    step, xy = STEPS[name], plates.points()
    # 1e-9 is 1e-7 mm over the whole plate
    np.testing.assert_allclose(step.partials(xy), central(step.apply, xy, 1e-4), rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", STEPS)
def test_inverse(name):
    step, xy = STEPS[name], plates.points()
    np.testing.assert_allclose(step.inverse(step.apply(xy)), xy, rtol=0.0, atol=1e-9)  # the promise of the inverses
    np.testing.assert_allclose(step.apply(step.inverse(xy)), xy, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", [name for name in STEPS if "lens, ideal" not in name and name != "reseau"])
def test_partials_by_complex_step(name):
    step, xy = STEPS[name], plates.points()
    columns = [step.apply(xy + 1e-30j * axis).imag / 1e-30 for axis in np.eye(2)]
    got = step.partials(xy)
    np.testing.assert_allclose(got, np.stack(columns, axis=-1), rtol=0.0, atol=1e-12 * np.abs(got).max())


@pytest.mark.parametrize("name", PLANES)
def test_plane_by_parameters(name):
    plane, xy = PLANES[name], plates.points()
    got = plane.by_parameters(xy)
    columns = []
    for axis in np.eye(len(plane.parameters)):
        moved = replace(plane, parameters=plane.parameters + 1e-30j * axis)
        columns.append(moved.apply(xy).imag / 1e-30)
    np.testing.assert_allclose(got, np.stack(columns, axis=-1), rtol=0.0, atol=1e-12 * np.abs(got).max())


def test_comparator_by_parameters():
    one, xy = plates.comparator(), plates.points()

    def moved(p: np.ndarray) -> np.ndarray:
        other = Comparator(scale=(p[0], p[1]), non_orthogonality=p[2], rotation=p[3], left_handed=True)
        return other.apply(xy)

    want = central(moved, one.parameters(), 1e-5)
    # sines of 100 mm bend: h^2 / 6 * 100 = 2e-9, and rounding 1e-16 * 100 / h = 1e-9
    np.testing.assert_allclose(one.by_parameters(xy), want, rtol=0.0, atol=1e-8)


def test_partials_at_the_centre_and_beyond_the_table():
    one = plates.lens(Side.MEASURED)
    for xy in (one.centre[None] + 1e-3, np.array([[150.0, 150.0]])):
        np.testing.assert_allclose(one.partials(xy), central(one.apply, xy, 1e-4), rtol=0.0, atol=1e-9)
    at = np.stack([one.centre, one.centre])
    np.testing.assert_array_equal(one.apply(at), at)
    assert np.isfinite(one.partials(at)).all()
