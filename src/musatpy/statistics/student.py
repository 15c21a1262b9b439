"""Student's t."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray


def as_normal(t: FloatArray, freedom: FloatArray) -> FloatArray:
    """Return values (k,) of Student's t of `freedom` (k,) degrees as normal variables (Wallace 1959).

    Both have the same chance to be exceeded, to some per cent of it; infinite degrees leave t as it is.
    """
    n = np.minimum(freedom, 1e12)
    z = (8.0 * n + 1.0) / (8.0 * n + 3.0) * np.sqrt(n * np.log1p(np.square(t) / n))
    return np.asarray(np.copysign(z, t))
