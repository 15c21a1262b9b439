"""Compiled points as the operator sees them: in their models, the angles of their rays, what is to be said."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.geometry.geodesy import surface

if TYPE_CHECKING:
    from musatpy.compilation.compiled import Compiled, CompiledModel

MISSED = 3.29  # sigmas of a y-parallax, of 99.9 %
DRY, SHORELINE, ABOVE, BETWEEN, PARALLAX = "dry", "shoreline", "above the water", "between the tides", "y-parallax"


def in_models(compiled: Compiled, position: FloatArray) -> FloatArray:
    """Return positions (k, 3) of all points as coordinates of their models, m."""
    out, first = np.full(position.shape, np.nan), 0
    for model in compiled.models:
        here = position[first : first + len(model.rows)]
        known = np.isfinite(here).all(axis=1)
        out[first : first + len(here)][known] = model.stereo.model(compiled.run.frame.working(here[known]))
        first += len(here)
    return out


def incidences(compiled: Compiled) -> FloatArray:
    """Return the angles (k, 2) rad, in air, of the wet rays of points with the normal of the water over them.

    The water is the level or tilted surface of the run, without its waves.
    """
    return np.concatenate([_incidences(model) for model in compiled.models])


def _incidences(model: CompiledModel) -> FloatArray:
    points, stereo, frame = model.points, model.stereo, model.stereo.run.frame
    angle = np.full((len(model.rows), 2), np.nan)
    rows = np.flatnonzero(points.wet.any(axis=1) & np.isfinite(points.position).all(axis=1))
    ground = np.repeat(frame.working(points.position[rows])[:, None], 2, axis=1)
    over = surface(frame, stereo.water_slope, stereo.tides, ground)
    rays = stereo.rays(model.readings.xy[rows]) @ stereo.axes
    angle[rows] = np.arccos(np.clip(-np.einsum("kmi,kmi->km", over.normal, rays), -1.0, 1.0))
    return np.where(points.wet, angle, np.nan)


def remarks(compiled: Compiled) -> list[str | None]:
    """Return why points have no depth, and whether their y-parallax is beyond its limit; None where all is well."""
    wet, submerged, on_shore = compiled.gathered("wet"), compiled.submerged, compiled.on_shore
    off = np.abs(compiled.parallax_test) > MISSED
    lost = [reason is not None for reason in compiled.reasons]
    columns = (
        (submerged & (wet.sum(axis=1) == 1), BETWEEN),
        (submerged & ~wet.any(axis=1), ABOVE),
        (~submerged & on_shore, SHORELINE),
        (~submerged & ~on_shore, DRY),
        (off, PARALLAX),
    )
    texts = [", ".join(words for said, words in columns if said[row]) for row in range(len(lost))]
    return [None if none or not text else text for none, text in zip(lost, texts, strict=True)]
