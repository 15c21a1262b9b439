"""A raster of apparent heights: each post is a point, whose true place, depth and sigmas are bands of another one.

A post that cannot be corrected has its apparent height, no true place, and the number of its reason (`Fault`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import tee
from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.depth.corrected_files import SIGMAS
from musatpy.depth.correction import (
    NO_POINTS,
    Correction,
    CorrectionTally,
    Progress,
    attempted,
    in_order,
    require_sight,
)
from musatpy.errors import DepthError, Problem
from musatpy.interchange import geotiff
from musatpy.interchange.geotiff import Raster
from musatpy.interchange.layers import Grid

POSTS = 16384  # at a time
_BANDS = {"apparent": "m", "true_x": "", "true_y": "", "true_z": "", "depth": "m", "cameras": "", "reason": ""}


def band_of(raster: Raster, wanted: str) -> str:
    """Return the band of heights: the one that is wanted, or the only one. Raises `DepthError`."""
    return _band(raster.path, raster.names, wanted)


def only_band(source: Path, grid: Grid, wanted: str) -> Grid:
    """Return a grid of the heights alone. Raises `DepthError`."""
    name = _band(source, tuple(grid.bands), wanted)
    return replace(grid, bands={name: grid.bands[name]}, units={})


def _band(source: Path, names: Sequence[str], wanted: str) -> str:
    if wanted in names or (not wanted and len(names) == 1):
        return wanted or names[0]
    message = f"which band has the heights? --band is one of {', '.join(names)}"
    raise DepthError([Problem(file=str(source), message=message)])


def correct_raster(
    raster: Raster,
    target: Path,
    band: str,
    correction: Correction,
    *,
    jobs: int = 1,
    progress: Progress | None = None,
) -> CorrectionTally:
    """Correct the heights of a band of an open raster; `progress` is told of posts.

    Raises `DepthError` for posts that their system does not reach, and where no camera sees any, `InterchangeError`
    and `OSError`; then no file is left.
    """
    posts, tally = raster.posts, NO_POINTS
    rows, columns = posts.shape
    step = max(1, POSTS // columns)

    def apparent(first: int) -> FloatArray:
        last = min(first + step, rows)
        return np.column_stack([posts.places(first, last), raster.rows(band, first, last).ravel()])

    bands = _BANDS | ({} if correction.errors is None else dict.fromkeys(SIGMAS, "m"))
    with geotiff.written(target, posts, bands) as writer:
        given, waiting = tee(map(apparent, range(0, rows, step)))
        work = in_order(partial(attempted, correction, str(raster.path)), waiting, jobs)
        for first, here, done in zip(range(0, rows, step), given, work, strict=True):
            if isinstance(done, Problem):
                raise DepthError([done])
            points, _ = done
            values = (
                here[:, 2], *points.position.T, points.depth, points.cameras, points.fault, *points.sigma.T,
                points.depth_sigma,
            )  # fmt: skip
            shaped = (np.asarray(column, dtype=float).reshape(-1, columns) for column in values)
            writer.put(first, dict(zip(bands, shaped, strict=False)))
            tally = tally + CorrectionTally.of(points)
            if progress:
                progress(len(here))
        require_sight(correction, tally, raster.path, apparent(0))
    return tally
