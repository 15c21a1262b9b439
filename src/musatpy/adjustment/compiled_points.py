"""Groups of points that compiled kernels eliminate: what these take, out of network and state."""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.collinear import Follow
from musatpy.adjustment.ground import RIDGE, point_squares, prior_rows
from musatpy.adjustment.kernels import compiled_points
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import NormalEquations
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.water_surface import surface
from musatpy.arrays import FloatArray
from musatpy.model import ObservationKind

if TYPE_CHECKING:
    from musatpy.adjustment.kernels import points


def kernels_of(network: Network) -> ModuleType | None:
    """Return the compiled kernels for a network, None where numpy does the work."""
    return compiled_points(network.photos)


def split(network: Network) -> tuple[tuple[PointGroup, ...], tuple[PointGroup, ...]]:
    """Return the groups of points that have no unknowns but their own and those of their stations, and others.

    Others are kept points, those of equal elevations, and where water or waves are unknown all with a wet ray.
    """
    border = network.border
    unknown = network.water.unknown or border.count(ObservationKind.WAVE) > 0 or network.sea is not None
    plain, others = [], []
    for group in network.groups:
        if group.kept or (group.known and border.count(ObservationKind.EQUAL_ELEVATION)):
            others.append(group)
            continue
        wet = network.refracted[group.rays].any(axis=1) if unknown else np.zeros(len(group.point), dtype=bool)
        plain += [group.part(~wet)] if not wet.all() else []
        others += [group.part(wet)] if wet.any() else []
    return tuple(plain), tuple(others)


def add_eliminated(
    kernels: ModuleType, network: Network, state: State, group: PointGroup, normals: NormalEquations
) -> tuple[Follow, float]:
    """Add the points of a group to the normal equations; return how they follow a step, and r' N_pp^-1 r of all."""
    k, m = group.rays.shape
    at = _measured(kernels, network, state, group, state.ground[group.point])
    known = _known(kernels, network, state, group)
    out = kernels.Eliminated(shift=np.empty((k, 3)), by_station=np.zeros((k, 3, m, network.pattern.size)))
    slot, blocks, rhs = normals.to_add(at.photo)
    gain = kernels.eliminate(
        at,
        _stations(kernels, network, state),
        _water(kernels, network, state, group, at.ground),
        known,
        RIDGE,
        kernels.Sums(slot=slot, blocks=blocks, rhs=rhs),
        out,
    )
    axes = known.axes if len(known.axes) else np.broadcast_to(np.eye(3), (k, 3, 3))
    follow = Follow(
        group=group,
        axes=axes,
        shift=out.shift,
        by_station=out.by_station,
        by_extra=np.zeros((k, 3, 0)),
        index=np.zeros((k, 0), dtype=np.int64),
    )
    return follow, float(gain)


def squares_of(
    kernels: ModuleType | None, network: Network, state: State, group: PointGroup, ground: FloatArray
) -> FloatArray:
    """Return what `point_squares` does, compiled where there are kernels and the water has no waves."""
    if kernels is None or network.sea is not None:
        return point_squares(network, state, group, ground)
    out = np.empty(len(group.point))
    at = _measured(kernels, network, state, group, ground)
    kernels.squares(at, _stations(kernels, network, state), _water(kernels, network, state, group, ground), out)
    if group.known:
        priors = prior_rows(network, state, group.point, ground)
        out += np.einsum("ka,ka,ka->k", priors.deviation, priors.weight, priors.deviation)
    return out


def _measured(
    kernels: ModuleType, network: Network, state: State, group: PointGroup, ground: FloatArray
) -> points.Measured:
    rays = group.rays
    measured: points.Measured = kernels.Measured(
        photo=network.photo[rays],
        xy=network.xy[rays],
        weight=network.weight[rays],
        ground=np.ascontiguousarray(ground),
    )
    return measured


def _stations(kernels: ModuleType, network: Network, state: State) -> points.Stations:
    stations: points.Stations = kernels.Stations(
        *(np.ascontiguousarray(part) for part in (state.position, state.M, state.dM, network.axes)),
        focal_length=np.ascontiguousarray(network.focal_length),
        principal_point=np.ascontiguousarray(network.principal_point),
    )
    return stations


def _water(
    kernels: ModuleType, network: Network, state: State, group: PointGroup, ground: FloatArray
) -> points.Water:
    wet = network.refracted[group.rays]
    normal, depth = np.zeros((0, 0, 3)), np.zeros((0, 0))
    if wet.any():
        over = surface(
            network.frame,
            network.slope(state.tilt),
            state.tide[network.photo[group.rays]],
            np.repeat(ground[:, None], wet.shape[1], axis=1),
        )
        normal, depth = np.ascontiguousarray(over.normal), np.ascontiguousarray(over.depth)
    else:
        wet = np.zeros((0, 0), dtype=bool)
    water: points.Water = kernels.Water(wet=wet, normal=normal, depth=depth, index=float(state.index))
    return water


def _known(kernels: ModuleType, network: Network, state: State, group: PointGroup) -> points.Known:
    if not group.known:
        nothing = np.zeros((0, 3))
        unknown: points.Known = kernels.Known(
            axes=np.zeros((0, 3, 3)), free=np.zeros((0, 3), dtype=bool), weight=nothing, pull=nothing
        )
        return unknown
    priors = prior_rows(network, state, group.point, state.ground[group.point])
    weight = np.ascontiguousarray(priors.weight[:, :3])
    known: points.Known = kernels.Known(
        axes=np.ascontiguousarray(priors.axes), free=priors.free, weight=weight, pull=weight * priors.deviation[:, :3]
    )
    return known
