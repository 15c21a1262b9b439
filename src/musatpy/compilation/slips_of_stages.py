"""Slips of a whole model that its readings show: left and right exchanged, other units, exchanged axes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.stereomodels import Stereomodel, off_plate
from musatpy.geometry.collinearity import in_front

_OFF = 0.2  # mm, by which an image may lie off the straight rays of its point: y-parallax of refraction is less
_HIGH = 0.5  # of the flying height, above and below the origin
_FEW, _MOST = 0.5, 0.9  # shares of sound readings that say that something is wrong, and what puts it right


def slip_of(stereo: Stereomodel, xy: FloatArray) -> str:
    """Return what would make points of the readings (k, 2, 2) mm of a model, where most make none; else nothing."""
    xy = xy[np.isfinite(xy).all(axis=(1, 2))]
    if not len(xy) or _sound(stereo, xy) >= _FEW:
        return ""
    ways: Mapping[str, FloatArray] = {
        "left and right were exchanged": xy[:, ::-1],
        "they were in micrometres (factor 0.001)": 1e-3 * xy,
        "they were in inches (factor 25.4)": 25.4 * xy,
        "they were in centimetres (factor 10)": 10.0 * xy,
        "x and y were exchanged": xy[..., ::-1],
        "the plates were turned by half a turn": -xy,
    }
    shares = {words: _sound(stereo, others) for words, others in ways.items()}
    best = max(shares, key=lambda words: shares[words])
    return best if shares[best] >= _MOST else ""


def _sound(stereo: Stereomodel, xy: FloatArray) -> float:
    """Return the share of readings that are of points on both plates, in front, and near the ground."""
    with np.errstate(all="ignore"):  # parallel rays meet nowhere
        point = stereo.half_way(xy)
        both = np.repeat(point[:, None], 2, axis=1)
        gap = np.abs(stereo.images(both) - xy).max(axis=(1, 2))
        seen = in_front(both - stereo.stations, stereo.rotation).all(axis=1)
        sound = seen & (gap < _OFF) & (np.abs(point[:, 2]) < _HIGH * stereo.height)
    return float(np.mean(sound & ~off_plate(stereo, xy).any(axis=1)))
