"""`musat sea fit`: the surface of the water from points on it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from musatpy.cli.depth_options import POSITIVE, system_options
from musatpy.cli.messages import count_of, name_of, tell
from musatpy.cli.options import columns_of, out_option, picture_options, refuse_overwriting
from musatpy.cli.sea_options import pair_by, precision_by, precision_options

if TYPE_CHECKING:
    from musatpy.figures import ImageForm
    from musatpy.sea.stereo.estimate import SurfaceFit
    from musatpy.sea.stereo.surface_points import SurfacePoints

_OF = {"fourier": ("shortest", "longest", "most"), "grid": ("spacing", "curvature")}


@click.command(name="fit", short_help="Estimate the surface of the water.")
@click.argument("points", type=click.Path(path_type=Path))
@click.option("--model", type=click.Choice(list(_OF)), default="fourier", show_default=True, help="Waves or grid.")
@click.option("--shortest", type=POSITIVE, metavar="M", help="Shortest wave; default: the mean point spacing.")
@click.option("--longest", type=POSITIVE, metavar="M", help="Longest wave; default: the extent of the points.")
@click.option("--most", type=click.IntRange(0, 50), help="Largest number of waves. Default: 8.")
@click.option("--spacing", type=POSITIVE, metavar="M", help="Spacing of the grid; default: that of the points.")
@click.option("--curvature", type=POSITIVE, metavar="1/M", help="Sigma of the curvature; default: the likeliest.")
@click.option("--cameras", "stations", type=click.Path(path_type=Path), help="The two stations, for --image-sigma.")
@click.option("--plots", is_flag=True, help="Also draw the picture NAME.surface.png; needs the extra 'plots'.")
@picture_options("plots")
@system_options
@out_option
@precision_options
def command(
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
    columns = columns_of(points, given["columns"])
    crs, geoid = given["crs"], given["geoid"]
    system = system_alone(crs, geoid) if pair is None else system_of_points(points, pair, crs, geoid)
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
    refuse_overwriting(files, [points])
    write_files(files)
    if not quiet:
        tell(f"{name_of(report)}: {_summary(result)}")


def _fit(path: Path, points: SurfacePoints, model: str, given: dict[str, Any]) -> SurfaceFit:
    from musatpy.errors import Problem, SeaError
    from musatpy.sea.stereo.estimate import fit_fourier, fit_grid

    wanted = {name: given[name] for name in _OF[model] if given[name] is not None}
    try:
        return (fit_fourier if model == "fourier" else fit_grid)(points, **wanted)
    except ValueError as error:
        raise SeaError([Problem(file=str(path), message=str(error))]) from error


def _summary(result: SurfaceFit) -> str:
    from musatpy.sea.stereo.fourier import FourierSurface

    fitted = result.fitted
    what = count_of(fitted.count, "wave") if isinstance(fitted, FourierSurface) else "grid"
    rejected = count_of(len(result.rejected), "point")
    return f"{what}, sigma0 {result.sigma0:.3f}, residuals {result.rms:.3f} m RMS, {rejected} rejected"
