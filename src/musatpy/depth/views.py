"""Depth factors over a stereo model, as tables and a picture: of the normal pair of the paper, or of any stations.

By the factor an apparent depth of a stereo pair is to be multiplied; for small angles of incidence it is the index.
Groeneveld Meijer (1964), Photogrammetric Engineering 30, with the symbols of the paper: Table 1 is `factors` of a
`VerticalPair`, Figure 4 their contours, Table 2 `normalised_table`, Table 3 `single_table`. Lengths of a pair are
in any unit, the same for all; those of stations are metres. Pictures need matplotlib, the extra `plots`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from musatpy.arrays import FloatArray
from musatpy.depth.cameras import CameraStations
from musatpy.depth.correction import Correction
from musatpy.errors import DepthError
from musatpy.figures import FORM, INK, ImageForm, add_bar, file_of, new_panels, styled
from musatpy.files import write_files
from musatpy.geometry.crs import local_map
from musatpy.geometry.systems import geographic
from musatpy.pointfiles.columns import PLAN, FileColumn, Wanted
from musatpy.pointfiles.point_tables import read_table
from musatpy.refraction.apparent import REASONS, Fault, Stations

_LONG, _LEAST = 6.5, 4.0  # inches, of the sides of a map
_BORDER = 0.05  # of the extent, around it
_FILES = ("png", "svg", "pdf")
_PLACES = (PLAN, ("d1", "d2", "s", "t"))
_NEARLY_ZERO = 1e-6  # of the height: stands for an apparent depth of zero, where rays have no true point


@dataclass(frozen=True, kw_only=True, eq=False)
class PairPlaces:
    """n places over a pair: distances from the nadirs, and parts of the base. A list need not be consistent."""

    d1: FloatArray
    d2: FloatArray
    s: FloatArray
    t: FloatArray

    @classmethod
    def at(cls, x: FloatArray, y: FloatArray, base: float) -> PairPlaces:
        """Return places x along the base and y across it, Groeneveld Meijer (14)."""
        return cls(d1=np.hypot(x, y), d2=np.hypot(base - x, y), s=x, t=base - x)


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthFactors:
    """Depth factors (n, d) at n places for d apparent depths, and the `Fault` of those that are NaN."""

    depths: FloatArray
    factor: FloatArray
    fault: NDArray[np.int8]

    def reasons(self) -> list[str]:
        """Return why factors are missing, each reason once."""
        return [REASONS[Fault(fault)] for fault in np.unique(self.fault).tolist() if fault != Fault.NONE]


@dataclass(frozen=True, kw_only=True, eq=False)
class VerticalPair:
    """Two vertical photographs taken from one height above the water, `base` apart."""

    height: float
    base: float
    index: float

    def formula(self, places: PairPlaces, depths: FloatArray) -> DepthFactors:
        """Return the factors by (13)."""
        d1, d2, s, t = (values[:, None] for values in (places.d1, places.d2, places.s, places.t))
        factor = pair_factor(d1, d2, s, t, depths, self.height, self.index)
        return DepthFactors(depths=depths, factor=factor, fault=np.zeros(factor.shape, dtype=np.int8))

    def exact(self, x: FloatArray, y: FloatArray, depths: FloatArray) -> DepthFactors:
        """Return the factors of rays that are intersected as images give them."""
        position = np.array([[0.0, 0.0, self.height], [self.base, 0.0, self.height]])
        down = np.tile([0.0, 0.0, -1.0], (2, 1))
        stations = Stations(position=position, level=np.zeros(2), axis=down)
        return factors(model_of(CameraStations(names=("1", "2"), stations=stations), self.index), x, y, depths)


def model_of(cameras: CameraStations, index: float) -> Correction:
    """Return the correction of a model whose x and y are metres: on the ellipsoid east and north of its middle."""
    ellipsoid = cameras.system.ellipsoid
    if ellipsoid is None:
        return Correction(cameras=cameras, index=index)
    middle = geographic(ellipsoid, cameras.stations.position.mean(axis=0))
    return Correction(cameras=cameras, index=index, system=local_map(ellipsoid, middle))


def factors(model: Correction, x: FloatArray, y: FloatArray, depths: FloatArray) -> DepthFactors:
    """Return the exact factors at places (n,) for apparent depths (d,) below the mean tide of their cameras.

    At an apparent depth of zero the factor is that of a millionth of the height, which is 1e-6 apart at most.
    """
    stations, shape = model.cameras.stations, (len(x), len(depths))
    level = float(stations.level.mean())
    least = _NEARLY_ZERO * (float(stations.heights.min()) - level)
    points = np.empty((*shape, 3))
    points[..., 0], points[..., 1] = x[:, None], y[:, None]
    points[..., 2] = level - np.maximum(depths, least)
    flat = points.reshape(-1, 3)
    if model.cameras.has_rule:
        seen = model.cameras.sees(model.placed(flat).position)
        seen_level = seen @ stations.level / np.maximum(seen.sum(axis=1), 1)
        flat[:, 2] += np.where(seen.any(axis=1), seen_level - level, 0.0)
    true, _ = model(flat)
    return DepthFactors(depths=depths, factor=true.factor.reshape(shape), fault=true.fault.reshape(shape))


def read_places(path: Path) -> dict[str, FloatArray]:
    """Return the columns x, y, or else d1, d2, s, t, of a table.

    Raises `DepthError` with every line that cannot be used, and `OSError`.
    """
    columns = tuple(FileColumn(name=name) for name in sum(_PLACES, ()))
    table = read_table(path, Wanted(columns=columns, forms=_PLACES, bare=PLAN))
    table.require(DepthError, empty="no places")
    return dict(table.values)


def factor_table(places: Mapping[str, FloatArray], factors: DepthFactors) -> list[str]:
    """Return a line for each place: where it is, and its factor for each apparent depth (Table 1)."""
    heads = [*places, *(f"F({depth:g})" for depth in factors.depths.tolist())]
    lines = ["".join(f"{head:>10}" for head in heads)]
    for row, factor in enumerate(factors.factor.tolist()):
        where = "".join(f"{values[row]:10.1f}" for values in places.values())
        lines.append(where + "".join(f"{value:10.4f}" if value == value else f"{'-':>10}" for value in factor))
    return lines + [f"-: {reason}" for reason in factors.reasons()]


def normalised_table(x: FloatArray, y: FloatArray, factors: DepthFactors, normal: FloatArray) -> list[str]:
    """Return what it costs to use the factors `normal` (n,) of one apparent depth for every depth (Table 2).

    That is the largest departure of each depth, and where it is; `-` for one that has no factor where the one has.
    """
    heads = ("apparent", "at x", "at y", "F", "F used", "depth", "by F used", "error", "percent")
    lines = ["".join(f"{head:>10}" for head in heads)]
    away = np.abs(factors.factor - normal[:, None])
    worst = np.argmax(np.where(np.isfinite(away), away, -1.0), axis=0)
    for depth, place, F, gap in zip(factors.depths.tolist(), worst, factors.factor.T, away.T, strict=True):
        if np.isnan(gap[place]):
            lines.append(f"{depth:10.3f}" + f"{'-':>10}" * (len(heads) - 1))
            continue
        off = departure(F[place], normal[place], depth)
        lines.append(
            f"{depth:10.3f}{x[place]:10.1f}{y[place]:10.1f}{F[place]:10.4f}{normal[place]:10.4f}"
            f"{off.depth:10.3f}{off.other_depth:10.3f}{off.error:10.3f}{100.0 * off.relative:10.2f}"
        )
    return lines


def single_table(factor: FloatArray, value: float, depth: float, step: float) -> list[str]:
    """Return what it costs to use one factor for a whole model with factors (n,) of an apparent depth (Table 3).

    That is how far the depths by round levels of the right factor, and by its extremes, are from those by the one,
    and the part of the places that do not depart more.
    """
    heads = ("F", "depth", "departure", "percent", "of model")
    lines = ["".join(f"{head:>10}" for head in heads)]
    known = factor[np.isfinite(factor)]
    low, high = float(known.min()), float(known.max())
    round_levels = step * np.arange(np.ceil(low / step), np.floor(high / step) + 1)
    for level in np.unique(np.concatenate([[low, high], round_levels]))[::-1].tolist():
        off = departure(value, level, depth)
        within = 100.0 * (np.abs(known - value) <= abs(level - value) + 1e-12).mean()
        lines.append(
            f"{level:10.4f}{off.other_depth:10.3f}{off.error:10.3f}{100.0 * off.relative:10.2f}{within:9.0f}%"
        )
    return lines


@styled
def contour_picture(
    path: Path,
    x: FloatArray,
    y: FloatArray,
    factor: FloatArray,
    stations: FloatArray,
    *,
    title: str,
    step: float,
    form: ImageForm = FORM,
) -> None:
    """Write contours of factors (ny, nx) at x (nx,), y (ny,), and stations (k, 2), as Groeneveld Meijer's Figure 4.

    The format is that of the suffix, PNG, SVG or PDF; stations far from the contours are not drawn. Raises
    `MusatError` without matplotlib, and `DepthError` for another suffix.
    """
    kind = path.suffix.lower().removeprefix(".")
    if kind not in _FILES:
        raise DepthError.of(f"a picture is .png, .svg or .pdf, not '{path.suffix}'")
    sides = np.array([np.ptp(x), np.ptp(y)])
    low, high = np.array([x.min(), y.min()]) - _BORDER * sides, np.array([x.max(), y.max()]) + _BORDER * sides
    size = np.maximum(_LONG * sides / sides.max(), _LEAST)
    figure, ((axes,),) = new_panels(size[:1], size[1:], title)
    shown = np.ma.masked_invalid(factor)
    levels = step * np.arange(np.floor(shown.min() / step), np.ceil(shown.max() / step) + 1)
    filled = axes.contourf(x, y, shown, levels=levels, cmap="viridis_r", alpha=0.35)
    lines = axes.contour(x, y, shown, levels=levels, colors="0.2", linewidths=0.8)
    axes.clabel(lines, fmt=f"%.{max(2, int(np.ceil(-np.log10(step))))}f")
    near = stations[((stations >= low) & (stations <= high)).all(axis=1)]
    if len(near):
        axes.plot(*near.T, "^", color=INK, markersize=7, label="exposure stations")
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x", ylabel="y")
    add_bar(axes, filled, "depth factor F")
    write_files({path: file_of(figure, replace(form, kind=kind))[1]})


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthDeparture:
    """What one depth factor makes of apparent depths, and another in its place: arrays of one shape."""

    depth: FloatArray  # by the one factor
    other_depth: FloatArray  # by the other
    error: FloatArray  # other_depth - depth
    relative: FloatArray  # error in units of the depth


def pair_factor(
    d1: ArrayLike,
    d2: ArrayLike,
    s: ArrayLike,
    t: ArrayLike,
    apparent_depth: ArrayLike,
    height: ArrayLike,
    index: ArrayLike,
) -> FloatArray:
    """Return F of points at distances d1, d2 from the two nadirs, s and t of them along the base; shapes broadcast.

    `height` h of the cameras above the water, `apparent_depth` h_a. Groeneveld Meijer (13), with b = s + t.
    """
    s, t = np.asarray(s, dtype=float), np.asarray(t, dtype=float)
    n2, d1, d2 = np.square(index), np.asarray(d1, dtype=float), np.asarray(d2, dtype=float)
    fall = np.asarray(height, dtype=float) + apparent_depth
    first, second = (np.sqrt((n2 - 1.0) * np.square(d) + np.square(fall) * n2) for d in (d1, d2))
    # the factor of either ray is (first or second)/fall; s and t weigh their inverses
    return (s + t) / fall / (s / first + t / second)


def departure(factor: ArrayLike, other: ArrayLike, apparent_depth: ArrayLike) -> DepthDeparture:
    """Return how far the depths by the `other` factor are from those by `factor`; shapes broadcast.

    Table 2 is that of the factor of one apparent depth from the factors of others at the same place, Table 3 that
    of the factors of a model from a single value.
    """
    F, G, h_a = (np.asarray(values, dtype=float) for values in (factor, other, apparent_depth))
    F, G, h_a = np.broadcast_arrays(F, G, h_a)
    # relative by the factors, so that it exists at an apparent depth of zero too
    return DepthDeparture(depth=F * h_a, other_depth=G * h_a, error=(G - F) * h_a, relative=(G - F) / F)
