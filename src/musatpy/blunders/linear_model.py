"""The adjustment of a scene made linear: residuals at the minimum, and how far the rest checks each of them.

Errors that are common to many observations: one of one unit adds a column c to them. As an unknown more it explains
(c'Pv)^2 / c'P Qvv P c, where c'P Qvv P c = c'Pc - (A'Pc)' N^-1 (A'Pc) (Baarda 1968); points are eliminated, and
follow.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from musatpy.adjustment import ground as ground_points
from musatpy.adjustment.ground import nearest_ground
from musatpy.adjustment.iteration import SingularNormalsError
from musatpy.adjustment.kinds import kept_axes, state_after, station_rows
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import Cofactors, Factor, factorised
from musatpy.adjustment.point_normals import point_squares, settle_group
from musatpy.adjustment.sightings import index_partials, residuals
from musatpy.adjustment.unknowns import LEVEL, State
from musatpy.adjustment.water_surface import tide_groups
from musatpy.arrays import FloatArray, IntArray
from musatpy.blunders.checks import (
    CheckedPoints,
    Drop,
    checked_points,
    dropped,
)
from musatpy.blunders.scene import OTHERS_CHECKED, Factors, Scene
from musatpy.model import Block, CauseKind, ObservationKind

_FAR = 100.0  # squares of a point: control or images are more than some sigmas off
_STEPS = 4  # of an adjustment, that it takes as much as
_MEETS = 40.0  # squares for each of its images that say that these meet: stations need not be exact


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearModel(CheckedPoints):
    """The linear adjustment of a scene at a state, some observations out; its points after the step."""

    scene: Scene
    factor: Factor
    cofactors: Cofactors  # of stations and globals
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
    def squares(self) -> float:
        """v'Pv at the minimum, of images, control and stations."""
        squares = sum(float(np.sum(checks.squares)) for checks in self.points)
        return squares + float(np.sum(self.station_weight * np.square(self.stations)))

    def station_drop(self, columns: IntArray) -> Drop:
        """Return what some of the observations of each photo (n,) explain."""
        v, weight = self.stations[:, columns], self.station_weight[:, columns]
        n, q = self.stations.shape
        unit = np.broadcast_to(np.eye(q)[columns], (n, len(columns), q))
        Q = self.cofactors.cofactors_of(np.arange(n)[:, None], np.zeros((n, 0), dtype=np.int64), unit)
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
    return solved(scene, network, state, factor, factor.cofactors().holding(scene.held), factor.solve(line.rhs))


