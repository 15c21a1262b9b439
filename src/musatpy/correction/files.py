"""A file of apparent points, lines or heights, written again with the true ones (`musat correct`).

A point that cannot be corrected keeps its apparent place, has no true place, and has a reason.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import pyproj

from musatpy.correction.layers import BARE, correct_by_photographs, kind_of, read_heights
from musatpy.correction.photographs import Photographs
from musatpy.correction.rasters import band_of, correct_raster
from musatpy.correction.surfaces import correct_surface
from musatpy.depth.cameras import system_of_points
from musatpy.depth.corrected_files import correct_csv, correct_las
from musatpy.depth.correction import Correction, CorrectionTally, Progress
from musatpy.errors import DepthError, Problem
from musatpy.geometry.crs import LongitudeLatitude
from musatpy.geometry.projected import crs_of
from musatpy.geometry.systems import System
from musatpy.interchange import geotiff
from musatpy.interchange.any_file import RASTERS, write_layers
from musatpy.interchange.layers import LOCAL, placed
from musatpy.pointfiles.las_files import SUFFIXES
from musatpy.refraction.apparent import Fault

_DEEPEST = 80.0  # m, beyond what light comes back from in the clearest water


@dataclass(frozen=True, kw_only=True, eq=False)
class CorrectedFile:
    """What came of the points of a file, as what they were taken, and why they have no sigmas, if so."""

    tally: CorrectionTally
    system: System
    photographs: Photographs

    def lines(self) -> Iterator[str]:
        """Yield this in words."""
        yield from self.tally.lines()
        if self.photographs.without and self.tally.corrected:
            yield f"no sigmas: {self.photographs.without}"
        if self.system.ellipsoid:
            yield f"points taken as {self.system.text}"

    @property
    def doubts(self) -> list[str]:
        """What speaks against the result."""
        doubts = [self.photographs.caution] if self.photographs.caution else []
        if self.tally.deepest > _DEEPEST:
            doubts.append(
                f"down to {self.tally.deepest:.0f} m, where no photo shows the bottom: are there values of empty "
                "posts or points among the heights, or heights in another unit?"
            )
        return doubts

    @property
    def rejection(self) -> str:
        """Why the result is of no use; empty where a point is corrected."""
        if self.tally.corrected:
            return ""
        dry = 0 < self.tally.faults[Fault.ABOVE_WATER] == self.tally.seen
        return "no point is corrected" + (": nothing is under water: heights are positive up" if dry else "")


def correct_file(
    source: Path,
    target: Path,
    photographs: Photographs,
    index: float,
    *,
    crs: str | None = None,
    geoid: str | None = None,
    columns: Sequence[str] = ("x", "y", "z"),
    layer: str = "",
    band: str = "",
    surface: bool = False,
    jobs: int = 1,
    progress: Progress | None = None,
) -> CorrectedFile:
    """Correct the apparent points of a file, and write the true ones in the format that the target's suffix says.

    `crs`, `geoid`: system of the points, as `system_of_points` has it; `columns`: names of coordinates in a table;
    `layer`: that of a GeoPackage of several, `band`: that of the heights of a raster; `surface`: of a raster the
    true heights at its posts; `jobs`: processes; `progress` is told of bytes of a table, points of a cloud, posts
    of a raster. Tables, clouds and rasters that keep their kind may be of any size. Raises `DepthError`,
    `InterchangeError` and `SystemsError` for what cannot be used, and `OSError`; then nothing is written.
    """
    cameras, kind = photographs.cameras, kind_of(source, target)
    if surface and kind != RASTERS:
        raise DepthError([Problem(message="a surface is that of a raster, in another raster")])
    work = partial(Correction, cameras=cameras, index=index, errors=photographs.errors, through=photographs.through)
    unstated = LOCAL if cameras.system.ellipsoid is None else crs
    stand_in = crs_of(unstated) if unstated else None

    def system_of(stated: pyproj.CRS | None) -> System:
        return system_of_points(source, cameras, crs or (None if stated is None else stated.to_wkt()), geoid)

    if kind == RASTERS:
        with geotiff.opened(source, stand_in) as raster:
            system = system_of(placed(raster.posts.crs))
            raster = replace(raster, posts=replace(raster.posts, crs=placed(stand_in) or raster.posts.crs))
            correct = correct_surface if surface else correct_raster
            tally = correct(
                raster, target, band_of(raster, band), work(system=system), jobs=jobs, progress=progress
            )
    elif kind == SUFFIXES:
        system = system_of_points(source, cameras, crs, geoid)
        tally = correct_las(source, target, work(system=system), jobs=jobs, progress=progress)
    elif kind:
        system = system_of_points(source, cameras, crs, geoid)
        tally = correct_csv(source, target, work(system=system), columns=columns, jobs=jobs, progress=progress)
    else:
        layers, stated = read_heights(source, stand_in, layer, columns, band)
        system = system_of(stated)
        written = placed(stand_in) or stated or _crs_of(system)
        layers = {name: replace(part, crs=written) for name, part in layers.items()}
        numbered = target.suffix.lower() in (*SUFFIXES, *BARE)
        true, tally = correct_by_photographs(layers, work(system=system), source, numbered=numbered, jobs=jobs)
        write_layers(target, true)
    return CorrectedFile(tally=tally, system=system, photographs=photographs)


def _crs_of(system: System) -> pyproj.CRS | None:
    """Return what files say of longitude and latitude on the ellipsoid of a run; no datum is known."""
    if not isinstance(system, LongitudeLatitude):
        return None
    return pyproj.CRS.from_user_input(f"+proj=longlat {system.ellipsoid.definition} +type=crs")
