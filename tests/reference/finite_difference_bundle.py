"""A simultaneous bundle with unknown water, from residuals and central differences only; local jobs.

Stations, ground points, levels, corrections of tides, tilts and index are one long vector; what is observed is one
long vector of weighted misclosures; its derivatives are central differences, Gauss-Newton does the rest. Nothing is
shared with the program but the model classes and the place where its tides hold.
"""

from dataclasses import dataclass

import numpy as np

from musatpy.geometry.geodesy import middle_of
from musatpy.model import Block, CoordinateSystem, Treatment, WaterLevel
from reference.rays import rotation, sighted

_STILL = 1e-9  # of its scale (m, mrad, 1e-4, .01), by which an unknown changes in the last step


@dataclass(frozen=True, kw_only=True)
class Result:
    """Estimates and a posteriori covariance of the whole vector; `part` finds the unknowns of a kind in it."""

    x: np.ndarray
    covariance: np.ndarray
    part: dict[str, slice]
    sum_of_squares: float
    degrees_of_freedom: int

    def value(self, name: str, *shape: int) -> np.ndarray:
        """Estimates of one kind."""
        return self.x[self.part[name]].reshape(*shape)

    def sigma(self, name: str, *shape: int) -> np.ndarray:
        """Their standard deviations."""
        return np.sqrt(np.diag(self.covariance)[self.part[name]]).reshape(*shape)


class Problem:
    """The misclosures of a local block with every point triangulated."""

    def __init__(self, block: Block) -> None:
        assert block.options.system is CoordinateSystem.LOCAL and block.plates.triangulated.all()
        self.block = block
        n, p = len(block.photos.ids), len(block.points.ids)
        self.groups, self.tide_sigmas = _tide_groups(block)
        sizes = {
            "stations": 6 * n,
            "points": 3 * p,
            "levels": len(block.equal_elevations.ids),
            "tides": len(self.tide_sigmas),
            "tilt": 2 if block.options.water_tilt is Treatment.ADJUST else 0,
            "index": 1 if block.options.water_index is Treatment.ADJUST else 0,
        }
        ends = np.cumsum(list(sizes.values()))
        self.part = {name: slice(end - size, end) for (name, size), end in zip(sizes.items(), ends, strict=True)}
        self.size = int(ends[-1])

    def scale(self) -> np.ndarray:
        """Return the size of a usual change of each unknown (m, rad)."""
        scale = np.ones(self.size)
        scale[self.part["stations"]] = np.tile([1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3], len(self.block.photos.ids))
        scale[self.part["tilt"]], scale[self.part["index"]] = 1e-4, 1e-2
        return scale

    def start(self, positions: np.ndarray, attitudes: np.ndarray, points: np.ndarray) -> np.ndarray:
        """The vector of starting values."""
        x = np.zeros(self.size)
        x[self.part["stations"]] = np.hstack([positions, attitudes]).reshape(-1)
        x[self.part["points"]] = points.reshape(-1)
        equal = self.block.equal_elevations
        for group in range(len(equal.ids)):
            x[self.part["levels"]][group] = points[equal.point[equal.group == group], 2].mean()
        if self.block.water:
            x[self.part["index"]] = self.block.water.index
            x[self.part["tilt"]] = (self.block.water.tilt_east or 0.0, self.block.water.tilt_north or 0.0)[
                : self.part["tilt"].stop - self.part["tilt"].start
            ]
        return x

    def misclosures(self, x: np.ndarray) -> np.ndarray:
        """Computed minus observed over sigma, everything that is observed."""
        block = self.block
        stations = x[self.part["stations"]].reshape(-1, 6)
        points = x[self.part["points"]].reshape(-1, 3)
        parts = [self._images(x, stations, points)]
        control = block.control
        used = control.known & ~control.fixed[:, None]
        parts.append(((points[control.point] - control.position) / control.sigma)[used])
        given = np.hstack([block.photos.position, block.photos.attitude])
        sigma = np.hstack([block.photos.position_sigma, block.photos.attitude_sigma])
        parts.append(((stations - given) / sigma)[np.isfinite(sigma)])
        equal = block.equal_elevations
        levels = x[self.part["levels"]]
        parts.append((points[equal.point, 2] - levels[equal.group]) / equal.sigma[equal.group])
        for table, value in ((block.distances, "length"), (block.height_differences, "difference")):
            between = points[table.point[:, 1]] - points[table.point[:, 0]]
            computed = np.linalg.norm(between, axis=1) if value == "length" else between[:, 2]
            parts.append((computed - getattr(table, value)) / table.sigma)
        parts += self._water(x)
        return np.concatenate(parts)

    def _images(self, x: np.ndarray, stations: np.ndarray, points: np.ndarray) -> np.ndarray:
        block, plates = self.block, self.block.plates
        camera, target = stations[plates.photo, :3], points[plates.point]
        seen = target + self._to_water(x, plates.photo, camera, target)
        vector = np.einsum("rij,rj->ri", rotation(stations[plates.photo, 3:]), seen - camera)
        link = block.photos.camera[plates.photo]
        f = block.cameras.focal_length[link][:, None]
        computed = block.cameras.principal_point[link] - f * vector[:, :2] / vector[:, 2:]
        sigma = np.where(np.isnan(plates.sigma), block.options.plate_sigma, plates.sigma)
        submerged = block.points.bathymetric[plates.point][:, None]
        sigma = np.where(submerged, block.options.submerged_factor, 1.0) * sigma
        return ((computed - plates.xy) / sigma).reshape(-1)

    def _to_water(self, x: np.ndarray, photo: np.ndarray, camera: np.ndarray, target: np.ndarray) -> np.ndarray:
        """From ground points to their water points, zero for dry ones: in axes in which the plane is level."""
        block = self.block
        shift = np.zeros_like(target)
        wet = block.points.bathymetric[block.plates.point]
        if not wet.any():
            return shift
        tilt = np.array([block.water.tilt_east or 0.0, block.water.tilt_north or 0.0])
        index = block.water.index
        if self.part["tilt"].stop > self.part["tilt"].start:
            tilt = x[self.part["tilt"]]
        if self.part["index"].stop > self.part["index"].start:
            index = float(x[self.part["index"]][0])
        correction = np.append(x[self.part["tides"]], 0.0)[self.groups]
        origin = middle_of(block.photos.position)[:2]
        water = (block.photos.tide + correction)[photo] + (target[:, :2] - origin) @ tilt
        up = np.array([-tilt[0], -tilt[1], 1.0])
        length = np.linalg.norm(up)
        up = up / length
        east = np.array([up[2], 0.0, -up[0]]) / np.hypot(up[0], up[2])
        axes = np.stack([east, np.cross(up, east), up])
        depth = (water - target[:, 2]) / length
        local = (camera - target)[wet] @ axes.T
        shift[wet] = sighted(local, depth[wet], index) @ axes
        return shift

    def _water(self, x: np.ndarray) -> list[np.ndarray]:
        water = self.block.water
        tides = x[self.part["tides"]] / self.tide_sigmas
        parts = [tides[np.isfinite(tides)]]
        if water and water.tilt_sigma and self.part["tilt"].stop > self.part["tilt"].start:
            given = np.array([water.tilt_east or 0.0, water.tilt_north or 0.0])
            parts.append((x[self.part["tilt"]] - given) / water.tilt_sigma)
        if water and water.sigma and self.part["index"].stop > self.part["index"].start:
            parts.append((x[self.part["index"]] - water.index) / water.sigma)
        return parts


