"""What is drawn of a compilation: surfaces of depth or of height, their contours, and grids of posts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.compiled import Compiled
from musatpy.compilation.datums import Datum
from musatpy.compilation.grids import PostGrid, grids_of
from musatpy.compilation.joined_surfaces import EdgeMatch, Of, Surface, surfaces_of
from musatpy.model import CoordinateSystem
from musatpy.model.compilation import ContourSpec
from musatpy.surfaces.contours import Contour, Contours, contours, levels_between
from musatpy.surfaces.grid_contours import grid_contours
from musatpy.units import DEGREE

_SAME = 1e-6  # m, of levels


@dataclass(frozen=True, kw_only=True, eq=False)
class Sheet:
    """The contours of one surface: of its triangles, or of the posts of a grid, by whose name it goes then."""

    name: str
    surface: Surface
    contours: Contours


@dataclass(frozen=True, kw_only=True, eq=False)
class Bottom:
    """The surfaces of a compilation with their contours, how its models match, and grids of posts.

    Surfaces are of depths below the sounding datum, or of heights.
    """

    surfaces: tuple[Surface, ...]
    sheets: tuple[Sheet, ...]
    edges: tuple[EdgeMatch, ...]
    grids: tuple[PostGrid, ...] = ()
    of: Of = Of.DEPTH

    @property
    def named(self) -> list[tuple[str, Surface]]:
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

    def vertices(self, sheet: Sheet, line: Contour, datum: Datum) -> FloatArray:
        """Return the vertices (k, 3) of a contour in the system of the job."""
        level = np.full(len(line.xy), line.level)
        if self.of is Of.HEIGHT:
            return sheet.surface.coordinates(line.xy, level)
        return sheet.surface.below(line.xy, level, datum)

    def dropped(self, surface: Surface) -> int:
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


def _sheets(surfaces: Iterable[tuple[str, Surface]], spec: ContourSpec) -> tuple[Sheet, ...]:
    """Return the contours of the triangles of surfaces."""
    sheets = []
    for name, surface in surfaces:
        tin, lines = surface.tin, Contours(lines=(), dropped=0)
        if tin is not None:
            draw = partial(contours, tin, shortest=spec.shortest)
            lines = _contours(spec, float(tin.z.min()), float(tin.z.max()), draw)
        sheets.append(Sheet(name=name, surface=surface, contours=lines))
    return tuple(sheets)


def _of_posts(grid: PostGrid, spec: ContourSpec) -> Sheet:
    """Return the contours of the posts of a grid."""
    lines = Contours(lines=(), dropped=0)
    if np.isfinite(grid.depth).any():
        low, high = float(np.nanmin(grid.depth)), float(np.nanmax(grid.depth))
        draw = partial(grid_contours, grid.depth, (grid.west, grid.south), grid.spacing, shortest=spec.shortest)
        lines = _contours(spec, low, high, draw)
    return Sheet(name=grid.name, surface=grid.surface, contours=lines)


def _contours(spec: ContourSpec, low: float, high: float, draw: Callable[..., Contours]) -> Contours:
    """Return contours at multiples of the interval and at levels listed, those only that a surface reaches."""
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
    return draw(levels=sorted(levels), index=thick)
