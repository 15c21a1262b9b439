"""`musat sea correct`: true points of apparent ones through an estimated surface."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from musatpy.cli.depth_options import index_by, index_options, system_options
from musatpy.cli.messages import name_of, tell
from musatpy.cli.options import columns_of, refuse_overwriting
from musatpy.cli.sea_options import pair_by, precision_by, precision_options, sea_system

if TYPE_CHECKING:
    from musatpy.sea.stereo.through import Corrected


@click.command(name="correct", short_help="True points of apparent ones through such a surface.")
@click.argument("points", type=click.Path(path_type=Path))
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path), help="The file of true points.")
@click.option("--surface", required=True, type=click.Path(path_type=Path), help="NAME.surface.json of 'sea fit'.")
@click.option("--cameras", "stations", required=True, type=click.Path(path_type=Path), help="Its pair of stations.")
@system_options
@index_options
@precision_options
def command(points: Path, out: Path, surface: Path, stations: Path, quiet: bool, **given: Any) -> None:
    """Correct the apparent POINTS of the pair of a surface.

    They come as CSV (id,x,y,z[,sx,sy,sz]) or in the record of a run (.json), intersected as if there were no water.
    Every point gets its sigmas, of images and surface together, or the reason why it is not corrected.
    """
    from musatpy.errors import Problem, SeaError
    from musatpy.files import write_files
    from musatpy.reports.sea import corrected_csv
    from musatpy.sea.stereo.point_records import read_points
    from musatpy.sea.stereo.surface_file import load_map, load_surface
    from musatpy.sea.stereo.through import correct

    refuse_overwriting([out], [points, stations, surface])
    index, fitted, pair = index_by(given), load_surface(surface), pair_by(stations, given)
    columns = columns_of(points, given["columns"])
    system, surface_map = sea_system(given, pair), load_map(surface)
    read = read_points(points, precision_by(given, pair), given["only"], columns, system, surface_map)
    _require_one_earth(surface, surface_map, read.plan)
    try:
        corrected = correct(fitted, pair.stations.position, read.points, index, read.plan)
    except ValueError as error:
        raise SeaError([Problem(file=str(stations), message=str(error))]) from error
    write_files({out: corrected_csv(read, corrected).encode()})
    if not quiet:
        _tell(out, corrected, read.left)


def _require_one_earth(surface: Path, surface_map: Any, plan: Any) -> None:
    """Raise `SeaError` unless surface and points stand both on the ellipsoid, or both in local coordinates."""
    from musatpy.errors import Problem, SeaError

    if (surface_map is None) != (plan is None):
        where = ("in local coordinates", "on the ellipsoid")
        message = f"stands {where[surface_map is not None]}, the points {where[plan is not None]}"
        raise SeaError([Problem(file=str(surface), message=message)])


def _tell(out: Path, corrected: Corrected, left: tuple[str, ...]) -> None:
    """Print how many points are corrected, and why the others are not."""
    from musatpy.sea.stereo.through import REASONS, Fault

    good = int((corrected.fault == Fault.NONE).sum())
    tell(f"{name_of(out)}: {len(corrected.fault)} points, {good} corrected")
    for fault in Fault:
        count = int((corrected.fault == fault).sum())
        if fault != Fault.NONE and count:
            tell(f"{count} not: {REASONS[fault]}")
    for line in left:
        tell(f"left out: {line}")
