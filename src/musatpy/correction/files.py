"""A file of apparent points, table or LAS, written again with the true ones (`musat correct`).

A point that cannot be corrected keeps its apparent place, has no true place, and has a reason.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from musatpy.correction.photographs import Photographs
from musatpy.depth.correction import Correction, Progress, Tally
from musatpy.depth.csv_points import correct_csv
from musatpy.depth.las_points import correct_las
from musatpy.depth.point_systems import system_of_points
from musatpy.errors import DepthError, Problem
from musatpy.geometry.systems import System
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
    jobs: int = 1,
    progress: Progress | None = None,
) -> CorrectedFile:
    """Correct the apparent points of a file of any size, and write one of the same kind with the true ones.

    `crs`, `geoid`: system of the points, as `system_of_points` has it; `columns`: names of coordinates in a table;
    `jobs`: processes; `progress` is told of bytes of a table, points of a cloud. Raises `DepthError` and
    `SystemsError` for what cannot be used, and `OSError`; then nothing is written.
    """
    las = source.suffix.lower() in SUFFIXES
    if las != (target.suffix.lower() in SUFFIXES):
        raise DepthError([Problem(message=f"{source.name} and {target.name} are not of one kind")])
    system = system_of_points(source, photographs.cameras, crs, geoid)
    work = Correction(cameras=photographs.cameras, index=index, system=system, errors=photographs.errors)
    if las:
        tally = correct_las(source, target, work, jobs=jobs, progress=progress)
    else:
        tally = correct_csv(source, target, work, columns=columns, jobs=jobs, progress=progress)
    return CorrectedFile(tally=tally, system=system, without=photographs.without)
