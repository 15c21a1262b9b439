"""Profiles: points along a line, put in order, cleared of spikes, thinned, and read off at even steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray

_HALF = 3  # readings to either side of one whose median it is held against


@dataclass(frozen=True, kw_only=True, eq=False)
class LineProfile:
    """k readings in the order of their stations (k,) m along a line, `offset` (k,) m to its left; input `rows`.

    spike (k,) are readings farther from the median of seven than a limit, kept (k,) those that a thinning needs.
    """

    rows: IntArray
    station: FloatArray
    offset: FloatArray
    value: FloatArray
    spike: BoolArray
    kept: BoolArray

    def at_steps(self, step: float) -> tuple[FloatArray, FloatArray]:
        """Return stations (s,) from the first reading on, a step apart, and the values there, spikes left out."""
        good = self.station[~self.spike]
        if not len(good):
            return np.zeros(0), np.zeros(0)
        posts = np.arange(good[0], good[-1] + 1e-9 * max(step, 1.0), step)
        return posts, self.at(posts)

    def at(self, stations: FloatArray) -> FloatArray:
        """Return the values (s,) between readings, spikes left out; beyond the first and the last, theirs."""
        good = ~self.spike
        station, first = np.unique(self.station[good], return_index=True)
        return np.interp(stations, station, self.value[good][first])

    def variance_at(self, stations: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the variances (s,) of values between readings with independent sigmas (k,)."""
        good = ~self.spike
        station, first = np.unique(self.station[good], return_index=True)
        after = np.clip(np.searchsorted(station, stations), 1, max(len(station) - 1, 1))
        if len(station) < 2:
            return np.full(len(stations), float(np.square(sigma[good][0])))
        part = np.clip((stations - station[after - 1]) / (station[after] - station[after - 1]), 0.0, 1.0)
        variance = np.square(sigma[good][first])
        return np.square(1.0 - part) * variance[after - 1] + np.square(part) * variance[after]


def profile(
    xy: FloatArray, value: FloatArray, start: FloatArray, end: FloatArray, *, spike: float, tolerance: float
) -> LineProfile:
    """Return the readings xy (k, 2) m with values (k,) along the line from `start` (2,) to `end` (2,).

    `spike` and `tolerance` (m) are the limits of spikes and of thinning (Douglas and Peucker 1973, in station and
    value); infinite for none of the first, 0 for none of the second.
    """
    along = (end - start) / np.linalg.norm(end - start)
    station, offset = (xy - start) @ along, (xy - start) @ np.array([-along[1], along[0]])
    order = np.argsort(station, kind="stable")
    station, values = station[order], value[order]
    # of each value and its three neighbours to either side, as far as there are any
    medians = np.array([np.median(values[max(i - _HALF, 0) : i + _HALF + 1]) for i in range(len(values))])
    spikes = np.abs(values - medians) > spike
    kept = np.zeros(len(order), dtype=bool)
    good = np.flatnonzero(~spikes)
    kept[good[_needed(station[good], values[good], tolerance)]] = True
    return LineProfile(rows=order, station=station, offset=offset[order], value=values, spike=spikes, kept=kept)


def _needed(station: FloatArray, value: FloatArray, tolerance: float) -> BoolArray:
    """Return which points (k,) a line needs that stays within a tolerance of the others."""
    needed = np.zeros(len(station), dtype=bool)
    if not tolerance > 0.0 or len(station) < 3:
        return ~needed
    needed[[0, -1]] = True
    parts = [(0, len(station) - 1)]
    while parts:
        first, last = parts.pop()
        if last - first < 2:
            continue
        line = np.interp(station[first : last + 1], station[[first, last]], value[[first, last]])
        off = np.abs(value[first : last + 1] - line)
        worst = first + int(off.argmax())
        if off.max() > tolerance:
            needed[worst] = True
            parts += [(first, worst), (worst, last)]
    return needed
