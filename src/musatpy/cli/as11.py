"""`musat as11`: stereomodels of a run, points compiled in them, and their comparison with other sources."""

from __future__ import annotations

import datetime
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from musatpy.cli import options
from musatpy.cli.correct import correct, correction_options
from musatpy.cli.messages import (
    complain,
    complain_of,
    complain_of_each,
    complain_of_verdict,
    name_of,
    not_done,
    tell,
)
from musatpy.cli.options import FILE, NOT_NEGATIVE, POSITIVE, LazyGroup, flag, option, options_of
from musatpy.errors import count_of

if TYPE_CHECKING:
    from musatpy.as11_runs import CompileResult
    from musatpy.compilation.compiled import Compiled
    from musatpy.figures import ImageForm

_run = click.argument("run", type=FILE)
_run_and_deck = options_of(_run, click.argument("deck", type=FILE), options.out_option, options.anyway_option)
_model = options_of(click.argument("left"), click.argument("right"))
_bottom = click.argument("bottom", type=FILE)


@click.group(name="as11", cls=LazyGroup, short_help="Compile points in stereomodels of a run.")
def command() -> None:
    """Set up stereomodels from a run, and compile points in them through the water."""


@command.command(name="compile", short_help="Compile the points of a deck.")
@_run_and_deck
@options.carriage_control_option
@options.csv_option
@flag("--plots", "Also draw pictures of depths, sigmas and contours (NAME.depths.svg).")
@options.picture_options("plots")
@flag("--gis", "Also write points and contours for GIS and CAD (NAME.gpkg, NAME.dxf).")
@flag("--las", "Also write the points as a point cloud (NAME.las).")
@options.crs_option("System of these files, for example EPSG:4267; GeoJSON is then written too.")
@options.strict_option
@options.date_option
@click.pass_context
def compile_command(
    ctx: click.Context, /, run: Path, deck: Path, out_dir: Path | None, crs: str, gis: bool, las: bool, **given: Any
) -> None:
    """Compile the compilation DECK in stereomodels of RUN.json, and write the listing NAME.lst and the record
    NAME.json.

    RUN.json is the record of a run; it may be a punched deck, which has no covariances. Exit status: 0 done, 1
    the run or the deck cannot be used, 4 rejected (with --strict: or doubtful).
    """
    if crs and not (gis or las):
        raise click.UsageError("--crs goes with --gis or --las")
    from musatpy.as11_runs import compile_deck
    from musatpy.runs import output_paths

    options.refuse_overwriting(output_paths(deck, out_dir)[:2], [run, deck])
    result = compile_deck(run, deck, out_dir, crs=crs, gis=gis, las=las, **given)
    compiled = _compiled(ctx, deck, result)
    lost = sum(reason is not None for reason in compiled.reasons)
    without = f", {lost} without coordinates" if lost else ""
    points = f"{count_of(len(compiled.rows), 'point')} in {count_of(len(compiled.models), 'model')}"
    grade = "" if result.verdict is None else f"{result.verdict.grade}, "
    tell(f"{name_of(deck)}: {grade}{points}{without}, listing {name_of(result.files[0])}")
    ctx.exit(result.status)


def _compiled(ctx: click.Context, deck: Path, result: CompileResult) -> Compiled:
    """Complain of what is wrong or odd, and return what came of the deck; exit where nothing did."""
    if result.compiled is None:
        not_done(deck, "compiled", result.problems)
        ctx.exit(result.status)
    complain_of(result.problems)
    complain_of_verdict(deck, result.verdict)
    complain_of_each(deck, result.warnings)
    return result.compiled


