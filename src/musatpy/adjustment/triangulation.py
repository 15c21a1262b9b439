"""One MUSAT-IIA triangulation as a least squares problem: only stations (and levels of groups) are unknown."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from musatpy.adjustment.collinear import add_collinear
from musatpy.adjustment.conditions import add_full, add_weighted, measured_conditions, simple_variances
from musatpy.adjustment.ground import settle
from musatpy.adjustment.iteration import Linearisation
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import NormalEquations
from musatpy.adjustment.sightings import image_coordinates
from musatpy.adjustment.unknowns import State
from musatpy.model import Weights

FloatArray = NDArray[np.float64]
Scale = tuple[FloatArray, ...] | None


@dataclass(frozen=True, kw_only=True)
class Triangulation:
    """The modified geodetic restraint of a network (ETL-0306 section 3, docs/theory.md).

    States that it sees have their points settled; `apply` settles those that it returns.
    """

    network: Network
    weights: Weights
    rotation_limit: float
    translation_limit: float
    fixed_scale: Scale = None  # the variances of equal weights, the same for the whole triangulation

    def linearise(self, state: State) -> Linearisation:
        """Return the reduced normal equations of stations and levels at `state`."""
        network = self.network
        normals = NormalEquations(network.pattern, network.levels)
        scale: Scale = None
        if self.weights is Weights.FULL:
            for group in network.pass_groups:
                add_full(network, state, group, _adjusted(network, state, group), normals)
        else:
            scale = self.fixed_scale or simple_variances(network, state, self.weights)
            for group, variance in zip(network.pass_groups, scale, strict=True):
                add_weighted(network, group, measured_conditions(network, state, group), variance, normals)
        for group in network.control_groups:
            add_collinear(network, state, group, normals)
        _add_station_observations(network, state, normals)
        matrix, rhs = normals.finished()
        return Linearisation(matrix=matrix, rhs=rhs, objective=self.evaluate(state, scale), scale=scale)

    def evaluate(self, state: State, scale: Scale) -> float:
        """Return the weighted sum of squares at `state`."""
        network = self.network
        total = station_squares(network, state) + base_squares(network, state)
        for number, group in enumerate(network.pass_groups):
            if scale is None:
                total += float(state.squares[group.point].sum())
            else:
                value = measured_conditions(network, state, group).value
                total += float(np.sum(np.square(value) / scale[number]))
        for group in network.control_groups:
            total += float(state.squares[group.point].sum())
        return total if np.isfinite(total) else np.inf

    def apply(self, state: State, step: FloatArray) -> State:
        """Return the state after a step of stations and levels, its points settled again."""
        n = self.network.photos
        stations = step[: 6 * n].reshape(n, 6)
        shift = np.einsum("nji,nj->ni", self.network.axes, stations[:, :3])
        moved = replace(
            state,
            position=state.position + shift,
            attitude=state.attitude + stations[:, 3:],
            levels=state.levels + step[6 * n :],
        )
        return settle(self.network, moved)

    def converged(self, step: FloatArray) -> bool:
        """Return whether the largest differential rotation and translation are below their limits."""
        _, rotation, _, translation = largest_movements(step, self.network.photos)
        return rotation < self.rotation_limit and translation < self.translation_limit


def largest_movements(step: FloatArray, photos: int) -> tuple[int, float, int, float]:
    """Return (photo, rad) of the largest differential rotation and (photo, m) of the largest translation."""
    stations = step[: 6 * photos].reshape(photos, 6)
    rotation = np.abs(stations[:, 3:]).max(axis=1)
    translation = np.linalg.norm(stations[:, :3], axis=1)
    turned, moved = int(rotation.argmax()), int(translation.argmax())
    return turned, float(rotation[turned]), moved, float(translation[moved])


def station_squares(network: Network, state: State) -> float:
    """Return the weighted sum of squares of observed station positions and attitudes."""
    deviation = station_deviation(network, state)
    weight = np.concatenate([network.position_weight, network.attitude_weight], axis=1)
    return float(np.sum(weight * np.square(deviation)))


def station_deviation(network: Network, state: State) -> FloatArray:
    """Return current minus given stations (n, 6): east, north, up in m and angles in rad, within half a turn."""
    shift = np.einsum("nij,nj->ni", network.axes, state.position - network.position)
    turn = state.attitude - network.attitude
    return np.concatenate([shift, turn - 2.0 * np.pi * np.rint(turn / (2.0 * np.pi))], axis=1)


def base_squares(network: Network, state: State) -> float:
    """Return the weighted sum of squares of the known air bases."""
    length, _ = air_bases(network, state)
    return float(np.sum(network.base_weight * np.square(length - network.base_length)))


def air_bases(network: Network, state: State) -> tuple[FloatArray, FloatArray]:
    """Return the lengths (b,) of the known bases and their unit vectors (b, 3), first to second station."""
    base = state.position[network.base_photo[:, 1]] - state.position[network.base_photo[:, 0]]
    length = np.linalg.norm(base, axis=1)
    return length, base / length[:, None]


def _adjusted(network: Network, state: State, group: PointGroup) -> FloatArray:
    ground = np.repeat(state.ground[group.point][:, None], group.rays.shape[1], axis=1)
    return image_coordinates(network, state, group.rays, ground)


def _add_station_observations(network: Network, state: State, normals: NormalEquations) -> None:
    weight = np.concatenate([network.position_weight, network.attitude_weight], axis=1)
    normals.add_diagonal(weight, -weight * station_deviation(network, state))
    if len(network.base_length):
        length, unit = air_bases(network, state)
        photo = network.base_photo
        axes = network.axes[photo]
        a = np.zeros((len(length), 2, 6))
        a[:, 0, :3] = -np.einsum("bij,bj->bi", axes[:, 0], unit)
        a[:, 1, :3] = np.einsum("bij,bj->bi", axes[:, 1], unit)
        w = network.base_weight
        matrix = np.einsum("bmi,b,bnj->bminj", a, w, a)
        rhs = np.einsum("bmi,b,b->bmi", a, w, network.base_length - length)
        normals.add(photo, matrix, rhs)
