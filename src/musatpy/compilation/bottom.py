"""The bottom of a model: triangles over its submerged points, and contours of depth below the sounding datum.

Points of the run that are read again check the model, and make no bottom; nor do spikes of profiles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.compilation.compiled import Compiled, CompiledModel
from musatpy.compilation.profiles import profiles_of
from musatpy.errors import SurfaceError
from musatpy.geometry.plan import Plan
from musatpy.model.compilation import AGAIN, ContourSpec
from musatpy.surfaces.contours import Contours, contours, levels_between
from musatpy.surfaces.tin import Tin


@dataclass(frozen=True, kw_only=True, eq=False)
class BottomPoints:
    """k points of a bottom, xy (k, 2) m: depths below the datum (k,) m, with sigmas, and those of the water."""

    xy: FloatArray
    depth: FloatArray
    sigma: FloatArray
    water: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """The surface of a model in plan, metres east and north of its middle (X, Y of local jobs), depths positive.

    The network is None, with its `reason`, where the points make none. `plan` takes places back to the job, None in
    local jobs.
    """

    model: CompiledModel
    points: BottomPoints
    tin: Tin | None
    plan: Plan | None
    reason: str = ""

    def coordinates(self, xy: FloatArray, height: FloatArray) -> FloatArray:
        """Return coordinates (k, 3) of the job of places (k, 2) at heights (k,)."""
        places = np.column_stack([xy, height])
        return places if self.plan is None else self.plan.coordinates(places)

    def places(self, coordinates: FloatArray) -> FloatArray:
        """Return the places (k, 2) of the first two coordinates (k, 2) of the job."""
        if self.plan is None:
            return coordinates
        return self.plan.places(np.column_stack([coordinates, np.zeros(len(coordinates))]))[:, :2]


@dataclass(frozen=True, kw_only=True, eq=False)
class Bottom:
    """The surface of a model with its contours."""

    surface: Surface
    lines: Contours

    @property
    def model(self) -> CompiledModel:
        """The model."""
        return self.surface.model

    @property
    def tin(self) -> Tin | None:
        """The triangles."""
        return self.surface.tin


def surfaces_of(compiled: Compiled) -> list[Surface]:
    """Return the surface of each model: depths below the sounding datum."""
    longest = compiled.deck.contours.longest_edge if compiled.deck.contours else np.inf
    (depth, sigma), first, surfaces = compiled.datum_depth, 0, []
    spike = np.zeros(len(depth), dtype=bool)
    for line in profiles_of(compiled):
        spike[line.rows] |= line.profile.spike if line.profile else False
    for model in compiled.models:
        rows = slice(first, first := first + len(model.rows))
        again = compiled.deck.stages.kind[model.rows] == AGAIN
        used = np.flatnonzero(model.readings.submerged & ~again & ~spike[rows] & np.isfinite(depth[rows]))
        water = compiled.datum.height - model.points.water_level
        surfaces.append(_surface(model, used, np.stack([depth[rows], sigma[rows], water])[:, used], longest))
    return surfaces


def bottoms_of(compiled: Compiled) -> list[Bottom]:
    """Return the bottom of each model, none where the deck asks for no contours.

    Raises `MusatError` where matplotlib is missing, and `SurfaceError` for too many contours.
    """
    spec = compiled.deck.contours
    return [] if spec is None else [_bottom(surface, spec) for surface in surfaces_of(compiled)]


def _surface(model: CompiledModel, rows: IntArray, depths: FloatArray, longest_edge: float) -> Surface:
    """Return the surface by points `rows` (k,) of a model; depths (3, k): theirs, sigmas, those of the water."""
    position, system = model.points.position[rows], model.stereo.run.map_system
    plan = None if system is None or not len(rows) else Plan.about(system, position)
    xy = (position if plan is None else plan.places(position))[:, :2]
    points = BottomPoints(xy=xy, depth=depths[0], sigma=depths[1], water=depths[2])
    if not len(rows):
        reason = "no submerged point of it has a position"
        return Surface(model=model, points=points, tin=None, plan=None, reason=reason)
    try:
        tin = Tin.of(np.column_stack([xy, points.depth]), points.sigma, longest_edge)
    except SurfaceError as error:
        return Surface(model=model, points=points, tin=None, plan=plan, reason=error.problems[0].message)
    return Surface(model=model, points=points, tin=tin, plan=plan)


def _bottom(surface: Surface, spec: ContourSpec) -> Bottom:
    tin = surface.tin
    if tin is None:
        return Bottom(surface=surface, lines=Contours(lines=(), dropped=0))
    levels = levels_between(float(tin.z.min()), float(tin.z.max()), spec.interval)
    thick = levels[np.rint(levels / spec.interval) % spec.index == 0]
    return Bottom(surface=surface, lines=contours(tin, levels.tolist(), thick.tolist(), spec.shortest))