@command.command(name="contours", short_help="Draw contours of a raster of depths.")
@click.argument("raster", type=FILE)
@option(
    "-o --out",
    "File to write; its suffix says the format: .gpkg, .dxf, .geojson. May be repeated.",
    FILE,
    name="targets",
    required=True,
    multiple=True,
)
@option("--interval", "Interval between contours, m.", POSITIVE)
@option("--depth", "Depth of one contour, m. May be repeated.", float, name="levels", multiple=True)
@option("--index", "One contour in this many is thick.", click.IntRange(min=1), shown=5)
@option("--shortest", "Leave out pieces that are shorter than this, m.", NOT_NEGATIVE, default=0.0)
@option("--band", "Band of the raster. Default: depth, or the only band.", default="")
@option("--datum", "The band has heights: draw depths below this one.", float)
@options.crs_option("Coordinate system of a raster that does not state it.")
def contours_command(
    raster: Path, targets: tuple[Path, ...], interval: float | None, band: str, crs: str, **wish: Any
) -> None:
    """Draw the contours of RASTER, which `musat correct --surface` or `musat as11 compile` has written.

    The lines are 3-D, at the heights of their depths; the depths are a column or, in DXF, layers.
    """
    from musatpy.compilation.rasters import ContourWish, contour_raster

    if (interval is None) == (not wish["levels"]):
        raise click.UsageError("give --interval, or --depth for each contour")
    options.refuse_overwriting(targets, [raster])
    drawn, what = contour_raster(raster, targets, ContourWish(interval=interval or 0.0, **wish), band=band, crs=crs)
    lines = drawn.lines
    depths = count_of(len({line.level for line in lines}), what.removesuffix("s"))
    length = sum(line.length for line in lines)
    left_out = f", {count_of(drawn.dropped, 'piece')} left out" if drawn.dropped else ""
    for target in targets:
        tell(f"{name_of(target)}: {count_of(len(lines), 'line')} of {depths}, {length:.0f} m{left_out}")


@command.command(name="correct", hidden=True)
@_run
@_model
@click.argument("points", type=FILE)
@correction_options
@click.pass_context
def correct_command(ctx: click.Context, /, run: Path, left: str, right: str, points: Path, **given: Any) -> None:
    """Correct POINTS. An old name of `musat correct --run RUN.json --photos LEFT,RIGHT`."""
    given["photos"] = f"{left},{right}"
    given["surface"] |= {points.suffix.lower(), given["out"].suffix.lower()} <= {".tif", ".tiff"}
    correct(ctx, points, run, is_run=True, **given)


@command.command(name="compare-points", short_help="Compare the points of a deck with those of the run.")
@_run_and_deck
def points_command(run: Path, deck: Path, out_dir: Path | None, anyway: bool) -> None:
    """Compile DECK in stereomodels of RUN.json, and compare its points with those of the run that have the same
    names.

    The listing NAME.points.lst has the differences, compiled less run, their sigmas and tests, and their analysis;
    the record goes to NAME.points.json.
    """
    from musatpy.as11_runs import compare_points

    listing, record, _ = _results(deck, out_dir, "points", run)
    count, lengths, problems = compare_points(run, deck, listing, record, anyway)
    complain_of(problems)
    least, mean, largest = lengths
    tell(
        f"{name_of(deck)}: {count_of(count, 'point')} of the run, vectors {least:.4f} to {largest:.4f} m, "
        f"mean {mean:.4f} m, listing {name_of(listing)}"
    )


def _results(compared: Path, out_dir: Path | None, kind: str, *others: Path) -> tuple[Path, Path, Path]:
    """Return listing, record and picture of a comparison, which are none of the files that are read."""
    stem = (compared.parent if out_dir is None else out_dir) / f"{compared.stem}.{kind}"
    listing, record, picture = (stem.with_name(f"{stem.name}.{ending}") for ending in ("lst", "json", "png"))
    options.refuse_overwriting([listing, record, picture], [compared, *others])
    return listing, record, picture


