"""What is exchanged with other programs: points, lines and grids, with their coordinate system and its heights.

Coordinates stand in the order x (easting, longitude), y (northing, latitude), z, whatever order the register gives
the axes of the system.

Packages of the extra `gis`, loaded where they are used, and the problems of files that they read and write.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy import extras
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.errors import InterchangeError, MusatError, Problem
from musatpy.pointfiles.columns import number

if TYPE_CHECKING:
    import pyproj

# The engineering system by which files and callers say that coordinates are local, where a system is required.
LOCAL = (
    'ENGCRS["local",EDATUM["local"],CS[Cartesian,2],AXIS["easting",east],AXIS["northing",north],'
    'LENGTHUNIT["metre",1]]'
)


@dataclass(frozen=True, kw_only=True, eq=False)
class LayerColumn:
    """One value of each point or line: numbers, NaN where there is none, or texts."""

    values: FloatArray | IntArray | TextArray  # (n,)
    unit: str = ""

    @property
    def is_text(self) -> bool:
        """Whether its values are texts."""
        return self.values.dtype.kind == "U"

    @property
    def is_whole(self) -> bool:
        """Whether its values are whole numbers."""
        return self.values.dtype.kind == "i"

    @classmethod
    def of(cls, values: Any, unit: str = "") -> LayerColumn:
        """Return a column of any values (n,): whole numbers, numbers (None is NaN), or else texts (None is '')."""
        array = np.asarray(values)
        if array.dtype.kind in "biu":
            return cls(values=array.astype(np.int64), unit=unit)
        if array.dtype.kind == "f":
            return cls(values=array.astype(float), unit=unit)
        texts = ["" if value is None else str(value) for value in array.tolist()]
        return cls(values=np.array(texts, dtype=np.str_), unit=unit)


def placed(crs: pyproj.CRS | None) -> pyproj.CRS | None:
    """Return the system of a layer, None for an engineering one: its coordinates are local."""
    return None if crs is None or crs.is_engineering else crs


@dataclass(frozen=True, kw_only=True, eq=False)
class Layer:
    """A coordinate system, None of a local one, and in words what heights are above."""

    crs: pyproj.CRS | None = None
    heights: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Points(Layer):
    """n points. Raises `ValueError` for what is no number, and for arrays of other lengths; lines do too."""

    xyz: FloatArray  # (n, 3)
    columns: Mapping[str, LayerColumn] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.xyz.ndim != 2 or self.xyz.shape[1] != 3:
            raise ValueError(f"points are rows of x, y, z, not an array of the shape {self.xyz.shape}")
        _require_finite(self.xyz)
        _require_length(self.columns, len(self.xyz))


def joined(chunks: Sequence[Points]) -> Points:
    """Return the points of chunks, one or more, with the same columns as one layer."""
    columns = {
        name: LayerColumn.of(np.concatenate([chunk.columns[name].values for chunk in chunks]), column.unit)
        for name, column in chunks[0].columns.items()
    }
    return replace(chunks[0], xyz=np.concatenate([chunk.xyz for chunk in chunks]), columns=columns)


def with_numbers(points: Points) -> Points:
    """Return points whose columns of texts are numbers where all of the texts are, or are missing."""
    return replace(points, columns={name: _as_numbers(column) for name, column in points.columns.items()})


def _as_numbers(column: LayerColumn) -> LayerColumn:
    if not column.is_text:
        return column
    texts = [text.strip() for text in column.values.tolist()]
    values = np.array([number(text) for text in texts])
    given = np.array([text.lower() not in ("", "nan") for text in texts], dtype=bool)
    if np.isfinite(values[given]).all():
        return LayerColumn.of(values, column.unit)
    return LayerColumn.of(texts, column.unit)


@dataclass(frozen=True, kw_only=True, eq=False)
class Lines(Layer):
    """n lines; one that is closed does not repeat its first vertex.

    Longitudes of a line across the meridian of 180 degrees go on beyond it: it stays as short as it is. In GeoJSON
    it is cut there, areas in GeoPackages too.
    """

    vertices: Sequence[FloatArray]  # n of (k, 3)
    closed: BoolArray  # (n,)
    columns: Mapping[str, LayerColumn] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for line in self.vertices:
            if line.ndim != 2 or line.shape[1] != 3 or len(line) < 2:
                raise ValueError(f"lines are two rows of x, y, z or more, not an array of the shape {line.shape}")
            _require_finite(line)
        if len(self.closed) != len(self.vertices):
            raise ValueError(f"{len(self.closed)} lines are closed or not, and {len(self.vertices)} have vertices")
        _require_length(self.columns, len(self.vertices))
        if self.crs is not None and self.crs.is_geographic:
            object.__setattr__(self, "vertices", [continuous(line) for line in self.vertices])

    @classmethod
    def of_paths(cls, paths: Sequence[FloatArray], **others: Any) -> Lines:
        """Return the lines of paths, of which those are closed that end where they begin."""
        closed = [len(path) > 3 and bool((path[0] == path[-1]).all()) for path in paths]
        vertices = [path[:-1] if is_ring else path for path, is_ring in zip(paths, closed, strict=True)]
        return cls(vertices=vertices, closed=np.array(closed, dtype=bool), **others)

    def paths(self) -> list[FloatArray]:
        """Return the vertices of each line as they are drawn: those of a closed one end with the first."""
        return [
            np.concatenate([line, line[:1]]) if is_ring else line
            for line, is_ring in zip(self.vertices, self.closed.tolist(), strict=True)
        ]


@dataclass(frozen=True, kw_only=True, eq=False)
class Polygons(Lines):
    """n areas without holes: their closed outlines."""

    @classmethod
    def of_outlines(cls, outlines: Sequence[FloatArray], **others: Any) -> Polygons:
        """Return the areas in outlines (k, 3), whose vertices are put counterclockwise, as RFC 7946 wants them."""
        areas = cls(vertices=outlines, closed=np.ones(len(outlines), dtype=bool), **others)
        turned = []
        for outline in areas.vertices:
            x, y = (outline[:, :2] - outline[0, :2]).T
            area = x @ np.roll(y, -1) - y @ np.roll(x, -1)  # twice that, negative of one that goes clockwise
            turned.append(outline if area > 0.0 else outline[::-1])
        return replace(areas, vertices=turned)


def continuous(line: FloatArray) -> FloatArray:
    """Return the vertices of a line (k, 2 or 3) in degrees without a jump of a whole turn at 180 degrees."""
    if np.ptp(line[:, 0]) <= 180.0:
        return line
    turns = np.rint((line[:, 0] - line[0, 0]) / 360.0)
    return line - 360.0 * turns[:, None] * np.eye(1, line.shape[1])


def cut_at_180(path: FloatArray, is_area: bool) -> list[FloatArray]:
    """Return a line, a ring or a point (k, 2 or 3) cut at 180 degrees, longitudes within them (RFC 7946, 3.1.9).

    A ring that crosses the meridian again and again keeps one part on each side of it.
    """
    turn = 360.0 * np.eye(1, path.shape[1])
    path = continuous(path)
    path = path + turn * (path[:, 0].min() < -180.0)
    beyond = path[:, 0] > 180.0
    at = np.flatnonzero(beyond[1:] != beyond[:-1])
    if not len(at):
        return [path - turn * beyond[0]]
    step = path[at + 1] - path[at]
    cuts = path[at] + (180.0 - path[at, :1]) / step[:, :1] * step
    cuts[:, 0] = 180.0
    whole = np.insert(path, at + 1, cuts, axis=0)
    if is_area:
        sides = [whole[whole[:, 0] <= 180.0], whole[whole[:, 0] >= 180.0]]
        parts = [side if (side[0] == side[-1]).all() else np.concatenate([side, side[:1]]) for side in sides]
    else:
        ends = [0, *(at + 1 + np.arange(len(at))).tolist(), len(whole) - 1]
        parts = [whole[first : last + 1] for first, last in pairwise(ends)]
    extended = [part for part in parts if np.ptp(part[:, : 1 if is_area else 2], axis=0).any()]
    return [part - turn * (part[:, 0].max() > 180.0) for part in extended]


@dataclass(frozen=True, kw_only=True, eq=False)
class Posts(Layer):
    """The nodes of a square grid of a shape (rows, columns): rows go north from `south`, columns east from `west`.

    Raises `ValueError` where the spacing is none.
    """

    west: float
    south: float
    spacing: float  # m or, of longitudes and latitudes, degrees
    shape: tuple[int, int]

    def __post_init__(self) -> None:
        if not self.spacing > 0.0:
            raise ValueError(f"the spacing of a grid is {self.spacing}")

    def places(self, first: int, last: int) -> FloatArray:
        """Return x and y (k, 2) of the nodes of rows from `first` to before `last`, row by row."""
        columns = self.west + self.spacing * np.arange(self.shape[1])
        x, y = np.meshgrid(columns, self.south + self.spacing * np.arange(first, last))
        return np.column_stack([x.ravel(), y.ravel()])


@dataclass(frozen=True, kw_only=True, eq=False)
class Grid(Posts):
    """Values at the nodes of a square grid, NaN where empty; its shape is that of the values.

    Raises `ValueError` where bands are of different shapes, or the spacing is none.
    """

    shape: tuple[int, int] = field(init=False)
    bands: Mapping[str, FloatArray]  # (rows, columns) each
    units: Mapping[str, str] = field(default_factory=dict)  # of bands

    def __post_init__(self) -> None:
        super().__post_init__()
        shapes = {values.shape for values in self.bands.values()}
        if len(shapes) != 1 or any(len(shape) != 2 for shape in shapes):
            raise ValueError(f"bands of a grid are of one shape (rows, columns), not of {sorted(shapes)}")
        object.__setattr__(self, "shape", shapes.pop())


def _require_finite(xyz: FloatArray) -> None:
    if not np.isfinite(xyz).all():
        raise ValueError("a coordinate is no number: what has no place has no row in a layer")


def _require_length(columns: Mapping[str, LayerColumn], count: int) -> None:
    for name, column in columns.items():
        if column.values.shape != (count,):
            raise ValueError(f"column {name} has the shape {column.values.shape}, and there are {count} rows")


package = partial(extras.package, "gis")


def fault(path: Path, place: str, found: str, expected: str, line: int | None = None) -> Problem:
    """Return what is wrong at a place of a file (a feature, a layer, a column), and what is expected there."""
    message = f"{place}: {found}; expected: {expected}" if place else f"{found}; expected: {expected}"
    return Problem(file=str(path), line=line, message=message, found=found, expected=expected)


def refuse(path: Path, place: str, found: str, expected: str) -> InterchangeError:
    """Return the error of one fault."""
    return InterchangeError([fault(path, place, found, expected)])


@contextmanager
def gdal_options(use: str, options: Mapping[str, str]) -> Iterator[None]:
    """Set configuration options of the GDAL of pyogrio for a while."""
    pyogrio = package("pyogrio", use)
    before = {name: pyogrio.get_gdal_config_option(name) for name in options}
    pyogrio.set_gdal_config_options(options)
    try:
        yield
    finally:
        pyogrio.set_gdal_config_options(before)


@contextmanager
def upsets(path: Path, what: str) -> Iterator[None]:
    """Turn what a package raises over a file into an `InterchangeError` that begins with `what` went wrong.

    The errors of these packages have no common kind, and the bytes of files upset them in every way; errors of the
    system about files (`OSError` with its number) stay.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what these packages put right by themselves
            yield
    except MusatError:
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        text = " ".join(str(error).split()) or type(error).__name__
        raise InterchangeError.of(f"{what}: {text}", file=path) from error


def require_content(path: Path) -> None:
    """Raise `InterchangeError` for an empty file, and `OSError` for none."""
    with path.open("rb") as file:
        if not file.read(1):
            raise refuse(path, "", "the file is empty", "points, lines or a grid")
