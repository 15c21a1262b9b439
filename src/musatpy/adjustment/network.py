"""The block as the adjustment sees it: working coordinates, weights, points by their rays, and global unknowns."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np

from musatpy.adjustment.normals import PARAMETERS
from musatpy.adjustment.sparse import Pattern
from musatpy.adjustment.wavy_water import WorkingSea
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.geodesy import Frame, frame_of
from musatpy.model import Block, Control, ObservationKind, PointStatus
from musatpy.model.tables import order_of

if TYPE_CHECKING:
    from musatpy.adjustment.iteration import WaterKnowledge
    from musatpy.adjustment.lenses import CameraLenses
    from musatpy.adjustment.parameters import Parameters
    from musatpy.adjustment.ports import CameraPorts

ORDER, BACK = [1, 2, 0], [2, 0, 1]  # of turned axes: north, up, east; where east, north, up are among them
_FEW = 2**12  # rays
RAYS = 2**14  # at a time: the arrays of one elimination stay within some megabytes


@dataclass(frozen=True, kw_only=True, eq=False)
class PointGroup:
    """k points with m rays each: `point` (k,) links to points, `rays` (k, m) links to measurements.

    The rays of a point stand in the order of the photos in the deck: consecutive rays make the conditions.
    """

    point: IntArray
    rays: IntArray
    kept: bool = False  # the points are not eliminated: their coordinates stand in the border
    known: bool = False  # something is known of the points beforehand, or they are tied to others
    counts: BoolArray | None = None  # (k, m) False: the ray only fills a row of `together`; None: all count

    def part(self, rows: slice | BoolArray | IntArray) -> Self:
        """Return some of the points."""
        counts = None if self.counts is None else self.counts[rows]
        return replace(self, point=self.point[rows], rays=self.rays[rows], counts=counts)

    def some(self, rows: BoolArray) -> list[Self]:
        """Return some of the points, as none or one group."""
        chosen = np.flatnonzero(rows)  # by numbers rows are found several times as fast as by a mask
        return [self.part(chosen)] if len(chosen) else []

    def weights(self, weight: FloatArray) -> FloatArray:
        """Return the weights (k, m, 2) of the rays, of those of all measurements (r, 2)."""
        own = weight.take(self.rays, axis=0)
        return own if self.counts is None else own * self.counts[..., None]


@dataclass(frozen=True, kw_only=True, eq=False)
class GroundPriors:
    """What is known of the p points beforehand, in level coordinates and east, north, up components."""

    given: FloatArray  # (p, 3) level coordinates, NaN where not given
    known: BoolArray  # (p, 3) east, north, up is known
    held: BoolArray  # (p, 3) known without error
    weight: FloatArray  # (p, 3) 1/m2, 0 where unknown or held
    group: IntArray  # (p,) equal elevation group, -1 for none
    group_weight: FloatArray  # (p,) 1/m2
    decorrelation: FloatArray | None = None  # (p, 3, 3) what has these weights, of east, north, up; None: these


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredTies:
    """The d observations of one kind that were measured between stations and kept points, and take part."""

    row: IntArray  # (d,) of the table of the block
    photo: IntArray  # (d, a)
    point: IntArray  # (d, b)
    value: FloatArray  # (d,), or (d, 3) of vectors
    weight: FloatArray  # likewise
    principal: FloatArray | None = None  # (d, 3, 3) from the components of the table to these; None: they are these

    def on_card(self, row: int, error: FloatArray) -> FloatArray:
        """Return errors of a row of the table in its components, of those of all its independent ones."""
        if self.principal is None or row not in self.row or len(error) != self.principal.shape[1]:
            return error
        return error @ self.principal[self.row == row][0]


_NONE, _NO_ENDS = np.zeros(0, dtype=np.int64), np.zeros((0, 0), dtype=np.int64)
NOTHING = MeasuredTies(row=_NONE, photo=_NO_ENDS, point=_NO_ENDS, value=np.zeros(0), weight=np.zeros(0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Border:
    """The global unknowns: those of each kind, in the order of `kinds.UNKNOWNS`, then the kept points."""

    columns: Mapping[ObservationKind, tuple[str, ...]]  # the names of the unknowns of each kind
    kept: IntArray  # (c,) points that are not eliminated, three columns each: east, north, up

    @property
    def size(self) -> int:
        """Number of global unknowns g."""
        return self.first_kept + 3 * len(self.kept)

    @property
    def first_kept(self) -> int:
        """Column of the first coordinate of the first kept point."""
        return sum(len(names) for names in self.columns.values())

    def count(self, kind: ObservationKind) -> int:
        """Return the number of unknowns of a kind."""
        return len(self.columns[kind])

    def at(self, kind: ObservationKind) -> slice:
        """Return the columns of the unknowns of a kind."""
        first = sum(len(names) for each, names in self.columns.items() if each < kind)
        return slice(first, first + self.count(kind))

    def numbers(self, kind: ObservationKind) -> IntArray:
        """Return the same as numbers."""
        return np.arange(self.first_kept)[self.at(kind)]

    def having(self, kind: ObservationKind, names: tuple[str, ...]) -> Self:
        """Return the border with other unknowns of a kind."""
        return replace(self, columns={**self.columns, kind: names})

    def kept_columns(self, point: IntArray) -> IntArray:
        """Return the columns (..., 3) of kept points (...)."""
        return self.first_kept + 3 * np.searchsorted(self.kept, point)[..., None] + np.arange(3)

    def names(self, point_ids: list[str]) -> list[str]:
        """Return a name for every global unknown."""
        return [
            *(name for names in self.columns.values() for name in names),
            *(f"point {point_ids[point]} {axis}" for point in self.kept for axis in ("east", "north", "up")),
        ]


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
    parameters: Mapping[ObservationKind, Parameters]  # further unknowns: of lenses, and the like
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
    left_out: tuple[PointGroup, ...]  # points that took no part and have a position, with all their rays
    measured: Mapping[ObservationKind, MeasuredTies]
    pattern: Pattern  # which photos meet in the normal equations, or in a point to be intersected
    turned: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=bool))  # (n,) or (0,): see `iteration`
    # what was gathered of the points once, by its class, for all networks of the same points and rays
    gathered: dict[type, Any] = field(default_factory=dict, repr=False)

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

    @property
    def lenses(self) -> CameraLenses | None:
        """The lenses that have unknown parameters, None where cameras are held."""
        return cast("CameraLenses | None", self.parameters.get(ObservationKind.LENS))

    @property
    def ports(self) -> CameraPorts | None:
        """The ports of cameras, known or not; None where no camera has any."""
        return cast("CameraPorts | None", self.parameters.get(ObservationKind.PORT))

    def with_parameters(self, known: Mapping[ObservationKind, Parameters]) -> Self:
        """Return the network with others of its further unknowns."""
        return replace(self, parameters={**self.parameters, **known})

    def unknown(self, kind: ObservationKind) -> bool:
        """Return whether there are unknowns of a kind, in the border or with those of photos."""
        return self.border.count(kind) > 0 or (kind is ObservationKind.WATER_LEVEL and self.water.per_photo)

    def unknowns(self, group: PointGroup, columns: IntArray) -> IntArray:
        """Return the unknowns (k, m q + X) of the photos of points, and in the `columns` (k, X) of the border."""
        return np.concatenate([self.pattern.rows(self.photo[group.rays]), self.pattern.order + columns], axis=1)

    def slope(self, tilt: FloatArray) -> FloatArray:
        """Return the slope vector (3,) of the water surface in working axes."""
        return tilt @ self.tilt_axes

    def with_known_waves(self, waves: FloatArray | None = None) -> Self:
        """Return the network with its waves known, as they were given or with parameters (k, 4)."""
        if self.sea is None:
            return self
        sea = self.sea if waves is None else self.sea.at(waves)
        return replace(self, sea=sea.known, border=self.border.having(ObservationKind.WAVE, ()))

    def apart(
        self, groups: Sequence[PointGroup], xy: FloatArray, refracted: BoolArray
    ) -> tuple[Self, list[PointGroup]]:
        """Return a network of the points of groups alone, numbered one after the other, and these groups in it.

        Each point counts for itself with its own images xy (r, 2) and rays that are `refracted` (r,), those of its
        group, so that one can be there more than once.
        """
        point = np.concatenate([group.point for group in groups])
        rays = np.concatenate([group.rays.reshape(-1) for group in groups])
        of_ray, every = np.empty(len(rays), dtype=int), []
        points = measured = 0
        for group in groups:
            k, m = group.rays.shape
            row = np.arange(points, points + k)
            of_ray[measured : measured + k * m] = np.repeat(row, m)
            every.append(replace(group, point=row, rays=np.arange(measured, measured + k * m).reshape(k, m)))
            points, measured = points + k, measured + k * m
        priors = {one.name: getattr(self.priors, one.name) for one in fields(self.priors)}
        priors = {name: column if column is None else column[point] for name, column in priors.items()}
        alone = replace(
            self,
            photo=self.photo[rays],
            point=of_ray,
            xy=xy,
            weight=self.weight[rays],
            refracted=refracted,
            priors=replace(self.priors, **priors),
            pass_groups=tuple(group for group in every if not group.known),
            control_groups=tuple(group for group in every if group.known),
            kept_groups=(),
            left_out=(),
            gathered={},
        )
        return alone, every

    def with_unknown_points(self) -> Self:
        """Return the network as if nothing were known of its points."""
        nothing = np.zeros_like(self.priors.known)
        return replace(self, priors=replace(self.priors, known=nothing, held=nothing))

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
    """Return the working frame of a job. Raises `SystemsError` where its ellipsoid is unknown."""
    return frame_of(block.options.system, block.ellipsoid, block.photos.position)


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


def group_points(photo: IntArray, point: IntArray, used: BoolArray, selected: BoolArray) -> tuple[PointGroup, ...]:
    """Return the selected points with their used rays, grouped by the number of rays."""
    rays = np.flatnonzero(used & selected[point])
    key = point[rays] * (photo.max(initial=0) + 1) + photo[rays]  # by points, then photos, then rows
    rays = rays[order_of(key)]
    of_ray = point[rays]
    start = np.flatnonzero(np.append(True, of_ray[1:] != of_ray[:-1])[: len(rays)])
    members, count = of_ray[start], np.diff(start, append=len(rays))
    groups = []
    for m in np.flatnonzero(np.bincount(count)).tolist():
        chosen = np.flatnonzero(count == m)
        groups.append(PointGroup(point=members[chosen], rays=rays[start[chosen][:, None] + np.arange(m)]))
    return tuple(groups)


def together(groups: Sequence[PointGroup]) -> tuple[PointGroup, ...]:
    """Return the eliminated points of groups in one, short rows filled with their last rays; many as they are.

    For what takes points by themselves: of few of them a call takes longer than what it computes.
    """
    some = [group for group in groups if not group.kept]
    longest = max((group.rays.shape[1] for group in some), default=0)
    if len(some) < 2 or longest * sum(len(group.point) for group in some) > _FEW:
        return tuple(groups)
    ray = np.arange(longest)
    counts = [np.broadcast_to(ray < group.rays.shape[1], (len(group.point), longest)) for group in some]
    one = PointGroup(
        point=np.concatenate([group.point for group in some]),
        rays=np.concatenate([group.rays[:, np.minimum(ray, group.rays.shape[1] - 1)] for group in some]),
        known=any(group.known for group in some),
        counts=np.concatenate(counts),
    )
    return one, *(group for group in groups if group.kept)


def parts_of(groups: Iterable[PointGroup], rays: int) -> tuple[PointGroup, ...]:
    """Return groups of points in parts of at most so many rays."""
    parts = []
    for group in groups:
        size = max(1, rays // group.rays.shape[1])
        parts += [group.part(slice(start, start + size)) for start in range(0, len(group.point), size)]
    return tuple(parts)


def first_rows(point: IntArray, points: int) -> IntArray:
    """Return (p,) the first row of a table that names each point, -1 for none."""
    row = np.full(points, -1)
    row[point[::-1]] = np.arange(len(point))[::-1]
    return row


def inverse_squares(sigma: FloatArray) -> FloatArray:
    """Return weights 1/sigma^2, 0 where there is no sigma."""
    weight: FloatArray = 1.0 / np.square(sigma)
    weight[np.isnan(weight)] = 0.0
    return weight


def decorrelated(control: Control) -> tuple[FloatArray, FloatArray]:
    """Return unit triangles T (k, 3, 3) and weights (k, 3) of the known components: C^-1 = T' diag(weights) T.

    With C = L L', T = diag(L) L^-1: east as it is, north less what east predicts of it, up less what both predict.
    So up alone has a row of its own, and what it would be without its observation has the other two.
    """
    together = control.known[:, :, None] & control.known[:, None, :]
    L = np.linalg.cholesky(np.where(together & control.correlated[:, None, None], control.covariance, np.eye(3)))
    size = np.diagonal(L, axis1=1, axis2=2)
    return size[:, :, None] * np.linalg.inv(L), 1.0 / np.square(size)


def unknown_name(network: Network, block: Block) -> Callable[[int], str]:
    """Return what names the unknowns of the normal equations of a block."""
    q, split, photos = network.pattern.size, network.pattern.order, block.photos.ids.tolist()
    rest = network.border.names(block.points.ids.tolist())

    def name(unknown: int) -> str:
        if unknown < split:
            return f"photo {photos[unknown // q]} {PARAMETERS[unknown % q]}"
        return rest[unknown - split]

    return name


def kept_axes(network: Network, ground: FloatArray) -> FloatArray:
    """Return the axes (..., 3, 3) along which the coordinates of kept points (..., 3) are unknown."""
    axes = np.asarray(network.frame.axes(ground.reshape(-1, 3))) if ground.size else np.zeros(0)
    return axes.reshape(*ground.shape, 3)