@command.command(name="compare-contours", short_help="Compare contours with those of another source.")
@_run
@_bottom
@click.argument("contours", type=FILE)
@options.out_option
@options.anyway_option
@option("--datum", "How far the datum of CONTOURS is below that of the bottom, m.", float, default=0.0)
@option("--farthest", "Do not compare contours that are farther apart than this, m.", POSITIVE, default=math.inf)
@options.crs_option("Coordinate system of a file that does not state it, for example EPSG:32620.")
@option("--layer", "Layer of a GeoPackage that has several.", default="")
@flag("--depths", "Third coordinates are depths, positive down, and not heights.")
def compare_contours_command(run: Path, bottom: Path, contours: Path, out_dir: Path | None, **given: Any) -> None:
    """Compare contours of BOTTOM with the 3-D lines of CONTOURS, in the system of RUN.json.

    BOTTOM is a deck, which is compiled in stereomodels of the run, or a GeoTIFF with a band depth. CONTOURS is a
    DXF, GeoJSON, GeoPackage, CSV or XYZ file. Its depths are in the column depth, or are its heights with the
    opposite sign. The listing goes to CONTOURS.contours.lst, the record to CONTOURS.contours.json.
    """
    from musatpy.as11_comparisons import compare_contours

    listing, record, _ = _results(contours, out_dir, "contours", run, bottom)
    compared = compare_contours(run, bottom, contours, (listing, record), **given)
    partners = {row.depth for row in compared.distances}
    tell(
        f"{name_of(contours)}: contours of {count_of(len(partners), 'depth')}, RMS distance {compared.rms:.2f} m, "
        f"listing {name_of(listing)}"
    )


@command.command(name="compare-soundings", short_help="Compare a bottom with soundings.")
@_run
@_bottom
@click.argument("soundings", type=FILE)
@options.out_option
@options.anyway_option
@option("--datum", "How far the datum of the soundings is below that of the bottom, m.", float, default=0.0)
@option("--datum-sigma", "Sigma of --datum, m.", NOT_NEGATIVE, default=0.0)
@option("--sigma", "Sigma of soundings that have none, m.", NOT_NEGATIVE, default=0.0)
@option("--plan-sigma", "Sigma of the positions of soundings, m.", NOT_NEGATIVE, default=0.0)
@option("--steepest", "Leave out soundings on a steeper bottom.", NOT_NEGATIVE, default=math.inf)
@option(
    "--radius",
    "Take as the bottom the plane of the points within this distance, m, and not a triangle.",
    POSITIVE,
    default=math.inf,
)
@option("--not-before", "Leave out soundings before this day (column date).", click.DateTime(["%Y-%m-%d"]))
@options.crs_option("Coordinate system of x and y in a file that does not state it, for example EPSG:32620.")
@flag("--plots", "Also draw a picture of the differences (SOUNDINGS.soundings.png).")
@options.picture_options("plots")
def soundings_command(
    run: Path,
    bottom: Path,
    soundings: Path,
    out_dir: Path | None,
    anyway: bool,
    not_before: datetime.datetime | None,
    crs: str,
    plots: bool,
    form: ImageForm,
    **matching: float,
) -> None:
    """Compare BOTTOM with the soundings of the CSV, LAS or LAZ file SOUNDINGS, in the system of RUN.json.

    BOTTOM is a deck, which is compiled in stereomodels of the run, or a GeoTIFF with bands depth and sigma, which
    `musat correct --surface` or `musat as11 compile` has written. Columns of a CSV file are lat and lon (degrees)
    or x and y; depth or height; and sigma, name and date if they are known. The listing goes to
    SOUNDINGS.soundings.lst, the record to SOUNDINGS.soundings.json.
    """
    from musatpy.as11_comparisons import compare_soundings
    from musatpy.compilation.other_bottoms import Matching
    from musatpy.soundings.differences import samples

    listing, record, picture = _results(soundings, out_dir, "soundings", run, bottom)
    how = Matching(not_before=None if not_before is None else not_before.date(), **matching)
    drawn = picture if plots else None
    compared, warnings = compare_soundings(
        run, bottom, soundings, (listing, record), how, picture=drawn, form=form, crs=crs, anyway=anyway
    )
    complain_of_each(soundings, warnings)
    sample = samples(compared.differences)[0]
    tell(
        f"{name_of(soundings)}: {len(compared.rows)} of {count_of(len(compared.soundings.names), 'sounding')}, "
        f"median {sample.median:.3f} m, NMAD {sample.spread:.3f} m, listing {name_of(listing)}"
    )


