"""Gross errors among the images and the control: who is named, and what is left of them in the result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from musatpy.orientation.twomedia.oriented import orient
from musatpy.orientation.twomedia.sights import Plane, Sights
from orientation.twomedia.geometries import geometry, sights_of, truth_of
from orientation.twomedia.methods import METHODS, control_of


def contaminated(sights: Sights, seed: int, focal_length: float) -> tuple[Sights, set[int]]:
    """Return sights with noise, 5 % of wrong images (50 um to 10 mm) and a wrong control point, and the wrong points."""
    rng = np.random.default_rng(seed)
    image = sights.image + rng.normal(size=sights.image.shape) * sights.image_sigma
    rows = rng.choice(len(image), max(1, len(image) // 20), replace=False)
    size = np.exp(rng.uniform(np.log(50e-6), np.log(10e-3), len(rows))) / focal_length
    turn = rng.uniform(0.0, 2.0 * np.pi, len(rows))
    image[rows] += size[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    wrong = set(sights.point[rows].tolist())
    control = sights.control.copy()
    known = np.flatnonzero(sights.is_control)
    if len(known):
        point = int(rng.choice(known))
        control[point] += 0.1 * rng.normal(size=3)
        wrong.add(point)
    return replace(sights, image=image, control=control), wrong


@pytest.mark.parametrize("method", METHODS)
def test_wrong_images_and_control_are_named(method):
    true = geometry("lab", method)
    sights, wrong = contaminated(sights_of(true, control_of(METHODS[method])), 10, true.kind.c)
    result = orient(sights, METHODS[method], Plane(), true.kind.B)
    assert wrong <= set(np.flatnonzero(result.outliers).tolist())
    unknown = result.problem.unknown
    errors = (result.at.vector - truth_of(true).vector[0])[unknown] / result.sigma[unknown]
    assert np.abs(errors).max() < 3.5
    assert result.fits
