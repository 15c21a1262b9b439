"""The least-squares spectrum of heights at irregular places in plan: which wave vectors they speak for.

At every wave vector k of a grid, level, cosine and sine are fitted to the heights by weighted least squares; the
power is the share of the sum of squares that cosine and sine take away. In one dimension this is the spectrum of
Lomb and Scargle with a floating mean. The sums are products of two matrices, because exp(i k . x) is the product
of its parts along x and y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray

FINER = 4  # wave vectors per resolution, 2 pi over the extent: Newton's method starts within pi / 8 at the edges
_BLOCK = 2000  # places whose sums are formed together, lest many fill the memory
_LATTICE = 0.85  # mean of exp(i k.x) by which places repeat along a wave vector: 1 on a lattice, little elsewhere
_FEWEST, _MOST = 25, 1000  # places that are asked for a lattice: of fewer, chance alone looks like one
_AS_HIGH = 0.98  # of the highest peak: such a peak of a longer wave is preferred, of which the other is an alias


@dataclass(frozen=True, kw_only=True, eq=False)
class Band:
    """The waves that are looked for: their lengths (m), and how many of them the places can tell apart."""

    shortest: float
    longest: float
    trials: int

    def holds(self, vector: FloatArray) -> bool:
        """Tell whether a wave vector (2,) rad/m is within."""
        length = 2.0 * np.pi / float(np.linalg.norm(vector))
        return bool(self.shortest <= length <= self.longest)


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """Wave vectors x (a,) >= 0, y (b,) rad/m; power (a, b), 0 to 1, and 0 outside the band."""

    x: FloatArray
    y: FloatArray
    power: FloatArray

    @property
    def peak(self) -> tuple[FloatArray, float]:
        """The wave vector (2,) of the largest power, and that power; of peaks as high as it, the longest wave.

        On a regular grid of places every wave has aliases of the same power, shorter ones.
        """
        number = np.hypot(self.x[:, None], self.y)
        high = self.power >= _AS_HIGH * self.power.max()
        i, j = np.unravel_index(int(np.argmin(np.where(high, number, np.inf))), self.power.shape)
        a, b = max(int(i) - FINER, 0), max(int(j) - FINER, 0)  # one resolution around: the same peak
        around = self.power[a : i + FINER + 1, b : j + FINER + 1]
        up, across = np.unravel_index(int(np.argmax(around)), around.shape)
        i, j = a + up, b + across
        return np.array([self.x[i], self.y[j]]), float(self.power[i, j])


def mean_spacing(xy: FloatArray) -> float:
    """Return the mean distance (m) of places (n, 2): root of their area, that of the box around them, over n."""
    extent = np.ptp(xy, axis=0)
    return float(np.sqrt(extent[0] * extent[1] / len(xy)))


def lattice(xy: FloatArray) -> FloatArray:
    """Return the wave vectors (m, 2) rad/m along which places (n, 2) repeat: none unless they are regular.

    Two waves that differ by one of them are the same at all places. Looked for up to 1.5 times the wave number of
    the mean spacing.
    """
    if len(xy) < _FEWEST:
        return np.empty((0, 2))
    some = np.random.default_rng(len(xy)).permutation(len(xy))[:_MOST]
    place, step = xy[some] - xy.mean(axis=0), 2.0 * np.pi / (FINER * np.ptp(xy, axis=0))
    count = np.ceil(3.0 * np.pi / mean_spacing(xy) / step).astype(int)
    kx, ky = step[0] * np.arange(count[0] + 1), step[1] * np.arange(-count[1], count[1] + 1)
    window = np.abs(np.exp(1j * place[:, :1] * kx).T @ np.exp(1j * place[:, 1:] * ky)) / len(place)
    # all places are the same to a wave of no number
    window[: FINER + 1, count[1] - FINER : count[1] + FINER + 1] = 0.0
    peaks = []
    while window.max() >= _LATTICE:
        i, j = np.unravel_index(int(np.argmax(window)), window.shape)
        peaks.append((kx[i], ky[j]))
        window[max(i - FINER, 0) : i + FINER + 1, max(j - FINER, 0) : j + FINER + 1] = 0.0
    vectors = np.array(peaks).reshape(-1, 2)
    return np.concatenate([vectors, -vectors])


def band(xy: FloatArray, shortest: float | None = None, longest: float | None = None) -> Band:
    """Return the band of places (n, 2); by default from their mean spacing to the diagonal of their box.

    On a regular grid nothing shorter than twice the spacing can be told from its alias, and the longer wave is
    taken (`Spectrum.peak`); irregular places have no such limit. Raises `ValueError` where nothing lies between.
    """
    extent = np.ptp(xy, axis=0)
    short = mean_spacing(xy) if shortest is None else shortest
    long = float(np.hypot(*extent)) if longest is None else longest
    if not 0.0 < short < long:
        raise ValueError(f"no wave is shorter than {long:.1f} m and longer than {short:.1f} m")
    k = 2.0 * np.pi / short
    cells = np.pi * k * k / 2.0 / float(np.prod(2.0 * np.pi / extent))  # of the half plane, one per resolution
    return Band(shortest=short, longest=long, trials=max(1, round(cells)))


def spectrum(xy: FloatArray, height: FloatArray, weight: FloatArray, waves: Band) -> Spectrum:
    """Return the spectrum of heights (n,) at places (n, 2) with weights (n,)."""
    step = 2.0 * np.pi / (FINER * np.ptp(xy, axis=0))
    count = np.ceil(2.0 * np.pi / waves.shortest / step).astype(int)
    kx, ky = step[0] * np.arange(count[0] + 1), step[1] * np.arange(-count[1], count[1] + 1)
    share = weight / weight.sum()
    centred = height - share @ height
    place = xy - xy.mean(axis=0)
    power = _power(place, kx, ky, share, centred)
    number = np.hypot(kx[:, None], ky)
    inside = (number >= 2.0 * np.pi / waves.longest) & (number <= 2.0 * np.pi / waves.shortest)
    inside[0, : count[1]] = False  # k and -k are one wave
    return Spectrum(x=kx, y=ky, power=np.where(inside, power, 0.0))


def _power(xy: FloatArray, kx: FloatArray, ky: FloatArray, w: FloatArray, z: FloatArray) -> FloatArray:
    """Return the power (a, b) at places (n, 2) for kx (a,), ky (b,); weights of sum 1, heights of mean 0 (n,)."""
    mean, double, product = (np.zeros((len(kx), len(ky)), dtype=complex) for _ in range(3))
    for start in range(0, len(xy), _BLOCK):
        part = slice(start, start + _BLOCK)
        along, across = np.exp(1j * xy[part, :1] * kx), np.exp(1j * xy[part, 1:] * ky)
        mean += (along * w[part, None]).T @ across
        double += (np.square(along) * w[part, None]).T @ np.square(across)
        product += (along * (w * z)[part, None]).T @ across
    cc = (1.0 + double.real) / 2.0 - np.square(mean.real)
    ss = (1.0 - double.real) / 2.0 - np.square(mean.imag)
    cs = double.imag / 2.0 - mean.real * mean.imag
    det = cc * ss - cs * cs
    usable = det > 1e-6  # else cosine and sine are one and the same at these places
    taken = ss * product.real**2 + cc * product.imag**2 - 2.0 * cs * product.real * product.imag
    total = float(w @ np.square(z))
    return np.where(usable, taken / np.where(usable, det, 1.0), 0.0) / max(total, 1e-300)
