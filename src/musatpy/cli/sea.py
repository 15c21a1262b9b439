"""`musat sea fit`: the surface of the water from points on it; `musat correct --sea`, through that surface.

And `musat correct --by-control`, by what is wrong at control points. `musat sea correct` and `musat sea
interpolate` were the names of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from musatpy.cli import options
from musatpy.cli.depth import POSITIVE, Finite, SigmasOfAxes, index_by, index_options, system_options
from musatpy.cli.messages import complain, name_of, progress_through, tell
from musatpy.cli.options import FILE, LazyGroup, flag, option, options_of
from musatpy.errors import SeaError, count_of

if TYPE_CHECKING:
    from musatpy.correction.files import Chosen
    from musatpy.correction.methods import Tally
    from musatpy.depth.cameras import CameraStations
    from musatpy.figures import ImageForm
    from musatpy.sea.interpolation.control_tables import ControlTable
    from musatpy.sea.stereo.estimate import SurfaceFit
    from musatpy.sea.stereo.point_records import PointPrecision
    from musatpy.sea.stereo.surface_points import SurfacePoints

_OF = {"fourier": ("shortest", "longest", "most"), "grid": ("spacing", "curvature")}
FAMILIES = ("none", "gaussian", "exponential", "elliptic", "bessel", "swell")
UNHELPFUL = 3  # exit status of the old name where the interpolation does not help
_RECORD, _TABLES = ".json", (".csv", ".xyz", ".txt")


precision_options = options_of(
    option(
        "--sigma M|X,Y,Z",
        "Sigma of points that have none of their own: one for all coordinates, or one for each.",
        SigmasOfAxes({1: (0, 0, 0), 3: (0, 1, 2)}),
    ),
    option("--image-sigma UM", "Sigma of plate coordinates; replaces --sigma.", POSITIVE),
    options.columns_option,
    options.quiet_option,
    option("--focal MM", "Focal length of the pair, with --image-sigma.", POSITIVE),
    option("--pair LEFT,RIGHT", "Names of the two stations, if there are more."),
    option("--only PATTERN", "Use only points with such names, as 'W*'.", multiple=True),
)
control_options = options_of(
    click.option("--trend", type=click.Choice(["constant", "plane"]), default="constant", show_default=True),
    option(
        "--function",
        "Covariance function to try; may be repeated. Default: all.",
        click.Choice(FAMILIES),
        name="families",
        multiple=True,
    ),
    flag("--no-noise", "Estimate no noise; use the sigmas of the control."),
    flag("--keep-outliers", "Also use control points that contradict the others."),
    option(
        "--reach M",
        "Largest distance from a control point at which heights are corrected. Default: from the covariance.",
        POSITIVE,
    ),
    flag("--plots", "Also draw the picture NAME.png; needs the extra 'plots'."),
)
CONTROL_SIGMA: Any = {
    "meaning": "Sigma of control points that have none of their own. Default: 0.",
    "kind": Finite(0.0),
}


def pair_by(path: Path, chosen: str | None) -> CameraStations:
    """Return the cameras of the two stations of a pair. Raises `DepthError`, `OSError`."""
    from musatpy.depth.cameras import RECORD, read_cameras, read_run

    cameras = read_run(path, water=False) if path.suffix.lower() == RECORD else read_cameras(path, water=False)
    if not chosen:
        if len(cameras.names) != 2:
            raise click.UsageError(
                f"{count_of(len(cameras.names), 'station')} in {name_of(path)}: --pair says which two"
            )
        return cameras
    names = [name.strip() for name in chosen.split(",")]
    if len(names) != 2 or len(set(names)) != 2:
        raise click.UsageError(f"--pair: two names are needed, not '{chosen}'")
    for name in names:
        if name not in cameras.names:
            raise click.UsageError(f"--pair: no station {name} among {', '.join(cameras.names)}")
    return cameras.only([cameras.names.index(name) for name in names])


def precision_by(given: dict[str, Any], pair: Any) -> PointPrecision:
    """Return how precise points are by the options, and by the cameras of their pair where they are known."""
    from musatpy.sea.stereo.point_records import PointPrecision

    sigma, image, focal = (given[name] for name in ("sigma", "image_sigma", "focal"))
    if (image is None) != (focal is None):
        raise click.UsageError("--image-sigma and --focal go together")
    if sigma is not None and image is not None:
        raise click.UsageError("--sigma and --image-sigma: one or the other")
    if sigma is not None:
        return PointPrecision(sigma=sigma)
    if image is None:
        return PointPrecision()
    if pair is None:
        raise click.UsageError("--image-sigma needs --cameras")
    return PointPrecision(cameras=pair.stations.position, image_sigma=image * 1e-3 / focal)


@click.group(name="sea", cls=LazyGroup, short_help="Estimate the surface of the water.")
def command() -> None:
    """Estimate the surface of the water, through which `musat correct --sea` corrects the points of a map."""


@command.command(name="fit", short_help="Estimate the surface of the water.")
@click.argument("points", type=click.Path(path_type=Path))
@option("--model", "Waves or grid.", click.Choice(list(_OF)), shown="fourier")
@option("--shortest M", "Shortest wave; default: the mean point spacing.", POSITIVE)
@option("--longest M", "Longest wave; default: the extent of the points.", POSITIVE)
@option("--most", "Largest number of waves. Default: 8.", click.IntRange(0, 50))
@option("--spacing M", "Spacing of the grid; default: that of the points.", POSITIVE)
@option("--curvature 1/M", "Sigma of the curvature; default: the likeliest.", POSITIVE)
@option("--cameras", "The two stations, for --image-sigma.", click.Path(path_type=Path), name="stations")
@flag("--plots", "Also draw the picture NAME.surface.png; needs the extra 'plots'.")
@options.picture_options("plots")
@system_options
@options.out_option
@precision_options
def fit_command(
    points: Path,
    model: str,
    stations: Path | None,
    plots: bool,
    form: ImageForm,
    quiet: bool,
    out_dir: Path | None,
    **given: Any,
) -> None:
    """Estimate the surface of the water from POINTS on it.

    POINTS is a CSV file (id,x,y,z[,sx,sy,sz]) or the record of a run (.json), with points of one simultaneous pair
    that were intersected in air. The report is NAME.surface.txt; the surface, which 'musat correct --sea' reads, is
    NAME.surface.json.
    """
    from musatpy.depth.cameras import system_alone, system_of_points
    from musatpy.files import write_files
    from musatpy.reports.sea import surface_text
    from musatpy.sea.stereo.point_records import read_points
    from musatpy.sea.stereo.surface_file import dumps

    for other, names in _OF.items():
        wrong = [name for name in names if other != model and given[name] is not None]
        if wrong:
            raise click.UsageError(f"--{wrong[0]} is for the model {other}")
    pair = None if stations is None else pair_by(stations, given["pair"])
    columns = options.columns_of(points, given["columns"])
    crs, geoid = given["crs"], given["geoid"]
    system = system_alone(crs, geoid) if pair is None else system_of_points(points, pair.system, crs, geoid)
    read = read_points(points, precision_by(given, pair), given["only"], columns, system)
    surface_map = read.plan.map if read.plan else None
    result = _fit(points, read.points, model, given)
    folder = points.parent if out_dir is None else out_dir
    report, surface = (folder / f"{points.stem}.surface.{suffix}" for suffix in ("txt", "json"))
    title = f"SURFACE OF THE WATER FROM {points.name}"
    if surface_map:
        title += f"\nX and Y on the map {surface_map.text}"
    files = {report: surface_text(result, title, read.left).encode(), surface: dumps(result, surface_map).encode()}
    if plots:
        from musatpy.sea.pictures import surface_picture

        suffix, image = surface_picture(result, title.split("\n")[0], form)
        files[folder / f"{points.stem}.surface.{suffix}"] = image
    options.refuse_overwriting(files, [points])
    write_files(files)
    if not quiet:
        tell(f"{name_of(report)}: {_summary(result)}")


def _fit(path: Path, points: SurfacePoints, model: str, given: dict[str, Any]) -> SurfaceFit:
    from musatpy.sea.stereo.estimate import fit_fourier, fit_grid

    wanted = {name: given[name] for name in _OF[model] if given[name] is not None}
    try:
        return (fit_fourier if model == "fourier" else fit_grid)(points, **wanted)
    except ValueError as error:
        raise SeaError.of(error, file=path) from error


def _summary(result: SurfaceFit) -> str:
    from musatpy.sea.stereo.fourier import FourierSurface

    fitted = result.fitted
    what = count_of(fitted.count, "wave") if isinstance(fitted, FourierSurface) else "grid"
    rejected = count_of(len(result.rejected), "point")
    return f"{what}, sigma0 {result.sigma0:.3f}, residuals {result.rms:.3f} m RMS, {rejected} rejected"


# --- through that surface, or by control ---


@command.command(name="correct", hidden=True)
@click.argument("points", type=FILE)
@option("-o --out", "File of true points to write; its suffix says the format.", FILE, required=True)
@option("--surface", "Surface NAME.surface.json of 'sea fit'.", FILE, required=True)
@option("--cameras", "File with the two stations of the pair.", FILE, name="stations", required=True)
@system_options
@index_options
@precision_options
@click.pass_context
def sea_command(ctx: click.Context, /, points: Path, surface: Path, stations: Path, **given: Any) -> None:
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
    from musatpy.sea.stereo.surface_file import load_map, load_surface

    options.refuse_overwriting([given["out"]], [points, stations, surface])
    index, fitted, surface_map = index_by(given, pair), load_surface(surface), load_map(surface)
    system = system_of_points(points, pair.system, given["crs"], given["geoid"])
    if (surface_map is None) != (system.ellipsoid is None):
        where = ("in local coordinates", "on the ellipsoid")
        message = f"stands {where[surface_map is not None]}, the points {where[system.ellipsoid is not None]}"
        raise SeaError.of(message, file=surface)
    correction = ThroughSurface(
        system=system,
        fitted=fitted,
        stations=pair.stations.position,
        index=index,
        precision=precision,
        map=surface_map,
        source=str(stations),
    )
    _, tally = write_corrected(points, correction, given)
    if not tally.corrected:
        reject(ctx, points)


def write_corrected(
    points: Path, method: Chosen, given: dict[str, Any], *, bar: bool = True, **more: Any
) -> tuple[Chosen, Tally]:
    """Correct the points of a file, say what has come of them, and return it after the method in their system.

    `more` are arguments of `correct_file`; `bar`: whether it can be shown how far it is.
    """
    from musatpy.correction.files import correct_file

    with progress_through(points, given["quiet"] or not bar) as progress:
        method, tally = correct_file(
            points,
            given["out"],
            method,
            columns=options.columns_of(points, given["columns"]),
            only=given.get("only", ()),
            layer=given.get("layer", ""),
            band=given.get("band", ""),
            progress=progress,
            crs=given["crs"],
            **more,
        )
    if not given["quiet"]:
        first, *lost = method.lines(tally)
        tell("\n".join([f"{name_of(given['out'])}: {first}", *lost]))
    return method, tally


def reject(ctx: click.Context, points: Path, why: str = "no point is corrected") -> None:
    """End with the status of a result that is of no use."""
    from musatpy.runs import ExitStatus

    complain(f"{name_of(points)}: {why}")
    ctx.exit(ExitStatus.REJECTED)


@command.command(name="interpolate", hidden=True)
@click.argument("points", type=FILE)
@click.argument("control", type=FILE)
@option("-o --out", "File of corrected points to write.", FILE, required=True)
@options.columns_option
@system_options
@control_options
@option("--sigma M", name="control_sigma", **CONTROL_SIGMA)
@options.quiet_option
@click.pass_context
def interpolate_command(ctx: click.Context, /, points: Path, control: Path, **given: Any) -> None:
    """Correct the heights of POINTS. An old name of `musat correct --by-control`.

    Exit status 3 if the interpolation does not help.
    """
    correct_by_control(ctx, points, control, given, UNHELPFUL)


def correct_by_control(
    ctx: click.Context, points: Path, control: Path, given: dict[str, Any], unhelpful: int | None = None
) -> None:
    """Correct heights of points by what is interpolated between control points; `unhelpful`: status if in vain."""
    from musatpy.correction.sea_methods import ByControl
    from musatpy.files import write_files
    from musatpy.reports.sea import collocation_text, verdict_line
    from musatpy.sea.interpolation.control_tables import control_of, on_plan
    from musatpy.sea.interpolation.correlation import SignalKind
    from musatpy.sea.interpolation.interpolate import Benefit, InterpolationOptions, interpolate
    from musatpy.sea.interpolation.prediction import Trend

    out = given["out"]
    report, picture = out.with_suffix(".txt"), out.with_suffix(".png")
    _check_outputs([out, report, *([picture] if given["plots"] else [])], [points, control])
    table, system = _control_table(points, control, given)
    mapped = _mapped(points, table, given["columns"], system) if table.needs_mapped else {}
    observed, plan = on_plan(control_of(table, mapped, str(points), given["control_sigma"]), system)
    wanted = InterpolationOptions(
        trend=Trend.PLANE if given["trend"] == "plane" else Trend.CONSTANT,
        families=tuple(kind for kind in SignalKind if not given["families"] or kind in given["families"]),
        free_noise=not given["no_noise"],
        reject=not given["keep_outliers"],
        reach=given["reach"],
    )
    result = interpolate(observed, wanted)
    files = {report: collocation_text(result, table.ids, (points.name, control.name)).encode()}
    if given["plots"]:
        from musatpy.sea.pictures import interpolation_picture

        _, files[picture] = interpolation_picture(result, points.name)
    correction = ByControl(system=system, interpolation=result, plan=plan)
    _, tally = write_corrected(points, correction, given)
    write_files(files)
    if not given["quiet"]:
        tell(verdict_line(result))
    if result.verdict == Benefit.NOT and unhelpful:
        ctx.exit(unhelpful)
    if result.verdict == Benefit.NOT:
        reject(ctx, points, "nothing is gained by its control points")
    if not tally.corrected:
        reject(ctx, points)


def _check_outputs(results: Sequence[Path], inputs: Sequence[Path]) -> None:
    from musatpy.files import real_path

    places = [real_path(path) for path in results]
    if len(set(places)) < len(places):
        raise click.UsageError(
            f"{name_of(results[0])}: the report and the picture stand beside it as .txt and .png"
        )
    options.refuse_overwriting(results, inputs)


def _control_table(points: Path, control: Path, given: dict[str, Any]) -> tuple[ControlTable, Any]:
    """Return the control points of a table, record or deck, and the system of points: as said, else of the job."""
    from musatpy.depth.cameras import LOCAL, system_alone
    from musatpy.formats.musat import read_deck
    from musatpy.sea.interpolation import control_tables

    record, known = (
        control_tables.run_tables(path) if path.suffix.lower() == _RECORD else None for path in (points, control)
    )
    deck = None if control.suffix.lower() in (_RECORD, *_TABLES) else read_deck(control)
    system: Any = system_alone(given["crs"], given["geoid"])
    if system is not None and (record is not None or not system.plane_alone):
        why = "a record has its own system" if record is not None else f"{system.text} has no heights"
        raise click.UsageError(f"--crs: {why}")
    if system is None and (record or known):
        system = control_tables.record_system(record or known or {})
    if system is None:
        system = LOCAL if deck is None else control_tables.deck_system(deck)
    if known is not None:
        return control_tables.record_control(known, str(control), system), system
    if deck is not None:
        return control_tables.deck_control(deck, str(control), system), system
    return control_tables.read_control(control, system), system


def _mapped(points: Path, table: ControlTable, columns: tuple[str, ...], system: Any) -> Any:
    """Return the mapped points of the control points that have true heights alone."""
    from musatpy.sea.interpolation.control_tables import read_mapped, record_mapped

    if points.suffix.lower() == _RECORD:
        return record_mapped(points, system)
    if points.suffix.lower() not in _TABLES:
        message = f"points of {name_of(points)} have no ids: the control points need x, y and dz, or both heights"
        raise click.UsageError(message)
    return read_mapped(points, table.ids, columns, system)
