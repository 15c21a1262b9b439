"""Products of vectors in space."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a x b (..., 3).

    Few vectors at a time are the rule here, for which np.cross takes several times as long: it looks for its axes.
    """
    first = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out = np.empty((*first.shape, 3), dtype=first.dtype)
    out[..., 0] = first
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out