@command.command(name="drive", short_help="Drive the mark along a path.")
@_run
@_model
@click.argument("path", type=FILE)
@options.out_option
@options.anyway_option
@flag("--air", "The mark is where straight rays meet, not the true point.")
@flag("--job", "The path is in the system of the job (lat, lon, height).", name="of_job")
@option("--rate", "Number of cycles a second.", click.FloatRange(min=0.0, max=1000.0, min_open=True), shown=50.0)
def drive_command(
    run: Path,
    left: str,
    right: str,
    path: Path,
    out_dir: Path | None,
    anyway: bool,
    air: bool,
    of_job: bool,
    rate: float,
) -> None:
    """Drive the mark along PATH in the stereomodel of photos LEFT and RIGHT of RUN.json.

    PATH is a CSV file with columns t (s), X, Y, Z (m in the model) or, with --job, lat, lon (degrees) and height
    (m), or X, Y, Z of a local job. PATH.stages.csv has the refined plate coordinates of both stages for every
    cycle.
    """
    import numpy as np

    from musatpy.as11_runs import run_of
    from musatpy.compilation.loop import Drive, driven, driven_csv, read_path
    from musatpy.compilation.stereomodels import set_up
    from musatpy.files import write_files

    target = (path.parent if out_dir is None else out_dir) / f"{path.stem}.stages.csv"
    options.refuse_overwriting([target], [run, path])
    triangulation = run_of(run, anyway)
    if triangulation.caution:
        complain(f"{name_of(run)}: {triangulation.caution}")
    stereo = set_up(triangulation, left, right)
    path_in_model = read_path(path, stereo, of_job=of_job)
    result = driven(stereo, path_in_model, rate, Drive.AIR if air else Drive.TRUE)
    write_files({target: driven_csv(result).encode()})
    if len(off := result.off(stereo)):
        cycles = count_of(len(off), "cycle")
        complain(f"{name_of(path)}: {cycles} off the plates, t = {off[0]:g} to {off[-1]:g} s")
    late = f"{1e3 * np.quantile(result.seconds, 0.99):.2f} ms, at most {1e3 * result.seconds.max():.2f}"
    tell(
        f"{name_of(target)}: {len(result.t)} cycles at {rate:g} Hz, {result.missed} missed; 99 % within {late} ms; "
        f"stages up to {result.speed:.3f} mm/s"
    )


@command.command(name="setup", short_help="Set up the models of a deck.")
@_run_and_deck
@options.carriage_control_option
@options.date_option
@click.pass_context
def setup_command(ctx: click.Context, /, run: Path, deck: Path, out_dir: Path | None, **given: Any) -> None:
    """Set up the stereomodels of DECK on RUN.json, and write the listing NAME.setup.lst and the record
    NAME.setup.json.

    They have the axes of the models, what the stages should read at the points of the run, whether the models are
    recovered, and the standard errors to expect. DECK needs no readings. Exit status: 0 done, 1 the run or the deck
    cannot be used.
    """
    from musatpy.as11_runs import set_up_deck, setup_paths

    options.refuse_overwriting(setup_paths(deck, out_dir), [run, deck])
    result = set_up_deck(run, deck, out_dir, **given)
    compiled = _compiled(ctx, deck, result)
    models = count_of(len(compiled.models), "model")
    tell(f"{name_of(deck)}: {models} set up, listing {name_of(result.files[0])}")
