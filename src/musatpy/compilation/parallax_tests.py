"""Whether y-parallaxes are what errors of pointing, of the stations and of the water make."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.readings_of_run import are_of_run, on_both_photos, points_of_run
from musatpy.probability import student_as_normal

if TYPE_CHECKING:
    from musatpy.compilation.compiled import CompiledModel

_CHECKED = 1e-3  # of the variance of pointing that the stations must leave of a y-parallax that made them


def parallax_tests(model: CompiledModel, sigma_of_run: bool) -> FloatArray:
    """Return y-parallaxes (k,) over their sigmas, as normal variables; NaN where nothing checks them.

    The share of the stations is known as well as the sigma0 of the run that scales it: with few degrees of freedom
    f that may be much too small, and all points of a model with it. By Welch (1947) and Satterthwaite (1946) the
    test value is Student's t of f / s^2 degrees, s the share in the variance, and of f where the sigma of pointing
    comes from the run too (`sigma_of_run`). The y-parallaxes of readings that made the stations are residuals of
    the adjustment: of the variance of pointing less the share of the stations.
    """
    points, share = model.points, 1.0 - model.points.pointing_share
    variance = np.square(points.y_parallax_sigma)
    freedom = np.full(len(variance), model.stereo.run.freedom)
    if not sigma_of_run:
        with np.errstate(divide="ignore"):
            freedom = freedom / np.square(np.maximum(share, 0.0))
    for row, scale in _made_the_stations(model).items():
        pointing = scale * points.pointing_share[row]
        left = pointing - share[row]
        variance[row] *= left if left > _CHECKED * pointing else np.nan
        freedom[row] = model.stereo.run.freedom
    return student_as_normal(points.y_parallax / np.sqrt(variance), freedom)


def _made_the_stations(model: CompiledModel) -> dict[int, float]:
    """Return the readings (rows) that the run has used, with its variance of their pointing over that of the model.

    None where errors of known water are allowed for: these did not make the stations.
    """
    run, readings = model.stereo.run, model.readings
    point = points_of_run(model)
    rows = np.flatnonzero(point >= 0)
    if not len(rows) or run.considered:
        return {}
    same = rows[are_of_run(model, rows, point[rows])]
    plates, out = run.block.plates, dict[int, float]()
    for row in same.tolist():
        if not on_both_photos(model, int(point[row])):
            continue
        of_run = (plates.point == point[row]) & np.isin(plates.photo, model.stereo.photos)
        squares = np.square(plates.sigma[of_run] * run.unit_sigma)
        out[row] = float(squares.mean() / np.square(readings.sigma[row]).mean())
    return out
