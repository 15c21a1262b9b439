"""`musat depth`: depth factors over a stereo model, and the correction of apparent points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from musatpy.cli import depth_options
from musatpy.cli.correct import correct as correct_points
from musatpy.cli.correct import correction_options
from musatpy.cli.depth_options import NUMBER, POSITIVE
from musatpy.cli.messages import name_of, tell
from musatpy.cli.options import FILE, LazyGroup, dpi_option, option


@click.group(name="depth", cls=LazyGroup, short_help="Print and draw depth factors.")
def command() -> None:
    """Print and draw the depth factors of submerged points over a stereo model."""


@command.command(name="table")
@depth_options.view_options
@depth_options.area_options
@depth_options.depths_option
@option("--at", "File of places, with columns x,y or d1,d2,s,t.", click.Path(path_type=Path), name="listed")
def table(listed: Path | None, depths: tuple[float, ...], **given: Any) -> None:
    """Print the depth factor at places of a model, for some apparent depths."""
    from musatpy.depth.views import factor_table

    view = depth_options.ModelView(given)
    places, factors = view.listed(listed, depths) if listed else view.over_grid(depths)
    tell(view.heading())
    tell("\n".join(factor_table(places, factors)))


@command.command(name="errors")
@depth_options.view_options
@depth_options.area_options
@depth_options.depths_option
@option("--normal", "Apparent depth whose factors are used for all depths.", NUMBER, shown=25.0)
@option("--value", "Factor to use for the whole model. Default: the median of all places.", POSITIVE)
@option("--step", "Step between the factors listed.", POSITIVE, shown=0.01)
def errors(depths: tuple[float, ...], normal: float, value: float | None, step: float, **given: Any) -> None:
    """Print the errors of two approximations: the factors of one depth for all depths, and one factor for the whole
    model."""
    import numpy as np

    from musatpy.depth.views import normalised, normalised_table, single_table, single_value

    view = depth_options.ModelView(given)
    places, factors = view.over_grid(depths)
    _, at_normal = view.over_grid((normal,))
    factor = at_normal.factor[:, 0]
    if not np.isfinite(factor).any():
        raise click.UsageError("there is no factor anywhere: " + "; ".join(at_normal.reasons()))
    depth_options.check_step(step, factor)
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
@depth_options.view_options
@depth_options.area_options
@option("--depth", "Apparent depth.", NUMBER, shown=25.0)
@option("--step", "Step between the contours.", POSITIVE, shown=0.01)
@dpi_option
def picture(picture: Path, depth: float, step: float, dpi: int, **given: Any) -> None:
    """Draw contours of the depth factor over a model into PICTURE (.png, .svg, .pdf)."""
    import numpy as np

    from musatpy.depth.views import contour_picture
    from musatpy.figures import ImageForm

    given["grid"] = tuple(max(61.0, number) for number in given["grid"])  # smooth lines
    view = depth_options.ModelView(given)
    x, y = view.grid()
    _, factors = view.over_grid((depth,))
    factor = factors.factor.reshape(len(y), len(x))
    if not np.isfinite(factor).any():
        raise click.UsageError("there is no factor anywhere: " + "; ".join(factors.reasons()))
    depth_options.check_step(step, factor)
    job = f"\n{given['stations'].stem}" if given["stations"] else ""
    title = f"Depth factor at an apparent depth of {depth:g}\n{view.heading()}{job}"
    contour_picture(picture, x, y, factor, view.nadirs(), title=title, step=step, form=ImageForm(dpi=dpi))
    tell(f"{name_of(picture)}: F {np.nanmin(factor):.4f} to {np.nanmax(factor):.4f}")


@command.command(name="correct", hidden=True)
@click.argument("points", type=FILE)
@option("--cameras", "Stations: a CSV file or RUN.json.", FILE, name="stations", required=True)
@correction_options
@click.pass_context
def correct(ctx: click.Context, /, points: Path, stations: Path, **given: Any) -> None:
    """Correct points. An old name of `musat correct`."""
    correct_points(ctx, points, stations, is_run=stations.suffix.lower() == ".json", **given)
