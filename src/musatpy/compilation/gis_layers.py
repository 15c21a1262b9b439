"""A compilation as layers for other programs: its points and contours, on a map about it or in a system."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.bottom import Bottom, PostGrid
from musatpy.compilation.compiled import Compiled, DepthDatum
from musatpy.compilation.joined_surfaces import Of
from musatpy.errors import CompilationError
from musatpy.geometry.crs import MapPlan, system_of
from musatpy.geometry.projected import crs_of
from musatpy.geometry.systems import Geocentric
from musatpy.interchange.layers import Grid, LayerColumn, Lines, Points
from musatpy.units import MICROMETRE


def _placement(compiled: Compiled, crs: str) -> tuple[Callable[[FloatArray], FloatArray], dict[str, Any]]:
    """Return how positions (k, 3) of the job come into the system of layers, and this with what heights are.

    `crs`; a map about the points of a job on an ellipsoid; that of a local job. The datum of the map is the
    ellipsoid of the job and no more. Raises `SystemsError` for a system that is not on the ellipsoid of the job,
    and `CompilationError` for one of a local job.
    """
    position, system = compiled.points.position, compiled.run.map_system
    known = np.isfinite(position).all(axis=1)
    if system is None or not known.any():
        if crs:
            raise CompilationError.of("--crs: the run is a local job, in no registered system")
        return np.asarray, {"crs": None, "heights": "heights of the job"}
    import pyproj

    heights, frame = "above the ellipsoid of the job", compiled.run.frame
    if not crs:
        plan = MapPlan.about(system, position[known])
        return plan.places, {"crs": pyproj.CRS.from_user_input(plan.map.definition), "heights": heights}
    assert system.ellipsoid is not None  # of a job that is on one
    target = system_of(crs, system.ellipsoid)
    if isinstance(target, Geocentric):
        raise CompilationError.of(f"--crs: {crs} is geocentric, and maps are not")

    def places(positions: FloatArray) -> FloatArray:
        return target.coordinates(frame.level(frame.working(positions)))

    return places, {"crs": crs_of(crs), "heights": heights}


def layers_of(compiled: Compiled, bottoms: Sequence[Bottom], crs: str = "") -> dict[str, Points | Lines]:
    """Return the layers `points`, `contours` and `heights`, in a system or on a map about the points of the job.

    Heights are those of the job. Raises `SystemsError` and `CompilationError` for a system that it is not in.
    """
    places, system = _placement(compiled, crs)
    known = np.isfinite(compiled.points.position).all(axis=1)
    xyz = places(compiled.points.position[known])
    layers: dict[str, Points | Lines] = {"points": Points(xyz=xyz, columns=_columns(compiled, known), **system)}
    for bottom in bottoms:
        if any(sheet.contours.lines for sheet in bottom.sheets):
            layers[bottom.of.layer] = _contours(bottom, compiled.datum, places, system)
    return layers


def _contours(
    bottom: Bottom, datum: DepthDatum, places: Callable[[FloatArray], FloatArray], system: dict[str, Any]
) -> Lines:
    """Return contours as lines; those at one height have no rounding of the way there."""
    lines = [(sheet, line) for sheet in bottom.sheets for line in sheet.contours.lines]
    paths = []
    for sheet, line in lines:
        path = places(bottom.vertices(sheet, line, datum))
        if bottom.of is Of.HEIGHT:
            path[:, 2] = line.level
        elif datum.geoid is None:
            path[:, 2] = datum.height - line.level
        paths.append(np.concatenate([path[:-1], path[:1]]) if line.closed else path)
    columns = {
        "surface": LayerColumn.of([sheet.name for sheet, _ in lines]),
        str(bottom.of): LayerColumn.of([line.level for _, line in lines], "m"),
        "index_line": LayerColumn.of([int(line.index) for _, line in lines]),
    }
    return Lines.of_paths(paths, columns=columns, **system)


def raster_of(grid: PostGrid, datum: DepthDatum) -> Grid:
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
        heights=f"depths below {datum.title}",
    )


def _columns(compiled: Compiled, known: Any) -> dict[str, LayerColumn]:
    """Return the columns of the points that have a position."""
    values: dict[str, tuple[Any, str]] = {
        "model": (compiled.model_ids, ""),
        "point": (compiled.ids, ""),
        "class": (compiled.kind, ""),
        "submerged": (compiled.submerged.astype(int), ""),
        "depth": (np.where(compiled.submerged, compiled.datum_depth, np.nan), "m"),
        "depth_sigma": (np.where(compiled.submerged, compiled.datum_depth_sigma, np.nan), "m"),
        "s44_order": (compiled.orders, ""),
        "sigma_east": (compiled.sigma[:, 0], "m"),
        "sigma_north": (compiled.sigma[:, 1], "m"),
        "sigma_up": (compiled.sigma[:, 2], "m"),
        "water_level": (compiled.points.water_level, "m"),
        "y_parallax": (compiled.points.y_parallax / MICROMETRE, "um"),
    }
    return {name: LayerColumn.of(of[known], unit) for name, (of, unit) in values.items()}