def _tide_groups(block: Block) -> tuple[np.ndarray, np.ndarray]:
    """Correction of each photo (-1 for none) and the sigma of each correction, infinite without one."""
    photos, mode = block.photos, block.options.water_level
    n = len(photos.ids)
    if mode is WaterLevel.KNOWN:
        return np.full(n, -1), np.zeros(0)
    labels = {
        WaterLevel.ONE: np.full(n, "all"),
        WaterLevel.PHOTO: photos.ids,
        WaterLevel.GROUP: photos.tide_group,
        WaterLevel.DAY: photos.tide_day,
    }[mode]
    names, group = np.unique(labels, return_inverse=True)
    if mode is WaterLevel.PHOTO:
        names, group = photos.ids, np.arange(n)
    squares = [np.square(photos.tide_sigma[group == i]) for i in range(len(names))]
    return group, np.array([np.sqrt(np.nanmean(s)) if np.isfinite(s).any() else np.inf for s in squares])


def solve(block: Block, x: np.ndarray, iterations: int = 8) -> Result:
    """Gauss-Newton from `x` until it stands still; central differences with steps of a thousandth of a scale."""
    problem = Problem(block)
    scale = problem.scale()
    for _ in range(iterations):
        J = jacobian(problem, x, scale)
        step, *_ = np.linalg.lstsq(J, -problem.misclosures(x), rcond=None)
        x = x + step * scale
        if np.abs(step).max() < _STILL:
            break
    J, v = jacobian(problem, x, scale), problem.misclosures(x)
    dof = len(v) - problem.size
    covariance = np.linalg.inv(J.T @ J) * (v @ v / dof) * np.outer(scale, scale)
    return Result(
        x=x, covariance=covariance, part=problem.part, sum_of_squares=float(v @ v), degrees_of_freedom=dof
    )


