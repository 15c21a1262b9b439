"""A file of an old compilation, read, corrected in a stereomodel of a run, and written (`musat as11 correct`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.as11_runs import run_of
from musatpy.compilation.correcting import REASONS, Correction
from musatpy.compilation.correction_fields import smooth
from musatpy.compilation.correction_layers import (
    Corrector,
    Survey,
    Tally,
    correct_cloud,
    corrected_lines,
    corrected_points,
    total,
)
from musatpy.compilation.correction_rasters import BANDS, apparent_posts, corrected_rows, true_posts
from musatpy.compilation.misplaced_points import require_model
from musatpy.compilation.stereomodels import Stereomodel, set_up
from musatpy.compilation.triangulation import Triangulation
from musatpy.compilation.verdicts import verdict_of_correction
from musatpy.errors import CompilationError, Problem, SystemsError
from musatpy.geometry.crs import LongitudeLatitude, system_of
from musatpy.geometry.projected import crs_of
from musatpy.geometry.systems import LocalRectangular, System
from musatpy.interchange import geotiff
from musatpy.interchange.any_file import (
    CLOUDS,
    POINT_FILES,
    RASTERS,
    Layers,
    read_layers,
    read_points,
    write_layers,
    write_points,
)
from musatpy.interchange.layers import LOCAL, Grid, Points, placed
from musatpy.interchange.packages import refuse
from musatpy.model import Verdict
from musatpy.units import MICROMETRE

if TYPE_CHECKING:
    import pyproj

_MANY = 50_000  # points, from which on polynomials stand for the correction


_Done = tuple[Mapping[str, Tally], System]  # what came of layers, and as what their places were taken


@dataclass(frozen=True, kw_only=True, eq=False)
class CorrectedFile:
    """What came of the points, vertices or posts of a file, layer by layer, and as what they were taken."""

    layers: Mapping[str, Tally]
    system: System
    verdict: Verdict

    def lines(self) -> Iterator[str]:
        """Yield in words what it is worth, and what was corrected."""
        for number, (name, done) in enumerate(self.layers.items()):
            grade = "" if number else f"{self.verdict.grade}, "
            words = f"{grade}{name}: {done.known} of {done.count} with a position, {done.wet} under water"
            if done.wet:
                words += (
                    f"; down to {done.deepest:.3f} m, moved in plan by up to {done.shift:.3f} m, "
                    f"sigma of a depth {done.depth_sigma:.3f} m"
                )
            yield words
        yield f"taken as {self.system.text}"

    def warnings(self) -> Iterator[str]:
        """Yield the reasons of the verdict, what is to be known of the run, how many points are lost, by reason."""
        yield from (f"{reason.grade.lower()}: {reason.text}" for reason in self.verdict.reasons)
        yield from self.verdict.notes
        for name, done in self.layers.items():
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

    Files of points and rasters may be of any size: they are read twice, and never whole. `pointing` (um): sigma of
    image coordinates, by default of the plates of the run. Raises `CompilationError`, `InterchangeError` or
    `SystemsError` for what cannot be used, and `OSError`; then nothing is written.
    """
    triangulation = run_of(run, anyway)
    if triangulation.map_system is None and (crs or geoid):
        raise CompilationError(
            [Problem(message="--crs, --geoid: the run is a local job, in no system of a register")]
        )
    sigma = triangulation.block.options.plate_sigma * triangulation.unit_sigma
    work = _Work(
        stereo=set_up(triangulation, *photos),
        pointing=sigma if pointing is None else pointing * MICROMETRE,
        source=source,
        target=target,
        crs=crs,
        geoid=geoid,
        layer=layer,
        band=band,
    )
    with _about(source):
        if source.suffix.lower() in RASTERS:
            layers, system = work.raster()
        elif {source.suffix.lower(), target.suffix.lower()} <= {*POINT_FILES}:
            layers, system = work.points()
        else:
            layers, system = work.layers()
    return CorrectedFile(layers=layers, system=system, verdict=verdict_of_correction(layers, triangulation))


@contextmanager
def _about(source: Path) -> Iterator[None]:
    """Let problems with points and their systems name the file that they are in."""
    try:
        yield
    except (CompilationError, SystemsError) as error:
        raise type(error)(
            [replace(problem, file=problem.file or str(source)) for problem in error.problems]
        ) from error


