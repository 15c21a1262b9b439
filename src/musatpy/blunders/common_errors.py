"""Errors that are common to many observations, and what they have to do with a linear adjustment.

An error of one unit adds a column c to the observations. As an unknown more it explains (c'Pv)^2 / c'P Qvv P c,
where c'P Qvv P c = c'Pc - (A'Pc)' N^-1 (A'Pc) (Baarda 1968); points are eliminated, and follow.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.network import Network
from musatpy.adjustment.sightings import index_partials, residuals
from musatpy.adjustment.unknowns import LEVEL, State
from musatpy.adjustment.water_surface import tide_groups
from musatpy.arrays import FloatArray, IntArray
from musatpy.model import Block, CauseKind, CoordinateSystem, ObservationKind

if TYPE_CHECKING:
    from musatpy.blunders.checks import CheckedPoints
    from musatpy.blunders.linear_model import LinearModel

_K = ObservationKind


@dataclass(frozen=True, kw_only=True, eq=False)
class Column:
    """What an error of one unit adds to the observations, if it is common to many."""

    kind: CauseKind
    member: int = 0
    photo: tuple[int, ...] = ()
    name: str = ""
    on_images: bool = False  # `_errors_of_images`
    control: FloatArray | None = None  # (k, 3)
    stations: FloatArray | None = None  # (n, q)


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
        on_control = [number for number, column in enumerate(self.columns) if column.control is not None]
        control = _stacked([self.columns[number].control for number in on_control])
        for checks in points.points:
            m = checks.rays.shape[1]
            parts = [
                (on_images, slice(0, 2 * m), _errors_of_images(points.network, points.state, block, checks.rays))
            ]
            if on_control and checks.has_priors:
                of_control = np.where(checks.control[:, None, None] >= 0, control[checks.control], 0.0)
                parts.append((on_control, slice(2 * m, 2 * m + 3), of_control))
            for numbers, rows, c in parts:
                weighted = np.swapaxes(checks.weight[:, rows, None] * c, 1, 2)
                by_point = weighted @ checks.ground[:, rows]
                self.weight[numbers] += np.einsum("kco,koc->c", weighted, c)
                self.weight[numbers] -= np.einsum("kci,kci->c", by_point @ checks.inverse, by_point)
                self.pull[numbers] += np.einsum("kco,ko->c", weighted, checks.residual[:, rows])
                coupled = (weighted @ checks.partials[:, rows]).transpose(1, 0, 2).reshape(len(numbers), -1)
                for number, values in zip(numbers, coupled, strict=True):
                    self.coupling[number] += np.bincount(
                        checks.unknowns.reshape(-1), values, self.coupling.shape[1]
                    )


def _index_counts(network: Network) -> bool:
    """Return whether the index of the water, which is no unknown itself, is worth a hypothesis."""
    unknown = network.water.unknown or network.border.count(_K.WAVE) > 0
    return bool(unknown and not network.border.count(_K.WATER_INDEX))


def _columns(network: Network, block: Block) -> Iterator[Column]:
    """Yield camera constants, the index, units of length, and common errors of tides."""
    n, q = network.photos, network.pattern.size
    for camera in range(_cameras(block)):
        yield Column(kind=CauseKind.FOCAL_LENGTH, member=camera, on_images=True)
        for axis in range(2):
            yield Column(kind=CauseKind.PRINCIPAL_POINT, member=2 * camera + axis, on_images=True)
    if _index_counts(network):
        yield Column(kind=CauseKind.INDEX, on_images=True)
    yield from _units(block, n, q)
    if network.water.per_photo:
        for name, photos in tide_groups(block, network.water.level_weight > 0.0):
            column = np.zeros((n, q))
            column[photos, LEVEL] = 1.0
            yield Column(kind=CauseKind.TIDES, photo=tuple(photos.tolist()), name=name, stations=column)


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


def _units(block: Block, photos: int, unknowns: int) -> Iterator[Column]:
    """Yield what a wrong unit of length does: to heights, in local jobs to all coordinates."""
    system = block.options.system
    if system is CoordinateSystem.GEOCENTRIC:
        return
    axes = slice(0, 3) if system is CoordinateSystem.LOCAL else slice(2, 3)
    control, stations = np.zeros((len(block.control.point), 3)), np.zeros((photos, unknowns))
    control[:, axes] = np.nan_to_num(block.control.position[:, axes])
    stations[:, axes] = np.nan_to_num(block.photos.position[:, axes])
    yield Column(kind=CauseKind.UNIT, member=0, control=control)
    yield Column(kind=CauseKind.UNIT, member=1, stations=stations)


def _stacked(columns: list[FloatArray | None]) -> FloatArray:
    """Return columns of one shape as the last axis of an array, empty without columns."""
    values = [column for column in columns if column is not None]
    return np.stack(values, axis=-1) if values else np.zeros(0)
