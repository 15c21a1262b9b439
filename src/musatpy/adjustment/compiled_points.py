"""Groups of points that compiled kernels eliminate: what these take, out of network and state."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.collinear import Follow
from musatpy.adjustment.dependence import Diagonal
from musatpy.adjustment.ground import RIDGE, prior_rows
from musatpy.adjustment.kernels import compiled_points
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import Cofactors, NormalEquations
from musatpy.adjustment.reliability import Part
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.water_surface import surface
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model import ObservationKind

if TYPE_CHECKING:
    from musatpy.adjustment.kernels import points


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
        wet = np.asarray(network.refracted[group.rays].any(axis=1) & unknown)
        plain += [group.part(~wet)] if not wet.all() else []
        others += [group.part(wet)] if wet.any() else []
    return tuple(plain), tuple(others)


@dataclass(frozen=True, kw_only=True, eq=False)
class Images:
    """The images of a group of points, gathered once, and the pairs of their photos."""

    group: PointGroup
    photo: IntArray  # (k, m)
    xy: FloatArray  # (k, m, 2)
    weight: FloatArray  # (k, m, 2)
    slot: IntArray  # (k, m (m + 1)/2)
    wet: BoolArray  # (k, m), (0, 0) where all are dry

    @classmethod
    def of(cls, network: Network, group: PointGroup) -> Images:
        """Return the images of a group."""
        photo, wet = network.photo[group.rays], network.refracted[group.rays]
        return cls(
            group=group,
            photo=photo,
            xy=network.xy[group.rays],
            weight=network.weight[group.rays],
            slot=network.pattern.slots(photo),
            wet=wet if wet.any() else np.zeros((0, 0), dtype=bool),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Spread:
    """Cofactors of the k points of a group (k, 3, 3) along east, north, up, and those of their images."""

    group: PointGroup
    points: FloatArray
    images: Part


def beside_one_another(network: Network, group: PointGroup) -> PointGroup:
    """Return a group in the order of the first photos of its points: what they add to stays in the cache."""
    return group.part(np.argsort(network.photo[group.rays[:, 0]], kind="stable"))


def measured(kernels: ModuleType, images: Images, ground: FloatArray) -> points.Measured:
    """Return the images of points that are at `ground` (k, 3)."""
    at: points.Measured = kernels.Measured(photo=images.photo, xy=images.xy, weight=images.weight, ground=ground)
    return at


def stations_of(kernels: ModuleType, network: Network, state: State) -> points.Stations:
    """Return the photos where they are."""
    arrays = (state.position, state.M, state.dM, network.axes, network.focal_length, network.principal_point)
    stations: points.Stations = kernels.Stations(*(np.ascontiguousarray(array) for array in arrays))
    return stations


class CompiledPoints:
    """The points of a network that compiled kernels eliminate, and the `others`."""

    @classmethod
    def of(cls, network: Network) -> CompiledPoints | None:
        """Return the points of a network, None where numpy does all."""
        kernels = compiled_points(network.photos)
        return None if kernels is None else cls(kernels, network)

    def __init__(self, kernels: ModuleType, network: Network) -> None:
        plain, self.others = split(network)
        self._kernels, self._network = kernels, network
        self._images = [Images.of(network, beside_one_another(network, group)) for group in plain]

    def add_eliminated(self, state: State, normals: NormalEquations) -> tuple[list[Follow], float]:
        """Add the points to the normal equations; return how they follow a step, and r' N_pp^-1 r of all."""
        follows, gain = [], 0.0
        blocks, rhs = normals.sums
        stations = stations_of(self._kernels, self._network, state)
        for images in self._images:
            k, m = images.photo.shape
            ground = state.ground[images.group.point]
            known = self._known(state, images.group)
            out = self._kernels.Eliminated(
                shift=np.empty((k, 3)), by_station=np.zeros((k, 3, m, self._network.pattern.size))
            )
            sums = self._kernels.Sums(slot=images.slot, blocks=blocks, rhs=rhs)
            at, water = measured(self._kernels, images, ground), self._water(state, images, ground)
            gain += self._kernels.eliminate(at, stations, water, known, RIDGE, sums, out)
            follows.append(
                Follow(
                    group=images.group,
                    axes=known.axes if images.group.known else np.broadcast_to(np.eye(3), (k, 3, 3)),
                    shift=out.shift,
                    by_station=out.by_station,
                    by_extra=np.zeros((k, 3, 0)),
                    index=np.zeros((k, 0), dtype=np.int64),
                )
            )
        return follows, gain

    def set_squares(self, state: State, squares: FloatArray) -> None:
        """Set the weighted squares (p,) of the points where they are."""
        stations = stations_of(self._kernels, self._network, state)
        for images in self._images:
            point = images.group.point
            ground, out = state.ground[point], np.empty(len(point))
            self._kernels.squares(
                measured(self._kernels, images, ground), stations, self._water(state, images, ground), out
            )
            if images.group.known:
                priors = prior_rows(self._network, state, point, ground)
                out += np.einsum("ka,ka,ka->k", priors.deviation, priors.weight, priors.deviation)
            squares[point] = out

    @property
    def known(self) -> tuple[PointGroup, ...]:
        """The groups of points of which something is known."""
        return tuple(images.group for images in self._images if images.group.known)

    def spread(
        self, state: State, cofactors: Cofactors, residual: FloatArray, diagonal: Diagonal
    ) -> Iterator[Spread]:
        """Yield how errors spread to the points of which nothing is known, and to their images; add to `diagonal`.

        `residual` (all measurements, 2) mm.
        """
        network, stations = self._network, stations_of(self._kernels, self._network, state)
        for images in self._images:
            if images.group.known:
                continue
            (k, m), ground = images.photo.shape, state.ground[images.group.point]
            out = self._kernels.Spread(
                point=np.empty((k, 3, 3)),
                image=np.empty((k, m, 2)),
                covariance=np.empty((k, m, 2, 3)),
                diagonal=diagonal.stations,
            )
            inverse = self._kernels.Inverse(slot=images.slot, blocks=cofactors.blocks)
            at, water = measured(self._kernels, images, ground), self._water(state, images, ground)
            self._kernels.spread(at, stations, water, RIDGE, inverse, out)
            axes = network.frame.axes(ground)
            rays = np.repeat(images.group.rays[..., None], 2, axis=2)
            covariance = out.covariance.reshape(k, 2 * m, 3) @ np.swapaxes(axes, 1, 2)
            part = Part(
                kind=ObservationKind.PLATE,
                row=rays.reshape(-1),
                component=np.broadcast_to(np.arange(2), rays.shape).reshape(-1),
                residual=residual[images.group.rays].reshape(-1),
                weight=images.weight.reshape(-1),
                cofactor=out.image.reshape(-1),
                covariance=covariance.reshape(-1, 3),
            )
            yield Spread(group=images.group, points=axes @ out.point @ np.swapaxes(axes, 1, 2), images=part)

    def _water(self, state: State, images: Images, ground: FloatArray) -> points.Water:
        water: points.Water = self._kernels.dry_water()
        if len(images.wet):
            network, m = self._network, images.wet.shape[1]
            over = surface(
                network.frame,
                network.slope(state.tilt),
                state.tide[images.photo],
                np.repeat(ground[:, None], m, axis=1),
            )
            normal, depth = np.ascontiguousarray(over.normal), np.ascontiguousarray(over.depth)
            water = water._replace(wet=images.wet, normal=normal, depth=depth, refraction=float(state.index))
        return water

    def _known(self, state: State, group: PointGroup) -> points.Known:
        known: points.Known = self._kernels.nothing_known()
        if group.known:
            priors = prior_rows(self._network, state, group.point, state.ground[group.point])
            weight = np.ascontiguousarray(priors.weight[:, :3])
            pull = weight * priors.deviation[:, :3]
            axes = np.ascontiguousarray(priors.axes)
            known = known._replace(axes=axes, free=priors.free, weight=weight, pull=pull)
        return known
