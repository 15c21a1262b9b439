"""A compilation as layers for other programs: its points and contours, in metres of a map about its middle."""

from __future__ import annotations

from typing import Any

import numpy as np

from musatpy.compilation.bottom import Bottom
from musatpy.compilation.compiled import Compiled
from musatpy.geometry.plan import Plan
from musatpy.interchange.layers import Column, Lines, Points
from musatpy.units import MICROMETRE


def layers_of(compiled: Compiled, bottoms: list[Bottom]) -> dict[str, Points | Lines]:
    """Return the layers `points` and `contours`.

    Jobs on an ellipsoid are on a transverse Mercator map about their points, whose datum is the ellipsoid of the
    job and no more; local jobs have no system. Heights are those of the job.
    """
    position = compiled.gathered("position")
    known = np.isfinite(position).all(axis=1)
    system = compiled.run.map_system
    plan = None if system is None or not known.any() else Plan.about(system, position[known])
    place: dict[str, Any] = {"crs": None, "heights": "heights of the job"}
    if plan is not None:
        import pyproj

        place = {
            "crs": pyproj.CRS.from_user_input(plan.map.definition),
            "heights": "above the ellipsoid of the job",
        }
    xyz = position[known] if plan is None else plan.places(position[known])
    layers: dict[str, Points | Lines] = {"points": Points(xyz=xyz, columns=_columns(compiled, known), **place)}
    lines = [(bottom, line) for bottom in bottoms for line in bottom.lines.lines]
    if lines:
        datum, paths = compiled.datum.height, []
        for bottom, line in lines:
            at = bottom.surface.coordinates(line.xy, np.full(len(line.xy), datum - line.level))
            path = at if plan is None else plan.places(at)
            paths.append(np.concatenate([path[:-1], path[:1]]) if line.closed else path)
        columns = {
            "model": Column.of([bottom.model.name for bottom, _ in lines]),
            "depth": Column.of([line.level for _, line in lines], "m"),
            "index_line": Column.of([int(line.index) for _, line in lines]),
        }
        layers["contours"] = Lines.of_paths(paths, columns=columns, **place)
    return layers


def _columns(compiled: Compiled, known: Any) -> dict[str, Column]:
    """Return the columns of the points that have a position."""
    depth, sigma = compiled.datum_depth
    values: dict[str, tuple[Any, str]] = {
        "model": (compiled.model_ids, ""),
        "point": (compiled.deck.stages.ids[compiled.rows], ""),
        "class": (compiled.deck.stages.kind[compiled.rows], ""),
        "submerged": (compiled.submerged.astype(int), ""),
        "depth": (np.where(compiled.submerged, depth, np.nan), "m"),
        "depth_sigma": (np.where(compiled.submerged, sigma, np.nan), "m"),
        "sigma_east": (compiled.sigma[:, 0], "m"),
        "sigma_north": (compiled.sigma[:, 1], "m"),
        "sigma_up": (compiled.sigma[:, 2], "m"),
        "water_level": (compiled.gathered("water_level"), "m"),
        "y_parallax": (compiled.gathered("y_parallax") / MICROMETRE, "um"),
    }
    return {name: Column.of(of[known], unit) for name, (of, unit) in values.items()}
