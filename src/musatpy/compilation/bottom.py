"""The bottom of a model: triangles over its submerged points, and contours of depth below the sounding datum.

Points of the run that are read again check the model, and make no bottom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.compilation.compiled import Compiled, CompiledModel
from musatpy.errors import SurfaceError
from musatpy.geometry.frames import GeocentricFrame, GeographicFrame
from musatpy.geometry.plan import Plan
from musatpy.geometry.systems import Geocentric, Geographic, System
from musatpy.model.compilation import AGAIN, ContourSpec
from musatpy.surfaces.contours import Contours, contours, levels_between
from musatpy.surfaces.tin import Tin


@dataclass(frozen=True, kw_only=True, eq=False)
class Bottom:
    """The surface of a model in plan, metres east and north of its middle (X, Y of local jobs), depths positive.

    None with its `reason` where the points make none. `plan` takes places back to the job, None in local jobs.
    """

    model: CompiledModel
    tin: Tin | None
    lines: Contours
    plan: Plan | None
    reason: str = ""

    def coordinates(self, xy: FloatArray, depth: float, datum: float) -> FloatArray:
        """Return coordinates (k, 3) of the job of places (k, 2) at a depth below a datum."""
        places = np.column_stack([xy, np.full(len(xy), datum - depth)])
        return places if self.plan is None else self.plan.coordinates(places)


def bottoms_of(compiled: Compiled) -> list[Bottom]:
    """Return the bottom of each model, none where the deck asks for no contours.

    Raises `MusatError` where matplotlib is missing, and `SurfaceError` for too many contours.
    """
    spec, (depth, sigma), first = compiled.deck.contours, compiled.datum_depth, 0
    bottoms: list[Bottom] = []
    if spec is None:
        return bottoms
    for model in compiled.models:
        rows = slice(first, first := first + len(model.rows))
        again = compiled.deck.stages.kind[model.rows] == AGAIN
        used = np.flatnonzero(model.readings.submerged & ~again & np.isfinite(depth[rows]))
        bottoms.append(_bottom(model, spec, used, np.stack([depth[rows], sigma[rows]])[:, used]))
    return bottoms


def _bottom(model: CompiledModel, spec: ContourSpec, rows: IntArray, depths: FloatArray) -> Bottom:
    """Return the bottom by the points `rows` (k,) of a model, with depths (2, k) and their sigmas."""
    nothing = Contours(lines=(), dropped=0)
    if not len(rows):
        return Bottom(
            model=model, tin=None, lines=nothing, plan=None, reason="no submerged point of it has a position"
        )
    position, system = model.points.position[rows], _system(model)
    plan = None if system is None else Plan.about(system, position)
    xy = (position if plan is None else plan.places(position))[:, :2]
    try:
        tin = Tin.of(np.column_stack([xy, depths[0]]), depths[1], spec.longest_edge)
    except SurfaceError as error:
        return Bottom(model=model, tin=None, lines=nothing, plan=plan, reason=error.problems[0].message)
    levels = levels_between(float(tin.z.min()), float(tin.z.max()), spec.interval)
    thick = levels[np.rint(levels / spec.interval) % spec.index == 0]
    return Bottom(
        model=model, tin=tin, lines=contours(tin, levels.tolist(), thick.tolist(), spec.shortest), plan=plan
    )


def _system(model: CompiledModel) -> System | None:
    """Return the system of the coordinates of a job on the ellipsoid, None of a local one."""
    frame = model.stereo.run.frame
    if not isinstance(frame, GeocentricFrame):
        return None
    return (Geographic if isinstance(frame, GeographicFrame) else Geocentric)(frame.ellipsoid)
