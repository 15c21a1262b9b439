"""A file of apparent points, table, LAS or raster, written again with the true ones (`musat correct`).

A point that cannot be corrected keeps its apparent place, has no true place, and has a reason.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from musatpy.correction.photographs import Photographs
from musatpy.correction.rasters import band_of, correct_raster
from musatpy.depth.correction import Correction, Progress, Tally
from musatpy.depth.csv_points import correct_csv
from musatpy.depth.las_points import correct_las
from musatpy.depth.point_systems import system_of_points
from musatpy.errors import DepthError, Problem
from musatpy.geometry.projected import crs_of
from musatpy.geometry.systems import System
from musatpy.interchange import geotiff
from musatpy.interchange.any_file import RASTERS
from musatpy.interchange.layers import LOCAL, placed
from musatpy.pointfiles.las_files import SUFFIXES


@dataclass(frozen=True, kw_only=True, eq=False)
class CorrectedFile:
    """What came of the points of a file, as what they were taken, and why they have no sigmas, if so."""

    tally: Tally
    system: System
    without: str

    def lines(self) -> Iterator[str]:
        """Yield this in words."""
        yield from self.tally.lines()
        if self.without and self.tally.corrected:
            yield f"no sigmas: {self.without}"
        if self.system.ellipsoid:
            yield f"points taken as {self.system.text}"


def correct_file(
    source: Path,
    target: Path,
    photographs: Photographs,
    index: float,
    *,
    crs: str | None = None,
    geoid: str | None = None,
    columns: Sequence[str] = ("x", "y", "z"),
    band: str = "",
    jobs: int = 1,
    progress: Progress | None = None,
) -> CorrectedFile:
    """Correct the apparent points of a file of any size, and write one of the same kind with the true ones.

    `crs`, `geoid`: system of the points, as `system_of_points` has it; `columns`: names of coordinates in a table;
    `band`: that of the heights of a raster of several; `jobs`: processes; `progress` is told of bytes of a table,
    points of a cloud, posts of a raster. Raises `DepthError`, `InterchangeError` and `SystemsError` for what cannot
    be used, and `OSError`; then nothing is written.
    """
    suffix, kinds = source.suffix.lower(), (SUFFIXES, RASTERS)
    if any((suffix in kind) != (target.suffix.lower() in kind) for kind in kinds):
        raise DepthError([Problem(message=f"{source.name} and {target.name} are not of one kind")])
    cameras = photographs.cameras
    work = partial(Correction, cameras=cameras, index=index, errors=photographs.errors, through=photographs.through)
    if suffix in RASTERS:
        unstated = LOCAL if cameras.system.ellipsoid is None else crs
        with geotiff.opened(source, crs_of(unstated) if unstated else None) as raster:
            stated = placed(raster.posts.crs)
            system = system_of_points(source, cameras, crs or (None if stated is None else stated.to_wkt()), geoid)
            tally = correct_raster(
                raster, target, band_of(raster, band), work(system=system), jobs=jobs, progress=progress
            )
        return CorrectedFile(tally=tally, system=system, without=photographs.without)
    system = system_of_points(source, cameras, crs, geoid)
    if suffix in SUFFIXES:
        tally = correct_las(source, target, work(system=system), jobs=jobs, progress=progress)
    else:
        tally = correct_csv(source, target, work(system=system), columns=columns, jobs=jobs, progress=progress)
    return CorrectedFile(tally=tally, system=system, without=photographs.without)
