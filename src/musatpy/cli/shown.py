"""The options of `musat run` for what people look at: pictures, a page, and layers for GIS."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from musatpy.cli.messages import complain, complain_of_each, complain_of_error, count_of, name_of, tell
from musatpy.cli.options import options_of
from musatpy.errors import MusatError, ProblemsError

if TYPE_CHECKING:
    from musatpy.runs import RunResult
    from musatpy.shown_runs import Shown

shown_options = options_of(
    click.option("--plots", is_flag=True, help="The pictures of 'musat plot' too (NAME.plan.svg, ...)."),
    click.option("--html", is_flag=True, help="The page of 'musat report' too (NAME.html)."),
    click.option("--gis", is_flag=True, help="Stations, points, observations for GIS too (NAME.gpkg, GeoJSON)."),
    click.option("--crs", default="", help="With --gis: their system, on the ellipsoid of the job: EPSG:4267."),
)


def shown_of(given: dict[str, Any]) -> Shown:
    """Return what options want, taken from all that is given. Raises `click.UsageError` where it cannot be had."""
    from musatpy.shown_runs import Shown, check_packages

    wanted = Shown(**{name: given.pop(name) for name in ("plots", "html", "gis", "crs")})
    if wanted.crs and not wanted.gis:
        raise click.UsageError("--crs goes with --gis")
    try:
        check_packages(wanted)
    except ProblemsError as error:
        raise click.UsageError(f"--crs: {error.problems[0].message}") from error
    return wanted


def show(result: RunResult, wanted: Shown, quiet: bool) -> bool:
    """Write what is wanted of a run, say so, and return whether all of it could be."""
    if result.listing is None or not wanted.anything:
        return True
    from musatpy.plots.picture import NothingToShowError
    from musatpy.shown_runs import draw_run, write_layers, write_page

    name, done = name_of(result.deck), True
    try:
        if wanted.plots:
            drawn = draw_run(result)
            complain_of_each(result.deck, (f"no {picture}: {why}" for picture, why in drawn.reasons.items()))
            if drawn.files and not quiet:
                tell(f"{name}: {count_of(len(drawn.files), 'picture')}, {name_of(drawn.files[0])} the first")
        if wanted.html:
            page = write_page(result)
            if not quiet:
                tell(f"{name}: page {name_of(page)}")
        if wanted.gis:
            files, refused = write_layers(result, wanted.crs)
            complain_of_each(result.deck, refused)
            if not quiet:
                tell(f"{name}: layers {', '.join(name_of(file) for file in files)}")
    except ProblemsError as error:
        complain_of_each(result.deck, (problem.message for problem in error.problems))
        done = False
    except (OSError, MusatError) as error:
        complain_of_error(error)
        done = False
    except NothingToShowError as error:
        complain(f"{name}: no layers: {error}")
    return done
