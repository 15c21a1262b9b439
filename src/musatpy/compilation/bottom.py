"""What is drawn of a compilation: surfaces of depth or of height, their contours, and grids of posts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.compilation.compiled import Compiled, DepthDatum
from musatpy.compilation.joined_surfaces import EdgeMatch, JoinedSurface, Of, surfaces_of
from musatpy.errors import CollocationError, CompilationError
from musatpy.model import CoordinateSystem
from musatpy.model.compilation import ContourSpec, GridSpecs
from musatpy.sea.interpolation.correlation import SignalKind
from musatpy.sea.interpolation.interpolate import InterpolationOptions, interpolate
from musatpy.sea.interpolation.prediction import CrossValidation, Observed, Trend
from musatpy.surfaces.contours import Contour, Contours, contours, grid_contours, levels_between
from musatpy.surfaces.tin import Tin
from musatpy.units import DEGREE

_SAME = 1e-6  # m, of levels
_MOST = 250_000  # posts: with listing and layers 270 MB and 34 s of a busy processor
_MOST_COLLOCATED = 2000  # points: their covariances are factorised some dozen times
_FAMILIES = (SignalKind.GAUSSIAN, SignalKind.EXPONENTIAL)  # of a bottom: smooth, or rough


@dataclass(frozen=True, kw_only=True, eq=False)
class Sheet:
    """The contours of one surface: of its triangles, or of the posts of a grid, by whose name it goes then."""

    name: str
    surface: JoinedSurface
    contours: Contours


@dataclass(frozen=True, kw_only=True, eq=False)
class Bottom:
    """The surfaces of a compilation with their contours, how its models match, and grids of posts.

    Surfaces are of depths below the sounding datum, or of heights.
    """

    surfaces: tuple[JoinedSurface, ...]
    sheets: tuple[Sheet, ...]
    edges: tuple[EdgeMatch, ...]
    grids: tuple[PostGrid, ...] = ()
    of: Of = Of.DEPTH

    @property
    def named(self) -> list[tuple[str, JoinedSurface]]:
        """The surfaces with their names: numbers, those of heights behind an H."""
        letter = "H" if self.of is Of.HEIGHT else ""
        return [(f"{letter}{number}", surface) for number, surface in enumerate(self.surfaces, 1)]

    def warnings(self, grids: Iterable[str]) -> Iterator[str]:
        """Yield what of the surfaces and of `grids`, by name, that were asked for there is not, and why."""
        for _, surface in self.named:
            if surface.tin is None:
                names = ", ".join(surface.models)
                who = f"models {names} have" if len(surface.models) > 1 else f"model {names} has"
                yield f"{who} no surface of {self.of}s: {surface.reason}"
        for grid in grids:
            if self.of is Of.DEPTH and grid not in [found.name for found in self.grids]:
                yield f"grid {grid} has no posts: there is no surface"

    def vertices(self, sheet: Sheet, line: Contour, datum: DepthDatum) -> FloatArray:
        """Return the vertices (k, 3) of a contour in the system of the job."""
        level = np.full(len(line.xy), line.level)
        if self.of is Of.HEIGHT:
            return sheet.surface.coordinates(line.xy, level)
        return sheet.surface.below(line.xy, level, datum)

    def dropped(self, surface: JoinedSurface) -> int:
        """Return how many pieces of contours of a surface were too short."""
        return sum(sheet.contours.dropped for sheet in self.sheets if sheet.surface is surface)


def bottoms_of(compiled: Compiled) -> tuple[Bottom, ...]:
    """Return what is drawn of a compilation: its depths, and its heights, as far as the deck asks for them.

    Raises `MusatError` where matplotlib is missing, `SurfaceError` for too many contours, and `CompilationError`
    for grids that cannot be.
    """
    depths, heights = bottom_of(compiled), compiled.deck.heights
    found = [] if depths is None else [depths]
    if heights is not None:
        surfaces, edges = surfaces_of(compiled, Of.HEIGHT)
        terrain = Bottom(surfaces=surfaces, sheets=(), edges=edges, of=Of.HEIGHT)
        found.append(replace(terrain, sheets=_sheets(terrain.named, heights)))
    return tuple(found)


def bottom_of(compiled: Compiled) -> Bottom | None:
    """Return the depths of a compilation, None where the deck asks for no contours of these and no grids.

    Raises as `bottoms_of`.
    """
    spec, grids = compiled.deck.contours, compiled.deck.grids
    if spec is None and not len(grids.ids):
        return None
    angular = compiled.run.block.options.system is CoordinateSystem.GEOGRAPHIC
    surfaces, edges = surfaces_of(compiled)
    lines = None if compiled.deck.lines is None else compiled.deck.lines.grids
    posts = grids_of(grids, surfaces, DEGREE if angular else 1.0, lines)
    bottom = Bottom(surfaces=surfaces, sheets=(), edges=edges, grids=posts)
    if spec is None:
        return bottom
    of_posts = tuple(_of_posts(grid, spec) for grid in posts if grid.name == spec.grid)
    return replace(bottom, sheets=of_posts if spec.grid else _sheets(bottom.named, spec))


def _sheets(surfaces: Iterable[tuple[str, JoinedSurface]], spec: ContourSpec) -> tuple[Sheet, ...]:
    """Return the contours of the triangles of surfaces."""
    return tuple(
        _sheet(spec, name, surface, surface.tin.z, partial(contours, surface.tin))
        if surface.tin is not None
        else Sheet(name=name, surface=surface, contours=Contours(lines=(), dropped=0))
        for name, surface in surfaces
    )


def _of_posts(grid: PostGrid, spec: ContourSpec) -> Sheet:
    """Return the contours of the posts of a grid."""
    draw = partial(grid_contours, grid.depth, (grid.west, grid.south), grid.spacing)
    return _sheet(spec, grid.name, grid.surface, grid.depth[np.isfinite(grid.depth)], draw)


def _sheet(
    spec: ContourSpec, name: str, surface: JoinedSurface, values: FloatArray, draw: Callable[..., Contours]
) -> Sheet:
    """Return contours at multiples of the interval and at levels listed, those only that a surface reaches."""
    if not len(values):
        return Sheet(name=name, surface=surface, contours=Contours(lines=(), dropped=0))
    low, high = float(values.min()), float(values.max())
    even = levels_between(low, high, spec.interval) if np.isfinite(spec.interval) else np.zeros(0)
    levels = even.tolist()
    thick = even[np.rint(even / spec.interval) % spec.index == 0].tolist()
    for level in (*spec.listed, *spec.listed_index):
        same = next((other for other in levels if abs(other - level) < _SAME), None)
        if same is None and low < level < high:
            levels.append(level)
            same = level
        if same is not None and level in spec.listed_index:
            thick.append(same)
    lines = draw(levels=sorted(levels), index=thick, shortest=spec.shortest)
    return Sheet(name=name, surface=surface, contours=lines)


@dataclass(frozen=True, kw_only=True, eq=False)
class PostGrid:
    """Posts at multiples of a spacing (m) on the map of the job, rows from `south`, columns from `west` (m).

    depth and sigma (rows, columns) m, NaN where there is no surface. `surface` is one on the same map.
    """

    name: str
    spacing: float
    west: float
    south: float
    depth: FloatArray
    sigma: FloatArray
    surface: JoinedSurface
    validation: CrossValidation | None = None  # of the points, left out in groups, where posts are predicted

    @property
    def empty(self) -> int:
        """Number of posts without a depth."""
        return int(np.count_nonzero(np.isnan(self.depth)))

    def coordinates(self, datum: DepthDatum) -> FloatArray:
        """Return coordinates (p, 3) of the job of all posts, row by row, depths below a datum."""
        rows, columns = self.depth.shape
        x, y = np.meshgrid(
            self.west + self.spacing * np.arange(columns), self.south + self.spacing * np.arange(rows)
        )
        return self.surface.below(np.column_stack([x.ravel(), y.ravel()]), np.nan_to_num(self.depth.ravel()), datum)


def grids_of(
    specs: GridSpecs, surfaces: Sequence[JoinedSurface], corner_unit: float, lines: IntArray | None = None
) -> tuple[PostGrid, ...]:
    """Return the grids of posts on surfaces; corners count in `corner_unit` of the job's coordinates.

    There are none without a surface. Raises `CompilationError` for a grid of no posts, or of too many.
    """
    networks = [surface for surface in surfaces if surface.tin is not None]
    on_line: list[int | None] = [None] * len(specs.ids) if lines is None else lines.tolist()
    return tuple(_grid(specs, row, corner_unit, networks, line) for row, line in enumerate(on_line) if networks)


def _grid(
    specs: GridSpecs, row: int, corner_unit: float, surfaces: Sequence[JoinedSurface], line: int | None
) -> PostGrid:
    """Return a grid between its corners, over all of the surfaces where these are NaN."""
    name, spacing = str(specs.ids[row]), float(specs.spacing[row])
    corners = np.stack([specs.first[row], specs.second[row]]) * corner_unit
    if np.isfinite(corners).all():
        places = surfaces[0].places(corners)
    else:
        places = np.concatenate([surface.tin.xy for surface in surfaces if surface.tin])
    first = np.ceil(places.min(axis=0) / spacing - 1e-9)
    columns, rows = (np.floor(places.max(axis=0) / spacing + 1e-9) - first + 1.0).clip(0.0)
    if rows * columns > _MOST or not rows * columns:
        message = f"grid {name} has {rows * columns:.3g} posts: give another spacing (1 to {_MOST:,} posts)"
        raise CompilationError.of(message, line=line, card="GRD", field="spacing")
    x, y = np.meshgrid(first[0] + np.arange(columns), first[1] + np.arange(rows))
    posts = spacing * np.column_stack([x.ravel(), y.ravel()])
    depth, sigma = np.full(len(posts), np.nan), np.full(len(posts), np.nan)
    left_out: list[CrossValidation] = []
    for surface in surfaces:
        assert surface.tin is not None
        at = surface.tin.at(posts)
        new = np.isnan(depth) & np.isfinite(at.value)
        depth[new], sigma[new] = at.value[new], at.sigma[new]
        if specs.collocated[row] and new.any():
            depth[new], sigma[new], validation = _predicted(name, surface.tin, posts[new])
            left_out.append(validation)
    shape = (int(rows), int(columns))
    return PostGrid(
        name=name,
        spacing=spacing,
        west=float(first[0]) * spacing,
        south=float(first[1]) * spacing,
        depth=depth.reshape(shape),
        sigma=sigma.reshape(shape),
        surface=surfaces[0],
        validation=CrossValidation(
            error=np.concatenate([part.error for part in left_out]),
            sigma=np.concatenate([part.sigma for part in left_out]),
        )
        if left_out
        else None,
    )


def _predicted(name: str, tin: Tin, posts: FloatArray) -> tuple[FloatArray, FloatArray, CrossValidation]:
    """Return depths (p,) at posts (p, 2) by collocation of the points of a network, sigmas, and its validation.

    A plane and a signal, whose covariance is the better of two families by the restricted likelihood; what points
    err by is their sigmas. Sigmas of depths are larger by what points that were left out say. Raises
    `CompilationError`.
    """
    if len(tin.z) > _MOST_COLLOCATED:
        message = f"grid {name}: {len(tin.z)} points are too many for a collocation ({_MOST_COLLOCATED} at most)"
        raise CompilationError.of(message)
    observed = Observed(place=tin.xy, value=tin.z, sigma=tin.sigma)
    options = InterpolationOptions(trend=Trend.PLANE, families=_FAMILIES, free_noise=False, reject=False)
    try:
        found = interpolate(observed, options)
    except CollocationError as error:
        raise CompilationError.of(f"grid {name}: {error.problems[0].message}") from error
    prediction = found.collocation.predict(posts)
    return prediction.value, found.factor * prediction.sigma, found.grouped
