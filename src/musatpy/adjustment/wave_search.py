"""Where else unknown waves may be: least squares only finds the crest that it starts next to.

Where what is given of a wave leaves a part of a length open over the points that see it, other crests may fit the
images: a minimum of the sum of squares, and not the least. The spectrum of the waves (`wave_spectrum`) over what
the sigmas allow tells which waves to start from.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.adjustment.network import Network
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.wave_spectrum import LevelBlock, UnknownSea, spectrum
from musatpy.adjustment.wavy_water import AZIMUTH, CREST, HEIGHT, LENGTH, WorkingSea
from musatpy.arrays import BoolArray, FloatArray, finite_rows

SIGMAS = 3.0  # that are looked through to either side
_MESH = 0.12  # of a length, RMS over the rays: half a mesh off, 0.86 of what a wave explains is left of it
_LOSS = 1.0 / 3.0  # of what a wave explains at a node: by so much more it may explain between nodes
_MOST = 800  # nodes: of worse guesses, too many would have to be looked at
_PHASES = 16  # of the crest that are looked at
SHORTEST = 0.2  # of the length given
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
    wet &= finite_rows(state.ground)
    if not wet.any():
        return 0.0
    plan = (state.ground[wet] - sea.origin) @ sea.axes[:2].T
    return float(np.sqrt(np.mean(np.sum(np.square(plan), axis=1))))


def alike(sea: UnknownSea, wave: int, values: FloatArray, other: FloatArray) -> BoolArray:
    """Return (c,) whether one wave with `values` (c, 4) has the crests that it has with `other` (4,)."""
    first, second = (sea.phases(wave, rows) for rows in (values, other[None]))
    same = np.mean(np.cos(first - second), axis=1) * np.sign(values[:, HEIGHT]) * np.sign(other[HEIGHT])
    return same > _ALIKE


def nodes_of(sea: UnknownSea, wave: int) -> Nodes:
    """Return the nodes of one wave: so near to one another that a wave between two shows at both."""
    given, sigma = sea.trains.values[wave], sea.sigma[wave]
    meshes, sides, shift = [0.0, 0.0], [0, 0], 0.0
    for axis, of in enumerate((LENGTH, AZIMUTH)):
        if sigma[of] == 0.0:
            continue
        step = np.zeros(4)
        step[of] = 1e-3 * sigma[of]
        first, second = sea.phases(wave, np.stack([given + step, given - step]))
        turns = (first - second) / (2e-3 * 2.0 * np.pi)  # (N,) lengths that a sigma moves the crest
        mesh = min(_MESH / max(float(turns.std()), _MESH / SIGMAS), SIGMAS)  # sigmas
        meshes[axis], sides[axis] = mesh * sigma[of], max(int(np.ceil(SIGMAS / mesh - 0.5)), 0)
        shift += (0.5 * mesh * float(turns.mean()) * given[LENGTH]) ** 2
    wanted = list(sides)
    while (2 * sides[0] + 1) * (2 * sides[1] + 1) > _MOST:
        sides[int(sides[1] > sides[0])] -= 1
    offsets = [np.arange(-side, side + 1) * mesh for side, mesh in zip(sides, meshes, strict=True)]
    length, azimuth = (axis.ravel() for axis in np.meshgrid(*offsets, indexing="ij"))
    values = np.tile(given, (len(length), 1))
    values[:, LENGTH] += length
    values[:, AZIMUTH] += azimuth
    values = values[values[:, LENGTH] > SHORTEST * given[LENGTH]]
    return Nodes(values=values, shift=float(np.sqrt(shift)), whole=sides == wanted)


def starts(block: LevelBlock, nodes: Nodes, most: int) -> list[Start]:
    """Return the best starts for the level wave of a block, at most so many, no two with the same crests."""
    values, squares, least = _minima(block, nodes)
    left = np.argsort(squares, kind="stable")
    out: list[Start] = []
    while len(left) and len(out) < most:
        waves = block.state.waves.copy()
        waves[block.wave] = values[left[0]]
        if block.sea.trains.with_values(waves).sensible:
            out.append(Start(waves=waves, least=float(least[left[0]])))
        left = left[1:][~alike(block.sea, block.wave, values[left[1:]], waves[block.wave])]
    return out


def _minima(block: LevelBlock, nodes: Nodes) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return parameters (s, 4) at the minima over the crest at every node, the squares there, and the least near.

    The squares have the priors of the wave in them.
    """
    given, sigma = block.sea.trains.values[block.wave], block.sea.sigma[block.wave]
    at = spectrum(block, nodes.values)
    length = nodes.values[:, LENGTH, None]
    phase = np.broadcast_to(2.0 * np.pi * np.arange(_PHASES) / _PHASES, (len(length), _PHASES))
    if sigma[CREST] == 0.0:
        phase = 2.0 * np.pi * given[CREST] / length
    e = np.stack([np.cos(phase), np.sin(phase)], axis=-1)
    curve, pull = np.einsum("cpi,cij,cpj->cp", e, at.matrix, e), np.einsum("cpi,ci->cp", e, at.pull)
    weight = 1.0 / np.square(sigma[HEIGHT]) if sigma[HEIGHT] else np.inf
    # the height that is best for the crest
    height = (pull + weight * given[HEIGHT]) / (curve + weight) if sigma[HEIGHT] else given[HEIGHT] + 0.0 * pull
    explained = 2.0 * height * pull - np.square(height) * curve
    crest = phase / (2.0 * np.pi) * length
    crest = crest - np.rint((crest - given[CREST]) / length) * length
    off = [np.broadcast_to(nodes.values[:, of, None] - given[of], crest.shape) for of in (LENGTH, AZIMUTH)]
    off = [height - given[HEIGHT], *off, crest - given[CREST]]
    spread = sigma + np.array([0.0, 0.0, 0.0, nodes.shift]) * (sigma[CREST] > 0.0)
    prior = sum(np.square(part / size) for part, size in zip(off, spread, strict=True) if size)
    squares = block.squares - explained + prior
    lowest = (squares <= np.roll(squares, 1, axis=1)) & (squares <= np.roll(squares, -1, axis=1))
    values = nodes.values[np.nonzero(lowest)[0]]
    values[:, HEIGHT], values[:, CREST] = height[lowest], crest[lowest]
    least = squares - _LOSS * np.maximum(explained, 0.0)
    return values, squares[lowest], least[lowest]
