"""The block as the adjustment sees it: working coordinates, weights, and points sorted by their number of rays."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from musatpy.adjustment.border import Border
from musatpy.adjustment.sea import Sea, WorkingSea, wave_names
from musatpy.adjustment.sparse import Pattern
from musatpy.adjustment.water import WaterKnowledge, water_knowledge
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import AdjustmentError, Problem
from musatpy.geometry.frames import Frame, GeocentricFrame, GeographicFrame, LocalFrame
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import Block, CoordinateSystem, PointStatus, Program


@dataclass(frozen=True, kw_only=True, eq=False)
class PointGroup:
    """k points with m rays each: `point` (k,) links to points, `rays` (k, m) links to measurements.

    The rays of a point stand in the order of the photos in the deck: consecutive rays make the conditions.
    """

    point: IntArray
    rays: IntArray
    kept: bool = False  # the points are not eliminated: their coordinates stand in the border
    known: bool = False  # something is known of the points beforehand, or they are tied to others

    def part(self, rows: slice | BoolArray) -> Self:
        """Return some of the points."""
        return replace(self, point=self.point[rows], rays=self.rays[rows])


@dataclass(frozen=True, kw_only=True, eq=False)
class GroundPriors:
    """What is known of the p points beforehand, in level coordinates and east, north, up components."""

    given: FloatArray  # (p, 3) level coordinates, NaN where not given
    known: BoolArray  # (p, 3) east, north, up is known
    held: BoolArray  # (p, 3) known without error
    weight: FloatArray  # (p, 3) 1/m2, 0 where unknown or held
    group: IntArray  # (p,) equal elevation group, -1 for none
    group_weight: FloatArray  # (p,) 1/m2


@dataclass(frozen=True, kw_only=True, eq=False)
class Ties:
    """Measured distances and height differences between kept points, by their numbers in `Border.kept`."""

    distance: IntArray  # (d, 2)
    length: FloatArray  # (d,) m
    length_weight: FloatArray  # (d,) 1/m2
    rise: IntArray  # (h, 2)
    difference: FloatArray  # (h,) m, second minus first
    difference_weight: FloatArray  # (h,) 1/m2


@dataclass(frozen=True, kw_only=True, eq=False)
class Network:
    """All that stays as it is during one triangulation.

    n photos, m measurements, p points, g levels. Weights are 1/sigma^2, 0 where nothing was observed.
    """

    frame: Frame
    position: FloatArray  # (n, 3) given stations, working
    attitude: FloatArray  # (n, 3) given attitudes in `axes`
    axes: FloatArray  # (n, 3, 3) east, north, up at the given stations
    position_weight: FloatArray  # (n, 3) along axes
    attitude_weight: FloatArray  # (n, 3)
    focal_length: FloatArray  # (n,) mm
    principal_point: FloatArray  # (n, 2) mm
    water: WaterKnowledge
    sea: WorkingSea | None  # waves on it
    tilt_axes: (
        FloatArray  # (2, 3) east and north in the middle of the block: the tilts of the water are slopes there
    )
    photo: IntArray  # (m,)
    point: IntArray  # (m,)
    xy: FloatArray  # (m, 2) mm, measured, or corrected by WATPT
    weight: FloatArray  # (m, 2) 1/mm2
    refracted: BoolArray  # (m,) the ray is refracted in the conditions themselves, on whichever side of the water
    priors: GroundPriors
    border: Border
    pass_groups: tuple[
        PointGroup, ...
    ]  # points of which nothing is known; in IIA by coplanarity and scale restraint
    control_groups: tuple[PointGroup, ...]  # points with control, or of a group; enter by collinearity
    kept_groups: tuple[PointGroup, ...]  # the points of `border.kept`, which are not eliminated (IIIA)
    base_photo: IntArray  # (b, 2)
    base_length: FloatArray  # (b,) m
    base_weight: FloatArray  # (b,) 1/m2
    ties: Ties
    pattern: Pattern  # which photos meet in the normal equations, or in a point to be intersected

    @property
    def photos(self) -> int:
        """Number of photos n."""
        return len(self.position)

    @property
    def points(self) -> int:
        """Number of points p."""
        return len(self.priors.given)

    @property
    def groups(self) -> tuple[PointGroup, ...]:
        """All points of the solution."""
        return (*self.pass_groups, *self.control_groups, *self.kept_groups)

    def parts(self, rays: int) -> tuple[PointGroup, ...]:
        """Return all points of the solution, in parts of at most so many rays."""
        parts = []
        for group in self.groups:
            size = max(1, rays // group.rays.shape[1])
            parts += [group.part(slice(start, start + size)) for start in range(0, len(group.point), size)]
        return tuple(parts)

    def slope(self, tilt: FloatArray) -> FloatArray:
        """Return the slope vector (3,) of the water surface in working axes."""
        return tilt @ self.tilt_axes

    def with_waves_as_given(self) -> Self:
        """Return the network with its waves known as they were given."""
        if self.sea is None:
            return self
        return replace(self, sea=self.sea.known, border=replace(self.border, waves=()))

    def with_plates(self, xy: FloatArray, refracted: BoolArray) -> Self:
        """Return the network with other plate coordinates and other refracted rays."""
        return replace(self, xy=xy, refracted=refracted)

    def with_heights_held(self, height: FloatArray) -> Self:
        """Return the network with points held at heights (p,), NaN for those that are not, as fixed control is."""
        at = np.isfinite(height)
        if not at.any():
            return self
        given, known, held = self.priors.given.copy(), self.priors.known.copy(), self.priors.held.copy()
        given[at, 2], known[at, 2], held[at, 2] = height[at], True, True
        weight = np.where(held, 0.0, self.priors.weight)
        loose = [group.part(~at[group.point]) for group in self.pass_groups]
        bound = [replace(group.part(at[group.point]), known=True) for group in self.pass_groups]
        return replace(
            self,
            priors=replace(self.priors, given=given, known=known, held=held, weight=weight),
            pass_groups=tuple(group for group in loose if len(group.point)),
            control_groups=(*self.control_groups, *(group for group in bound if len(group.point))),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Participation:
    """Who takes part: (m,) measurements used, (p,) status of the points, and why a point is left out."""

    used: BoolArray
    status: IntArray
    reasons: dict[int, str]


def job_frame(block: Block) -> Frame:
    """Return the working frame of a job. Raises `AdjustmentError` where its ellipsoid is unknown."""
    system = block.options.system
    stations = block.photos.position
    if system is CoordinateSystem.LOCAL:
        return LocalFrame(_origin(stations))
    spec = block.ellipsoid
    if spec is None:
        raise AdjustmentError([Problem(message=f"a {system} job needs an ellipsoid")])
    try:
        ellipsoid = Ellipsoid.of(spec)
    except ValueError as error:
        raise AdjustmentError([Problem(message=str(error))]) from error
    if system is CoordinateSystem.GEOCENTRIC:
        return GeocentricFrame(_origin(stations), ellipsoid)
    return GeographicFrame(_origin(ellipsoid.geocentric(stations)), ellipsoid)


def _origin(positions: FloatArray) -> FloatArray:
    return np.rint(positions.mean(axis=0))


def participation(block: Block) -> Participation:
    """Decide which points and measurements enter the solution, by their flags, rays and control alone."""
    plates, p = block.plates, len(block.points.ids)
    flagged_in = np.bincount(plates.point[plates.triangulated], minlength=p)
    rays = np.bincount(plates.point, minlength=p)
    supported = np.zeros(p, dtype=bool)
    supported[block.control.point[block.control.known.any(axis=1)]] = True
    supported[block.equal_elevations.point] = True
    enters = (flagged_in >= 2) | (supported & (flagged_in >= 1))
    status = np.where(enters, PointStatus.TRIANGULATED, PointStatus.NOT_DETERMINED)
    status[~enters & (rays >= 2)] = PointStatus.INTERSECTED
    reasons = {}
    for i in np.flatnonzero(~enters):
        if rays[i] == 0:
            reasons[int(i)] = "not measured on any photo"
        elif rays[i] == 1:
            reasons[int(i)] = "measured on one photo only, and without control"
        elif flagged_in[i] == 1:
            reasons[int(i)] = "kept out: only one of its rays is not flagged N"
        else:
            reasons[int(i)] = "kept out by its flags"
    return Participation(used=plates.triangulated & enters[plates.point], status=status, reasons=reasons)


def build_network(block: Block, frame: Frame, part: Participation, sea: Sea | None = None) -> Network:
    """Return the network of a block, with the measured plate coordinates and straight rays."""
    photos, plates, bases = block.photos, block.plates, block.air_bases
    position = frame.working(photos.position)
    priors = _ground_priors(block, frame, part.status == PointStatus.TRIANGULATED)
    by_collinearity = priors.known.any(axis=1) | (priors.group >= 0)
    enters = part.status == PointStatus.TRIANGULATED
    kept, ties = _ties(block, enters)
    eliminated = enters.copy()
    eliminated[kept] = False
    pass_groups = group_points(plates.photo, plates.point, part.used, eliminated & ~by_collinearity)
    control_groups = tuple(
        replace(group, known=True)
        for group in group_points(plates.photo, plates.point, part.used, eliminated & by_collinearity)
    )
    left_out = group_points(
        plates.photo, plates.point, np.ones_like(part.used), part.status == PointStatus.INTERSECTED
    )
    together = [plates.photo[group.rays] for group in (*pass_groups, *control_groups, *left_out)]
    water = water_knowledge(block)
    return Network(
        frame=frame,
        position=position,
        attitude=photos.attitude,
        axes=frame.axes(position),
        position_weight=inverse_squares(photos.position_sigma),
        attitude_weight=inverse_squares(photos.attitude_sigma),
        focal_length=block.cameras.focal_length[photos.camera],
        principal_point=block.cameras.principal_point[photos.camera],
        water=water,
        sea=None if sea is None else WorkingSea.of(sea, frame),
        tilt_axes=np.asarray(frame.axes(np.zeros(3)))[:2],
        photo=plates.photo,
        point=plates.point,
        xy=plates.xy,
        weight=inverse_squares(plate_sigmas(block)),
        refracted=np.zeros(len(plates.photo), dtype=bool),
        priors=priors,
        border=Border(
            levels=len(block.equal_elevations.ids),
            waters=0 if water.per_photo else len(water.ids),
            tilts=2 if water.tilt_unknown else 0,
            indices=int(water.index_unknown),
            waves=() if sea is None else wave_names(sea),
            kept=kept,
        ),
        pass_groups=pass_groups,
        control_groups=control_groups,
        kept_groups=tuple(
            replace(group, kept=True, known=True)
            for group in group_points(plates.photo, plates.point, part.used, enters & ~eliminated)
        ),
        base_photo=bases.photo,
        base_length=bases.length,
        base_weight=inverse_squares(bases.sigma),
        ties=ties,
        pattern=Pattern.of(len(photos.ids), 7 if water.per_photo else 6, [*together, bases.photo]),
    )


def plate_sigmas(block: Block) -> FloatArray:
    """Return the sigmas (m, 2) mm of plate coordinates: the card's or the job's, times the submerged factor."""
    plates, options = block.plates, block.options
    sigma = np.where(np.isnan(plates.sigma), options.plate_sigma, plates.sigma)
    submerged = block.points.bathymetric[plates.point]
    return np.where(submerged[:, None], options.submerged_factor, 1.0) * sigma


def _ties(block: Block, enters: BoolArray) -> tuple[IntArray, Ties]:
    """Return the points (c,) that stay among the unknowns, and what was measured between them; nothing in IIA."""
    simultaneous = block.options.program is Program.IIIA
    distances, heights = block.distances, block.height_differences
    used = enters[distances.point].all(axis=1) & simultaneous
    rising = enters[heights.point].all(axis=1) & simultaneous
    ends = np.concatenate([distances.point[used].reshape(-1), heights.point[rising].reshape(-1)])
    kept = np.unique(ends)
    return kept, Ties(
        distance=np.searchsorted(kept, distances.point[used]),
        length=distances.length[used],
        length_weight=inverse_squares(distances.sigma[used]),
        rise=np.searchsorted(kept, heights.point[rising]),
        difference=heights.difference[rising],
        difference_weight=inverse_squares(heights.sigma[rising]),
    )


def group_points(photo: IntArray, point: IntArray, used: BoolArray, selected: BoolArray) -> tuple[PointGroup, ...]:
    """Return the selected points with their used rays, grouped by the number of rays."""
    rays = np.flatnonzero(used & selected[point])
    rays = rays[np.lexsort((photo[rays], point[rays]))]
    members, start, count = np.unique(point[rays], return_index=True, return_counts=True)
    groups = []
    for m in np.unique(count):
        chosen = count == m
        groups.append(PointGroup(point=members[chosen], rays=rays[start[chosen][:, None] + np.arange(m)[None, :]]))
    return tuple(groups)


def inverse_squares(sigma: FloatArray) -> FloatArray:
    """Return weights 1/sigma^2, 0 where there is no sigma."""
    return np.where(np.isnan(sigma), 0.0, 1.0 / np.square(np.where(np.isnan(sigma), 1.0, sigma)))


def _ground_priors(block: Block, frame: Frame, enters: BoolArray) -> GroundPriors:
    control, groups, p = block.control, block.equal_elevations, len(block.points.ids)
    given = np.full((p, 3), np.nan)
    given[control.point] = _level_coordinates(block, frame)
    known = np.zeros((p, 3), dtype=bool)
    known[control.point] = control.known & enters[control.point][:, None]
    held = np.zeros((p, 3), dtype=bool)
    held[control.point] = known[control.point] & control.fixed[:, None]
    weight = np.zeros((p, 3))
    weight[control.point] = inverse_squares(control.sigma)
    group, group_weight = np.full(p, -1), np.zeros(p)
    member = enters[groups.point]
    group[groups.point[member]] = groups.group[member]
    group_weight[groups.point[member]] = inverse_squares(groups.sigma)[groups.group[member]]
    return GroundPriors(
        given=given,
        known=known,
        held=held,
        weight=np.where(known & ~held, weight, 0.0),
        group=group,
        group_weight=group_weight,
    )


def _level_coordinates(block: Block, frame: Frame) -> FloatArray:
    """Return control in level coordinates (k, 3); geocentric control must be complete to have any."""
    position = block.control.position
    if block.options.system is CoordinateSystem.GEOCENTRIC:
        level = np.full(position.shape, np.nan)
        complete = ~np.isnan(position).any(axis=1)
        level[complete] = frame.level(frame.working(position[complete]))
        return level
    return position
