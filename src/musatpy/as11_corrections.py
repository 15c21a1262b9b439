"""A file of an old compilation, read, corrected in a stereomodel of a run, and written (`musat as11 correct`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from musatpy.as11_runs import run_of
from musatpy.compilation.correcting import REASONS, Correction
from musatpy.compilation.correction_fields import smooth
from musatpy.compilation.correction_layers import (
    Corrector,
    Tally,
    corrected_grid,
    corrected_lines,
    corrected_points,
)
from musatpy.compilation.stereomodels import set_up
from musatpy.compilation.triangulation import Triangulation
from musatpy.errors import CompilationError, Problem
from musatpy.geometry.crs import LongitudeLatitude, system_of
from musatpy.geometry.systems import LocalRectangular, System
from musatpy.interchange.any_file import Layers, read_layers, write_layers
from musatpy.interchange.layers import LOCAL, Grid, Lines, Points
from musatpy.units import MICROMETRE

if TYPE_CHECKING:
    import pyproj

_MANY = 50_000  # points, from which on polynomials stand for the correction
_FEW = 20_000  # points by which a file is known to be of the model


@dataclass(frozen=True, kw_only=True, eq=False)
class CorrectedFile:
    """What came of the points, vertices or posts of a file, layer by layer, and as what they were taken."""

    layers: Mapping[str, Tally]
    system: System
    caution: str = ""

    def lines(self) -> Iterator[str]:
        """Yield in words what was corrected."""
        for name, done in self.layers.items():
            words = f"{name}: {done.known} of {done.count} with a position, {done.wet} under water"
            if done.wet:
                words += (
                    f"; down to {done.deepest:.3f} m, moved in plan by up to {done.shift:.3f} m, "
                    f"sigma of a depth {done.depth_sigma:.3f} m"
                )
            yield words
        yield f"taken as {self.system.text}"

    def warnings(self) -> Iterator[str]:
        """Yield what is odd about the run, how many points have no position, by reason, and that none is wet."""
        if self.caution:
            yield self.caution
        for name, done in self.layers.items():
            if done.known and not done.wet:
                yield f"{name}: nothing is under water: heights are positive up"
            for why, count in zip(REASONS, done.lost.tolist(), strict=True):
                if count:
                    yield f"{name}: {count} without a position: {why or 'no apparent height'}"


def correct_file(
    run: Path,
    photos: tuple[str, str],
    source: Path,
    target: Path,
    *,
    anyway: bool = False,
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

    triangulation = run_of(run, anyway)
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
    done: dict[str, Tally] = {}
    for name, part in layers.items():
        corrector = _corrector(correction, part, band)
        true[name], done[name] = _corrected(corrector, replace(part, crs=part.crs or _crs_of(system)), band)
    write_layers(target, true)
    return CorrectedFile(layers=done, system=system, caution=triangulation.caution)


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


def _corrector(correction: Correction, part: Points | Lines | Grid, band: str) -> Corrector:
    """Return what corrects a layer: the correction itself or, where there are many points, polynomials of it.

    Raises `CompilationError` where none of the points is in the model.
    """
    if isinstance(part, Grid):
        height = part.bands[_band(part, band)]
        step = max(1, int(np.sqrt(height.size / _FEW)))
        row, column = (step * places for places in np.nonzero(np.isfinite(height[::step, ::step])))
        plane = [part.west + part.spacing * column, part.south + part.spacing * row]
        few, count = np.column_stack([*plane, height[row, column]]), height.size
        heights = (float(np.nanmin(height)), float(np.nanmax(height))) if len(few) else (0.0, 0.0)
    else:
        apparent = part.xyz if isinstance(part, Points) else np.concatenate(part.vertices)
        few, count = apparent[:: max(1, len(apparent) // _FEW)], len(apparent)
        heights = (float(apparent[:, 2].min()), float(apparent[:, 2].max()))
    correction.require_model(few)
    return (smooth(correction, heights) if count >= _MANY else None) or correction


def _corrected(
    correction: Corrector, part: Points | Lines | Grid, band: str
) -> tuple[Points | Lines | Grid, Tally]:
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
