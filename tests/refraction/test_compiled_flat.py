"""Compiled rays through level water beside their numpy twin, and when they are compiled.

Slow, as they are compiled first.
"""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from musatpy import compiling
from musatpy.errors import AdjustmentError
from musatpy.refraction import compiled_flat, flat

BOTH = (compiling.NUMBA, compiling.NUMPY)


def of_both(*arguments, wet=None):
    """Return the incidence of rays by compiled loops and by numpy."""
    found = []
    for kind in BOTH:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv(compiling.VARIABLE, kind)
            found.append(flat.incidence(*arguments, wet))
    return found


def assert_alike(*arguments, wet=None):
    """No array of a ray differs by more than 1e-12 of its largest element, or of 1 where all are smaller."""
    for a, b in zip(*map(astuple, of_both(*arguments, wet=wet)), strict=True):
        assert a.shape == b.shape
        over = tuple(range(len(np.shape(arguments[3])), b.ndim))
        scale = np.maximum(np.abs(b).max(axis=over, keepdims=True, initial=1.0), 1.0)
        np.testing.assert_allclose(a / scale, b / scale, rtol=0.0, atol=1e-12)


def scene(seed, rays, tilt, steepest, deepest=60.0):
    """Return cameras, ground points, verticals, depths and indices of random rays."""
    draws = np.random.default_rng(seed)
    up = np.array([0.0, 0.0, 1.0]) + tilt * draws.normal(size=(rays, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    aside = np.cross(up, draws.normal(size=(rays, 3)))
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    ground = draws.normal(size=(rays, 3)) * 1000.0
    depth = draws.uniform(0.0, deepest, rays)
    H = draws.uniform(20.0, 5000.0, rays)
    D = (H + depth) * draws.uniform(0.0, steepest, rays)
    camera = ground + up * (H + depth)[:, None] + aside * D[:, None]
    return camera, ground, up, depth, draws.uniform(1.0, 1.5, rays)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    rays=st.sampled_from((1, 7, 255, 256, 257, 1000)),
    tilt=st.sampled_from((0.0, 1e-3, 1.0)),
    steepest=st.sampled_from((0.0, 1.0, 20.0, 1000.0)),
)
def test_both_have_the_same_incidence_and_partials(seed: int, rays: int, tilt: float, steepest: float) -> None:
    """Level and tilted water, from the nadir to grazing rays, one block of rays and several."""
    camera, ground, up, depth, index = scene(seed, rays, tilt, steepest)
    assert_alike(camera, ground, up, depth, index)
    assert_alike(camera, ground, up, depth, 1.34, wet=True)


@pytest.mark.slow
def test_depth_zero_and_points_above_the_water() -> None:
    camera, ground, up, depth, index = scene(1, 600, 1e-3, 3.0, deepest=3.0)
    depth[::3] = 0.0
    depth[1::3] *= -0.1
    assert_alike(camera, ground, up, depth, index)
    assert_alike(camera, ground, up, depth, index, wet=True)  # as an adjustment takes them
    assert_alike(camera, ground, up, depth, index, wet=np.arange(600) % 2 == 0)


@pytest.mark.slow
def test_shapes_are_those_of_all_arguments_and_calls_do_not_show() -> None:
    camera, ground, up, depth, index = scene(2, compiled_flat.CHUNK + 300, 1e-3, 2.0)
    assert_alike(camera, ground, up[:1], depth, 1.34)
    some, _ = of_both(camera[-400:], ground[-400:], up[-400:], depth[-400:], index[-400:])
    all_, _ = of_both(camera, ground, up, depth, index)
    for a, b in zip(astuple(some), astuple(all_), strict=True):
        # a block may take one more step than others need
        np.testing.assert_allclose(a, b[-400:], rtol=1e-13, atol=1e-12)
    assert_alike(camera[:3, None], ground[:5], up[:5], np.broadcast_to(depth[:5], (3, 5)), index[:3, None])
    assert all(array.size == 0 for array in astuple(of_both(camera[:0], ground[:0], up[:0], depth[:0], 1.34)[0]))


def test_numba_is_left_alone_for_few_rays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(compiling.VARIABLE, raising=False)
    name = compiled_flat.__name__
    assert compiling.compiled_kernels(name, worth=True) is compiled_flat
    assert compiling.compiled_kernels(name, worth=False) is None
    monkeypatch.setitem(sys.modules, name, None)  # which fails where it is asked for
    compiling._loaded.cache_clear()
    flat.incidence(*scene(3, 10, 0.0, 1.0))
    monkeypatch.undo()
    compiling._loaded.cache_clear()


def test_without_numba_many_rays_go_by_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    compiling._loaded.cache_clear()
    monkeypatch.delenv(compiling.VARIABLE, raising=False)
    monkeypatch.setattr(flat, "LARGE", 5)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    flat.incidence(*scene(3, 10, 0.0, 1.0))
    monkeypatch.setenv(compiling.VARIABLE, compiling.NUMBA)
    with pytest.raises(AdjustmentError, match=r"pip install 'musatpy\[fast\]'"):
        flat.incidence(*scene(3, 10, 0.0, 1.0))
    compiling._loaded.cache_clear()