def jacobian(problem: Problem, x: np.ndarray, scale: np.ndarray, step: float = 1e-3) -> np.ndarray:
    """Central differences of the misclosures by all unknowns over `scale`."""
    columns = []
    for j in range(problem.size):
        h = np.zeros(problem.size)
        h[j] = step * scale[j]
        columns.append((problem.misclosures(x + h) - problem.misclosures(x - h)) / (2.0 * step))
    return np.stack(columns, axis=1)


@dataclass(frozen=True, kw_only=True)
class Joint:
    """Covariance of all unknowns and considered parameters of a problem, in the order of its `part`."""

    covariance: np.ndarray
    problem: Problem
    x: np.ndarray
    unit_sigma: float

    def sigma(self, name: str, *shape: int) -> np.ndarray:
        """Standard deviations of one kind."""
        return np.sqrt(np.diag(self.covariance)[self.problem.part[name]]).reshape(*shape)

    def depth_sigmas(self) -> np.ndarray:
        """Standard deviations (p,) of the mean water over each point minus its height; photos that see it."""
        gradient = np.stack([self._derivative(j) for j in range(len(self.x))], axis=1)
        return np.sqrt(np.einsum("pi,ij,pj->p", gradient, self.covariance, gradient))

    def _derivative(self, j: int) -> np.ndarray:
        h = np.zeros(len(self.x))
        h[j] = 1e-3
        return (self._depths(self.x + h) - self._depths(self.x - h)) / 2e-3

    def _depths(self, x: np.ndarray) -> np.ndarray:
        block, part = self.problem.block, self.problem.part
        points = x[part["points"]].reshape(-1, 3)
        tides = block.photos.tide + np.append(x[part["tides"]], 0.0)[self.problem.groups]
        sums = np.bincount(block.plates.point, weights=tides[block.plates.photo], minlength=len(points))
        level = sums / np.bincount(block.plates.point, minlength=len(points))
        origin = middle_of(block.photos.position)[:2]
        slope = x[part["tilt"]] if part["tilt"].stop > part["tilt"].start else np.zeros(2)
        return level + (points[:, :2] - origin) @ slope - points[:, 2]


def considered(wide: Block, x: np.ndarray, sigma: dict[str, np.ndarray], squares: float, dof: int) -> Joint:
    """Return the joint covariance at `x` of a block all of whose water `wide` makes unknown.

    `sigma` gives those of the considered parameters of a kind (tides, tilt, index); such a kind is not estimated
    and not observed. The adjustment has `dof` degrees of freedom and the weighted sum of squares `squares`: not
    quite that of `x` where it corrects images.
    """
    problem = Problem(wide)
    columns = {name: np.arange(problem.size)[problem.part[name]] for name in sigma}
    known = np.concatenate([*columns.values(), np.zeros(0, dtype=int)])
    C = np.square(np.concatenate([*sigma.values(), np.zeros(0)]))
    scale = problem.scale()
    J, v = jacobian(problem, x, scale) / scale, problem.misclosures(x)
    # the observations of what is considered are no observations
    lone = ((J != 0.0).sum(axis=1) == 1) & (J[:, known] != 0.0).any(axis=1)
    J, v = J[~lone], v[~lone]
    free = np.setdiff1d(np.arange(problem.size), known)
    A, B, D = J[:, free] * scale[free], J[:, known], scale[free]
    inverse = np.linalg.inv(A.T @ A)
    S = -(inverse @ A.T @ B) * D[:, None]
    # generalised least squares has the errors of the parameters among those of the observations
    explained = _least_squares(np.eye(len(v)), A, v) - _least_squares(
        np.linalg.inv(np.eye(len(v)) + (B * C) @ B.T), A, v
    )
    variance = (squares - explained) / dof
    joint = np.zeros((problem.size, problem.size))
    joint[np.ix_(free, free)] = variance * inverse * np.outer(D, D) + (S * C) @ S.T
    joint[np.ix_(free, known)] = S * C
    joint[np.ix_(known, free)] = (S * C).T
    joint[np.ix_(known, known)] = np.diag(C)
    return Joint(covariance=joint, problem=problem, x=x, unit_sigma=float(np.sqrt(variance)))


def _least_squares(weight: np.ndarray, A: np.ndarray, v: np.ndarray) -> float:
    """The least sum of squares v' P v with unknowns of the partials A."""
    left = v - A @ np.linalg.solve(A.T @ weight @ A, A.T @ weight @ v)
    return float(left @ weight @ left)
