"""Maps of a block: the view of it, scale and north, enlarged arrows and ellipses, names, and points by classes."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.figures import INK, LETTER, LIGHT, new_panels, shades, size_of, write_beside
from musatpy.plots.plane import MapPlane, ground_of, is_compilation, outlines, plane_of
from musatpy.records.tables import Tables, numbers, part
from musatpy.statistics.analyses import ellipses

CONFIDENCE = 0.95
NORMAL = 1.96  # sigmas of 95 % in one dimension
ELLIPSE = float(np.sqrt(-2.0 * np.log(1.0 - CONFIDENCE)))  # sigmas of 95 % in two: the root of chi-square
SHARE = 0.2  # of the distance between neighbours: what nine in ten of arrows or ellipses are drawn as
MOST_ARROWS = 1000  # or ellipses of a map: more cannot be told apart
MAPS_NEED = ("options", "stations", "cameras", "points")
_LONG, _SHORT = 8.0, 3.6  # inches, of the sides of a map
_PANEL = 4.6  # inches, of the long side of one of several maps
_BORDER, _KEY = 0.05, 0.09  # of the extent, around the block and for the keys below it
_BEYOND = 1.0  # extents of the block, within which points are in view
_PATH = re.compile(r"^(?:.*[/\\])?([^/\\]+)\.(?:jpe?g|tiff?|png|dng)$", re.IGNORECASE)
_MOST_NAMES = 40
_MOST_STATIONS = 200  # in maps of points, where more footprints would hide these
_PERCENTILE = 90.0
_NOTHING = 1e-6  # m, of vectors that are rounding errors
_DOTS = (2.0, 6.0)  # points, of the smallest and largest marker
_STEPS = (1.0, 2.0, 5.0, 10.0)
_MARKERS = "osD^vPX"  # of classes
_NOWHERE = np.empty((0, 2))
_NORTH = np.array([0.97, 0.92])  # of axes, where the arrow stands
_SIDES = np.array([[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])


# --- how large things are ---


def confidence_ellipses(covariance: FloatArray, turn: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return semi-axes (n, 2) m, the longer first, and its angle (n,) rad from x to y, of ellipses of 95 %.

    covariance (n, 3, 3) m2 along east, north, up; `turn` (n,) rad is by what y stands clockwise of north. They are
    standard ellipses times the root of the quantile of chi-square with two degrees of freedom, -2 ln(1 - 0.95).
    NaN where there is no covariance.
    """
    standard = ellipses(covariance)
    return ELLIPSE * np.column_stack([standard.major, standard.minor]), 0.5 * np.pi - (standard.bearing - turn)


