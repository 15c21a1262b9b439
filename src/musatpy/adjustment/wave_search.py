"""Where else unknown waves may be: least squares only finds the crest that it starts next to.

Where what is given of a wave leaves a part of a length open over the points that see it, the images may be fitted by
other crests: a minimum of the sum of squares, and not the least. The spectrum of the waves (`wave_spectrum`) over
what the sigmas allow tells which waves to start from.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from musatpy.adjustment.network import Network
from musatpy.adjustment.sea import AZIMUTH, CREST, HEIGHT, LENGTH, WorkingSea
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.wave_spectrum import LevelBlock, phases, spectrum

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_SIGMAS = 3.0  # that are looked through to either side
_MESH = 0.12  # of a length, RMS over the rays: half a mesh off, 0.86 of what a wave explains is left of it
_LOSS = 1.0 / 3.0  # of what a wave explains at a node: by so much more it may explain between nodes
_MOST = 20  # nodes to either side: of worse guesses, too many would have to be looked at
_PHASES = 16  # of the crest that are looked at
_ALIKE = 0.5  # correlation of two waves over the rays above which least squares goes from one to the other


@dataclass(frozen=True, kw_only=True, eq=False)
class Start:
    """Waves (k, 4) to start from; the sum of squares may come to be as low as `least` there."""

    waves: FloatArray
    least: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Nodes:
    """Lengths and azimuths of one wave, as parameters (c, 4); `shift` is what may be missing of its crest (m).

    whole: whether they cover what the sigmas allow.
    """

    values: FloatArray
    shift: float
    whole: bool


def shifts(values: FloatArray, sigma: FloatArray, reach: float) -> dict[int, float]:
    """Return the lengths by which sigmas (4,) of a wave (4,) shift its crests at a distance (m), by parameter."""
    L = values[LENGTH]
    return {
        LENGTH: reach * sigma[LENGTH] / L**2,
        AZIMUTH: reach * sigma[AZIMUTH] / L,
        CREST: sigma[CREST] / L,
    }


def reach_of(network: Network, state: State, sea: WorkingSea) -> float:
    """Return the RMS distance (m) of the points that are seen through the waves from their origin."""
    wet = np.zeros(network.points, dtype=bool)
    wet[network.point[network.refracted]] = True
    wet &= np.isfinite(state.ground).all(axis=1)
    if not wet.any():
        return 0.0
    plan = (state.ground[wet] - sea.origin) @ sea.axes[:2].T
    return float(np.sqrt(np.mean(np.sum(np.square(plan), axis=1))))


def alike(block: LevelBlock, wave: int, values: FloatArray, other: FloatArray) -> BoolArray:
    """Return (c,) whether one wave with `values` (c, 4) has the crests that it has with `other` (4,) over the rays."""
    first, second = (phases(block.trains, wave, rows, *block.sight) for rows in (values, other[None]))
    same = np.mean(np.cos(first - second), axis=1) * np.sign(values[:, HEIGHT]) * np.sign(other[HEIGHT])
    return np.asarray(same > _ALIKE)


def starts(block: LevelBlock, most: int) -> tuple[list[Start], BoolArray]:
    """Return the best starts for the waves of a block, `most` of each wave, and (k,) which waves lie open.

    Open are those of which the nodes do not cover what the sigmas allow. One wave at a time, the others at their
    best: two rounds find these where they depend on one another.
    """
    waves, is_open = block.sea.waves.copy(), np.zeros(len(block.sea.waves), dtype=bool)
    every: list[Start] = []
    for _ in range(2 if len(block.unknown) > 1 else 1):
        every = []
        for wave in block.unknown:
            nodes = _nodes(block, wave)
            is_open[wave] = not nodes.whole
            found = _lowest(block, wave, nodes, waves, most)
            every += found
            waves = found[0].waves if found else waves
    return sorted(every, key=lambda start: start.least), is_open


def _nodes(block: LevelBlock, wave: int) -> Nodes:
    """Return the nodes of one wave: so near to one another that a wave between two shows at both."""
    given, sigma = block.sea.waves[wave], block.sigma[wave]
    offsets, shift, whole = [], 0.0, True
    for of in (LENGTH, AZIMUTH):
        step = np.zeros(4)
        step[of] = 1e-3 * sigma[of]
        if sigma[of] == 0.0:
            offsets.append(np.zeros(1))
            continue
        first, second = phases(block.trains, wave, np.stack([given + step, given - step]), *block.sight)
        turns = (first - second) / (2e-3 * 2.0 * np.pi)  # (N,) of a crest by a sigma
        mesh = _MESH / max(float(turns.std()), 1e-6)  # sigmas
        side = max(int(np.ceil(_SIGMAS / mesh - 0.5)), 0)
        whole &= side <= _MOST
        offsets.append(np.arange(-min(side, _MOST), min(side, _MOST) + 1) * min(mesh, _SIGMAS) * sigma[of])
        shift += (0.5 * min(mesh, _SIGMAS) * float(turns.mean()) * given[LENGTH]) ** 2
    length, azimuth = (axis.ravel() for axis in np.meshgrid(*offsets, indexing="ij"))
    values = np.tile(given, (len(length), 1))
    values[:, LENGTH] += length
    values[:, AZIMUTH] += azimuth
    return Nodes(values=values[values[:, LENGTH] > 0.2 * given[LENGTH]], shift=float(np.sqrt(shift)), whole=whole)


def _lowest(block: LevelBlock, wave: int, nodes: Nodes, waves: FloatArray, most: int) -> list[Start]:
    """Return the best starts of one wave, no two with the same crests; the others stay as they are in `waves`."""
    values, squares, least = _minima(block, wave, nodes, waves)
    found = []
    left = np.argsort(squares, kind="stable")
    while len(left) and len(found) < most:
        best = waves.copy()
        best[wave] = values[left[0]]
        found.append(Start(waves=best, least=float(least[left[0]])))
        left = left[~alike(block, wave, values[left], best[wave])]
    return found


def _minima(
    block: LevelBlock, wave: int, nodes: Nodes, waves: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return parameters (s, 4) at the minima over the crest at every node, their squares, and what these may be.

    All with the priors of the wave in the squares.
    """
    given, sigma = block.sea.waves[wave], block.sigma[wave]
    at = spectrum(block, wave, nodes.values, waves)
    if sigma[CREST] > 0.0:
        phase = np.broadcast_to(2.0 * np.pi * np.arange(_PHASES) / _PHASES, (len(nodes.values), _PHASES))
    else:
        phase = 2.0 * np.pi * given[CREST] / nodes.values[:, LENGTH, None]
    e = np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    curve, pull = np.einsum("cpi,cij,cpj->cp", e, at.matrix, e), np.einsum("cpi,ci->cp", e, at.pull)
    weight = 1.0 / np.square(sigma[HEIGHT]) if sigma[HEIGHT] else 0.0
    height = (pull + weight * given[HEIGHT]) / np.maximum(curve + weight, 1e-12)
    height = height if sigma[HEIGHT] else np.full_like(height, given[HEIGHT])
    explained = 2.0 * height * pull - np.square(height) * curve
    length = nodes.values[:, LENGTH, None]
    crest = phase / (2.0 * np.pi) * length
    crest = crest - np.rint((crest - given[CREST]) / length) * length
    prior = weight * np.square(height - given[HEIGHT])
    if sigma[CREST]:
        prior = prior + np.square(crest - given[CREST]) / (np.square(sigma[CREST]) + np.square(nodes.shift))
    for of in (LENGTH, AZIMUTH):
        off = nodes.values[:, of, None] - given[of]
        prior = prior + np.square(off / sigma[of] if sigma[of] else 0.0 * off)
    squares = at.squares - explained + prior
    lowest = (squares <= np.roll(squares, 1, axis=1)) & (squares <= np.roll(squares, -1, axis=1))
    row, _ = np.nonzero(lowest)
    values = nodes.values[row]
    values[:, HEIGHT], values[:, CREST] = height[lowest], crest[lowest]
    least = squares - _LOSS * np.maximum(explained, 0.0)
    return values, squares[lowest], least[lowest]
