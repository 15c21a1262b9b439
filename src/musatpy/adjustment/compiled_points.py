"""The points of a network that compiled kernels eliminate: what these take, out of network and state."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from musatpy.adjustment.dependence import Diagonal
from musatpy.adjustment.ground import RIDGE, Priors, hold, prior_rows
from musatpy.adjustment.kernels import compiled_points
from musatpy.adjustment.kinds import WATER
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.normals import Cofactors, NormalEquations
from musatpy.adjustment.reliability import Part
from musatpy.adjustment.sequence import Part as SequencePart
from musatpy.adjustment.sequence import PointSequence
from musatpy.adjustment.threads import side_by_side
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.water_surface import surface
from musatpy.arrays import FloatArray, IntArray
from musatpy.model import ObservationKind

if TYPE_CHECKING:
    from musatpy.adjustment.kernels import points

Result = TypeVar("Result")

_LIGHT = 25  # times the rays repay threads where only their images are asked for, which takes 10 ns each


def split(network: Network, groups: Iterable[PointGroup]) -> tuple[tuple[PointGroup, ...], tuple[PointGroup, ...]]:
    """Return the points of groups that have no unknowns but their own and those of their photos, and others.

    Others are kept points, those of equal elevations, and all with a wet ray through waves, or where the border has
    unknowns of the water.
    """
    border = network.border
    unknown = network.sea is not None or any(len(border.numbers(kind.observed)) for kind in WATER)
    plain, others = [], []
    for group in groups:
        if group.kept or (group.known and border.count(ObservationKind.EQUAL_ELEVATION)):
            others.append(group)
        elif unknown:
            wet = np.asarray(network.refracted[group.rays].any(axis=1))
            plain += group.some(~wet)
            others += group.some(wet)
        else:
            plain.append(group)
    return tuple(plain), tuple(others)


def plain(array: FloatArray) -> FloatArray:
    """Return an array as kernels are compiled for: in the order of C, and writable."""
    flags = array.flags
    return array if flags.c_contiguous and flags.writeable else np.array(array, order="C")


def stations_of(kernels: ModuleType, network: Network, state: State) -> points.Stations:
    """Return the photos of a network where they are."""
    kappa = state.attitude[:, 2]
    turn = np.stack([np.cos(kappa), np.sin(kappa)], axis=1)
    arrays = (state.position, state.M, network.axes, turn, network.focal_length, network.principal_point)
    stations: points.Stations = kernels.Stations(*(plain(array) for array in arrays))
    return stations


@dataclass(frozen=True, kw_only=True, eq=False)
class Spread:
    """Cofactors of k points (k, 3, 3) along east, north, up, and those of their images."""

    point: IntArray
    points: FloatArray
    images: Part


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledRows:
    """Some groups of points of a network, as rows of its sequence, in parts for threads."""

    kernels: ModuleType
    network: Network
    groups: tuple[PointGroup, ...]

    @cached_property
    def sequence(self) -> PointSequence:
        """All points of the network that are eliminated."""
        return self.network.sequence(self.kernels)

    @cached_property
    def rows(self) -> IntArray:
        """The rows (j,) of the points of the groups."""
        return self.sequence.chosen(self.groups)[0]

    @cached_property
    def parts(self) -> list[SequencePart]:
        """The rows in parts."""
        return self.sequence.chosen(self.groups)[1]

    def of_parts(self, work: Callable[[SequencePart], Result], light: int = 1) -> list[Result]:
        """Return the results of `work` at all parts, in their order; `light`: times less than an elimination."""
        return list(side_by_side(work, self.parts, len(self.sequence.rays) // light))

    def seen(self, state: State) -> tuple[points.Measured, points.Stations, points.Water]:
        """Return images, stations and water in a state; not to be changed: what was asked for last is kept.

        Each step is judged where it leads, and the next one begins there.
        """
        network = self.network
        return self.sequence.last_seen.made(
            lambda: (self.measured(state.ground), self.stations(state), self.water(state, state.ground)),
            *(network.xy, network.weight, network.refracted, network.water, network.axes),
            *(network.focal_length, network.principal_point),
            *(state.position, state.attitude, state.ground, state.tide, state.tilt, state.index),
        )

    def measured(self, ground: FloatArray) -> points.Measured:
        """Return the images of the points of the sequence, which are at `ground` (p, 3)."""
        xy, root = self.sequence.images(self.network.xy, self.network.weight)
        at: points.Measured = self.kernels.Measured(
            point=self.sequence.point,
            start=self.sequence.start,
            photo=self.sequence.photo,
            xy=xy,
            root=root,
            ground=ground.take(self.sequence.point, axis=0),
        )
        return at

    def stations(self, state: State) -> points.Stations:
        """Return the photos where they are; not to be changed, as what is `seen`."""
        return self.sequence.last_stations.made(
            lambda: stations_of(self.kernels, self.network, state),
            *(self.network.axes, self.network.focal_length, self.network.principal_point),
            *(state.position, state.attitude),
        )

    def water(self, state: State, ground: FloatArray) -> points.Water:
        """Return the level water over points that are at `ground` (p, 3)."""
        network = self.network
        wet, point, row = self.sequence.wet(network.refracted, network.point)
        tide = state.tide.take(self.sequence.photo.take(wet))
        over = surface(network.frame, network.slope(state.tilt), tide, ground.take(point, axis=0))
        water: points.Water = self.kernels.Water(
            row=row,
            normal=plain(over.normal),
            depth=plain(over.depth),
            tangent=np.full(len(wet), np.nan),
            rise=np.append(1.0 / over.secant, 0.0) if network.water.per_photo else np.zeros(0),
            refraction=float(state.index),
        )
        return water

    @cached_property
    def known_rows(self) -> IntArray:
        """The rows of points of which something is known."""
        return self.sequence.chosen(group for group in self.groups if group.known)[0]

    def priors(self, state: State) -> Priors:
        """Return what is known of the points of `known_rows` in a state; not to be changed, as what is `seen`."""
        return self.sequence.last_priors.made(
            lambda: self._priors_at(state, state.ground),
            self.known_rows,
            self.network.priors,
            state.ground,
            state.levels,
        )

    def _priors_at(self, state: State, ground: FloatArray) -> Priors:
        point = self.sequence.point[self.known_rows]
        return prior_rows(self.network, state, point, ground[point])

    def known(self, state: State, ground: FloatArray) -> points.Known:
        """Return what is known of the points, which are at `ground` (p, 3)."""
        rows = self.known_rows
        row = np.full(len(self.sequence.point), -1)
        row[rows] = np.arange(len(rows))
        priors = self.priors(state) if ground is state.ground else self._priors_at(state, ground)
        weight = np.ascontiguousarray(priors.weight[:, :3])
        known: points.Known = self.kernels.Known(
            row=row,
            axes=plain(priors.axes),
            free=priors.free,
            weight=weight,
            pull=weight * priors.deviation[:, :3],
        )
        return known

    def add(
        self, normals: NormalEquations, matrix: bool, work: Callable[[SequencePart, points.Sums], Result]
    ) -> list[Result]:
        """Let `work` add the parts to the normal equations, each to sums of its own; return its results.

        Without `matrix` it adds to the right sides only.
        """
        blocks, rhs = normals.sums

        def added(part: SequencePart) -> tuple[points.Sums, Result]:
            if part is self.parts[0]:
                sums = self.kernels.Sums(first=0, blocks=blocks, rhs=rhs)
            else:
                own = np.zeros((part.last - part.first if matrix else 0, *blocks.shape[1:]))
                sums = self.kernels.Sums(first=part.first, blocks=own, rhs=np.zeros_like(rhs))
            return sums, work(part, sums)

        results = []
        for part, (sums, result) in zip(self.parts, self.of_parts(added), strict=True):
            if part is not self.parts[0]:
                if matrix:
                    blocks[part.first : part.last] += sums.blocks
                rhs += sums.rhs
            results.append(result)
        return results


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledFollow:
    """How the points follow a step: what is left of their elimination at `state`."""

    rows: CompiledRows
    eliminated: points.Eliminated
    stations: points.Stations
    at: points.Measured
    water: points.Water
    known: points.Known

    def move(self, network: Network, state: State, step: FloatArray, ground: FloatArray) -> None:
        """Set the points of `ground` (p, 3) where they are after a step (u,) of all unknowns from `state`."""
        kernels, sequence = self.rows.kernels, self.rows.sequence
        stations = step[: network.pattern.order].reshape(network.photos, -1)
        self.rows.of_parts(
            lambda part: kernels.follow(
                part.rows, self.at, self.stations, self.water, self.known, self.eliminated, stations, ground
            )
        )
        known = sequence.point[self.rows.known_rows]
        ground[known] = hold(network, known, ground[known])


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledPoints(CompiledRows):
    """The points of a network that compiled kernels eliminate, and the `others`."""

    others: tuple[PointGroup, ...]

    @classmethod
    def of(cls, network: Network, groups: Iterable[PointGroup]) -> CompiledPoints | None:
        """Return those of groups of a network, None where numpy does all."""
        kernels = compiled_points(network.photos)
        if kernels is None:
            return None
        plain, others = split(network, groups)
        return cls(kernels=kernels, network=network, groups=plain, others=others)

    def add_eliminated(
        self, state: State, normals: NormalEquations, matrix: bool = True
    ) -> tuple[CompiledFollow, float]:
        """Add the points to the normal equations; return how they follow a step, and r' N_pp^-1 r of all.

        Without `matrix` to the right sides only.
        """
        (at, stations, water), known = self.seen(state), self.known(state, state.ground)
        k = len(self.sequence.point)
        out = self.kernels.Eliminated(shift=np.empty((k, 3)), inverse=np.empty((k, 3, 3)))

        def work(part: SequencePart, sums: points.Sums) -> float:
            gain: float = self.kernels.eliminate(
                part.rows, at, stations, water, known, RIDGE, self.sequence.pairs, matrix, sums, out
            )
            return gain

        gain = sum(self.add(normals, matrix, work))
        follow = CompiledFollow(rows=self, eliminated=out, stations=stations, at=at, water=water, known=known)
        return follow, gain

    def set_reaches(self, state: State, out: FloatArray) -> None:
        """Set the squares (p,) m2 of how far the points can move upward by their largest weighted residuals."""
        (at, stations, water), known = self.seen(state), self.known(state, state.ground)
        up, point = np.empty_like(state.ground), self.sequence.point[self.rows]
        up[point] = self.network.frame.vertical(state.ground[point])[0]

        def work(rows: IntArray) -> None:
            self.kernels.reaches(rows, at, stations, water, known, RIDGE, up, out)

        # each point for itself: halves serve, where parts are too large for the few that are submerged
        deque(side_by_side(work, np.array_split(self.rows, 2), len(self.sequence.rays)), maxlen=0)

    def set_squares(self, state: State, squares: FloatArray) -> None:
        """Set the weighted squares (p,) of the points where they are."""
        at, stations, water = self.seen(state)
        self.of_parts(lambda part: self.kernels.squares(part.rows, at, stations, water, squares), _LIGHT)
        known, priors = self.sequence.point[self.known_rows], self.priors(state)
        squares[known] += np.einsum("ka,ka,ka->k", priors.deviation, priors.weight, priors.deviation)

    def set_residuals(self, state: State, residual: FloatArray) -> None:
        """Set the residuals (all measurements, 2) mm of the images of the points."""
        (at, stations, water), rays = self.seen(state), self.sequence.rays
        self.of_parts(lambda part: self.kernels.residuals(part.rows, at, stations, water, rays, residual), _LIGHT)

    @cached_property
    def _loose_rows(self) -> CompiledRows:
        return CompiledRows(kernels=self.kernels, network=self.network, groups=self.loose)

    @property
    def loose(self) -> tuple[PointGroup, ...]:
        """The groups of points of which nothing is known."""
        return tuple(group for group in self.groups if not group.known)

    @property
    def bound(self) -> tuple[PointGroup, ...]:
        """The groups of points of which something is known."""
        return tuple(group for group in self.groups if group.known)

    def spread(self, state: State, cofactors: Cofactors, residual: FloatArray, diagonal: Diagonal) -> Spread:
        """Return how errors spread to the points of which nothing is known, and to their images; add to `diagonal`.

        `residual` (all measurements, 2) mm.
        """
        from musatpy.adjustment.kernels import spreading  # numba is there

        network = self.network
        loose = self._loose_rows
        (at, stations, water), sequence = self.seen(state), self.sequence
        known = self.known(state, state.ground)
        taken = np.zeros(len(network.photo), dtype=bool)
        for group in loose.groups:
            taken[group.rays] = True
        rows, images, place = loose.rows, np.flatnonzero(taken), (np.cumsum(taken) - 1)[sequence.rays]
        axes, pairs = plain(network.frame.axes(state.ground[sequence.point])), sequence.pairs
        point = np.empty((len(sequence.point), 3, 3))
        image, covariance = np.empty((len(images), 2)), np.empty((len(images), 2, 3))

        def work(part: SequencePart) -> FloatArray:
            of_part = np.zeros_like(diagonal.stations)
            out = spreading.Spread(
                place=place, axes=axes, point=point, image=image, covariance=covariance, diagonal=of_part
            )
            spreading.spread(part.rows, at, stations, water, known, RIDGE, pairs, cofactors.blocks, out)
            return of_part

        for of_part in loose.of_parts(work):
            diagonal.stations += of_part
        part = Part(
            kind=ObservationKind.PLATE,
            row=np.repeat(images, 2),
            component=np.tile(np.arange(2), len(images)),
            residual=residual.take(images, axis=0).reshape(-1),
            weight=network.weight.take(images, axis=0).reshape(-1),
            cofactor=image.reshape(-1),
            covariance=covariance.reshape(-1, 3),
        )
        return Spread(point=sequence.point[rows], points=point.take(rows, axis=0), images=part)
