"""A right stage that has moved since the triangulation: corrected by the y-parallaxes of points read again.

Two components of the base and three rotations of the right photo, through the water, free as far as the points
determine them. The answer departs from the triangulation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.stereomodels import Stereomodel
from musatpy.compilation.true_points import Readings, true_points
from musatpy.errors import CompilationError, Problem
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix, turn

NAMES = ("by", "bz", "omega", "phi", "kappa")
_STEP = 1e-5  # rad, and of the flying height: some micrometres in the image
_TURNS = 10
_STILL = 1e-6  # mm, of y-parallaxes
_DETERMINED = 1e-3  # of the best determined direction
_OPEN = 1e-2  # share of a correction in directions that are not determined, from which on it has no sigma


@dataclass(frozen=True, kw_only=True, eq=False)
class MovedStage:
    """Corrections (5,) of by, bz (m), omega, phi, kappa (rad) in the model, with sigmas, NaN where not determined.

    `freedom` counts the `points` less the directions that they determine; parallax before and after, RMS in mm.
    """

    values: FloatArray
    sigma: FloatArray
    points: int
    freedom: int
    before: float
    after: float


def moved_right_stage(stereo: Stereomodel, readings: Readings) -> tuple[Stereomodel, MovedStage]:
    """Return the model with its right stage corrected by the y-parallaxes of readings, and the corrections.

    Raises `CompilationError` where no reading has a y-parallax.
    """
    scale = np.array([stereo.height, stereo.height, 1.0, 1.0, 1.0])

    def parallax(values: FloatArray) -> tuple[FloatArray, FloatArray]:
        run = _moved(stereo, values * scale).run.without_errors
        points = true_points(run, stereo.photos, readings)
        return points.y_parallax, points.y_parallax_sigma

    values = np.zeros(5)
    first, sigma = parallax(values)
    used = np.isfinite(first)
    if not used.any():
        raise CompilationError([Problem(message="no points are read again to adjust its right stage by")])
    off = first
    for _ in range(_TURNS):
        U, s, Vt = np.linalg.svd(_partials(parallax, values)[used] / sigma[used, None], full_matrices=False)
        held = s > _DETERMINED * s[0]
        step = -Vt[held].T @ ((U[:, held].T @ (off[used] / sigma[used])) / s[held])
        values = values + step
        before, (off, sigma) = off, parallax(values)
        if np.abs(off - before)[used].max() < _STILL:
            break
    spread = Vt[held].T / s[held]
    known = np.sum(np.square(Vt[held]), axis=0) > 1.0 - np.square(_OPEN)
    return _moved(stereo, values * scale), MovedStage(
        values=values * scale,
        sigma=np.where(known, np.linalg.norm(spread, axis=1) * scale, np.nan),
        points=int(used.sum()),
        freedom=int(used.sum() - held.sum()),
        before=_rms(first[used]),
        after=_rms(off[used]),
    )


def _partials(parallax: Callable[[FloatArray], tuple[FloatArray, FloatArray]], values: FloatArray) -> FloatArray:
    """Return the partials (k, 5) of y-parallaxes (k,), by central differences."""
    steps = _STEP * np.eye(5)
    return np.stack([(parallax(values + h)[0] - parallax(values - h)[0]) / (2.0 * _STEP) for h in steps], axis=1)


def _moved(stereo: Stereomodel, values: FloatArray) -> Stereomodel:
    """Return the model with corrections (5,) of its right stage."""
    run, row = stereo.run, stereo.right
    photos, frame = run.block.photos, run.frame
    station = frame.working(photos.position[row : row + 1])
    moved = station + np.array([0.0, *values[:2]]) @ stereo.axes
    turned = stereo.axes.T @ turn(values[2:]) @ stereo.axes  # of the photo, in working axes
    M = attitude_matrix(photos.attitude[row]) @ frame.axes(station)[0] @ turned.T
    position, attitude = photos.position.copy(), photos.attitude.copy()
    position[row] = frame.system(moved)[0]
    attitude[row] = attitude_from_matrix(M @ frame.axes(moved)[0].T)
    block = replace(run.block, photos=replace(photos, position=position, attitude=attitude))
    return replace(stereo, run=replace(run, block=block))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
