"""`musat correct`: true points of apparent ones, by all photographs that see them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from musatpy.cli import depth, options
from musatpy.cli import sea as sea_commands
from musatpy.cli.depth import POSITIVE
from musatpy.cli.messages import complain, name_of
from musatpy.cli.options import FILE, NamedPath, flag, option, options_of
from musatpy.memory import cores

if TYPE_CHECKING:
    from musatpy.correction.photographs import Photographs

_CONTROL = ("trend", "families", "control_sigma", "no_noise", "keep_outliers", "reach", "plots")
_STATIONS = ("photos", "pointing", "surface", "index", "temperature", "level", "focal", "angle")
_TABLES_AND_CLOUDS = (".csv", ".xyz", ".txt", ".las", ".laz")
correction_options = options_of(
    option("-o --out", "File of true points to write; its suffix says the format.", FILE, required=True),
    option("--photos NAME,NAME", "Use only these photos, as the two of a model. Default: all.", default=""),
    option("--pointing UM", "Sigma of an image coordinate. Default with --run: that of its plates.", POSITIVE),
    depth.system_options,
    depth.index_options,
    depth.camera_options,
    options.columns_option,
    option("--layer", "Layer of a GeoPackage that has several.", default=""),
    option("--band", "Band of a raster that has the heights, if it has several.", default=""),
    flag("--surface", "Write a raster of true heights, depths and sigmas."),
    options.strict_option,
    options.processes_option,
    options.quiet_option,
)


@click.command(name="correct", short_help="Correct apparent points for refraction.")
@click.argument("points", type=FILE)
@option("--run RUN.json", "Take the stations of this run.", FILE)
@option("--job NAME.job", "Job of an import, whose run --run is.", NamedPath(exists=True))
@option("--rays", "Rays of a point, with --job.", click.IntRange(min=2), shown=12)
@option("--cloud-sigma PX", "Sigma of the matcher's images, with --job.", POSITIVE)
@options.water_options
@option("--stations CSV", "Take the stations of this table.", FILE)
@option("--sea SURFACE.json", "Correct through this surface of 'sea fit'.", FILE)
@option("--by-control CONTROL", "Correct heights by errors at control points.", FILE)
@option("--control-sigma M", **sea_commands.CONTROL_SIGMA)
@sea_commands.control_options
@correction_options
@click.pass_context
def command(
    ctx: click.Context,
    /,
    points: Path,
    run: Path | None,
    stations: Path | None,
    sea: Path | None,
    by_control: Path | None,
    job: Path | None,
    rays: int,
    cloud_sigma: float | None,
    water: Path | None,
    water_side: str | None,
    **given: Any,
) -> None:
    """Correct the apparent points of POINTS for refraction, by all photos that see them.

    Formats are .csv, .xyz, .las, .laz, .tif, and points and 3-D lines of .gpkg, .geojson, .dxf. The suffix of the
    result says its format.

    A camera sees a point if the point is inside its format (this needs attitudes, focal length and format), and
    within --angle of the vertical; one of the two rules is needed. Points are in the system of the stations, in
    metres with Z up. For a run on the ellipsoid they may be in any system (--crs, that of the file, or that of the
    run): x is east or the longitude in degrees, y north or the latitude, and heights are above the ellipsoid or the
    --geoid.

    A point that cannot be corrected keeps its apparent place and gets a reason; lines are cut there, unless the
    point is above the water. If the stations have sigmas (from the run, or in columns of the table), the points get
    sigmas along east, north and up, and of their depth.

    With --job the points are those of a model that was imported: each goes back through the cameras of its file to
    pixels, and from there along rays of the adjusted cameras through the water; dry points too. --crs model says
    that points are in the coordinates of the model. Points below the water are wet, with --water in its areas
    alone; nearer to it than three sigmas they are undecided, and their sigmas cover both.

    With --sea the points are those of two stations, and their rays go through an estimated surface of the water.
    With --by-control no stations are needed: the errors of heights at control points are interpolated by
    least-squares collocation, and a report NAME.txt is written.

    Exit status: 0 corrected, 1 a file cannot be used, 4 no point is corrected, or control points improve nothing
    (with --strict: or doubtful).
    """
    if by_control is not None:
        if run or stations or sea or any(given[name] for name in _STATIONS):
            raise click.UsageError("--by-control takes no stations and none of their options")
        sea_commands.correct_by_control(ctx, points, by_control, given)
        return
    if wrong := [name for name in _CONTROL if given.pop(name) not in (None, False, (), "constant")]:
        raise click.UsageError(
            f"--{wrong[0].replace('_', '-').replace('families', 'function')} goes with --by-control"
        )
    if (run is None) == (stations is None):
        raise click.UsageError("--run or --stations is needed, and not both")
    source: Any = run or stations
    if job is not None:
        if run is None or sea is not None:
            raise click.UsageError("--job goes with --run, and not with --sea")
        how = {"most": rays, "image_sigma": cloud_sigma, "water": water, "side": water_side or ""}
        _by_job(ctx, points, run, job, how, given)
        return
    if water is not None:
        raise click.UsageError("--water goes with --job")
    if sea is not None:
        _through_sea(ctx, points, sea, source, given)
        return
    correct(ctx, points, source, is_run=run is not None, **given)


def _through_sea(ctx: click.Context, points: Path, surface: Path, source: Path, given: dict[str, Any]) -> None:
    from musatpy.sea.stereo.point_records import PointPrecision
    from musatpy.units import MICROMETRE

    if wrong := [name for name in ("surface", "level", "angle") if given[name]]:
        raise click.UsageError(f"--{wrong[0]} does not go with --sea")
    pair, precision = sea_commands.pair_by(source, given["photos"]), PointPrecision()
    if given["pointing"] is not None:
        focal = given["focal"] if pair.camera is None else float(pair.camera[:, 0].mean())
        if focal is None:
            raise click.UsageError("--pointing needs the focal length of the stations, or --focal")
        sigma = given["pointing"] * MICROMETRE / focal
        precision = PointPrecision(cameras=pair.stations.position, image_sigma=sigma)
    sea_commands.correct_through(ctx, points, surface, pair, precision, given, source)


def correct(ctx: click.Context, points: Path, source: Path, *, is_run: bool, **given: Any) -> None:
    """Correct the points of a file by the stations of a run, or of a table."""
    from musatpy.correction.photographs import ByPhotographs

    options.refuse_overwriting([given["out"]], [points, source])
    options.columns_of(points, given["columns"])
    photographs, index = _photographs(source, is_run, given)
    if not photographs.cameras.has_rule:
        message = "what a camera sees is not known: attitudes, focal length and format are needed, or --angle"
        raise click.UsageError(message)
    known = {points.suffix.lower(), given["out"].suffix.lower()} <= {*_TABLES_AND_CLOUDS}
    method = ByPhotographs(system=photographs.cameras.system, photographs=photographs, index=index)
    _write(ctx, points, method, given, bar=known)


def _write(ctx: click.Context, points: Path, method: Any, given: dict[str, Any], *, bar: bool = True) -> None:
    """Correct the points of a file, and tell what speaks against them."""
    from musatpy.runs import ExitStatus

    more = {"geoid": given["geoid"], "surface": given["surface"], "jobs": given["processes"] or cores()}
    method, tally = sea_commands.write_corrected(points, method, given, bar=bar, **more)
    for doubt in (doubts := method.doubts(tally)):
        complain(f"{name_of(points)}: doubtful: {doubt}")
    if why := method.rejection(tally):
        sea_commands.reject(ctx, points, why)
    if given["strict"] and doubts:
        ctx.exit(ExitStatus.REJECTED)


def _by_job(
    ctx: click.Context, points: Path, run: Path, job: Path, how: dict[str, Any], given: dict[str, Any]
) -> None:
    """Correct the points of a file through the cameras of a model that was imported."""
    from musatpy.correction.file_cameras import by_file_cameras

    in_model = given["crs"] == "model"
    if in_model and given["out"].suffix.lower() in (".las", ".laz"):
        message = "--crs model: results are in the system of the job, of which the file has no scales: write a .csv"
        raise click.UsageError(message)
    options.refuse_overwriting([given["out"]], [points, run])
    method = by_file_cameras(run, job, in_model=in_model, **how)
    _write(ctx, points, method, given | {"crs": None} if in_model else given)


def _photographs(source: Path, is_run: bool, given: dict[str, Any]) -> tuple[Photographs, float]:
    """Return the photographs that options name, and the index of their water."""
    from musatpy.correction.photographs import of_run, of_table
    from musatpy.units import MICROMETRE

    photos = [name.strip() for name in given["photos"].split(",") if name.strip()]
    pointing = None if given["pointing"] is None else given["pointing"] * MICROMETRE
    if is_run:
        if given["level"] is not None:
            raise click.UsageError("--level: the run has the tides of its photos")
        limit, camera = depth.limit_and_camera(given)
        run = of_run(source, photos=photos, pointing=pointing, camera=camera, limit=limit)
        return run, depth.index_by(given, run.cameras)
    cameras = depth.cameras_by(source, given)
    index = depth.index_by(given, cameras)
    return of_table(source, cameras, index, photos=photos, pointing=pointing), index


@click.command(name="correct", hidden=True)
@click.argument("points", type=FILE)
@option("--cameras", "Stations: a CSV file or RUN.json.", FILE, name="stations", required=True)
@correction_options
@click.pass_context
def depth_command(ctx: click.Context, /, points: Path, stations: Path, **given: Any) -> None:
    """Correct points. An old name of `musat correct`."""
    correct(ctx, points, stations, is_run=stations.suffix.lower() == ".json", **given)
