"""Gross errors among the images and the control: who is named, and what is left of them in the result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from musatpy.orientation.twomedia.helmert import misfits
from musatpy.orientation.twomedia.oriented import orient
from musatpy.orientation.twomedia.sights import Plane, Sights, problem_of
from orientation.twomedia.geometries import geometry, sights_of, truth_of
from orientation.twomedia.methods import METHODS, control_of


def contaminated(sights: Sights, seed: int, focal_length: float) -> Sights:
    """Return sights with noise, 5 % of wrong images (50 um to 10 mm) and a wrong control point."""
    rng = np.random.default_rng(seed)
    image = sights.image + rng.normal(size=sights.image.shape) * sights.image_sigma
    rows = rng.choice(len(image), max(1, len(image) // 20), replace=False)
    size = np.exp(rng.uniform(np.log(50e-6), np.log(10e-3), len(rows))) / focal_length
    turn = rng.uniform(0.0, 2.0 * np.pi, len(rows))
    image[rows] += size[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    control = sights.control.copy()
    known = np.flatnonzero(sights.is_control)
    if len(known):
        control[rng.choice(known)] += 0.1 * rng.normal(size=3)
    return replace(sights, image=image, control=control)


@pytest.mark.parametrize(
    "method", [name if name == "COMBINED" else pytest.param(name, marks=pytest.mark.slow) for name in METHODS]
)
def test_wrong_images_and_control_are_named(method):
    """All whose conditions the errors touch; one along the epipolar line of a pair only moves its point."""
    true = geometry("lab", method)
    sights = contaminated(sights_of(true, control_of(METHODS[method])), 10, true.kind.c)
    problem = problem_of(sights, METHODS[method], Plane())
    size = misfits(problem, truth_of(true))[0]
    point = np.concatenate([problem.point[group.images[:, 0]] for group in problem.groups])
    result = orient(sights, METHODS[method], Plane(), true.kind.B)
    assert (size > 8.0).any()
    assert set(point[size > 8.0]) <= set(np.flatnonzero(result.outliers))
    unknown = result.problem.unknown
    errors = (result.at.vector - truth_of(true).vector[0])[unknown] / result.sigma[unknown]
    assert np.abs(errors).max() < 3.5  # the largest of up to 15 unknowns, correlated
    assert result.fits
