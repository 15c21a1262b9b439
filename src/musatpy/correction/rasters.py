"""A raster of apparent heights: each post is a point, whose true place, depth and sigmas are bands of another one.

A post that cannot be corrected has its apparent height, no true place, and the number of its reason (`Fault`).
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.depth.correction import NO_POINTS, Correction, Progress, Tally, in_order, unreached
from musatpy.depth.csv_points import SIGMAS
from musatpy.errors import DepthError, Problem, SystemsError
from musatpy.interchange import geotiff
from musatpy.interchange.geotiff import Raster
from musatpy.refraction.apparent import TruePoints

_POSTS = 16384  # at a time
_BANDS = {"apparent": "m", "true_x": "", "true_y": "", "true_z": "", "depth": "m", "cameras": "", "reason": ""}


def band_of(raster: Raster, wanted: str) -> str:
    """Return the band of heights: the one that is wanted, or the only one. Raises `DepthError`."""
    if wanted in raster.names or (not wanted and len(raster.names) == 1):
        return wanted or raster.names[0]
    message = f"which band has the heights? --band is one of {', '.join(raster.names)}"
    raise DepthError([Problem(file=str(raster.path), message=message)])


def correct_raster(
    raster: Raster,
    target: Path,
    band: str,
    correction: Correction,
    *,
    jobs: int = 1,
    progress: Progress | None = None,
) -> Tally:
    """Correct the heights of a band of an open raster; `progress` is told of posts.

    Raises `DepthError` for posts that their system does not reach, and where no camera sees any, `InterchangeError`
    and `OSError`; then no file is left.
    """
    posts, tally = raster.posts, NO_POINTS
    rows, columns = posts.shape
    step = max(1, _POSTS // columns)

    def apparent(first: int) -> FloatArray:
        last = min(first + step, rows)
        return np.column_stack([posts.places(first, last), raster.rows(band, first, last).ravel()])

    bands = _BANDS | ({} if correction.errors is None else dict.fromkeys(SIGMAS, "m"))
    source = str(raster.path)
    with geotiff.written(target, posts, bands) as writer:
        work = in_order(partial(_corrected, correction, source), map(apparent, range(0, rows, step)), jobs)
        for first, done in zip(range(0, rows, step), work, strict=True):
            if isinstance(done, Problem):
                raise DepthError([done])
            height, points = done
            values = (
                height, *points.position.T, points.depth, points.cameras, points.fault, *points.sigma.T,
                points.depth_sigma,
            )  # fmt: skip
            shaped = (np.asarray(column, dtype=float).reshape(-1, columns) for column in values)
            writer.put(first, dict(zip(bands, shaped, strict=False)))
            tally = tally + Tally.of(points)
            if progress:
                progress(len(height))
        correction.require_sight(tally, raster.path)
    return tally


def _corrected(
    correction: Correction, source: str, apparent: FloatArray
) -> tuple[FloatArray, TruePoints] | Problem:
    """Return the heights of posts and their true points; a function of the module: other processes call it."""
    try:
        return apparent[:, 2], correction(apparent)[0]
    except SystemsError as error:
        return unreached(source, error)
