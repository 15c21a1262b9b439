"""The spectrum of an unknown wave: what each length and azimuth could lower the sum of squares by.

With length and azimuth held, a wave is linear in two numbers: the heights of a wave with a crest at the origin, and
of one with it a quarter of a length on. From the block adjusted without the wave, one linearisation says what these
would change, for as many lengths and azimuths as one likes, all other unknowns allowed for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import NormalMatrix, factorised
from musatpy.adjustment.simultaneous import Simultaneous
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.wavy_water import CREST, HEIGHT, LENGTH, WorkingSea, wave_names
from musatpy.arrays import FloatArray, IntArray, finite_rows
from musatpy.model import ObservationKind
from musatpy.refraction.waves import Trains

_PART = 48  # waves at a time, at most
_CELLS = 4e6  # of the normal equations of single points: what they need in memory stays within some ten megabytes
_FREE = 1e3  # m, sigma of the heights of a spectrum: so good as unknown


@dataclass(frozen=True, kw_only=True, eq=False)
class UnknownSea:
    """The k waves of a job as they were given, and where the rays of a state see the bottom through them.

    sigma (k, 4) is 0 where a parameter is known; place (N, 2) m is about the origin of the waves, time (N,) s.
    """

    trains: Trains
    sigma: FloatArray
    place: FloatArray
    time: FloatArray

    @classmethod
    def of(cls, network: Network, state: State) -> UnknownSea:
        """Return that of a network. Raises `ValueError` where its waves are known."""
        sea = network.sea
        if sea is None or sea.trains is None:
            raise ValueError("the network has no unknown waves")
        rays = np.flatnonzero(network.refracted & finite_rows(state.ground[network.point]))
        return cls(
            trains=sea.trains,
            sigma=np.nan_to_num(np.asarray(sea.sea.sigma, dtype=float)),
            place=(state.ground[network.point[rays]] - sea.origin) @ sea.axes[:2].T,
            time=sea.sea.time[network.photo[rays]],
        )

    @cached_property
    def unknown(self) -> list[int]:
        """The waves of which something is unknown."""
        return [int(wave) for wave in np.flatnonzero((self.sigma > 0.0).any(axis=1))]

    def phases(self, wave: int, values: FloatArray) -> FloatArray:
        """Return the phases (c, N) rad of one wave with each of `values` (c, 4)."""
        surface = rows_of(self.trains, [wave] * len(values), values).surface
        return surface.vector @ self.place.T - surface.frequency[:, None] * self.time - surface.phase[:, None]


@dataclass(frozen=True, kw_only=True, eq=False)
class LevelBlock:
    """A block adjusted with one of its waves level, and the others as unknown as they are.

    network: with the wave level; `problem` makes the adjustment of a network; squares: the sum at `state`.
    """

    sea: UnknownSea
    wave: int
    network: Network
    state: State
    squares: float
    problem: Callable[[Network], Simultaneous]


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """With a height H and a phase p of the crest, wave (c,) changes the squares by H^2 e'S e - 2 H e'g.

    e = (cos p, sin p); matrix S (c, 2, 2), pull g (c, 2).
    """

    matrix: FloatArray
    pull: FloatArray


def levelled(network: Network, wave: int) -> Network:
    """Return the network with one of its unknown waves level, and known; the others stay unknown."""
    sea = network.sea
    if sea is None or sea.trains is None or sea.sea.sigma is None:
        raise ValueError("the network has no unknown waves")
    values, sigma = sea.waves.copy(), sea.sea.sigma.copy()
    values[wave, HEIGHT], sigma[wave] = 0.0, np.nan
    return _with_waves(network, sea, sea.trains.with_values(values), sigma)


def rows_of(trains: Trains, waves: list[int], values: FloatArray) -> Trains:
    """Return trains each of which is one of `waves` (c,), with other values (c, 4)."""
    return replace(
        trains,
        values=values,
        number=trains.number[waves],
        frequency=trains.frequency[waves],
        depth=trains.depth[waves],
        steady=trains.steady[waves],
    )


def spectrum(block: LevelBlock, values: FloatArray) -> Spectrum:
    """Return the spectrum of the level wave of a block with lengths and azimuths of `values` (c, 4)."""
    part = max(1, min(_PART, int(0.5 * np.sqrt(_CELLS / block.network.points))))
    parts = [_reduced(block, values[first : first + part]) for first in range(0, len(values), part)]
    matrix, pull = zip(*parts, strict=True)
    return Spectrum(matrix=np.concatenate(matrix), pull=np.concatenate(pull))


def _with_waves(network: Network, sea: WorkingSea, trains: Trains, sigma: FloatArray) -> Network:
    """Return the network with other waves, unknown where they have a sigma (k, 4)."""
    given = replace(sea.sea, surface=trains.surface, sigma=sigma, names=())
    border = network.border.having(ObservationKind.WAVE, wave_names(given))
    known = not given.unknown.any()
    return replace(network, sea=replace(sea, sea=given, trains=None if known else trains), border=border)


def _reduced(block: LevelBlock, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the reduced normal equations (c, 2, 2), (c, 2) of the heights of two waves for each of c `values`.

    One has a crest at the origin, the other one a quarter of a length on. All else is eliminated.
    """
    network, state, sea = block.network, block.state, block.network.sea
    if sea is None:
        raise ValueError("the network has no waves")
    doubled = np.repeat(values, 2, axis=0)
    doubled[:, HEIGHT] = 0.0
    doubled[0::2, CREST], doubled[1::2, CREST] = 0.0, 0.25 * values[:, LENGTH]
    given = sea.trains.values if sea.trains else state.waves
    which = [*range(len(given)), *[block.wave] * len(doubled)]
    trains = rows_of(block.sea.trains, which, np.concatenate([given, doubled]))
    of_doubled = np.full(doubled.shape, np.nan)
    of_doubled[:, HEIGHT] = _FREE
    sigma = np.full(given.shape, np.nan) if sea.sea.sigma is None else sea.sea.sigma
    tried = _with_waves(network, sea, trains, np.concatenate([sigma, of_doubled]))
    line = block.problem(tried).linearise(replace(state, waves=np.concatenate([state.waves, doubled])))
    last = tried.border.first_kept - len(doubled)
    S, g = _eliminated(line.matrix, line.rhs, np.arange(last, tried.border.first_kept))
    index = np.arange(len(doubled)).reshape(-1, 2)
    return S[index[:, :, None], index[:, None, :]], g.reshape(-1, 2)


def _eliminated(matrix: NormalMatrix, rhs: FloatArray, columns: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the normal equations (g, g), (g,) of some columns of the border, with all other unknowns eliminated.

    Zeros where these are not determined.
    """
    split = len(matrix.border)
    others = np.setdiff1d(np.arange(len(matrix.corner)), columns)
    rest = replace(matrix, border=matrix.border[:, others], corner=matrix.corner[np.ix_(others, others)])
    factor = factorised(rest)
    if factor is None:
        return np.zeros((len(columns), len(columns))), np.zeros(len(columns))
    cross = np.concatenate([matrix.border[:, columns], matrix.corner[np.ix_(others, columns)]])
    solved = factor.solve_scaled(cross * factor.scale[:, None]) * factor.scale[:, None]
    right = np.concatenate([rhs[:split], rhs[split:][others]])
    return matrix.corner[np.ix_(columns, columns)] - cross.T @ solved, rhs[split:][columns] - solved.T @ right