@dataclass(frozen=True, kw_only=True, eq=False)
class _Work:
    """A file that is corrected in a stereomodel, into which one; what options say of it."""

    stereo: Stereomodel
    pointing: float  # mm
    source: Path
    target: Path
    crs: str
    geoid: str
    layer: str
    band: str

    @property
    def stand_in(self) -> pyproj.CRS | None:
        """The system of files that say none."""
        stand_in = LOCAL if self.stereo.run.map_system is None else self.crs
        return crs_of(stand_in) if stand_in else None

    def correction(self, stated: pyproj.CRS | None) -> Correction:
        """Return the correction of points in the system that a file states, or that stands in."""
        system = _system_of(self.source, placed(stated), self.stereo.run, self.crs, self.geoid)
        return Correction(stereo=self.stereo, system=system, pointing=self.pointing)

    def written_crs(self, stated: pyproj.CRS | None, system: System) -> pyproj.CRS | None:
        """Return the system that a result states: that of the option, else of the file, else of the run."""
        return placed(self.stand_in) or placed(stated) or _crs_of(system)

    def points(self) -> _Done:
        """Correct a file of points chunk by chunk."""
        crs = next(read_points(self.source, self.stand_in)).crs
        correction = self.correction(crs)
        places = (part.xyz for part in read_points(self.source, self.stand_in, alone=True))
        corrector = _corrector(correction, Survey.of(places))
        tallies: list[Tally] = []
        if {self.source.suffix.lower(), self.target.suffix.lower()} <= {*CLOUDS}:
            correct_cloud(self.source, self.target, corrector, tallies)
        else:
            write_points(
                self.target, self._true_points(corrector, self.written_crs(crs, correction.system), tallies)
            )
        return {"points": total(tallies)}, correction.system

    def _true_points(self, corrector: Corrector, crs: pyproj.CRS | None, tallies: list[Tally]) -> Iterator[Points]:
        for apparent in read_points(self.source, self.stand_in):
            true, tally = corrected_points(corrector, replace(apparent, crs=crs))
            tallies.append(tally)
            yield true

    def raster(self) -> _Done:
        """Correct a raster row by row: into one, or into the posts that have a position as points."""
        if self.target.suffix.lower() not in (*RASTERS, *POINT_FILES):
            raise refuse(
                self.target, "", "a raster becomes a raster or points", ", ".join((*RASTERS, *POINT_FILES))
            )
        with geotiff.opened(self.source, self.stand_in) as raster:
            posts, band = raster.posts, _band(raster.names, self.band)
            correction = self.correction(posts.crs)
            posts = replace(posts, crs=self.written_crs(posts.crs, correction.system))

            def heights(first: int, last: int) -> FloatArray:
                return raster.rows(band, first, last)

            corrector = _corrector(correction, Survey.of(apparent_posts(posts, heights)))
            tallies: list[Tally] = []
            if self.target.suffix.lower() in RASTERS:
                with geotiff.written(self.target, posts, dict.fromkeys(BANDS, "m")) as writer:
                    for rows in corrected_rows(corrector, posts, heights):
                        tallies.append(rows.tally)
                        writer.put(rows.first, rows.values)
            else:
                write_points(self.target, true_posts(corrector, posts, heights, tallies))
        return {"grid": total(tallies)}, correction.system

    def layers(self) -> _Done:
        """Correct a file of points or lines as a whole."""
        layers = read_layers(self.source, self.stand_in, self.layer)
        stated = next((part.crs for part in layers.values() if part.crs is not None), None)
        correction = self.correction(stated)
        true: Layers = {}
        done: dict[str, Tally] = {}
        for name, part in layers.items():
            assert not isinstance(part, Grid)  # rasters go another way
            apparent = part.xyz if isinstance(part, Points) else np.concatenate(part.vertices)
            corrector = _corrector(correction, Survey.of([apparent]))
            part = replace(part, crs=self.written_crs(part.crs, correction.system))
            if isinstance(part, Points):
                true[name], done[name] = corrected_points(corrector, part)
            else:
                true[name], done[name] = corrected_lines(corrector, part)
        write_layers(self.target, true)
        return done, correction.system


def _corrector(correction: Correction, survey: Survey) -> Corrector:
    """Return what corrects points: the correction itself or, where there are many points, polynomials of it.

    Raises `CompilationError` where none of the points is in the model.
    """
    require_model(correction, survey.few)
    return (smooth(correction, survey.heights) if survey.count >= _MANY else None) or correction


def _band(names: Sequence[str], wanted: str) -> str:
    """Return the band of heights: the one that is wanted, or the only one. Raises `CompilationError`."""
    if wanted in names or (not wanted and len(names) == 1):
        return wanted or names[0]
    message = f"which band has the heights? --band is one of {', '.join(names)}"
    raise CompilationError([Problem(message=message)])


def _system_of(source: Path, stated: pyproj.CRS | None, run: Triangulation, crs: str, geoid: str) -> System:
    """Return the system of the points of a file: as it is said, as the file says, else that of the job."""
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
