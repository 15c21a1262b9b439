"""Random numbers that are the same on every machine and with every version of numpy.

Only the raw 64-bit stream of PCG64 is used, which numpy promises to keep; its `normal` makes no such promise. Each
purpose has its own stream, so that more blunders, say, do not change the noise.
"""

from __future__ import annotations

import zlib

import numpy as np
from scipy.special import ndtri

from musatpy.arrays import FloatArray, IntArray

_DECIMALS = 9  # of normal deviates: the last bits of a machine's logarithm do not show


class Draws:
    """Random streams by name, from one seed."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self._streams: dict[str, np.random.PCG64] = {}

    def uniform(self, name: str, *shape: int) -> FloatArray:
        """Return numbers of the open interval (0, 1), odd multiples of 2^-53."""
        if name not in self._streams:
            entropy = np.random.SeedSequence([self.seed, zlib.crc32(name.encode())])
            self._streams[name] = np.random.PCG64(entropy)
        raw = self._streams[name].random_raw(int(np.prod(shape)))
        return np.asarray(((np.asarray(raw, dtype=np.uint64) >> np.uint64(12)) + 0.5) * 2.0**-52).reshape(shape)

    def normal(self, name: str, *shape: int) -> FloatArray:
        """Return standard normal deviates, rounded to 1e-9."""
        return np.round(ndtri(self.uniform(name, *shape)), _DECIMALS)

    def signs(self, name: str, *shape: int) -> FloatArray:
        """Return -1 or +1 at random."""
        return np.where(self.uniform(name, *shape) < 0.5, -1.0, 1.0)

    def pick(self, name: str, size: int, number: int) -> IntArray:
        """Return `number` different ones of 0..size-1, in rising order."""
        order = np.argsort(self.uniform(name, size), kind="stable")
        return np.sort(order[:number])
