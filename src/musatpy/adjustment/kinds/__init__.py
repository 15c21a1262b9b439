"""The kinds of observations and of global unknowns, a few to a file; whoever deals with all loops over these.

They are counted, too. Every file of this folder with `KINDS` counts, in the order of `model.ObservationKind`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

import numpy as np

from musatpy.adjustment.iteration import State, WaterKnowledge
from musatpy.adjustment.kinds.kind import Kind, OfImages, OfWater, Prior, Rows, StationKind, Unknown
from musatpy.adjustment.kinds.measured import MeasuredKind
from musatpy.adjustment.kinds.parameter import ParameterUnknown
from musatpy.adjustment.network import NOTHING, MeasuredTies, Network
from musatpy.adjustment.normals import NormalEquations
from musatpy.adjustment.parameters import Parameters
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import BoolArray, FloatArray
from musatpy.model import Block, ObservationKind, extensions


def _all() -> list[Kind]:
    """Return the kinds of all files of the folder, and of extensions."""
    names = [f"{__name__}.{path.stem}" for path in Path(__file__).parent.glob("*.py") if path.stem != "__init__"]
    names += extensions.kind_modules()
    kinds = (kind for name in names for kind in getattr(import_module(name), "KINDS", ()))
    return sorted(kinds, key=lambda kind: kind.observed)


KINDS = tuple(_all())
DIRECT = tuple(kind for kind in KINDS if kind.direct)
MEASURED = tuple(kind for kind in KINDS if isinstance(kind, MeasuredKind))
PRIORS = tuple(kind for kind in KINDS if isinstance(kind, Prior))
UNKNOWNS = tuple(kind for kind in KINDS if isinstance(kind, Unknown))
WATER = tuple(kind for kind in KINDS if isinstance(kind, OfWater))
OF_IMAGES = tuple(kind for kind in KINDS if isinstance(kind, OfImages))
SEARCHED = tuple(kind for kind in KINDS if kind.searched)


def state_after(network: Network, state: State, step: FloatArray) -> State:
    """Return the state after a step of stations and global unknowns; ground points stay where they are."""
    n, q = network.photos, network.pattern.size
    stations = step[: q * n].reshape(n, q)
    state = replace(
        state,
        position=state.position + np.einsum("nji,nj->ni", network.axes, stations[:, :3]),
        attitude=state.attitude + stations[:, 3:6],
    )
    for kind in UNKNOWNS:
        if network.unknown(kind.observed):
            state = kind.state_after(network, step, state)
    return state


def largest_movements(step: FloatArray, network: Network) -> tuple[int, float, int, float]:
    """Return (photo, rad) of the largest differential rotation and (photo, m) of the largest translation."""
    n, q = network.photos, network.pattern.size
    stations = step[: q * n].reshape(n, q)
    rotation = np.abs(stations[:, 3:6]).max(axis=1)
    translation = np.linalg.norm(stations[:, :3], axis=1)
    turned, shifted = int(rotation.argmax()), int(translation.argmax())
    return turned, float(rotation[turned]), shifted, float(translation[shifted])


def kept_movement(step: FloatArray, network: Network) -> float:
    """Return the largest change of the coordinates of kept points, in m."""
    first = network.pattern.order + network.border.first_kept
    return float(np.abs(step[first:]).max(initial=0.0))


def direct_rows(network: Network, state: State) -> Iterator[tuple[Kind, Rows]]:
    """Yield the observations of every kind that has any."""
    for kind in DIRECT:
        if takes_part(kind, network) and len((rows := kind.rows(network, state)).row):
            yield kind, rows


def takes_part(kind: Kind, network: Network) -> bool:
    """Return whether there may be observations of a kind that have a weight: of those without, nothing is asked."""
    if isinstance(kind, StationKind):
        return bool(getattr(network, kind.attribute).any())
    if isinstance(kind, MeasuredKind):
        return len(network.measured[kind.observed].row) > 0
    return not isinstance(kind, Unknown) or network.unknown(kind.observed)


def measured_in(block: Block, enters: BoolArray) -> dict[ObservationKind, MeasuredTies]:
    """Return what takes part of the tables of observations between places; points that enter (p,) may be kept."""
    return {
        kind.observed: kind.measured(block, enters) if getattr(block, kind.observed.attribute).count else NOTHING
        for kind in MEASURED
    }


def measured_values(block: Block, network: Network, state: State) -> dict[ObservationKind, FloatArray]:
    """Return what was measured between places as it is at `state`, NaN where an end has no position."""
    some = {kind: getattr(block, kind.observed.attribute).count > 0 for kind in MEASURED}
    return {kind.observed: kind.values(block, network, state) if some[kind] else np.zeros(0) for kind in MEASURED}


def global_unknowns(
    block: Block, water: WaterKnowledge, sea: Sea | None, parameters: Mapping[ObservationKind, Parameters]
) -> dict[ObservationKind, tuple[str, ...]]:
    """Return the names of the global unknowns of each kind; most jobs have none."""
    some = water.unknown or sea is not None or block.equal_elevations.count > 0
    names = {kind.observed: tuple(kind.names(block, water, sea)) if some else () for kind in UNKNOWNS}
    return names | {kind: known.names for kind, known in parameters.items()}


def further_parameters(block: Block) -> dict[ObservationKind, Parameters]:
    """Return what is known beforehand of the further parameters of a block, of those kinds of which it has any."""
    every = {kind.observed: kind.parameters(block) for kind in UNKNOWNS if isinstance(kind, ParameterUnknown)}
    return {kind: known for kind, known in every.items() if known is not None}


def station_rows(network: Network, state: State) -> tuple[FloatArray, FloatArray]:
    """Return weights and residuals (n, q) of the unknowns of photos as observed, the water at each included."""
    weight, residual = np.zeros((2, network.pattern.order))
    for _, rows in direct_rows(network, state):
        if rows.index.shape[1] == 1 and rows.index[0, 0] < len(weight):
            weight[rows.index[:, 0]], residual[rows.index[:, 0]] = rows.weight, rows.residual
    return weight.reshape(network.photos, -1), residual.reshape(network.photos, -1)


def direct_squares(network: Network, state: State) -> float:
    """Return the weighted sum of squares of all observations that concern no image."""
    split = network.pattern.order
    of_unknowns, others = np.zeros(split + network.border.size), 0.0
    for _, rows in direct_rows(network, state):
        squares = rows.weight * np.square(rows.residual)
        if rows.index.shape[1] == 1:  # added up in the order of the unknowns, whatever their kinds
            of_unknowns[rows.index[:, 0]] += squares
        else:
            others += float(np.sum(squares))
    return float(np.sum(of_unknowns[:split])) + others + float(np.sum(of_unknowns[split:]))


def add_direct(network: Network, state: State, normals: NormalEquations) -> None:
    """Add all observations that concern no image."""
    for _, rows in direct_rows(network, state):
        normals.add_rows(rows.index, rows.partials, rows.weight, rows.residual)


@dataclass(frozen=True, kw_only=True, eq=False)
class Counts:
    """Scalar observations and unknowns by kind."""

    observations: dict[str, int]
    unknowns: dict[str, int]

    @property
    def degrees_of_freedom(self) -> int:
        """Observations minus unknowns."""
        return sum(self.observations.values()) - sum(self.unknowns.values())


def count(network: Network, unobserved_photos: int, free_motions: int) -> Counts:
    """Return what entered the solution; conditions of a point count as its 2m - 3 do, by images minus ground."""
    priors, water = network.priors, network.water
    control = (*network.control_groups, *network.kept_groups)
    known = np.concatenate([np.zeros(0, dtype=np.int64), *(g.point for g in control)])  # of others nothing is
    grouped = known[priors.group[known] >= 0]
    points = sum(len(g.point) for g in network.groups)
    wet = any(network.refracted[group.rays].any() for group in network.groups)
    unknown_water = [kind for kind in WATER if network.unknown(kind.observed)]
    of_water = sum(
        network.border.count(kind.observed)
        for kind in unknown_water
        if kind.observed is not ObservationKind.WATER_LEVEL and (wet or kind.weight(network).any())
    )
    levels = int(np.count_nonzero(_sees_water(network) | (water.level_weight > 0.0)))
    observations = {
        "plate coordinates, pass points": 2 * sum(g.rays.size for g in network.pass_groups),
        "plate coordinates, control points": 2 * sum(g.rays.size for g in control),
        "control coordinates": int(np.count_nonzero(priors.weight[known])),
        "station positions": int(np.count_nonzero(network.position_weight)),
        "station attitudes": int(np.count_nonzero(network.attitude_weight)),
        "equal elevations": len(grouped),
        "air bases": 0,
    }
    unknowns = {
        "station parameters": 6 * (network.photos - unobserved_photos),
        "ground coordinates": 3 * points - int(np.count_nonzero(priors.held[known])),
        "levels": len(np.unique(priors.group[grouped])),
    }
    further = {kind.noun: measured.value.size for kind, measured in network.measured.items()}
    further["water"] = sum(int(np.count_nonzero(kind.weight(network))) for kind in unknown_water)
    further["inner constraints"] = free_motions
    for observed, parameters in network.parameters.items():
        further[observed.noun] = int(np.count_nonzero(parameters.weight))
        if len(parameters.weight):
            unknowns[observed.noun] = len(parameters.weight)
    observations |= {kind: number for kind, number in further.items() if number}
    if levels + of_water:
        unknowns["water"] = levels + of_water
    return Counts(observations=observations, unknowns=unknowns)


def redundancy(network: Network) -> int:
    """Return the degrees of freedom of a network all of whose photos are held, at least 1."""
    return max(count(network, 0, 0).degrees_of_freedom, 1)


def _sees_water(network: Network) -> BoolArray:
    """Return (c,) whether a refracted ray depends on the correction of a tide."""
    seen = np.zeros(len(network.water.ids), dtype=bool)
    for group in network.groups if len(seen) else ():
        photo = network.photo[group.rays[network.refracted[group.rays]]]
        corrections = network.water.group[photo]
        seen[corrections[corrections >= 0]] = True
    return seen
