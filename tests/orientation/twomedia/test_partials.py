"""Partial derivatives of rays and conditions against central differences, and the paper's axes both ways."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from musatpy.orientation.twomedia.axes import from_paper, paper_partials, paper_vector
from musatpy.orientation.twomedia.helmert import Group, Problem
from musatpy.orientation.twomedia.rays import IMAGE, PHOTO, WATER, Orientation, image_rays
from musatpy.orientation.twomedia.sights import Plane, problem_of
from orientation.twomedia.geometries import HOUSE, A, B, N, geometry, rotation, sights_of, truth_of
from orientation.twomedia.methods import METHODS, control_of

_STEP = 1e-6
_ROUNDING = 5e-9  # relative, of central differences with that step


def misclosures(problem: Problem, group: Group, x: np.ndarray, image: np.ndarray, control: np.ndarray):
    """Return the conditions of a group at some values."""
    at = Orientation.of(x)
    rays = image_rays(at, problem.photo, image, problem.wet, problem.rise)
    points = np.zeros((1, len(group.images), 3)) if group.control is None else control[:, group.control]
    return group.condition(rays[group.images], points, at)


def differences(function, x: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Return the central difference of a function of an array for a change of it."""
    return (function(x + _STEP * change).value - function(x - _STEP * change).value) / (2.0 * _STEP)


@pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)
def test_partials_of_the_conditions(method):
    rng = np.random.default_rng(2)
    scene = geometry("tank", method.name)
    problem = problem_of(sights_of(scene, control_of(method)), method, Plane())
    wet = problem.wet.copy()
    if method.name != "SINGLE-FERMAT":  # of wet rays only
        wet[::5] = False
    problem = replace(problem, wet=wet, rise=0.02 * rng.normal(size=len(wet)))
    x = truth_of(scene).vector
    x = x + 0.01 * rng.normal(size=x.shape)
    image = problem.image[None] + 0.01 * rng.normal(size=problem.image.shape)
    control = problem.control[None] + 0.01 * rng.normal(size=problem.control.shape)
    for group in problem.groups:
        at = misclosures(problem, group, x, image, control)
        size = np.abs(at.by_rays).max()
        by_unknown = np.zeros((*at.value.shape, x.shape[1]))
        for ray, photo in enumerate(group.photos):
            by_unknown[..., PHOTO * photo : PHOTO * (photo + 1)] += at.by_rays[..., ray, :PHOTO]
            by_unknown[..., -WATER:] += at.by_rays[..., ray, PHOTO : PHOTO + WATER]
        by = partial(misclosures, problem, group)
        for column, change in enumerate(np.eye(x.shape[1])):
            numeric = differences(partial(by, image=image, control=control), x, change)
            np.testing.assert_allclose(by_unknown[..., column], numeric, atol=_ROUNDING * size)
        for ray in range(len(group.photos)):
            for axis in range(2):
                change = np.zeros_like(image)
                change[0, group.images[:, ray], axis] = 1.0
                numeric = differences(lambda v, by=by: by(x, v, control), image, change)
                by_image = at.by_rays[..., ray, IMAGE][..., axis]
                np.testing.assert_allclose(by_image, numeric, atol=_ROUNDING * size)
        for axis in range(3) if group.control is not None else ():
            change = np.broadcast_to(np.eye(3)[axis], control.shape)
            numeric = differences(partial(by, x, image), control, change)
            np.testing.assert_allclose(at.by_control[..., axis], numeric, atol=_ROUNDING * size)


def test_axes_of_the_paper_both_ways():
    rng = np.random.default_rng(3)
    photos, slope_level = rng.uniform(-1.2, 1.2, (5, 12)), rng.uniform(-0.2, 0.2, (5, 3))
    x = np.concatenate([photos, slope_level, np.full((5, 1), N)], axis=1)
    at = Orientation.of(x)
    np.testing.assert_allclose(from_paper(paper_vector(at)).vector, x, atol=1e-14)
    J = paper_partials(at)
    for column, change in enumerate(_STEP * np.eye(16)):
        numeric = paper_vector(Orientation.of(x + change)) - paper_vector(Orientation.of(x - change))
        np.testing.assert_allclose(J[..., column], numeric / (2.0 * _STEP), atol=1e-8)


def test_a_ray_as_the_paper_prints_it():
    """(2) to (9) in the paper's own axes, written out, against the ray of the house."""
    scene = geometry("lab", "PAIR-SUCCESSIVE")
    sights = sights_of(scene)
    rays = image_rays(truth_of(scene), sights.photo, sights.image[None], sights.wet[sights.point], np.zeros(40))
    normal = np.array([A, B, 1.0]) / np.sqrt(A * A + B * B + 1.0)
    for row, (photo, point) in enumerate(zip(sights.photo, sights.point, strict=True)):
        ray = rotation(*scene.angles[photo]) @ [*scene.images[photo, point], scene.kind.c]
        ray = ray / np.linalg.norm(ray)
        C = scene.stations[photo]
        k = -(np.array([A, B, 1.0]) @ C + scene.d) / (np.array([A, B, 1.0]) @ ray)
        cos_i = ray @ normal
        bent = (ray - normal * (cos_i - np.sqrt(N * N - 1.0 + cos_i**2))) / N
        np.testing.assert_allclose(rays.origin[0, row] * HOUSE, C + k * ray, atol=1e-12)
        np.testing.assert_allclose(rays.direction[0, row] * HOUSE, bent, atol=1e-12)


def test_only_wet_rays_need_water_below_them():
    """A photo turned to the sky shows dry points as any other, and no wet ones."""
    at = truth_of(geometry("lab", "SINGLE-RAY"))
    at = replace(at, attitude=at.attitude + np.radians([120.0, 0.0, 0.0]))
    wet = np.array([True, False])
    rays = image_rays(at, np.zeros(2, dtype=int), np.zeros((1, 2, 2)), wet, np.zeros(2))
    np.testing.assert_array_equal(rays.real, [~wet])
