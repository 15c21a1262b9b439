"""The spectrum of unknown waves: what each length and azimuth could lower the sum of squares by.

With length and azimuth held, a wave is linear in two numbers, the heights of a wave with a crest at the origin and of
one with it a quarter of a length on. From the block adjusted with the water level, one linearisation says what these
two would change, for as many lengths and azimuths as one likes, all other unknowns allowed for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import factorised
from musatpy.adjustment.sea import CREST, HEIGHT, LENGTH, Sea, WorkingSea
from musatpy.adjustment.simultaneous import Simultaneous
from musatpy.adjustment.unknowns import State
from musatpy.refraction.trains import Trains

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_PART = 48  # waves at a time
_FREE = 1e3  # m, sigma of the heights of a spectrum: so good as unknown


def held_at(network: Network, waves: FloatArray) -> Network:
    """Return the network with its waves (k, 4) known."""
    if network.sea is None:
        return network
    return replace(network, sea=network.sea.at(waves).known, border=replace(network.border, waves=()))


def level_waves(network: Network) -> FloatArray:
    """Return the waves (k, 4) as given, those of height zero of which something is unknown."""
    if network.sea is None:
        return np.zeros((0, 4))
    waves = network.sea.waves.copy()
    waves[network.sea.sea.unknown.any(axis=1), HEIGHT] = 0.0
    return waves


def rows_of(trains: Trains, waves: IntArray, values: FloatArray) -> Trains:
    """Return trains of which each is one of `waves` (c,), with other values (c, 4)."""
    return replace(
        trains,
        values=values,
        number=trains.number[waves],
        frequency=trains.frequency[waves],
        depth=trains.depth[waves],
        steady=trains.steady[waves],
    )


def phases(trains: Trains, wave: int, values: FloatArray, xy: FloatArray, time: FloatArray) -> FloatArray:
    """Return the phases (c, N) rad that one wave has with each of `values` (c, 4) at places (N, 2) and times (N,)."""
    surface = rows_of(trains, np.full(len(values), wave), values).surface
    return np.asarray(surface.vector @ xy.T - surface.frequency[:, None] * time - surface.phase[:, None])


@dataclass(frozen=True, kw_only=True, eq=False)
class LevelBlock:
    """A block adjusted with those of its waves level of which something is unknown."""

    network: Network  # with the waves unknown
    state: State
    squares: float
    problem: Callable[[Network], Simultaneous]  # of a network

    @cached_property
    def sea(self) -> WorkingSea:
        """The sea as it was given."""
        if self.network.sea is None:
            raise ValueError("the block has no waves")
        return self.network.sea

    @cached_property
    def trains(self) -> Trains:
        """The waves as they were given."""
        if self.sea.trains is None:
            raise ValueError("the waves of the block are known")
        return self.sea.trains

    @cached_property
    def sigma(self) -> FloatArray:
        """(k, 4) of the waves as they were given, 0 where they are known."""
        return np.nan_to_num(np.asarray(self.sea.sea.sigma, dtype=float))

    @cached_property
    def unknown(self) -> list[int]:
        """The waves of which something is unknown."""
        return [int(wave) for wave in np.flatnonzero(self.sea.sea.unknown.any(axis=1))]

    @cached_property
    def sight(self) -> tuple[FloatArray, FloatArray]:
        """Where refracted rays (N, 2) see the bottom, about the origin of the waves, and at which times (N,)."""
        network = self.network
        rays = np.flatnonzero(network.refracted & np.isfinite(self.state.ground[network.point]).all(axis=1))
        plan = (self.state.ground[network.point[rays]] - self.sea.origin) @ self.sea.axes[:2].T
        return plan, self.sea.sea.time[network.photo[rays]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """Of c waves with a height H and the phase p of their crest: the squares change by H^2 e'S e - 2 H e'g.

    e = (cos p, sin p); matrix S (c, 2, 2), pull g (c, 2); squares is the sum without a wave, with the other ones.
    """

    matrix: FloatArray
    pull: FloatArray
    squares: float


def spectrum(block: LevelBlock, wave: int, values: FloatArray, others: FloatArray) -> Spectrum:
    """Return the spectrum of one wave with lengths and azimuths of `values` (c, 4), and `others` (k, 4) as they are.

    Of the other unknown waves, heights and crests are free.
    """
    companions = [row for row in block.unknown if row != wave]
    matrix, pull, squares = [], [], block.squares
    for first in range(0, len(values), _PART):
        part = values[first : first + _PART]
        which = np.array([wave] * len(part) + companions)
        S, g = _reduced(block, which, np.concatenate([part, others[companions]]))
        split = 2 * len(part)
        # heights of the companions are known a little: none of them may take what it likes
        heights = np.square(others[companions, HEIGHT]) + np.square(block.sigma[companions, HEIGHT])
        known = np.diag(np.repeat(1.0 / np.maximum(heights, np.finfo(float).tiny), 2))
        cross = np.linalg.solve(S[split:, split:] + known, np.column_stack([S[split:, :split], g[split:]]))
        S = S[:split, :split] - S[:split, split:] @ cross[:, :-1]
        squares = block.squares - float(g[split:] @ cross[:, -1])
        index = np.arange(split).reshape(-1, 2)
        matrix.append(S[index[:, :, None], index[:, None, :]])
        pull.append((g[:split] - g[split:] @ cross[:, :-1]).reshape(-1, 2))
    return Spectrum(matrix=np.concatenate(matrix), pull=np.concatenate(pull), squares=squares)


def _reduced(block: LevelBlock, which: IntArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return reduced normal equations (2c, 2c), (2c,) of the heights of waves (c, 4) about level water.

    Two of each, one with a crest at the origin and one a quarter of a length on.
    """
    network, state = block.network, block.state
    level, doubled = level_waves(network), np.repeat(values, 2, axis=0)
    doubled[:, HEIGHT] = 0.0
    doubled[0::2, CREST], doubled[1::2, CREST] = 0.0, 0.25 * values[:, LENGTH]
    rows = np.concatenate([level, doubled])
    trains = rows_of(block.trains, np.concatenate([np.arange(len(level)), np.repeat(which, 2)]), rows)
    sigma = np.full(rows.shape, np.nan)
    sigma[len(level) :, HEIGHT] = _FREE
    sea = Sea(surface=trains.surface, time=block.sea.sea.time, origin=block.sea.sea.origin, sigma=sigma)
    tried = replace(
        network,
        sea=replace(block.sea, sea=sea, trains=trains),
        border=replace(network.border, waves=("",) * len(doubled)),
    )
    line = block.problem(tried).linearise(replace(state, waves=rows))
    columns = np.zeros(tried.border.size, dtype=bool)
    columns[tried.border.first_wave : tried.border.first_kept] = True
    whole = line.matrix
    rest = replace(whole, border=whole.border[:, ~columns], corner=whole.corner[np.ix_(~columns, ~columns)])
    factor = factorised(rest)
    if factor is None:
        return np.zeros((len(doubled), len(doubled))), np.zeros(len(doubled))
    cross = np.concatenate([whole.border[:, columns], whole.corner[np.ix_(~columns, columns)]])
    split = len(whole.border)
    right = np.concatenate([line.rhs[:split], line.rhs[split:][~columns]])
    solved = factor.solve_scaled(cross * factor.scale[:, None]) * factor.scale[:, None]
    return whole.corner[np.ix_(columns, columns)] - cross.T @ solved, line.rhs[split:][columns] - solved.T @ right
