"""Decks whose stations are approximations, given in place of what a run has punched."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.triangulation import Triangulation, of_block
from musatpy.compilation.true_points import Readings, true_points
from musatpy.model.compilation import RECOVERABLE
from musatpy.reduction.readings_job import reduce

_PAIRS = 10  # of photos that are looked at
_MISFIT = 6.0  # plate sigmas that half the y-parallaxes of adjusted photos are well below


def unadjusted(run: Triangulation) -> str:
    """Return what says that the stations of a deck are not those of its plates; empty where nothing does.

    A punched deck may have no plate measurements. Raises `DeckError` as `reduction.readings_job.reduce` where they
    are raw.
    """
    if run.block.raw:
        run = of_block(reduce(run.block)[0])
    last = len(run.block.photos.ids) - 2
    first = np.unique(np.linspace(0, max(last, 0), _PAIRS).astype(np.int64))[: max(last + 1, 0)]
    off = np.concatenate([np.zeros(0), *(np.abs(_y_parallaxes(run, left)) for left in first.tolist())])
    known = off[np.isfinite(off)]
    limit = max(RECOVERABLE, _MISFIT * run.block.options.plate_sigma)
    if not len(known) or np.median(known) <= limit:
        return ""
    half = f"half have y-parallaxes over {1e3 * np.median(known):.0f} um (expected: below {1e3 * limit:.0f} um)"
    return (
        f"its stations do not fit its plate measurements: of {len(known)} points that neighbouring photos share, "
        f"{half}. It is the deck of a run that is still to be adjusted: give the record of the run, NAME.json, or "
        "the deck that it punched, NAME.pun (--anyway compiles from it)"
    )


def _y_parallaxes(run: Triangulation, left: int) -> FloatArray:
    """Return the y-parallaxes (k,) mm of the points that a photo shares with the next one, NaN where unknown."""
    block, plates = run.block, run.block.plates
    one, other = (np.flatnonzero((plates.photo == photo) & plates.triangulated) for photo in (left, left + 1))
    common, here, there = np.intersect1d(plates.point[one], plates.point[other], return_indices=True)
    at = np.stack([one[here], other[there]], axis=1)
    readings = Readings(
        ids=block.points.ids[common],
        submerged=block.points.bathymetric[common] & np.isfinite(block.photos.tide[[left, left + 1]]).all(),
        xy=plates.xy[at],
        sigma=np.full((len(common), 2, 2), block.options.plate_sigma),
    )
    return true_points(run.without_errors, (left, left + 1), readings).y_parallax
