"""`musat sea fit`: the surface of the water from points on it, and the pair that they come from."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from musatpy.cli import options
from musatpy.cli.depth_options import POSITIVE, Numbers, system_options
from musatpy.cli.messages import count_of, name_of, tell
from musatpy.cli.options import LazyGroup, flag, option, options_of

if TYPE_CHECKING:
    from musatpy.depth.cameras import CameraStations
    from musatpy.figures import ImageForm
    from musatpy.sea.stereo.estimate import SurfaceFit
    from musatpy.sea.stereo.point_records import PointPrecision
    from musatpy.sea.stereo.surface_points import SurfacePoints

_HIDDEN = {  # old names of `musat correct --sea` and `--by-control`
    "correct": "musatpy.cli.sea_correct:sea_command",
    "interpolate": "musatpy.cli.sea_correct:interpolate_command",
}
_OF = {"fourier": ("shortest", "longest", "most"), "grid": ("spacing", "curvature")}


class SigmaOption(Numbers):
    """Sigmas of three coordinates, or one of all."""

    name = "sigmas"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Return the three sigmas of a text."""
        sigmas = super().convert(value, param, ctx)
        if len(sigmas) not in (1, 3):
            self.fail(f"1 or 3 numbers are needed, not {len(sigmas)}", param, ctx)
        if min(sigmas) <= 0.0:
            self.fail("a sigma is greater than zero", param, ctx)
        return sigmas * (3 // len(sigmas))


precision_options = options_of(
    option(
        "--sigma M|X,Y,Z",
        "Sigma of points that have none of their own: one for all coordinates, or one for each.",
        SigmaOption(),
    ),
    option("--image-sigma UM", "Sigma of plate coordinates; replaces --sigma.", POSITIVE),
    options.columns_option,
    options.quiet_option,
    option("--focal MM", "Focal length of the pair, with --image-sigma.", POSITIVE),
    option("--pair LEFT,RIGHT", "Names of the two stations, if there are more."),
    option("--only PATTERN", "Use only points with such names, as 'W*'.", multiple=True),
)


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


@click.group(name="sea", cls=LazyGroup, modules=_HIDDEN, short_help="Estimate the surface of the water.")
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
    from musatpy.errors import SeaError
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
