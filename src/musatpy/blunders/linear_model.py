"""The adjustment of a scene made linear: residuals at the minimum, and how far the rest checks each of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from musatpy.adjustment import ground as ground_points
from musatpy.adjustment.direct import state_after, station_rows
from musatpy.adjustment.ground import nearest_ground, point_squares, settle_group
from musatpy.adjustment.iteration import SingularNormalsError
from musatpy.adjustment.kinds import kept_axes
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import Cofactors, Factor, factorised
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray, IntArray
from musatpy.blunders.checks import (
    OTHERS_CHECKED,
    ROUNDING,
    CheckedPoints,
    Drop,
    Inverse,
    checked_points,
    dropped,
)
from musatpy.blunders.common_errors import CommonErrors
from musatpy.blunders.factors import Factors
from musatpy.blunders.scene import Scene

_FAR = 100.0  # squares of a point: control or images are more than some sigmas off
_STEPS = 4  # of an adjustment, that it takes as much as
_MEETS = 40.0  # squares for each of its images that say that these meet: stations need not be exact


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearModel(CheckedPoints):
    """The linear adjustment of a scene at a state, some observations out; its points after the step."""

    scene: Scene
    factor: Factor
    inverse: Inverse
    step: FloatArray  # (u,) to the minimum
    stations: FloatArray  # (n, q) residuals of positions, attitudes, tides
    station_weight: FloatArray  # (n, q)

    @cached_property
    def minimum(self) -> State:
        """Stations and kept points after the step, for the observations of these alone."""
        return _after(self.network, self.state, self.step)

    @cached_property
    def common(self) -> CommonErrors:
        """What errors do that are common to many observations."""
        return CommonErrors.of(self)

    @property
    def cofactors(self) -> Cofactors:
        """The cofactors of stations and globals."""
        return self.inverse.cofactors

    @property
    def squares(self) -> float:
        """v'Pv at the minimum, of images, control and stations."""
        squares = sum(float(np.sum(checks.squares)) for checks in self.points)
        return squares + float(np.sum(self.station_weight * np.square(self.stations)))

    def stations_explaining(self, squares: float, columns: IntArray) -> IntArray:
        """Return the photos (k,) some of whose observations may explain so many squares or more."""
        own = np.sum(self.station_weight[:, columns] * np.square(self.stations[:, columns]), axis=1)
        return np.flatnonzero((own > 0.0) & (own >= OTHERS_CHECKED * (1.0 - ROUNDING) * squares))

    def station_drop(self, photo: IntArray, columns: IntArray) -> Drop:
        """Return what some of the observations of photos (k,) explain."""
        v, weight = self.stations[photo[:, None], columns], self.station_weight[photo[:, None], columns]
        unit = np.broadcast_to(np.eye(self.stations.shape[1])[columns], (*v.shape, self.stations.shape[1]))
        Q = self.inverse.cofactors_of(photo[:, None], np.zeros((len(photo), 0), dtype=np.int64), unit)
        return dropped(v, weight, Q, OTHERS_CHECKED)


def linear_model(scene: Scene, factors: Factors, state: State) -> LinearModel:
    """Return the linear adjustment of a scene, its weights times `factors`, points at their best for the stations.

    Raises `SingularNormalsError`.
    """
    scene.effort.spend_steps(scene.network, _STEPS)
    problem = scene.problem(factors)
    network = problem.network
    state = by_images(network, ground_points.settle(network, state))
    line = problem.linearise(state)
    factor = factorised(line.matrix)
    if factor is None:
        raise SingularNormalsError(line.matrix)
    return solved(scene, network, state, Inverse(factor=factor, held=scene.held), factor.solve(line.rhs))


def solved(scene: Scene, network: Network, state: State, inverse: Inverse, step: FloatArray) -> LinearModel:
    """Return the linear adjustment of a scene, `step` (u,) from its minimum, with the `inverse` of its normals."""
    points = checked_points(scene.block, network, state, inverse, step)
    station_weight, residual = station_rows(network, state)
    return LinearModel(
        network=network,
        state=state,
        points=points.points,
        scene=scene,
        factor=inverse.factor,
        inverse=inverse,
        step=step,
        stations=residual + step[: residual.size].reshape(residual.shape),
        station_weight=station_weight,
    )


def by_images(network: Network, state: State) -> State:
    """Return the state with control points where their images meet, where these meet well and control is far off.

    Images are linear near their point only; control is linear everywhere.
    """
    ground, far = state.ground.copy(), state.squares > _FAR
    for group in network.control_groups:
        if group.rays.shape[1] < 2:
            continue
        for part in group.some(far[group.point]):
            part = replace(part, known=False)
            start = nearest_ground(network.with_unknown_points(), state, part, 0.0)
            met, _ = settle_group(network, state, part, start)
            squares = point_squares(network, state, part, met)
            good = squares < _MEETS * part.rays.shape[1]
            ground[part.point[good]] = met[good]
    return replace(state, ground=ground)


def _after(network: Network, state: State, step: FloatArray) -> State:
    """Return the state with stations, water and kept points moved by a step."""
    after, kept = state_after(network, state, step), network.border.kept
    if not len(kept):
        return after
    ground, local = state.ground.copy(), step[network.pattern.order + network.border.kept_columns(kept)]
    ground[kept] += np.einsum("kji,kj->ki", kept_axes(network, ground[kept]), local)
    return replace(after, ground=ground)
