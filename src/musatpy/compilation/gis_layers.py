"""A compilation as layers for other programs: its points and contours, in metres of a map about its middle."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from musatpy.compilation.bottom import Bottom
from musatpy.compilation.compiled import Compiled
from musatpy.compilation.grids import PostGrid
from musatpy.compilation.joined_surfaces import Surface
from musatpy.geometry.plan import Plan
from musatpy.interchange.layers import Column, Grid, Lines, Points
from musatpy.model.compilation import SoundingDatum
from musatpy.surfaces.contours import Contour
from musatpy.units import MICROMETRE


def layers_of(compiled: Compiled, bottom: Bottom | None) -> dict[str, Points | Lines]:
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
    lines = [] if bottom is None else list(_numbered_lines(bottom))
    if lines:
        datum, paths = compiled.datum.height, []
        for _, surface, line in lines:
            at = surface.coordinates(line.xy, np.full(len(line.xy), datum - line.level))
            path = at if plan is None else plan.places(at)
            paths.append(np.concatenate([path[:-1], path[:1]]) if line.closed else path)
        columns = {
            "surface": Column.of([number for number, _, _ in lines]),
            "depth": Column.of([line.level for _, _, line in lines], "m"),
            "index_line": Column.of([int(line.index) for _, _, line in lines]),
        }
        layers["contours"] = Lines.of_paths(paths, columns=columns, **place)
    return layers


def raster_of(grid: PostGrid, datum: SoundingDatum) -> Grid:
    """Return the depths of a grid of posts and their sigmas; on the map of the points, or in a local system."""
    crs = None
    if grid.surface.plan is not None:
        import pyproj

        crs = pyproj.CRS.from_user_input(grid.surface.plan.map.definition)
    return Grid(
        west=grid.west,
        south=grid.south,
        spacing=grid.spacing,
        bands={"depth": grid.depth, "sigma": grid.sigma},
        units={"depth": "m", "sigma": "m"},
        crs=crs,
        heights=f"depths below {datum.name or 'the height 0 of the job'}",
    )


def _numbered_lines(bottom: Bottom) -> Iterator[tuple[int, Surface, Contour]]:
    for number, (surface, drawn) in enumerate(zip(bottom.surfaces, bottom.lines, strict=True), 1):
        for line in drawn.lines:
            yield number, surface, line


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