def round_length(length: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that a positive length reaches."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(power * max(step for step in _STEPS if step * power <= length * (1.0 + 1e-9)))


def largest_of_cells(places: FloatArray, sizes: FloatArray, most: int) -> IntArray:
    """Return the rows of places (n, 2), growing, whose sizes (n,) are the largest in the cells of a square grid.

    The grid has about so many cells; where there are no more places than that, all are returned.
    """
    if len(places) <= most:
        return np.arange(len(places))
    low, reach = places.min(axis=0), np.maximum(np.ptp(places, axis=0), 1e-9)
    side = max(float(np.sqrt(reach.prod() / most)), float(reach.max()) / most)
    cell = np.floor((places - low) / side).astype(np.int64)
    order = np.lexsort((-sizes, cell[:, 1], cell[:, 0]))
    first = np.append(True, (np.diff(cell[order], axis=0) != 0).any(axis=1))
    return np.sort(order[first])


def spacing(extent: FloatArray, number: int) -> float:
    """Return the distance of neighbours, of a number of places spread over an extent (2,)."""
    number = max(number, 1)
    return max(float(np.sqrt(np.prod(extent) / number)), float(np.max(extent)) / number)


def magnification(sizes: FloatArray, apart: float, share: float = SHARE) -> float:
    """Return the factor by which nine in ten of sizes (n,) are drawn within a share of the distance of neighbours.

    A few that are much larger are drawn so, and the others can be seen. 0 where no size is known.
    """
    known = sizes[np.isfinite(sizes) & (sizes > 0.0)]
    return share * apart / float(np.percentile(known, _PERCENTILE)) if len(known) else 0.0


def dot_size(bounds: FloatArray, number: int) -> float:
    """Return the size (points) of the markers of a number of points in bounds (2, 2)."""
    sides = bounds[1] - bounds[0]
    return float(np.clip(0.3 * spacing(sides, number) / sides.max() * _LONG * 72.0, *_DOTS))


# --- the map ---


def view_of(core: FloatArray, others: FloatArray, keys: bool = False) -> tuple[FloatArray, BoolArray]:
    """Return the bounds (2, 2) of a picture, west south and east north, and which others (n,) lie in it.

    All of the core (m, 2) is in view, and of the others (n, 2) what lies within one extent of it: a point that went
    astray does not make a dot of the block. Below it is room for keys.
    """
    core = core[np.isfinite(core).all(axis=1)]
    low, high = core.min(axis=0), core.max(axis=0)
    reach = _BEYOND * max(float((high - low).max()), 1.0)
    seen = ((others >= low - reach) & (others <= high + reach)).all(axis=1)
    both = np.concatenate([core, others[seen]])
    low, high = both.min(axis=0), both.max(axis=0)
    extent = max(float((high - low).max()), 1.0)
    low, high = low - _BORDER * extent, high + _BORDER * extent
    low[1] -= keys * _KEY * extent
    lacking = np.maximum(_SHORT / _LONG * (high - low).max() - (high - low), 0.0)
    return np.array([low - 0.5 * lacking, high + 0.5 * lacking]), seen


def new_maps(bounds: FloatArray, plane: MapPlane, title: str, panels: Sequence[str] = ("",)) -> tuple[Any, Any]:
    """Return a figure with maps of bounds (2, 2) m side by side, each with a title of its own.

    Raises `MusatError` where matplotlib is missing.
    """
    sides = bounds[1] - bounds[0]
    width, height = ((_LONG if len(panels) == 1 else _PANEL) * sides / sides.max()).tolist()
    figure, (maps,) = new_panels([width] * len(panels), [height], title)
    for axes, name in zip(maps, panels, strict=True):
        dress(axes, bounds, plane)
        axes.set_title(name)
    return figure, maps


def dress(axes: Any, bounds: FloatArray, plane: MapPlane) -> None:
    """Give axes the bounds (2, 2) m, labels with units, a scale bar at the lower right, and north."""
    from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

    axes.set(xlim=bounds[:, 0], ylim=bounds[:, 1], xlabel=plane.labels[0], ylabel=plane.labels[1], aspect="equal")
    axes.locator_params(nbins=5)
    arrow = {"arrowstyle": "-|>", "color": INK, "shrinkA": 0, "shrinkB": 0}
    axes.annotate(plane.north, (0.97, 0.98), (0.97, 0.86), xycoords="axes fraction", ha="center", arrowprops=arrow)
    length = round_length(0.2 * float(bounds[1, 0] - bounds[0, 0]))
    text = f"{length:g} m" if length < 1000.0 else f"{length / 1000.0:g} km"
    axes.add_artist(
        AnchoredSizeBar(axes.transData, length, text, "lower right", borderpad=0.8, frameon=False, label_top=True)
    )


def add_arrows(
    axes: Any, places: FloatArray, vectors: FloatArray, label: str, *, color: str = INK, share: float = SHARE
) -> None:
    """Draw vectors (n, 2) m at places (n, 2), with one of a round length as their key; NaN is left out.

    Nine in ten are drawn within a share of the distance between neighbours.
    """
    rows = np.flatnonzero(np.isfinite(vectors).all(axis=1) & np.isfinite(places).all(axis=1))
    length = np.linalg.norm(vectors[rows], axis=1)
    if not (length > _NOTHING).any():
        return
    some = largest_of_cells(places[rows], length, MOST_ARROWS)
    if len(some) < len(rows):
        label += ", the largest of each cell"
    extent = np.array([np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())])
    factor = magnification(length[some], spacing(extent, len(some)), share)
    drawn = quiver(axes, places[rows[some]], vectors[rows[some]], factor, color=color)
    axes.plot([], [], "->", color=color, label=label)
    add_key(axes, drawn, factor, "m")


def quiver(axes: Any, places: FloatArray, vectors: FloatArray, factor: float, **style: Any) -> Any:
    """Draw and return vectors (n, 2) at places (n, 2), so many times enlarged in the units of the axes."""
    scale = {"angles": "xy", "scale_units": "xy", "scale": 1.0 / factor, "width": 0.003}
    return axes.quiver(*places.T, *vectors.T, **{"zorder": 3, **scale, **style})


def add_key(axes: Any, drawn: Any, factor: float, unit: str) -> None:
    """Draw an arrow of a round length at the lower left of axes, as the key of arrows so many times enlarged."""
    length = round_length(0.1 * float(np.ptp(axes.get_xlim())) / factor)
    axes.quiverkey(drawn, 0.13, 0.035, length, f"{length:g} {unit}", labelpos="E", coordinates="axes")


def draw_outlines(axes: Any, corners: FloatArray) -> None:
    """Draw the footprints (n, 4, 2) of photos."""
    known = corners[np.isfinite(corners).all(axis=(1, 2))]
    if len(known):
        draw_rings(axes, known, label="footprints", linewidths=0.6, zorder=0)


def draw_rings(axes: Any, corners: FloatArray, **style: Any) -> None:
    """Draw closed lines through corners (n, k, 2), in light grey."""
    from matplotlib.collections import LineCollection

    rings = np.concatenate([corners, corners[:, :1]], axis=1)
    axes.add_collection(LineCollection(list(rings), colors=LIGHT, **style), autolim=False)


