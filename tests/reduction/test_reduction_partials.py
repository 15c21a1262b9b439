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

from musatpy.reduction import atmosphere, nadir
from musatpy.reduction.atmosphere import Model, Refraction
from musatpy.reduction.comparator import Comparator
from musatpy.reduction.curvature import Curvature
from musatpy.reduction.distortion import Lens, Side
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


def central(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Return derivatives (..., k) of function(at (k,))."""
    columns = []
    for i, h in enumerate(steps):
        step = np.zeros(len(at))
        step[i] = h
        columns.append((function(at + step) - function(at - step)) / (2.0 * h))
    return np.stack(columns, axis=-1)


def by_xy(function: Callable[[np.ndarray], np.ndarray], xy: np.ndarray) -> np.ndarray:
    columns = []
    for i in range(2):
        step = np.zeros(2)
        step[i] = 1e-4
        columns.append((function(xy + step) - function(xy - step)) / 2e-4)
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("name", STEPS)
def test_partials_by_coordinates(name):
    step, xy = STEPS[name], plates.points()
    # 1e-9 is 1e-7 mm over the whole plate
    np.testing.assert_allclose(step.partials(xy), by_xy(step.apply, xy), rtol=0.0, atol=1e-9)


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

    want = central(moved, one.parameters(), np.full(4, 1e-5))
    # sines of 100 mm bend: h^2 / 6 * 100 = 2e-9, and rounding 1e-16 * 100 / h = 1e-9
    np.testing.assert_allclose(one.by_parameters(xy), want, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("side", Side)
def test_lens_by_parameters(side):
    one, xy = plates.lens(side), plates.points()
    at = np.concatenate([one.centre, one.k, one.p])
    # steps that move a point by a few micrometres: larger ones bend
    steps = np.array([1e-3, 1e-3, 1e-5, 1e-9, 1e-13, 1e-18, 1e-8, 1e-8, 1e-6])

    def moved(p: np.ndarray) -> np.ndarray:
        return replace(one, centre=p[:2], k=p[2:6], p=p[6:]).apply(xy)

    got, want = one.by_parameters(xy), central(moved, at, steps)
    scale = np.abs(got).max(axis=(0, 1))
    np.testing.assert_allclose(got / scale, want / scale, rtol=0.0, atol=2e-7)  # 1e-14 / step / size of a column


@pytest.mark.parametrize("side", Side)
def test_lens_by_table(side):
    one, xy = plates.lens(side), plates.points()

    def moved(values: np.ndarray) -> np.ndarray:
        return replace(one, radial=values).apply(xy)

    want = central(moved, one.radial, np.full(len(one.radial), 1e-3))
    np.testing.assert_allclose(one.by_table(xy), want, rtol=0.0, atol=1e-7)  # bends by slope^2 * step^2


def test_reseau_by_crosses():
    one, xy = plates.reseau(), plates.points(count=6)
    corners, by_measured, by_calibrated = one.by_crosses(xy)
    for name, got in (("measured", by_measured), ("calibrated", by_calibrated)):
        grid = getattr(one, name).reshape(-1)

        def moved(values: np.ndarray, name: str = name) -> np.ndarray:
            return replace(one, **{name: values.reshape(one.measured.shape)}).apply(xy)

        want = central(moved, grid, np.full(len(grid), 1e-4)).reshape(len(xy), 2, -1, 2)
        for point, own in enumerate(corners):
            np.testing.assert_allclose(
                np.swapaxes(got[point], 0, 1), want[point][:, own], rtol=0.0, atol=1e-9
            )  # as above
            others = np.delete(want[point], own, axis=1)
            np.testing.assert_allclose(others, 0.0, atol=1e-9)


def test_refraction_and_curvature_by_parameters():
    xy, view = plates.points(), plates.view()
    bent = Refraction(view=view, K=9e-5)
    want = central(lambda K: Refraction(view=view, K=K[0]).apply(xy), np.array([9e-5]), np.array([1e-6]))
    # mm/rad, up to 400: rounding 1e-14 / 1e-6, bending 400 * 1e-12
    np.testing.assert_allclose(bent.by_parameters(xy), want, rtol=0.0, atol=1e-7)
    flat = Curvature(view=view, height=6000.0)
    want = central(lambda h: Curvature(view=view, height=h[0]).apply(xy), np.array([6000.0]), np.full(1, 10.0))
    # mm/m: rounding 1e-14 / 10
    np.testing.assert_allclose(flat.by_parameters(xy), want, rtol=0.0, atol=1e-12)
    by_bc = nadir.bend_by_parameters(view, xy, 1e-4, -3e-4)
    want = central(lambda p: nadir.bend(view, xy, p[0], p[1]), np.array([1e-4, -3e-4]), np.full(2, 1e-6))
    np.testing.assert_allclose(by_bc, want, rtol=0.0, atol=1e-6)  # of 300: bending 300 * 1e-9


@pytest.mark.parametrize("model", Model)
@pytest.mark.parametrize(("camera", "ground"), [(1860.0, 1100.0), (6000.0, 0.0), (8900.0, 2500.0)])
def test_refraction_constant_by_heights(model, camera, ground):
    got = atmosphere.constant_partials(model, camera, ground)
    want = central(
        lambda p: np.array(atmosphere.constant(model, p[0], p[1])), np.array([camera, ground]), np.full(2, 1.0)
    )
    # K is some 1e-5 rad and rounds, through the difference of two pressures, to 1e-19 * 1e3
    np.testing.assert_allclose(got, want, rtol=1e-5, atol=1e-15)


def test_partials_at_the_centre_and_beyond_the_table():
    one = plates.lens(Side.MEASURED)
    for xy in (one.centre[None] + 1e-3, np.array([[150.0, 150.0]])):
        np.testing.assert_allclose(one.partials(xy), by_xy(one.apply, xy), rtol=0.0, atol=1e-9)
    at = np.stack([one.centre, one.centre])
    np.testing.assert_array_equal(one.apply(at), at)
    assert np.isfinite(one.partials(at)).all()
    assert isinstance(one, Lens)