def solved(
    scene: Scene, network: Network, state: State, factor: Factor, cofactors: Cofactors, step: FloatArray
) -> LinearModel:
    """Return the linear adjustment of a scene, `step` (u,) from its minimum, with the factor of its normals."""
    points = checked_points(scene.block, network, state, cofactors, step)
    station_weight, residual = station_rows(network, state)
    return LinearModel(
        network=network,
        state=state,
        points=points.points,
        scene=scene,
        factor=factor,
        cofactors=cofactors,
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


_K = ObservationKind


@dataclass(frozen=True, kw_only=True, eq=False)
class Column:
    """What an error of one unit adds to the observations, if it is common to many."""

    kind: CauseKind
    member: int = 0
    photo: tuple[int, ...] = ()
    name: str = ""
    on_images: bool = False  # `_errors_of_images`
    stations: FloatArray | None = None  # (n, q)

    @classmethod
    def of_tides(cls, name: str, photo: IntArray, network: Network) -> Column:
        """Return the error of the tides of some photos (k,)."""
        stations = np.zeros((network.photos, network.pattern.size))
        stations[photo, LEVEL] = 1.0
        return cls(kind=CauseKind.TIDES, photo=tuple(photo.tolist()), name=name, stations=stations)


@dataclass(frozen=True, kw_only=True, eq=False)
class CommonErrors:
    """c'Pc (C,) and c'Pv (C,) of columns c of observations, and c'PA (C, u) by stations and globals."""

    columns: tuple[Column, ...]
    weight: FloatArray
    pull: FloatArray
    coupling: FloatArray

    @classmethod
    def of(cls, model: LinearModel) -> CommonErrors:
        """Return those of all observations of a linear model."""
        block = model.scene.block
        columns = tuple(_columns(model.network, block))
        sums = cls(
            columns=columns,
            weight=np.zeros(len(columns)),
            pull=np.zeros(len(columns)),
            coupling=np.zeros((len(columns), len(model.step))),
        )
        sums._add(block, model)
        for number, column in enumerate(columns):
            if column.stations is not None:
                weighted = model.station_weight * column.stations
                sums.coupling[number, : weighted.size] += weighted.reshape(-1)
                sums.weight[number] += float(np.sum(weighted * column.stations))
                sums.pull[number] += float(np.sum(weighted * model.stations))
        return sums

    def _add(self, block: Block, points: CheckedPoints) -> None:
        """Add what the observations of points have in these sums."""
        on_images = [number for number, column in enumerate(self.columns) if column.on_images]
        for checks in points.points:
            rows = slice(0, 2 * checks.rays.shape[1])
            c = _errors_of_images(points.network, points.state, block, checks.rays)
            weighted = np.swapaxes(checks.weight[:, rows, None] * c, 1, 2)
            by_point = weighted @ checks.ground[:, rows]
            self.weight[on_images] += np.einsum("kco,koc->c", weighted, c)
            self.weight[on_images] -= np.einsum("kci,kci->c", by_point @ checks.inverse, by_point)
            self.pull[on_images] += np.einsum("kco,ko->c", weighted, checks.residual[:, rows])
            coupled = (weighted @ checks.partials[:, rows]).transpose(1, 0, 2).reshape(len(on_images), -1)
            for number, values in zip(on_images, coupled, strict=True):
                self.coupling[number] += np.bincount(checks.unknowns.reshape(-1), values, self.coupling.shape[1])


def _index_counts(network: Network) -> bool:
    """Return whether the index of the water, which is no unknown itself, is worth a hypothesis."""
    unknown = network.water.unknown or network.border.count(_K.WAVE) > 0
    return bool(unknown and not network.border.count(_K.WATER_INDEX))


def _columns(network: Network, block: Block) -> Iterator[Column]:
    """Yield camera constants, the index, and common errors of tides."""
    for camera in range(_cameras(block)):
        yield Column(kind=CauseKind.FOCAL_LENGTH, member=camera, on_images=True)
        for axis in range(2):
            yield Column(kind=CauseKind.PRINCIPAL_POINT, member=2 * camera + axis, on_images=True)
    if _index_counts(network):
        yield Column(kind=CauseKind.INDEX, on_images=True)
    if network.water.per_photo:
        for name, photos in tide_groups(block, network.water.level_weight > 0.0):
            yield Column.of_tides(name, photos, network)


def _cameras(block: Block) -> int:
    """Return how many cameras photos have, the last of them included."""
    return int(block.photos.camera.max()) + 1


def _errors_of_images(network: Network, state: State, block: Block, rays: IntArray) -> FloatArray:
    """Return what errors of one unit add to images (k, m): (k, 2m, C), columns of `_columns` in their order."""
    cameras = _cameras(block)
    photo, index = network.photo[rays], _index_counts(network)
    camera = 3 * block.photos.camera[photo]
    image = network.xy[rays] + residuals(network, state, rays.reshape(-1)).reshape(*rays.shape, 2)
    ray = (image - network.principal_point[photo]) / network.focal_length[photo][..., None]
    out = np.zeros((*rays.shape, 2, 3 * cameras + index))
    np.put_along_axis(out, camera[..., None, None], -ray[..., None], axis=-1)
    for axis in range(2):
        np.put_along_axis(out[:, :, axis], camera[..., None] + 1 + axis, -1.0, axis=-1)
    if index:
        wet = network.refracted[rays]
        out[wet, :, -1] = -index_partials(network, state, rays[wet])
    return out.reshape(len(rays), 2 * rays.shape[1], -1)