def free_sides(places: FloatArray, room: FloatArray, taken: FloatArray) -> FloatArray:
    """Return on which side (n, 2) of places (n, 2) a name of a size (2,) has room: 1 or -1 along x and along y.

    It is the first of right and left above, right and left below, where no name before it stands, nor one with its
    middle at `taken` (k, 2); 0, 0 where there is none.
    """
    out = np.zeros_like(places)
    for row, place in enumerate(places):
        for side in _SIDES:
            middle = place + 0.5 * side * room
            if (np.abs(taken - middle) >= room).any(axis=1).all():
                out[row], taken = side, np.append(taken, [middle], axis=0)
                break
    return out


def without_paths(names: TextArray) -> TextArray:
    """Return names (n,), those of files of photos without their folders and suffixes."""
    return np.array([_PATH.sub(r"\1", name) for name in names.tolist()], dtype=np.str_)


def name_places(
    axes: Any, xy: FloatArray, names: TextArray, most: int = _MOST_NAMES, taken: FloatArray = _NOWHERE, **style: Any
) -> FloatArray:
    """Write names beside places (n, 2) that are in view and have room; of many, every second, third, ... only.

    `taken` (k, 2) are the middles of names written before. Returns them with those of these.
    """
    names = without_paths(names)
    low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
    known = np.flatnonzero(((xy >= low) & (xy <= high)).all(axis=1))
    rows = known[:: -(-len(known) // most) or 1]
    letters = max((len(name) for name in names[rows].tolist()), default=0)
    room = np.array([letters + 1, 2]) * LETTER * (high - low) / size_of(axes)
    taken = np.append(taken, [low + _NORTH * (high - low)], axis=0)
    sides = free_sides(xy[rows], room, taken)
    for side in _SIDES:
        on = rows[(sides == side).all(axis=1)]
        aligned = {"ha": "left" if side[0] > 0.0 else "right", "va": "bottom" if side[1] > 0.0 else "top"}
        write_beside(axes, xy[on], names[on], tuple(4.0 * side), **aligned, **style)
    return np.concatenate([taken, (xy[rows] + 0.5 * sides * room)[sides[:, 0] != 0.0]])


# --- the points of a block ---


@dataclass(frozen=True, kw_only=True, eq=False)
class PointMap:
    """The points of a block on its plane, m, with what is drawn under them."""

    plane: MapPlane
    stations: FloatArray  # (k, 2)
    outlines: FloatArray  # (k, 4, 2)
    places: FloatArray  # (n, 2)
    seen: BoolArray  # (n,) in view
    bounds: FloatArray  # (2, 2)


def point_map(tables: Tables) -> PointMap:
    """Return the map of the points of a run or a compilation, of the latter without photos.

    Raises `NothingToShowError` where the system of the job is not known.
    """
    plane, position = plane_of(tables), numbers(part(tables, "points"), "position", 3)
    if is_compilation(tables):
        stations, around = np.empty((0, 2)), np.empty((0, 4, 2))
    else:
        stations = plane.places(numbers(part(tables, "stations"), "position", 3))[:, :2]
        around = outlines(tables, plane, ground_of(plane.places(position)))
    places = plane.places(position)[:, :2]
    core = np.concatenate([stations, around.reshape(-1, 2)]) if len(stations) else places
    bounds, seen = view_of(core, places, keys=not len(stations))
    return PointMap(plane=plane, stations=stations, outlines=around, places=places, seen=seen, bounds=bounds)


def class_maps(
    block: PointMap, title: str, panels: Sequence[tuple[str, IntArray, Sequence[str]]], together: bool
) -> Any:
    """Return a figure of the points of a block by classes: titles, classes (n,), -1 of none, and their names.

    Each class has a shade and a marker, among those of its panel or, `together`, of all of them.
    """
    figure, maps = new_maps(block.bounds, block.plane, title, [name for name, _, _ in panels])
    size = dot_size(block.bounds, int(block.seen.sum()))
    for axes, (_, grade, names) in zip(maps, panels, strict=True):
        if 0 < len(block.stations) <= _MOST_STATIONS:
            draw_outlines(axes, block.outlines)
            axes.plot(*block.stations.T, "+", color=INK, label="stations")
        grades = np.concatenate([grades[block.seen] for _, grades, _ in panels]) if together else grade[block.seen]
        used = np.unique(grades[grades >= 0])
        for shade, number in zip(shades()(np.linspace(0.0, 1.0, len(used))), used.tolist(), strict=True):
            rows = block.seen & (grade == number)
            marker = _MARKERS[number % len(_MARKERS)]
            axes.plot(*block.places[rows].T, marker, color=shade, markersize=size, label=names[number])
    return figure
