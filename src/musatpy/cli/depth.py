"""`musat depth`: depth factors over a stereo model, and the correction of apparent points."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from musatpy.cli.depth_options import (
    NUMBER,
    POSITIVE,
    View,
    area_options,
    camera_options,
    cameras_by,
    check_step,
    depths_option,
    index_by,
    index_options,
    system_options,
    view_options,
)
from musatpy.cli.messages import name_of, progress_through, tell
from musatpy.cli.options import columns_of, columns_option, quiet_option, refuse_overwriting

if TYPE_CHECKING:
    from musatpy.depth.correction import Correction, Progress, Tally


@click.group(name="depth", short_help="Depth factors, and true points of apparent ones.")
def command() -> None:
    """Depth factors of submerged points over a stereo model, and the correction of files of apparent points."""


@command.command(name="table")
@view_options
@area_options
@depths_option
@click.option("--at", "listed", type=click.Path(path_type=Path), help="A file of places: x,y or d1,d2,s,t.")
def table(listed: Path | None, depths: tuple[float, ...], **given: Any) -> None:
    """Print the depth factor at places of a model, for some apparent depths."""
    from musatpy.depth.factor_tables import factor_table

    view = View(given)
    places, factors = view.listed(listed, depths) if listed else view.over_grid(depths)
    tell(view.heading())
    tell("\n".join(factor_table(places, factors)))


@command.command(name="errors")
@view_options
@area_options
@depths_option
@click.option(
    "--normal", type=NUMBER, default=25.0, show_default=True, help="Apparent depth whose factors are used."
)
@click.option("--value", type=POSITIVE, help="One factor for the model; the median of the places where not given.")
@click.option("--step", type=POSITIVE, default=0.01, show_default=True, help="Between the factors listed.")
def errors(depths: tuple[float, ...], normal: float, value: float | None, step: float, **given: Any) -> None:
    """Print what two approximations cost: factors of one depth for all, and one factor for the whole model."""
    import numpy as np

    from musatpy.depth.factor_tables import normalised_table, single_table
    from musatpy.depth.views import normalised, single_value

    view = View(given)
    places, factors = view.over_grid(depths)
    _, at_normal = view.over_grid((normal,))
    factor = at_normal.factor[:, 0]
    if not np.isfinite(factor).any():
        raise click.UsageError("there is no factor anywhere: " + "; ".join(at_normal.reasons()))
    check_step(step, factor)
    x, y = (places[name] for name in ("x", "y"))
    tell(view.heading())
    tell(f"Factors of the apparent depth {normal:g} for all depths: largest departures")
    tell("\n".join(normalised_table(x, y, factors.depths, normalised(factors, factor))))
    value = float(np.nanmedian(factor)) if value is None else value
    tell(f"One factor {value:.4f} for the whole model, apparent depth {normal:g}")
    tell("\n".join(single_table(single_value(factor, value, normal, step))))
    missing = np.count_nonzero(np.isnan(factor))
    if missing:
        tell(f"{missing} of {len(factor)} places have no factor: {'; '.join(at_normal.reasons())}")
    for reason in factors.reasons():
        tell(f"-: {reason}")


@command.command(name="picture")
@click.argument("picture", type=click.Path(path_type=Path))
@view_options
@area_options
@click.option("--depth", type=NUMBER, default=25.0, show_default=True, help="Apparent depth.")
@click.option("--step", type=POSITIVE, default=0.01, show_default=True, help="Between contours.")
def picture(picture: Path, depth: float, step: float, **given: Any) -> None:
    """Draw contours of the depth factor over a model into PICTURE (.png, .svg, .pdf)."""
    import numpy as np

    from musatpy.depth.picture import contour_picture

    given["grid"] = tuple(max(61.0, number) for number in given["grid"])  # smooth lines
    view = View(given)
    x, y = view.grid()
    _, factors = view.over_grid((depth,))
    factor = factors.factor.reshape(len(y), len(x))
    if not np.isfinite(factor).any():
        raise click.UsageError("there is no factor anywhere: " + "; ".join(factors.reasons()))
    check_step(step, factor)
    title = f"Depth factor at an apparent depth of {depth:g}\n{view.heading()}"
    contour_picture(picture, x, y, factor, view.nadirs(), title=title, step=step)
    tell(f"{name_of(picture)}: F {np.nanmin(factor):.4f} to {np.nanmax(factor):.4f}")


@command.command(name="correct")
@click.argument("points", type=click.Path(path_type=Path))
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path), help="The file of true points.")
@click.option(
    "--cameras",
    "stations",
    required=True,
    type=click.Path(path_type=Path),
    help="The exposure stations: a CSV file, or RUN.json.",
)
@system_options
@index_options
@camera_options
@columns_option
@click.option(
    "-j", "--jobs", type=click.IntRange(min=1), help="Processes; as many as there are cores where not given."
)
@quiet_option
def correct(
    points: Path, out: Path, stations: Path, columns: tuple[str, ...], jobs: int | None, quiet: bool, **given: Any
) -> None:
    """Correct the apparent points of POINTS (.csv, .las, .laz) for refraction.

    A camera sees a point that lies in its format, which needs attitudes, focal length and format, and within
    --angle of the vertical; one of the two rules is needed. Points are in the system of the stations, metres with Z
    up; those of a run on the ellipsoid in any (--crs, a LAS file's own, or that of the run): x east or longitude in
    degrees, y north or latitude, heights above the ellipsoid unless --geoid says another.
    """
    from musatpy.depth.correction import Correction
    from musatpy.depth.point_systems import system_of_points
    from musatpy.pointfiles.las_files import SUFFIXES

    refuse_overwriting([out], [points, stations])
    names = columns_of(points, columns)
    cameras = cameras_by(stations, given)
    if not cameras.has_rule:
        message = "what a camera sees is not known: attitudes, focal length and format are needed, or --angle"
        raise click.UsageError(message)
    las = points.suffix.lower() in SUFFIXES
    if las != (out.suffix.lower() in SUFFIXES):
        raise click.UsageError(f"{name_of(points)} and {name_of(out)} are not of one kind")
    system = system_of_points(points, cameras, given["crs"], given["geoid"])
    correction = Correction(cameras=cameras, index=index_by(given, cameras), system=system)
    with progress_through(points, quiet) as progress:
        tally = _correct(points, out, correction, names, jobs or _cores(), progress)
    if not quiet:
        taken = [f"points taken as {system.text}"] if system.ellipsoid else []
        tell("\n".join([f"{name_of(out)}: {tally.lines()[0]}", *tally.lines()[1:], *taken]))


def _correct(
    points: Path, out: Path, correction: Correction, names: tuple[str, ...], jobs: int, progress: Progress | None
) -> Tally:
    from musatpy.depth.csv_points import correct_csv
    from musatpy.depth.las_points import correct_las
    from musatpy.pointfiles.las_files import SUFFIXES

    if points.suffix.lower() in SUFFIXES:
        return correct_las(points, out, correction, jobs=jobs, progress=progress)
    return correct_csv(points, out, correction, columns=names, jobs=jobs, progress=progress)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
