"""`musat correct --sea`, through an estimated surface; `musat sea correct` was its name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from musatpy.cli.depth_options import index_by, index_options, system_options
from musatpy.cli.messages import complain, name_of, progress_through, tell
from musatpy.cli.options import NamedPath, columns_of, refuse_overwriting
from musatpy.cli.sea_options import pair_by, precision_by, precision_options

if TYPE_CHECKING:
    from musatpy.correction.methods import Method, Tally
    from musatpy.depth.cameras import CameraStations
    from musatpy.sea.stereo.point_records import PointPrecision


@click.command(name="correct", hidden=True)
@click.argument("points", type=NamedPath())
@click.option(
    "-o", "--out", required=True, type=NamedPath(), help="File of true points to write; its suffix says the format."
)
@click.option("--surface", required=True, type=NamedPath(), help="Surface NAME.surface.json of 'sea fit'.")
@click.option(
    "--cameras", "stations", required=True, type=NamedPath(), help="File with the two stations of the pair."
)
@system_options
@index_options
@precision_options
@click.pass_context
def command(ctx: click.Context, /, points: Path, surface: Path, stations: Path, **given: Any) -> None:
    """Correct the apparent POINTS of a pair. An old name of `musat correct --sea`."""
    pair = pair_by(stations, given["pair"])
    correct_through(ctx, points, surface, pair, precision_by(given, pair), given, stations)


def correct_through(
    ctx: click.Context,
    points: Path,
    surface: Path,
    pair: CameraStations,
    precision: PointPrecision,
    given: dict[str, Any],
    stations: Path,
) -> None:
    """Correct the points of a file through a surface, intersected in air from a pair of stations."""
    from musatpy.correction.sea_methods import ThroughSurface
    from musatpy.depth.cameras import system_of_points
    from musatpy.errors import Problem, SeaError
    from musatpy.sea.stereo.surface_file import load_map, load_surface

    refuse_overwriting([given["out"]], [points, stations, surface])
    index, fitted, surface_map = index_by(given, pair), load_surface(surface), load_map(surface)
    system = system_of_points(points, pair, given["crs"], given["geoid"])
    if (surface_map is None) != (system.ellipsoid is None):
        where = ("in local coordinates", "on the ellipsoid")
        message = f"stands {where[surface_map is not None]}, the points {where[system.ellipsoid is not None]}"
        raise SeaError([Problem(file=str(surface), message=message)])
    correction = ThroughSurface(
        system=system,
        fitted=fitted,
        stations=pair.stations.position,
        index=index,
        precision=precision,
        map=surface_map,
        source=str(stations),
    )
    if not write_corrected(points, correction, given).corrected:
        reject(ctx, points)


def write_corrected(points: Path, method: Method, given: dict[str, Any]) -> Tally:
    """Correct the points of a file by their sea, say what has come of them, and return it."""
    from musatpy.correction.files import correct_file

    with progress_through(points, given["quiet"]) as progress:
        method, tally = correct_file(
            points,
            given["out"],
            method,
            crs=given["crs"],
            columns=columns_of(points, given["columns"]),
            only=given.get("only", ()),
            layer=given.get("layer", ""),
            band=given.get("band", ""),
            progress=progress,
        )
    if not given["quiet"]:
        first, *more = method.lines(tally)
        tell("\n".join([f"{name_of(given['out'])}: {first}", *more]))
    return tally


def reject(ctx: click.Context, points: Path, why: str = "no point is corrected") -> None:
    """End with the status of a result that is of no use."""
    from musatpy.runs import ExitStatus

    complain(f"{name_of(points)}: {why}")
    ctx.exit(ExitStatus.REJECTED)
