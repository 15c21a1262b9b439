"""Interpolation between readings without crests of its own; loading what else has it takes as long as an import."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray


def monotone(x: FloatArray, y: FloatArray, at: FloatArray) -> FloatArray:
    """Return the values (k,) of monotone cubics (PCHIP) through y (n,) at ascending x (n,), n > 1.

    Beyond the ends they go on. Slopes are weighted harmonic means of those of the neighbouring pieces, zero where
    these turn (Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5, 1984).
    """
    h, slope = np.diff(x), np.zeros(len(x))
    m = np.diff(y) / h
    slope[[0, -1]] = m[[0, -1]]
    if len(m) > 1:
        rise = np.flatnonzero(m[:-1] * m[1:] > 0.0)
        first, second = h[rise] + 2.0 * h[rise + 1], 2.0 * h[rise] + h[rise + 1]
        slope[rise + 1] = (first + second) / (first / m[rise] + second / m[rise + 1])
        (h0, h1), (m0, m1) = (np.stack([of[[0, -1]], of[[1, -2]]]) for of in (h, m))
        end = ((2.0 * h0 + h1) * m0 - h0 * m1) / (h0 + h1)  # of the parabola through three readings
        steep = (m0 * m1 <= 0.0) & (np.abs(end) > 3.0 * np.abs(m0))
        slope[[0, -1]] = np.where(end * m0 <= 0.0, 0.0, np.where(steep, 3.0 * m0, end))
    row = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(h) - 1)
    s, d0, d1, m, h = at - x[row], slope[row], slope[row + 1], m[row], h[row]
    return np.asarray(y[row] + s * (d0 + s / h * (3.0 * m - 2.0 * d0 - d1 + s / h * (d0 + d1 - 2.0 * m))))
