"""Considered parameters: water that the deck knows with a sigma, and that the adjustment does not estimate.

Their errors are no unknowns, and go into everything. With the normals N of the unknowns, and N_xc between these and
the parameters, errors c of the parameters move the estimates by S c, S = -N^-1 N_xc, and the ground points, which
are eliminated, by (-F S - F_c) c (Schmidt 1966). To the covariances comes S C S' with the C of the cards: it is not
scaled by sigma0. With T = N_cc + N_cx S and the right side g of the parameters, such errors explain
g' (T + C^-1)^-1 g of the weighted sum of squares; the rest is chi-square of the degrees of freedom.

The partials are those of the adjustment itself: its network with the considered parameters in its border.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.collinear import Simultaneous
from musatpy.adjustment.iteration import State, WaterKnowledge
from musatpy.adjustment.kinds import global_unknowns
from musatpy.adjustment.kinds.lens import LensParameter
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import Cofactors, Factor
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.model import Block, ConsideredWater, ObservationKind, Program

if TYPE_CHECKING:
    from musatpy.adjustment.datum import InnerConstraints


_PAIRS = 2**20  # elements of S gathered at a time
_WAVE = ObservationKind.WAVE
_UNITS = {  # others are in m
    ObservationKind.WATER_TILT: "arc sec",
    ObservationKind.WATER_INDEX: "",
    ObservationKind.LENS: "",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Considered:
    """What c considered parameters do to a solution.

    network, state: those of the solution with the parameters in the border; free: which of its columns are unknowns
    of the adjustment; cofactors: covariances, in metres and radians, that come from the parameters alone.
    """

    network: Network
    state: State
    free: BoolArray  # (g,)
    cofactors: Cofactors
    parameters: ConsideredWater

    def with_covariances(self, estimated: Cofactors) -> Cofactors:
        """Return covariances of the unknowns: those `estimated`, and what comes from the parameters."""
        spread = self.cofactors
        return replace(
            estimated,
            blocks=estimated.blocks + spread.blocks,
            border=estimated.border + spread.border[:, self.free],
            corner=estimated.corner + spread.corner[np.ix_(self.free, self.free)],
        )


def considered_parameters(
    block: Block, network: Network, state: State, factor: Factor, held: IntArray, inner: InnerConstraints | None
) -> Considered | None:
    """Return what the considered parameters of a block do, None where none of them has a part in it.

    `network` has the true rays, `factor` that of its normals with full weights, in which `held` unknowns stay.
    """
    wide = extended(block, network, state)
    known, sigma = wide.known, wide.sigma
    if not len(sigma):
        return None
    problem = Simultaneous(network=wide.network, options=block.options, held=held)
    line = problem.linearise(wide.state)
    normals = line.matrix
    cross = np.concatenate([normals.border[:, known], normals.corner[np.ix_(~known, known)]])
    S = -factor.scale[:, None] * factor.solve_scaled(cross * factor.scale[:, None])
    # the diagonal of what nothing observes is 1
    of_parameters = normals.corner[np.ix_(known, known)] * cross.any(axis=0)
    T = sigma[:, None] * (of_parameters + cross.T @ S) * sigma
    columns = np.concatenate([np.zeros(len(normals.border), dtype=bool), known])
    g = sigma * (line.rhs[columns] + line.rhs[~columns] @ S)
    if inner is not None:
        S = S + inner.restored(wide.network, wide.state, cross, known)
    return Considered(
        network=wide.network,
        state=wide.state,
        free=~known,
        cofactors=_cofactors(wide.network, S, np.square(sigma), known),
        parameters=ConsideredWater(
            names=np.array(wide.names, dtype=np.str_),
            units=np.array(wide.units, dtype=np.str_),
            sigma=sigma,
            explained=float(g @ np.linalg.solve(np.eye(len(sigma)) + T, g)),
        ),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Extended:
    """A network with c considered parameters in its border, as if they were unknown, and its state."""

    network: Network
    state: State
    known: BoolArray  # (g,) columns of the border that are the parameters
    names: list[str]
    units: list[str]
    sigma: FloatArray  # (c,)


def extended(block: Block, network: Network, state: State) -> Extended:
    """Return a network with the considered parameters of its block in the border."""
    water, border = block.water, network.border
    group, levels, sigma = _levels(block, network.water)
    tilt = 0.0 if network.water.tilt_unknown or water is None else water.tilt_sigma or 0.0
    index = 0.0 if network.water.index_unknown or water is None else water.sigma or 0.0
    knowledge = replace(
        network.water,
        group=group,
        ids=np.concatenate([network.water.ids, levels]),
        level_weight=np.concatenate([network.water.level_weight, np.zeros(len(levels))]),
        tilt_weight=0.0 if tilt else network.water.tilt_weight,
        tilt_unknown=network.water.tilt_unknown or tilt > 0.0,
        index_weight=0.0 if index else network.water.index_weight,
        index_unknown=network.water.index_unknown or index > 0.0,
    )
    sea, waves = network.sea, np.zeros(0)
    if sea is not None and sea.sea.considered:
        sea = sea.unknown
        state = replace(state, waves=sea.waves)
        waves = np.asarray(sea.sea.sigma)[sea.sea.unknown]
    parameters, cameras = dict(network.parameters), np.zeros(0)
    if block.options.program is not Program.IIIA and (lenses := LensParameter().parameters(block)):
        cameras = 1.0 / np.sqrt(lenses.weight)
        parameters[ObservationKind.LENS] = lenses.weighted(0.0)
        state = replace(state, parameters={ObservationKind.LENS: lenses.given})
    columns = global_unknowns(block, knowledge, sea.sea if sea else None, parameters)
    wide = replace(border, columns=columns if len(waves) else columns | {_WAVE: border.columns[_WAVE]})
    names: list[str] = []
    units: list[str] = []
    known: list[bool] = []
    for kind, now in wide.columns.items():
        before = border.count(kind)
        known += [number >= before for number in range(len(now))]
        names += now[before:]
        units += ["deg" if name.endswith("azimuth") else _UNITS.get(kind, "m") for name in now[before:]]
    return Extended(
        network=replace(network, water=knowledge, sea=sea, parameters=parameters, border=wide),
        state=state,
        known=np.array(known + [False] * 3 * len(wide.kept), dtype=bool),
        names=names,
        units=units,
        sigma=np.concatenate([sigma, [tilt] * 2 if tilt else [], [index] if index else [], waves, cameras]),
    )


def _levels(block: Block, water: WaterKnowledge) -> tuple[IntArray, TextArray, FloatArray]:
    """Return the common errors of tides that have a sigma and of which `water` makes no unknown.

    Which correction or error the tide of each photo has (n,), -1 for none, errors counting last; names (c,) in
    words and sigmas (c,) m of the errors. Those of a tide group have one, else those of a day, else each its own:
    of the root mean square of the sigmas on the cards. A tide whose card has no sigma is without error.
    """
    photos, first = block.photos, len(water.ids)
    chosen = np.flatnonzero((water.group < 0) & np.isfinite(photos.tide) & (photos.tide_sigma > 0.0))
    labels = [
        f"tide group {group}" if group else f"day {day}" if day else f"photo {photo}"
        for group, day, photo in zip(
            photos.tide_group[chosen], photos.tide_day[chosen], photos.ids[chosen], strict=True
        )
    ]
    names, start, number = np.unique(np.array(labels, dtype=np.str_), return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(start))  # in the order of the photos
    group = water.group.copy()
    group[chosen] = first + rank[number]
    squares = np.bincount(rank[number], weights=np.square(photos.tide_sigma[chosen]), minlength=len(names))
    count = np.bincount(rank[number], minlength=len(names))
    return group, names[np.argsort(start)], np.sqrt(squares / np.maximum(count, 1))


def _cofactors(network: Network, S: FloatArray, C: FloatArray, known: BoolArray) -> Cofactors:
    """Return [S; I] C [S; I]' in the pattern of the network, its border in the order of the network's."""
    n, q = network.photos, network.pattern.size
    stations, g = S[: n * q].reshape(n, q, -1), len(known)
    full = np.zeros((g, len(C)))
    full[~known], full[known] = S[n * q :], np.eye(len(C))
    i, j = network.pattern.pairs.T
    blocks = np.empty((len(i), q, q))
    size = max(1, _PAIRS // max(1, q * len(C)))
    for start in range(0, len(i), size):
        rows = slice(start, start + size)
        blocks[rows] = (stations[i[rows]] * C) @ np.swapaxes(stations[j[rows]], 1, 2)
    return Cofactors(
        pattern=network.pattern,
        blocks=blocks,
        border=(S[: n * q] * C) @ full.T,
        corner=(full * C) @ full.T,
    )
