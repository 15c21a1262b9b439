"""`musat as11 compare-soundings`: a compiled bottom beside soundings."""

from __future__ import annotations

import datetime
from pathlib import Path

import click

from musatpy.cli.messages import complain_of_each, count_of, name_of, tell
from musatpy.cli.options import NamedPath, anyway_option, out_option, refuse_overwriting


@click.command(name="compare-soundings", short_help="Hold a bottom against soundings.")
@click.argument("run", type=NamedPath())
@click.argument("bottom", type=NamedPath())
@click.argument("soundings", type=NamedPath())
@out_option
@anyway_option
@click.option(
    "--datum", type=float, default=0.0, help="How far the datum of the soundings is below the bottom's, m."
)
@click.option("--datum-sigma", type=click.FloatRange(min=0.0), default=0.0, help="Of that, m.")
@click.option("--sigma", type=click.FloatRange(min=0.0), default=0.0, help="Of soundings whose file has none, m.")
@click.option("--plan-sigma", type=click.FloatRange(min=0.0), default=0.0, help="Of the places of soundings, m.")
@click.option("--steepest", type=click.FloatRange(min=0.0), default=None, help="Slope of the bottom at most.")
@click.option(
    "--radius",
    type=click.FloatRange(min=0.0, min_open=True),
    default=None,
    help="The bottom is the plane of the points so near, m, and no triangle.",
)
@click.option("--not-before", type=click.DateTime(["%Y-%m-%d"]), default=None, help="First day (column date).")
@click.option("--crs", default="", help="Coordinate system of x and y of a file that says none: EPSG:32620.")
@click.option("--plots", is_flag=True, help="A picture of the differences too (SOUNDINGS.soundings.png).")
def command(
    run: Path,
    bottom: Path,
    soundings: Path,
    out_dir: Path | None,
    anyway: bool,
    steepest: float | None,
    radius: float | None,
    not_before: datetime.datetime | None,
    crs: str,
    plots: bool,
    **sigmas: float,
) -> None:
    """Hold soundings of the CSV, LAS or LAZ file SOUNDINGS against BOTTOM, in the system of RUN.json.

    BOTTOM is a deck, which is compiled in stereomodels of the run, or a GeoTIFF with bands depth and sigma, as
    `musat correct --surface` and the grids of `musat as11 compile` are. Columns of a CSV file are lat and lon
    (degrees) or x and y, depth or height, and sigma, name and date as known. The listing goes to
    SOUNDINGS.soundings.lst, the record to SOUNDINGS.soundings.json.
    """
    import math

    from musatpy.as11_comparisons import compare_soundings
    from musatpy.compilation.sounded import Matching
    from musatpy.soundings.differences import samples

    stem = (soundings.parent if out_dir is None else out_dir) / f"{soundings.stem}.soundings"
    listing, record, picture = (stem.with_name(f"{stem.name}.{kind}") for kind in ("lst", "json", "png"))
    refuse_overwriting([listing, record, picture], [run, bottom, soundings])
    how = Matching(
        steepest=math.inf if steepest is None else steepest,
        radius=math.inf if radius is None else radius,
        not_before=None if not_before is None else not_before.date(),
        **sigmas,
    )
    compared, warnings = compare_soundings(
        run, bottom, soundings, (listing, record), how, picture=picture if plots else None, crs=crs, anyway=anyway
    )
    complain_of_each(soundings, warnings)
    first = samples(compared.differences)[0]
    tell(
        f"{name_of(soundings)}: {len(compared.rows)} of {count_of(len(compared.soundings.names), 'sounding')}, "
        f"median {first.median:.3f} m, NMAD {first.spread:.3f} m, listing {name_of(listing)}"
    )
