"""A file of an old compilation, read, corrected in a stereomodel of a run, and written (`musat as11 correct`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from musatpy.compilation.correcting import (
    Corrected,
    Correction,
    corrected_grid,
    corrected_lines,
    corrected_points,
)
from musatpy.compilation.stereomodels import set_up
from musatpy.compilation.triangulation import Triangulation, of_record
from musatpy.errors import CompilationError, Problem
from musatpy.geometry.crs import LongitudeLatitude, system_of
from musatpy.geometry.systems import LocalRectangular, System
from musatpy.interchange.any_file import Layers, read_layers, write_layers
from musatpy.interchange.layers import LOCAL, Grid, Lines, Points
from musatpy.units import MICROMETRE

if TYPE_CHECKING:
    import pyproj


@dataclass(frozen=True, kw_only=True, eq=False)
class CorrectedFile:
    """What came of the points, vertices or posts of a file, layer by layer, and as what they were taken."""

    layers: Mapping[str, Corrected]
    system: System

    def lines(self) -> Iterator[str]:
        """Yield in words what was corrected."""
        for name, done in self.layers.items():
            wet = np.isfinite(done.depth)
            words = (
                f"{name}: {int(done.known.sum())} of {len(done.xyz)} with a position, {int(wet.sum())} under water"
            )
            if wet.any():
                words += (
                    f"; down to {done.depth[wet].max():.3f} m, moved in plan by up to {np.nanmax(done.shift):.3f} m"
                    f", sigma of a depth {np.median(done.depth_sigma[wet]):.3f} m (median)"
                )
            yield words
        yield f"taken as {self.system.text}"

    def warnings(self) -> Iterator[str]:
        """Yield how many have no position, by reason, and that all are above the water."""
        for name, done in self.layers.items():
            if done.known.any() and not np.isfinite(done.depth).any():
                yield f"{name}: nothing is under water: heights are positive up"
            reasons, counts = np.unique(done.reason[~done.known], return_counts=True)
            for why, count in zip(reasons.tolist(), counts.tolist(), strict=True):
                yield f"{name}: {count} without a position: {why or 'no apparent height'}"


def correct_file(
    run: Path,
    photos: tuple[str, str],
    source: Path,
    target: Path,
    *,
    crs: str = "",
    geoid: str = "",
    layer: str = "",
    band: str = "",
    pointing: float | None = None,
) -> CorrectedFile:
    """Correct the apparent points, lines or grid of a file in the model of two photos, and write the true ones.

    `pointing` (um): sigma of image coordinates, by default of the plates of the run. Raises `CompilationError`,
    `InterchangeError` or `SystemsError` for what cannot be used, and `OSError`; then nothing is written.
    """
    import pyproj

    triangulation = of_record(run)
    stereo = set_up(triangulation, *photos)
    local = triangulation.map_system is None
    if local and (crs or geoid):
        raise CompilationError(
            [Problem(message="--crs, --geoid: the run is a local job, in no system of a register")]
        )
    stand_in = LOCAL if local else crs
    layers = read_layers(source, pyproj.CRS.from_user_input(stand_in) if stand_in else None, layer)
    system = _system_of(source, layers, triangulation, crs, geoid)
    sigma = triangulation.block.options.plate_sigma * triangulation.unit_sigma
    correction = Correction(
        stereo=stereo, system=system, pointing=sigma if pointing is None else pointing * MICROMETRE
    )
    true: Layers = {}
    done: dict[str, Corrected] = {}
    for name, part in layers.items():
        _require_model(correction, part, band)
        true[name], done[name] = _corrected(correction, replace(part, crs=part.crs or _crs_of(system)), band)
    write_layers(target, true)
    return CorrectedFile(layers=done, system=system)


def _system_of(source: Path, layers: Layers, run: Triangulation, crs: str, geoid: str) -> System:
    """Return the system of the points of a file: as it is said, as the file says, else that of the job."""
    stated = next((part.crs for part in layers.values() if part.crs is not None), None)
    if run.map_system is None:
        if stated is not None:
            message = f"the run is a local job, and the file is in {stated.name}"
            raise CompilationError([Problem(file=str(source), message=message)])
        return LocalRectangular()
    ellipsoid = run.map_system.ellipsoid
    assert ellipsoid is not None  # of a job that is on one
    definition = crs or (stated.to_wkt() if stated is not None else "")
    if definition:
        return system_of(definition, ellipsoid, geoid)
    if geoid:
        raise CompilationError([Problem(message="--geoid goes with --crs")])
    return LongitudeLatitude(ellipsoid)


def _crs_of(system: System) -> pyproj.CRS | None:
    """Return what files say of longitude and latitude on the ellipsoid of a run; no datum is known."""
    import pyproj

    if not isinstance(system, LongitudeLatitude):
        return None
    return pyproj.CRS.from_user_input(f"+proj=longlat {system.ellipsoid.definition} +type=crs")


def _require_model(correction: Correction, part: Points | Lines | Grid, band: str) -> None:
    if isinstance(part, Points):
        correction.require_model(part.xyz)
    elif isinstance(part, Lines):
        correction.require_model(np.concatenate(part.vertices))
    else:
        height = part.bands[_band(part, band)]
        row, column = np.nonzero(np.isfinite(height))
        place = [part.west + part.spacing * column, part.south + part.spacing * row, height[row, column]]
        correction.require_model(np.column_stack(place))


def _corrected(
    correction: Correction, part: Points | Lines | Grid, band: str
) -> tuple[Points | Lines | Grid, Corrected]:
    if isinstance(part, Points):
        return corrected_points(correction, part)
    if isinstance(part, Lines):
        return corrected_lines(correction, part)
    return corrected_grid(correction, part, _band(part, band))


def _band(grid: Grid, wanted: str) -> str:
    """Return the band of heights: the one that is wanted, or the only one. Raises `CompilationError`."""
    if wanted in grid.bands or (not wanted and len(grid.bands) == 1):
        return wanted or next(iter(grid.bands))
    message = f"which band has the heights? --band is one of {', '.join(grid.bands)}"
    raise CompilationError([Problem(message=message)])
