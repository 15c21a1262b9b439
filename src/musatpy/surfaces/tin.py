"""A surface over points in a plane: triangles, linear in each, nothing outside; or planes of the points about."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import SurfaceError

INSIDE, OUTSIDE, LONG_EDGE, LAND, FEW, EMPTY = range(6)
REASONS = {
    OUTSIDE: "outside the surface",
    LONG_EDGE: "an edge of the surface there is too long",
    LAND: "land, between points of the shoreline",
    EMPTY: "the raster is empty there",
    FEW: "too few points within the radius, or to one side",
}
_FLAT = 1e-9  # of the extent along: points on a line have no triangles
_PAIRS = 1_000_000  # of places and points that are in memory at a time
_THIN = 1e-6  # of the squared extent along: points on a line make no plane
_BORDER = 1e-9  # of a triangle: so far out a place is still on its border, and inside, as points of a border are


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceValues:
    """What a surface is at m places: value (m,) and gradient (m, 2), NaN where there is none, for a `reason` (m,).

    sigma (m,) of the value by those of the points that make it.
    """

    value: FloatArray
    gradient: FloatArray
    sigma: FloatArray
    reason: IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Tin:
    """The Delaunay triangles (t, 3) of points xy (n, 2) m with values z (n,) and sigmas (n,).

    fault (t,) says why triangles are no part of the surface (INSIDE: they are). merged: points that fell on others.
    """

    xy: FloatArray
    z: FloatArray
    sigma: FloatArray
    triangles: IntArray
    fault: IntArray
    merged: int
    search: Any  # the Delaunay triangulation of scipy

    @classmethod
    def of(
        cls,
        points: FloatArray,
        sigma: FloatArray | None = None,
        longest_edge: float = np.inf,
        shore: BoolArray | None = None,
    ) -> Tin:
        """Return the network of points (n, 3) with sigmas (n,) of their values; those in one place are meaned.

        Triangles with all corners on the shoreline, points `shore` (n,), are land and no part of the surface.

        Raises `SurfaceError` for fewer than three places, and for places on a line.
        """
        from scipy.spatial import Delaunay  # it takes long to load

        sigma = np.zeros(len(points)) if sigma is None else sigma
        xy, place, count = np.unique(points[:, :2], axis=0, return_inverse=True, return_counts=True)
        place = place.reshape(-1)
        z = np.bincount(place, weights=points[:, 2], minlength=len(xy)) / count
        variance = np.bincount(place, weights=np.square(sigma), minlength=len(xy)) / count**2
        if len(xy) < 3:
            raise SurfaceError.of(f"a surface needs three places, not {len(xy)}")
        extent = np.linalg.svd(xy - xy.mean(axis=0), compute_uv=False)
        if extent[1] <= _FLAT * extent[0]:
            raise SurfaceError.of(f"the {len(xy)} places lie on a line: they make no surface")
        search = Delaunay(xy)
        on_shore = np.zeros(len(xy), dtype=bool)
        on_shore[place[np.zeros(len(place), dtype=bool) if shore is None else shore]] = True
        land = on_shore[search.simplices].all(axis=1)
        corners = xy[search.simplices]
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        area = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])  # none along a straight edge of the surface
        long, flat = edges.max(axis=1) > longest_edge, area <= _FLAT * np.square(edges.max(axis=1))
        return cls(
            xy=xy,
            z=z,
            sigma=np.sqrt(variance),
            triangles=search.simplices.astype(np.int64),
            fault=np.where(land, LAND, np.where(long | flat, LONG_EDGE, INSIDE)),
            merged=len(points) - len(xy),
            search=search,
        )

    @property
    def kept(self) -> BoolArray:
        """(t,) triangles of the surface."""
        return np.asarray(self.fault == INSIDE)

    @property
    def area(self) -> float:
        """Of the surface in plan, m2."""
        a, b, c = (self.xy[self.triangles[self.kept, corner]] for corner in range(3))
        u, v = b - a, c - a
        return float(0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum())

    def at(self, places: FloatArray) -> SurfaceValues:
        """Return the surface at places (m, 2)."""
        triangle = self._triangles_at(places)
        reason = np.where(triangle >= 0, self.fault[triangle], OUTSIDE)
        good = np.flatnonzero(reason == INSIDE)
        corners, to_weights = self.triangles[triangle[good]], self.search.transform[triangle[good]]
        two = np.einsum("mij,mj->mi", to_weights[:, :2], places[good] - to_weights[:, 2])  # barycentric
        weights, z = np.column_stack([two, 1.0 - two.sum(axis=1)]), self.z[corners]
        gradient, value, sigma = np.full((len(places), 2), np.nan), *np.full((2, len(places)), np.nan)
        gradient[good] = np.einsum("mij,mi->mj", to_weights[:, :2], z[:, :2] - z[:, 2:])
        value[good] = np.sum(weights * z, axis=1)
        sigma[good] = np.sqrt(np.sum(np.square(weights * self.sigma[corners]), axis=1))
        return SurfaceValues(value=value, gradient=gradient, sigma=sigma, reason=reason)

    def _triangles_at(self, places: FloatArray) -> IntArray:
        """Return the triangles (m,) of places, -1 outside; each search starts at the last, so strip by strip."""
        strips = max(1, int(np.sqrt(len(self.xy))))
        low, high = self.xy[:, 0].min(), self.xy[:, 0].max()
        strip = np.clip(np.nan_to_num((places[:, 0] - low) / (high - low)), 0.0, 1.0) * strips
        order, triangle = np.lexsort((places[:, 1], np.floor(strip))), np.empty(len(places), dtype=np.int64)
        triangle[order] = self.search.find_simplex(places[order], tol=_BORDER)
        return triangle


def planes_at(places: FloatArray, xy: FloatArray, z: FloatArray, sigma: FloatArray, radius: float) -> SurfaceValues:
    """Return at places (m, 2) the planes by least squares of points xy (n, 2), z (n,) within a radius, m.

    They are weighted by sigma (n,), where all have one. Three that are not on a line are the fewest,
    and where a plane is worse than a point, all being to one side, there is none.
    """
    from scipy.spatial import KDTree  # it takes long to load

    tree = KDTree(xy)
    pairs = np.cumsum(tree.query_ball_point(places, radius, return_length=True))
    blocks = np.split(places, np.flatnonzero(np.diff(pairs // _PAIRS)) + 1)
    parts = [_planes(block, tree.query_ball_point(block, radius), (xy, z, sigma), radius) for block in blocks]
    columns = zip(*((part.value, part.gradient, part.sigma, part.reason) for part in parts), strict=True)
    value, gradient, deviation, reason = (np.concatenate(column) for column in columns)
    return SurfaceValues(value=value, gradient=gradient, sigma=deviation, reason=reason)


def _planes(places: FloatArray, rows: Any, points: tuple[FloatArray, ...], radius: float) -> SurfaceValues:
    """Return the planes at places (m, 2) of their `rows` (m lists) of points."""
    xy, z, sigma = points
    count = np.array([len(near) for near in rows], dtype=np.int64)
    place, point = np.repeat(np.arange(len(places)), count), np.concatenate([*rows, []]).astype(np.int64)
    A = np.column_stack([np.ones(len(point)), (xy[point] - places[place]) / radius])
    weighted = bool((sigma > 0.0).all())
    weight = 1.0 / np.square(sigma[point]) if weighted else np.ones(len(point))
    N, plain, b = np.zeros((len(places), 3, 3)), np.zeros((len(places), 3, 3)), np.zeros((len(places), 3))
    np.add.at(N, place, weight[:, None, None] * A[:, :, None] * A[:, None, :])
    np.add.at(plain, place, A[:, :, None] * A[:, None, :])
    np.add.at(b, place, (weight * z[point])[:, None] * A)
    good = np.flatnonzero((count >= 3) & _spread(plain, count))
    good = good[np.linalg.inv(plain[good])[:, 0, 0] <= 1.0]
    value, gradient = np.full(len(places), np.nan), np.full((len(places), 2), np.nan)
    deviation, reason = np.full(len(places), np.nan), np.full(len(places), FEW)
    Q = np.linalg.inv(N[good])
    x = np.einsum("kij,kj->ki", Q, b[good])
    value[good], gradient[good], reason[good] = x[:, 0], x[:, 1:] / radius, INSIDE
    deviation[good] = np.sqrt(Q[:, 0, 0]) if weighted else 0.0
    return SurfaceValues(value=value, gradient=gradient, sigma=deviation, reason=reason)


def _spread(N: FloatArray, count: IntArray) -> BoolArray:
    """Return whether points spread across a line, by their sums of squares N (m, 3, 3) about the places."""
    number = np.maximum(count, 1)
    mean = N[:, 0, 1:] / number[:, None]
    scatter = N[:, 1:, 1:] / number[:, None, None] - mean[:, :, None] * mean[:, None, :]
    least, largest = np.linalg.eigvalsh(scatter).T
    return np.asarray(least > _THIN * largest)
