"""The bottom of a compilation: its surfaces, contours of depth below the sounding datum, and grids of posts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.compilation.compiled import Compiled
from musatpy.compilation.grids import PostGrid, grids_of
from musatpy.compilation.joined_surfaces import EdgeMatch, Surface, surfaces_of
from musatpy.model import CoordinateSystem
from musatpy.model.compilation import ContourSpec
from musatpy.surfaces.contours import Contours, contours, levels_between
from musatpy.surfaces.tin import Tin
from musatpy.units import DEGREE


@dataclass(frozen=True, kw_only=True, eq=False)
class Bottom:
    """The surfaces of a compilation with the contours of each, how its models match, and grids of posts."""

    surfaces: tuple[Surface, ...]
    lines: tuple[Contours, ...]
    edges: tuple[EdgeMatch, ...]
    grids: tuple[PostGrid, ...] = ()


def bottom_of(compiled: Compiled) -> Bottom | None:
    """Return the bottom of a compilation, None where the deck asks for no contours and no grids.

    Raises `MusatError` where matplotlib is missing, `SurfaceError` for too many contours, and `CompilationError`
    for grids that cannot be.
    """
    spec, grids = compiled.deck.contours, compiled.deck.grids
    if spec is None and not len(grids.ids):
        return None
    angular = compiled.run.block.options.system is CoordinateSystem.GEOGRAPHIC
    surfaces, edges = surfaces_of(compiled)
    return Bottom(
        surfaces=surfaces,
        lines=tuple(_contours(surface.tin, spec) for surface in surfaces),
        edges=edges,
        grids=grids_of(grids, surfaces, DEGREE if angular else 1.0),
    )


def _contours(tin: Tin | None, spec: ContourSpec | None) -> Contours:
    if tin is None or spec is None:
        return Contours(lines=(), dropped=0)
    levels = levels_between(float(tin.z.min()), float(tin.z.max()), spec.interval)
    thick = levels[np.rint(levels / spec.interval) % spec.index == 0]
    return contours(tin, levels.tolist(), thick.tolist(), spec.shortest)
