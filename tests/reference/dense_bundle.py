"""An independent simultaneous bundle adjustment of a block: dense, slow, and simple enough to be believed.

Every ground point, station, level and unknown of the water is an unknown; every residual is differentiated by
complex steps through the whole chain, refraction included; the normal system is solved by QR. It shares only the
model classes with the program, and the place where its tides hold. Frames: attitudes refer to the local vertical
frame of the given station position, which stays fixed. Water is tilted in local jobs only.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import qr, solve_triangular

from musatpy.geometry.geodesy import middle_of
from musatpy.model import Block, ControlKind, CoordinateSystem, Treatment, Water, WaterLevel
from reference.earth import Earth, earth_of
from reference.rays import angles_of, level_axes, rotation, sighted

_STEP = 1e-30  # complex step: no cancellation, so the smaller the better
_SETTLED = 1e-7  # whitened length of the last step: rounding of the residuals stands at about a tenth of it


@dataclass(frozen=True, kw_only=True)
class Start:
    """Where the iteration begins, in the job's system: at what a simulation knows, or another solution has."""

    position: np.ndarray  # (n, 3)
    attitude: np.ndarray  # (n, 3) in the frame of the given position
    points: np.ndarray  # (p, 3)
    tides: np.ndarray | None = None  # (t,) corrections of tides, m; None: nought


@dataclass(frozen=True, kw_only=True)
class State:
    """Current values: station increments in the given frames, ground parameters, levels, the water."""

    stations: np.ndarray  # (n, 6) east, north, up from the given position (m); omega, phi, kappa (rad)
    ground: np.ndarray  # (p, 3) ground parameters; of no meaning where the point is not determined
    levels: np.ndarray  # (g,) m
    tides: np.ndarray  # (t,) m, corrections
    tilt: np.ndarray  # (2,) rad, towards east and north
    index: float


@dataclass(frozen=True, kw_only=True)
class Result:
    """What `solve` returns: model shapes, a posteriori covariances, NaN where not determined."""

    position: np.ndarray  # (n, 3) in the job's system
    attitude: np.ndarray  # (n, 3) in the local vertical frame of the adjusted position
    covariance: np.ndarray  # (n, 6, 6) east north up omega phi kappa, frame held fixed
    points: np.ndarray  # (p, 3) in the job's system
    point_covariance: np.ndarray  # (p, 3, 3) east north up
    residual: np.ndarray  # (m, 2) mm, adjusted minus measured
    triangulated: np.ndarray  # (m,)
    levels: np.ndarray  # (g,)
    level_sigmas: np.ndarray  # (g,)
    water: dict[str, tuple[np.ndarray, np.ndarray]]  # tides, tilt, index, as far as unknown, with their sigmas
    sigma0: float
    degrees_of_freedom: int
    sum_of_squares: float
    observations: dict[str, int]
    unknowns: dict[str, int]


@dataclass(frozen=True, kw_only=True)
class Kind:
    """One kind of observation: rows that each depend on a few unknowns.

    `evaluate` takes increments (rows, k), complex, to the unknowns of `index` (rows, k; -1 is held fixed) and
    returns weighted misclosures (rows, c); `used` (rows, c) says which of them are observations.
    """

    name: str
    index: np.ndarray
    used: np.ndarray
    evaluate: Callable[[State, np.ndarray], np.ndarray]


