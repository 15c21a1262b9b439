"""Many points of two photos through still water, chunk by chunk: where they are, and their errors.

Points near the water line, whose rays are not both wet or both dry, or that do not come to rest, are left to who
looks at every ray of its own (`true_points`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.compilation.pair_errors import Described, PairErrors, described
from musatpy.compilation.pair_images import APART, AT_REST, chunks, met, sunk
from musatpy.geometry.geodesy import Frame, GeographicFrame

if TYPE_CHECKING:
    from musatpy.compilation.true_points import Readings, TruePoints


@dataclass(frozen=True, kw_only=True, eq=False)
class Places:
    """Places (3, c) in working axes: coordinates in the system of the job (3, c), heights (c,), axes (3, 3, c)."""

    X: FloatArray
    system: FloatArray
    height: FloatArray
    axes: FloatArray

    @classmethod
    def of(cls, frame: Frame, X: FloatArray) -> Places:
        """Return places (3, c) with what a frame says of them."""
        level = frame.level(X.T)
        axes = np.ascontiguousarray(np.moveaxis(frame.axes_at(level), 0, -1))
        system = level if isinstance(frame, GeographicFrame) else frame.system(X.T)
        return cls(X=X, system=system.T, height=level[:, 2].copy(), axes=axes)

    def part(self, rows: BoolArray | slice) -> Places:
        """Return some of the places."""
        return Places(**{name: values[..., rows] for name, values in vars(self).items()})


def put_clear_points(out: TruePoints, errors: PairErrors, frame: Frame, readings: Readings) -> BoolArray:
    """Put the points of k readings into `out`, but for those that are returned (k,): they stay as they are."""
    every, doubtful = np.arange(len(readings.xy)), np.ones(len(readings.xy), dtype=bool)
    for part in chunks(len(every)):
        rows = every[part]
        xy = np.ascontiguousarray(readings.xy[part].reshape(-1, 4).T)
        weight = np.ascontiguousarray(1.0 / np.square(readings.sigma[part].reshape(-1, 4).T))
        with np.errstate(all="ignore"):  # of rays that do not meet: such points stay doubtful
            doubtful[_put_chunk(out, rows, errors, frame, xy, weight, readings.submerged[part])] = False
    return doubtful


def _put_chunk(
    out: TruePoints, rows: IntArray, errors: PairErrors, frame: Frame, xy: FloatArray, weight: FloatArray,
    submerged: BoolArray,
) -> IntArray:  # fmt: skip
    """Put the clear points of readings xy (4, c) into their `rows` (c,), and return these."""
    pair = errors.pair
    X, last, sine2 = met(pair, xy, weight)
    apparent, clear = Places.of(frame, X), (last < AT_REST) & (sine2 > APART) & pair.seen(X)
    under = pair.gaps(X, apparent.height) > 0.0
    wet, dry = submerged & under.all(axis=0), ~(submerged & under.any(axis=0))
    done = []
    for through, chosen in ((True, clear & wet), (False, clear & dry)):
        if not chosen.any():
            continue
        here = _some(chosen)
        read, w, at, flagged = xy[:, here], weight[:, here], apparent.part(here), submerged[here]
        true = sunk(pair, read, w, at.X, (at.axes[2], at.height)) if through else at.X
        place = Places.of(frame, true) if through else at
        points = described(errors, read, w, place.X, place.height, place.axes, through)
        sides = points.gaps > 0.0 if through else points.gaps <= 0.0
        near = np.abs(points.gaps).min(axis=0) < points.kink
        sure = (points.last < AT_REST) & pair.seen(points.X) & (~flagged | (sides.all(axis=0) & ~near))
        done.append(rows[here][_some(sure)])
        _put(out, done[-1], _some(sure), points, at, frame, flagged[_some(sure)], through)
    return np.concatenate([rows[:0], *done])


def _some(chosen: BoolArray) -> BoolArray | slice:
    """Return chosen rows, as a slice where they are all: nothing is copied then."""
    return slice(None) if chosen.all() else chosen


def _put(
    out: TruePoints, rows: IntArray, sure: BoolArray | slice, points: Described, apparent: Places, frame: Frame,
    submerged: BoolArray, through: bool,
) -> None:  # fmt: skip
    """Put the points that are `sure` into their rows (s,); submerged (s,)."""
    X, surface = points.X[:, sure], points.gaps[:, sure].mean(axis=0)
    level = frame.level(X.T)
    out.position[rows] = level if isinstance(frame, GeographicFrame) else frame.system(X.T)
    out.covariance[rows] = np.moveaxis(points.covariance[..., sure], -1, 0)
    out.residual[rows] = points.residual[:, sure].T.reshape(-1, 2, 2)
    out.y_parallax[rows] = points.parallax[sure]
    out.y_parallax_sigma[rows] = np.sqrt(points.parallax_variance[sure])
    out.pointing_share[rows] = (points.pointing / points.parallax_variance)[sure]
    out.wet[rows] = through
    wet = _some(submerged)
    rows = rows[wet]
    out.apparent[rows] = apparent.system[:, sure].T[wet]
    out.water_level[rows], out.depth[rows] = (surface + level[:, 2])[wet], surface[wet]
    out.depth_sigma[rows] = np.sqrt(points.depth_variance[sure][wet])
    out.incidence[rows] = points.incidence[sure][wet]
