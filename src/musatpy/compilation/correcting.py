"""Old compilations corrected: apparent points, lines and grids of a stereomodel -> true ones, with their sigmas.

An apparent point lies where the straight rays of both photos meet best: its true point is the one whose refracted
images make these rays. Points above the water stay. A grid is read off at its own posts again, as true points lie
beside the apparent ones.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.compilation.compiled import NO_TIDE, OFF_PLATE
from musatpy.compilation.loop import Loop
from musatpy.compilation.stereomodels import Stereomodel, off_plate
from musatpy.compilation.true_points import BEHIND, Readings, true_points
from musatpy.errors import CompilationError, Problem, SystemsError
from musatpy.geometry.collinearity import in_front
from musatpy.geometry.systems import System
from musatpy.interchange.layers import Column, Grid, Lines, Points

CHUNK = 65536  # points at a time
_TURNS = 3  # times that the posts of a grid are looked for; what is left is the cube of a slope of the correction
_STEPS = 40
_STILL = 1e-7  # m
_FOOT = 0.3048
BELOW_HORIZON = "a photo is below its horizon"


@dataclass(frozen=True, kw_only=True, eq=False)
class Corrected:
    """k points in the system of their file: xyz (k, 3), NaN where a reason (k,), else empty, says why.

    sigma (k, 3) m along east, north, up; depth and depth_sigma (k,) m, NaN of dry points; shift (k,) m in plan.
    """

    xyz: FloatArray
    sigma: FloatArray
    depth: FloatArray
    depth_sigma: FloatArray
    shift: FloatArray
    reason: TextArray

    @property
    def known(self) -> BoolArray:
        """(k,) which have a position."""
        return np.asarray(np.isfinite(self.xyz).all(axis=1))


@dataclass(frozen=True, kw_only=True, eq=False)
class Correction:
    """How apparent points are corrected: the model, the system of the points, the sigma (mm) of their images."""

    stereo: Stereomodel
    system: System
    pointing: float

    def __call__(self, apparent: FloatArray) -> Corrected:
        """Return the true points of apparent ones (k, 3). Raises `SystemsError` where the system does not reach."""
        parts = [self._part(apparent[first : first + CHUNK]) for first in range(0, len(apparent), CHUNK)]
        return parts[0] if len(parts) == 1 else _joined(parts or [self._part(apparent)])

    def _part(self, apparent: FloatArray) -> Corrected:
        stereo, frame = self.stereo, self.stereo.run.frame
        working, reason = self._lost(apparent)
        both = np.repeat(stereo.model(working)[:, None], 2, axis=1)
        xy, known = stereo.images(both), np.isfinite(stereo.tides).all() and stereo.run.block.water is not None
        below = frame.height(working) < np.nan_to_num(stereo.tides, nan=np.inf).max()
        wet = below & (reason == "")
        if known:
            xy[wet] = _refracted_images(stereo, both[wet, 0])
        else:
            reason[wet] = NO_TIDE
        used = np.flatnonzero(reason == "")
        readings = Readings(
            ids=used.astype(np.str_),
            submerged=below[used],
            xy=xy[used],
            sigma=np.full((len(used), 2, 2), self.pointing),
        )
        points = true_points(stereo.run, stereo.photos, readings)
        for row, why in points.reasons.items():
            reason[used[row]] = why
        count, good = len(apparent), np.isfinite(points.position).all(axis=1)
        rows = used[good]
        out = {name: np.full((count, 3), np.nan) for name in ("xyz", "sigma", "moved")}
        true = frame.working(points.position[good])
        out["xyz"][rows] = self.system.coordinates(frame.level(true))
        out["sigma"][rows] = np.sqrt(np.diagonal(points.covariance[good], axis1=1, axis2=2))
        out["moved"][rows] = np.einsum("kij,kj->ki", frame.axes(working[rows]), true - working[rows])
        depth, depth_sigma = np.full(count, np.nan), np.full(count, np.nan)
        depth[used], depth_sigma[used] = points.depth, points.depth_sigma
        return Corrected(
            xyz=out["xyz"],
            sigma=out["sigma"],
            depth=depth,
            depth_sigma=depth_sigma,
            shift=np.linalg.norm(out["moved"][:, :2], axis=1),
            reason=reason,
        )

    def require_model(self, apparent: FloatArray) -> None:
        """Raise `CompilationError` where none of the points (k, 3) is in the model, with what would put them there.

        Raises `SystemsError` where the system does not reach one.
        """
        if (self._lost(apparent)[1] == "").any():
            return
        middle = self.system.coordinates(self.stereo.run.frame.level(self.stereo.origin[None]))[0]
        place = ", ".join(
            f"{name} {value:.{min(decimals, 6)}f}"
            for name, value, decimals in zip(self.system.names, middle.tolist(), self.system.decimals, strict=True)
        )
        message = (
            f"both photos show none of the {len(apparent)} points, taken as {self.system.text}; the middle of the "
            f"model is {place}"
        )
        ways = {
            "x and y exchanged": apparent[:, [1, 0, 2]],
            "feet": apparent * _FOOT,
            "heights in feet": apparent * [1.0, 1.0, _FOOT],
            "depths positive down": apparent * [1.0, 1.0, -1.0],
        }
        for words, others in ways.items():
            with suppress(SystemsError):
                if (self._lost(others)[1] == "").any():
                    message += f". It shows them as {words}"
        raise CompilationError([Problem(message=message)])

    def _lost(self, points: FloatArray) -> tuple[FloatArray, TextArray]:
        """Return points (k, 3) in working coordinates, and why a photo does not show them, empty where both do."""
        stereo, frame = self.stereo, self.stereo.run.frame
        working = frame.from_level(self.system.level(points))
        gap = stereo.model(working)[:, None] - stereo.stations
        reason = np.full(len(points), "", dtype="<U80")
        reason[off_plate(stereo, stereo.images(gap + stereo.stations)).any(axis=1)] = OFF_PLATE
        reason[~in_front(gap, stereo.rotation).all(axis=1)] = BEHIND
        up = frame.axes(working)[:, 2] @ stereo.axes.T
        reason[(np.einsum("ksi,ki->ks", gap, up) >= 0.0).any(axis=1)] = BELOW_HORIZON
        return working, reason


def _refracted_images(stereo: Stereomodel, apparent: FloatArray) -> FloatArray:
    """Return the images (k, 2, 2) mm, refracted, whose straight rays meet in points (k, 3) of the model."""
    loop, stretch = Loop(stereo=stereo), np.array([1.0, 1.0, stereo.index])
    true, xy = apparent.copy(), np.empty((len(apparent), 2, 2))
    active = np.arange(len(true))
    for _ in range(_STEPS):
        xy[active] = loop.stages(true[active]).xy
        gap = apparent[active] - stereo.apparent(xy[active])
        true[active] += gap * stretch  # a depth is about as many times its apparent one
        active = active[np.abs(gap).max(axis=1) > _STILL]
        if not len(active):
            break
    return xy


def _joined(parts: list[Corrected]) -> Corrected:
    return Corrected(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])})


def corrected_points(correction: Correction, points: Points) -> tuple[Points, Corrected]:
    """Return the true points of a layer, those without a position left out, and what came of all of them."""
    done = correction(points.xyz)
    known = done.known
    columns = {name: replace(column, values=column.values[known]) for name, column in points.columns.items()}
    return replace(points, xyz=done.xyz[known], columns=columns | _columns(done, known)), done


def corrected_lines(correction: Correction, lines: Lines) -> tuple[Lines, Corrected]:
    """Return the true lines of a layer, cut where vertices have no position, and what came of all vertices."""
    sizes = [len(path) for path in lines.vertices]
    done = correction(np.concatenate(lines.vertices))
    known, first = done.known, np.concatenate([[0], np.cumsum(sizes)])
    pieces: list[FloatArray] = []
    source: list[int] = []
    closed: list[bool] = []
    for line in range(len(sizes)):
        rows = np.arange(first[line], first[line + 1])
        runs = [run for run in np.split(rows, np.flatnonzero(np.diff(known[rows])) + 1) if known[run[0]]]
        whole = len(runs) == 1 and len(runs[0]) == len(rows)
        pieces += [done.xyz[run] for run in runs if len(run) > 1]
        source += [line for run in runs if len(run) > 1]
        closed += [whole and bool(lines.closed[line]) for run in runs if len(run) > 1]
    rows_of = np.array(source, dtype=np.int64)
    columns = {name: replace(column, values=column.values[rows_of]) for name, column in lines.columns.items()}
    return replace(lines, vertices=pieces, closed=np.array(closed, dtype=bool), columns=columns), done


def corrected_grid(correction: Correction, grid: Grid, band: str) -> tuple[Grid, Corrected]:
    """Return the true surface of a band of apparent heights at the posts of the same grid, and what came of these.

    The apparent place of each post is the one whose true point stands on the post.
    """
    rows, columns = grid.shape
    x, y = np.meshgrid(grid.west + grid.spacing * np.arange(columns), grid.south + grid.spacing * np.arange(rows))
    posts = np.column_stack([x.ravel(), y.ravel()])
    place = posts.copy()
    for turn in range(_TURNS):
        height = _bilinear(grid, grid.bands[band], place)
        done = _at(correction, np.column_stack([place, height]))
        if turn + 1 < _TURNS:
            place -= np.nan_to_num(done.xyz[:, :2] - posts)
    values = {"height": done.xyz[:, 2], "depth": done.depth, "sigma": done.sigma[:, 2]}
    bands = {name: column.reshape(rows, columns) for name, column in values.items()}
    return replace(grid, bands=bands, units=dict.fromkeys(bands, "m")), done


def _at(correction: Correction, apparent: FloatArray) -> Corrected:
    """Return what comes of points (k, 3), of which those without a height have no reason either: they are empty."""
    given = np.flatnonzero(np.isfinite(apparent[:, 2]))
    done = correction(apparent[given])
    out = {}
    for name, values in vars(done).items():
        blank = "" if values.dtype.kind == "U" else np.nan
        out[name] = np.full((len(apparent), *values.shape[1:]), blank, dtype=values.dtype)
        out[name][given] = values
    return Corrected(**out)


def _bilinear(grid: Grid, values: FloatArray, place: FloatArray) -> FloatArray:
    """Return values (k,) of a grid between its posts, NaN outside and beside an empty one."""
    rows, columns = values.shape
    at = (place - [grid.west, grid.south]) / grid.spacing
    at = np.where(np.abs(at - np.rint(at)) < 1e-9, np.rint(at), at)
    low = np.clip(np.floor(at).astype(np.int64), 0, [max(columns - 2, 0), max(rows - 2, 0)])
    high = np.minimum(low + 1, [columns - 1, rows - 1])
    u, v = (at - low).T
    out = np.zeros(len(place))
    for row, weight_v in ((low[:, 1], 1.0 - v), (high[:, 1], v)):
        for column, weight_u in ((low[:, 0], 1.0 - u), (high[:, 0], u)):
            weight = weight_u * weight_v
            out += np.where(weight == 0.0, 0.0, weight * values[row, column])
    outside = (at < 0.0).any(axis=1) | (at > [columns - 1, rows - 1]).any(axis=1)
    return np.where(outside, np.nan, out)


def _columns(done: Corrected, known: BoolArray) -> dict[str, Column]:
    values = {
        "depth": done.depth, "sigma_depth": done.depth_sigma, "sigma_east": done.sigma[:, 0],
        "sigma_north": done.sigma[:, 1], "sigma_up": done.sigma[:, 2],
    }  # fmt: skip
    return {name: Column.of(column[known], "m") for name, column in values.items()}