class Network:
    """A block with what of it takes part: links, index numbers of the unknowns, kinds of observations."""

    def __init__(self, block: Block, *, refraction: bool) -> None:
        if len(block.distortion.camera) or len(block.fiducial_measurements.photo):
            raise ValueError("the reference takes refined plate coordinates only")
        self.block, self.refraction = block, refraction
        self.earth: Earth = earth_of(block)
        self.station_native = self.earth.native(block.photos.position)
        self.station_xyz = self.earth.cartesian(self.station_native)
        self.station_frame = np.array(self.earth.frame(self.station_native))
        self.determined = _determined(block)
        self.rows = np.flatnonzero(block.plates.triangulated & self.determined[block.plates.point])
        local = block.options.system == CoordinateSystem.LOCAL
        self.middle = middle_of(block.photos.position)[:2] if local else np.zeros(2)
        self.tide_group, self.tide_sigmas = _tide_groups(block)
        self._number_unknowns()
        kinds = [self._images(), self._control(), self._priors(), self._equal_elevations(), self._bases()]
        kinds += [*self._ties(), *self._water()]
        self.kinds = [kind for kind in kinds if kind.used.any()]

    def _number_unknowns(self) -> None:
        block = self.block
        n, p, g = len(block.photos.ids), len(block.points.ids), len(block.equal_elevations.ids)
        free = np.repeat(self.determined[:, None], 3, axis=1)
        held = block.control.known & block.control.fixed[:, None]
        free[block.control.point] &= ~held
        members = block.equal_elevations.group[self.determined[block.equal_elevations.point]]
        self.station_index = np.arange(6 * n).reshape(n, 6)
        self.ground_index = np.full((p, 3), -1)
        self.ground_index[free] = 6 * n + np.arange(free.sum())
        self.level_index = np.full(g, -1)
        used = np.isin(np.arange(g), members)
        self.level_index[used] = 6 * n + free.sum() + np.arange(used.sum())
        tilted, refracted = (
            mode is Treatment.ADJUST for mode in (block.options.water_tilt, block.options.water_index)
        )
        self.unknowns = {
            "stations": 6 * n,
            "points": int(free.sum()),
            "levels": int(used.sum()),
            "tides": len(self.tide_sigmas),
            "tilt": 2 * tilted,
            "index": 1 * refracted,
        }
        ends = np.cumsum([0, *self.unknowns.values()]).tolist()
        self.part = dict(zip(self.unknowns, map(slice, ends[:-1], ends[1:]), strict=True))
        self.size = ends[-1]
        self.tide_index, tilt, index = (
            np.arange(self.size)[self.part[name]] for name in ("tides", "tilt", "index")
        )
        self.tilt_index = tilt if tilted else np.full(2, -1)
        self.index_index = index if refracted else np.full(1, -1)

    def station(self, state: State, photo: np.ndarray, increments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rectangular coordinates and ground-to-photo rotations of stations, increments (rows, 6) applied."""
        values = state.stations[photo] + increments
        frame = self.station_frame[photo]
        xyz = self.station_xyz[photo] + np.einsum("rji,rj->ri", frame, values[:, :3])
        return xyz, rotation(values[:, 3:]) @ frame

    def project(
        self, state: State, photo: np.ndarray, point: np.ndarray, increments: np.ndarray, wet: np.ndarray
    ) -> np.ndarray:
        """(rows, 2) plate coordinates, mm; `wet` rows go through the water when they lie below it.

        Increments (rows, 13) of station, point, tide, tilts and index.
        """
        camera, matrix = self.station(state, photo, increments[:, :6])
        native = self.earth.shift(state.ground[point], increments[:, 6:9])
        target = self.earth.cartesian(native)
        if wet.any():
            slope = state.tilt + increments[:, 10:12]
            tide = self.block.photos.tide + np.append(state.tides, 0.0)[self.tide_group]
            water = tide[photo] + increments[:, 9] + np.sum((target[:, :2] - self.middle) * slope, axis=1)
            axes, length = level_axes(slope)
            axes = axes @ self.earth.frame(native)
            depth = np.where(wet, (water - native[:, 2]) / length, -1.0)
            local = np.einsum("rij,rj->ri", axes, camera - target)
            index = state.index + increments[:, 12]
            target = target + np.einsum("rji,rj->ri", axes, sighted(local, depth, index))
        u, v, w = np.moveaxis(np.einsum("rij,rj->ri", matrix, target - camera), -1, 0)
        cameras = self.block.cameras
        link = self.block.photos.camera[photo]
        f = cameras.focal_length[link]
        return cameras.principal_point[link] - np.stack([f * u / w, f * v / w], axis=-1)

    def wet(self, rows: np.ndarray) -> np.ndarray:
        """(rows,) True for measurements of bathymetric points when refraction is asked for."""
        return self.block.points.bathymetric[self.block.plates.point[rows]] & self.refraction

    def _images(self) -> Kind:
        rows, plates = self.rows, self.block.plates
        photo, point, wet = plates.photo[rows], plates.point[rows], self.wet(rows)
        if np.isnan(self.block.photos.tide[photo[wet]]).any():
            raise ValueError("a photo with submerged points has no tide")
        options = self.block.options
        sigma = np.where(np.isnan(plates.sigma), options.plate_sigma, plates.sigma)[rows]
        sigma = sigma * np.where(self.block.points.bathymetric[point], options.submerged_factor, 1.0)[:, None]
        tides = np.append(self.tide_index, -1)[self.tide_group[photo]]
        water = np.broadcast_to([*self.tilt_index, *self.index_index], (len(rows), 3))

        def evaluate(state: State, increments: np.ndarray) -> np.ndarray:
            return (self.project(state, photo, point, increments, wet) - plates.xy[rows]) / sigma

        index = np.hstack([self.station_index[photo], self.ground_index[point], tides[:, None], water])
        return Kind(name="plate", index=index, used=np.ones((len(rows), 2), dtype=bool), evaluate=evaluate)

    def _control(self) -> Kind:
        control, earth = self.block.control, self.earth
        vertical = control.kind == ControlKind.VERTICAL
        used = control.known & ~control.fixed[:, None] & self.determined[control.point][:, None]
        # The plumb line is perpendicular to east and north, so an unknown height does not matter there.
        filled = np.where(np.isnan(control.position), 0.0, control.position)
        native = earth.native(filled)
        reference, frame = earth.cartesian(native), np.array(earth.frame(native))
        root = np.tile(np.eye(3), (len(sigma := np.where(used, control.sigma, 1.0)), 1, 1)) / sigma[:, None]
        for row in np.flatnonzero(np.isfinite(control.correlation).all(axis=1) & used.any(axis=1)):
            # the symmetric root of the inverse of C, of the components that are known
            east_north, east_up, north_up = control.correlation[row]
            C = np.array([[1.0, east_north, east_up], [east_north, 1.0, north_up], [east_up, north_up, 1.0]])
            C *= np.outer(control.sigma[row], control.sigma[row])
            values, vectors = np.linalg.eigh(C[np.ix_(used[row], used[row])])
            root[row][np.ix_(used[row], used[row])] = vectors @ np.diag(values**-0.5) @ vectors.T

        def evaluate(state: State, increments: np.ndarray) -> np.ndarray:
            moved = earth.shift(state.ground[control.point], increments)
            enu = np.einsum("rij,rj->ri", frame, earth.cartesian(moved) - reference)
            enu[:, 2] = np.where(vertical, moved[:, 2] - native[:, 2], enu[:, 2])
            return np.einsum("rij,rj->ri", root, enu)

        return Kind(name="control", index=self.ground_index[control.point], used=used, evaluate=evaluate)

    def _priors(self) -> Kind:
        photos = self.block.photos
        sigma = np.hstack([photos.position_sigma, photos.attitude_sigma])
        given = np.hstack([np.zeros_like(photos.position), photos.attitude])
        used = ~np.isnan(sigma)
        sigma = np.where(used, sigma, 1.0)

        def evaluate(state: State, increments: np.ndarray) -> np.ndarray:
            difference = state.stations - given
            difference[:, 3:] -= 2.0 * np.pi * np.round(difference[:, 3:] / (2.0 * np.pi))
            return (difference + increments) / sigma

        return Kind(name="station", index=self.station_index, used=used, evaluate=evaluate)

    def _equal_elevations(self) -> Kind:
        equal = self.block.equal_elevations
        used = self.determined[equal.point][:, None]

        def evaluate(state: State, increments: np.ndarray) -> np.ndarray:
            height = self.earth.shift(state.ground[equal.point], increments[:, :3])[:, 2]
            return ((height - state.levels[equal.group] - increments[:, 3]) / equal.sigma[equal.group])[:, None]

        index = np.hstack([self.ground_index[equal.point], self.level_index[equal.group][:, None]])
        return Kind(name="equal elevation", index=index, used=used, evaluate=evaluate)

    def _bases(self) -> Kind:
        bases = self.block.air_bases

        def evaluate(state: State, increments: np.ndarray) -> np.ndarray:
            ends = [self.station(state, bases.photo[:, i], increments[:, 6 * i : 6 * i + 6])[0] for i in (0, 1)]
            length = np.sqrt(((ends[1] - ends[0]) ** 2).sum(axis=1))
            return ((length - bases.length) / bases.sigma)[:, None]

        index = self.station_index[bases.photo].reshape(-1, 12)
        return Kind(name="air base", index=index, used=np.ones((len(index), 1), dtype=bool), evaluate=evaluate)

    def _ties(self) -> Iterator[Kind]:
        """Distances and height differences of points."""
        block = self.block
        for name, table in (("length", block.distances), ("difference", block.height_differences)):

            def evaluate(state: State, increments: np.ndarray, name: str = name, table: Any = table) -> np.ndarray:
                a, b = (
                    self.earth.shift(state.ground[table.point[:, end]], increments[:, 3 * end : 3 * end + 3])
                    for end in (0, 1)
                )
                between = self.earth.cartesian(b) - self.earth.cartesian(a)
                found = np.sqrt((between**2).sum(axis=1)) if name == "length" else b[:, 2] - a[:, 2]
                return ((found - getattr(table, name)) / table.sigma)[:, None]

            index = self.ground_index[table.point].reshape(-1, 6)
            yield Kind(name=name, index=index, used=np.ones((len(index), 1), dtype=bool), evaluate=evaluate)

    def _water(self) -> Iterator[Kind]:
        """What is known beforehand of tides, tilts and index."""
        water = self.block.water or Water(index=1.340)
        tilt = np.array([water.tilt_east or 0.0, water.tilt_north or 0.0])
        for name, index, given, sigma in (
            ("tides", self.tide_index, np.zeros(len(self.tide_index)), self.tide_sigmas),
            ("tilt", self.tilt_index, tilt, np.full(2, water.tilt_sigma or np.inf)),
            ("index", self.index_index, np.array([water.index]), np.full(1, water.sigma or np.inf)),
        ):

            def evaluate(
                state: State, increments: np.ndarray, name: str = name, given: Any = given, sigma: Any = sigma
            ) -> np.ndarray:
                return (np.atleast_1d(getattr(state, name))[:, None] + increments - given[:, None]) / sigma[:, None]

            used = np.isfinite(sigma) & (index >= 0)
            yield Kind(name=name, index=index[:, None], used=used[:, None], evaluate=evaluate)

    def misclosures(self, state: State) -> np.ndarray:
        """All weighted misclosures (computed minus observed, over sigma)."""
        parts = [k.evaluate(state, np.zeros(k.index.shape))[k.used] for k in self.kinds]
        return np.concatenate(parts)

    def jacobian(self, state: State) -> np.ndarray:
        """Dense derivatives of the misclosures by all unknowns, each by a complex step."""
        blocks = []
        for kind in self.kinds:
            dense = np.zeros((*kind.used.shape, self.size + 1))  # the last column takes what is held fixed
            rows = np.arange(len(kind.index))
            for j in range(kind.index.shape[1]):
                increments = np.zeros(kind.index.shape, dtype=complex)
                increments[:, j] = 1j * _STEP
                dense[rows, :, kind.index[:, j]] += np.imag(kind.evaluate(state, increments)) / _STEP
            blocks.append(dense[kind.used][:, : self.size])
        return np.vstack(blocks)

    def moved(self, state: State, step: np.ndarray) -> State:
        """The state after a step in the unknowns."""
        padded = np.append(step, 0.0)
        return State(
            stations=state.stations + padded[self.station_index],
            ground=self.earth.shift(state.ground, padded[self.ground_index]),
            levels=state.levels + padded[self.level_index],
            tides=state.tides + padded[self.tide_index],
            tilt=state.tilt + padded[self.tilt_index],
            index=state.index + float(padded[self.index_index[0]]),
        )


def solve(block: Block, start: Start, *, refraction: bool, max_iterations: int = 60) -> Result:
    """Adjust a block simultaneously; with `refraction` bathymetric points are seen through the water.

    Gauss-Newton from near the solution. Raises `RuntimeError` without convergence and `numpy.linalg.LinAlgError`
    when the unknowns are not determined.
    """
    network = Network(block, refraction=refraction)
    return _result(network, _iterate(network, starting_state(network, start), max_iterations))


def _tide_groups(block: Block) -> tuple[np.ndarray, np.ndarray]:
    """Correction of the tide of each photo (-1 for none) and the sigma of each correction, infinite without one."""
    photos, mode = block.photos, block.options.water_level
    if mode is WaterLevel.KNOWN:
        return np.full(len(photos.ids), -1), np.zeros(0)
    labels = {
        WaterLevel.ONE: np.full(len(photos.ids), "all"),
        WaterLevel.PHOTO: np.arange(len(photos.ids)),
        WaterLevel.GROUP: photos.tide_group,
        WaterLevel.DAY: photos.tide_day,
    }[mode]
    names, group = np.unique(labels, return_inverse=True)
    squares = [np.square(photos.tide_sigma[group == i]) for i in range(len(names))]
    return group, np.array([np.sqrt(np.nanmean(s)) if np.isfinite(s).any() else np.inf for s in squares])


def _determined(block: Block) -> np.ndarray:
    """(p,) points with two triangulated rays, or with one ray and control or an equal elevation."""
    p = len(block.points.ids)
    rays = np.bincount(block.plates.point[block.plates.triangulated], minlength=p)
    helped = np.zeros(p, dtype=bool)
    helped[block.control.point[block.control.known.any(axis=1)]] = True
    helped[block.equal_elevations.point] = True
    return (rays >= 2) | ((rays == 1) & helped)


def _iterate(network: Network, state: State, max_iterations: int) -> State:
    previous = np.inf
    for _ in range(max_iterations):
        r, scale, projected = _factor(network.jacobian(state), network.misclosures(state))
        state = network.moved(state, -solve_triangular(r, projected) / scale)
        length = float(np.linalg.norm(projected))
        if length < _SETTLED or (length < 1e-5 and length > 0.3 * previous):
            return state
        previous = length
    raise RuntimeError(f"not converged after {max_iterations} iterations: last step {length:.3g} sigma")


def _factor(jacobian: np.ndarray, misclosures: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    scale = np.sqrt((jacobian**2).sum(axis=0))
    if not scale.all():
        raise np.linalg.LinAlgError("an unknown appears in no observation")
    # R of matrix = Q R, and Q' right, without Q itself
    whole, size = qr(np.column_stack([jacobian / scale, misclosures]), mode="r")[0], len(scale)
    r, projected = whole[:size, :size], whole[:size, size]
    diagonal = np.abs(np.diag(r))
    if len(diagonal) < size or diagonal.min() < 1e-11 * diagonal.max():
        raise np.linalg.LinAlgError("the unknowns are not determined")
    return r, scale, projected


def starting_state(network: Network, start: Start) -> State:
    """Stations and points of `start`, what is held fixed put in, levels at the means of their members."""
    block, earth = network.block, network.earth
    offset = earth.cartesian(earth.native(start.position)) - network.station_xyz
    enu = np.einsum("nij,nj->ni", network.station_frame, offset)
    control, equal = block.control, block.equal_elevations
    ground = np.zeros((len(block.points.ids), 3))
    ground[network.determined] = earth.native(start.points[network.determined])
    held = control.known & control.fixed[:, None] & network.determined[control.point][:, None]
    given = earth.native(np.where(np.isnan(control.position), 0.0, control.position))
    ground[control.point] = np.where(held, given, ground[control.point])
    used = network.determined[equal.point]
    members = np.bincount(equal.group[used], minlength=len(equal.ids))
    sums = np.bincount(equal.group[used], weights=ground[equal.point[used], 2], minlength=len(equal.ids))
    water = block.water or Water(index=1.340)
    return State(
        stations=np.hstack([enu, start.attitude]),
        ground=ground,
        levels=sums / np.maximum(members, 1),
        tides=np.zeros(len(network.tide_sigmas)) if start.tides is None else start.tides,
        tilt=np.array([water.tilt_east or 0.0, water.tilt_north or 0.0]),
        index=water.index,
    )


def _result(network: Network, state: State) -> Result:
    block, earth = network.block, network.earth
    misclosures = network.misclosures(state)
    r, scale, _ = _factor(network.jacobian(state), misclosures)
    dof = len(misclosures) - network.size
    total = float(misclosures @ misclosures)
    variance = total / dof if dof > 0 else np.nan
    inverse = solve_triangular(r, np.eye(len(r))) / scale[:, None]
    inverse = np.vstack([inverse, np.zeros(len(r))])  # the row of what is held fixed
    every = np.arange(len(block.photos.ids))
    xyz, matrix = network.station(state, every, np.zeros((len(every), 6)))
    native = earth.from_cartesian(xyz)
    # Positions stay along the axes of the given frame: the adjusted one differs by distance over earth radius.
    attitude = angles_of(matrix @ np.swapaxes(np.array(earth.frame(native)), -1, -2))
    stations, points = inverse[network.station_index], inverse[network.ground_index]
    point_covariance = variance * points @ np.swapaxes(points, -1, -2)
    point_covariance[~network.determined] = np.nan
    seen = np.flatnonzero(network.determined[block.plates.point])
    residual = np.full((len(block.plates.point), 2), np.nan)
    photo, point = block.plates.photo[seen], block.plates.point[seen]
    computed = network.project(state, photo, point, np.zeros((len(seen), 13)), network.wet(seen))
    residual[seen] = computed - block.plates.xy[seen]
    triangulated = np.zeros(len(residual), dtype=bool)
    triangulated[network.rows] = True
    points_given = np.full(state.ground.shape, np.nan)
    points_given[network.determined] = earth.given(state.ground[network.determined])
    level_rows = inverse[network.level_index]
    return Result(
        position=earth.given(native),
        attitude=attitude,
        covariance=variance * stations @ np.swapaxes(stations, -1, -2),
        points=points_given,
        point_covariance=point_covariance,
        residual=residual,
        triangulated=triangulated,
        levels=state.levels,
        level_sigmas=np.sqrt(variance * (level_rows**2).sum(axis=1)),
        water={
            name: (np.atleast_1d(getattr(state, name)), np.sqrt(variance * (inverse[part] ** 2).sum(axis=1)))
            for name, part in list(network.part.items())[3:]
            if network.unknowns[name]
        },
        sigma0=float(np.sqrt(variance)),
        degrees_of_freedom=dof,
        sum_of_squares=total,
        observations={kind.name: int(kind.used.sum()) for kind in network.kinds},
        unknowns=network.unknowns,
    )
