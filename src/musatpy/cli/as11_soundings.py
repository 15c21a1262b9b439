"""`musat as11 compare-soundings`: a compiled bottom beside soundings."""

from __future__ import annotations

import datetime
from pathlib import Path

import click

from musatpy.cli.messages import complain, count_of, name_of, tell
from musatpy.cli.options import NamedPath, anyway_option, out_option, refuse_overwriting


@click.command(name="compare-soundings", short_help="Hold the bottom of a deck against soundings.")
@click.argument("run", type=NamedPath())
@click.argument("deck", type=NamedPath())
@click.argument("soundings", type=NamedPath())
@out_option
@anyway_option
@click.option("--datum", type=float, default=0.0, help="How far the datum of the soundings is below the deck's, m.")
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
    deck: Path,
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
    """Compile DECK in stereomodels of RUN.json, and hold its bottom against the CSV, LAS or LAZ file SOUNDINGS.

    Columns of a CSV file are lat and lon (degrees) or x and y, depth or height, and sigma, name and date as known.
    The listing goes to SOUNDINGS.soundings.lst, the record to SOUNDINGS.soundings.json.
    """
    import math

    from musatpy.as11_runs import compiled_deck
    from musatpy.compilation.joined_surfaces import surfaces_of
    from musatpy.compilation.sounded import Matching, sounded
    from musatpy.files import write_files
    from musatpy.reports import soundings as report
    from musatpy.reports.record import dumps
    from musatpy.soundings.differences import samples, scale_warning
    from musatpy.soundings.pictures import difference_picture
    from musatpy.soundings.sounding_files import read_soundings

    stem = (soundings.parent if out_dir is None else out_dir) / f"{soundings.stem}.soundings"
    listing, record, picture = (stem.with_name(f"{stem.name}.{kind}") for kind in ("lst", "json", "png"))
    refuse_overwriting([listing, record, picture], [run, deck, soundings])
    result, _ = compiled_deck(run, deck, anyway)
    how = Matching(
        steepest=math.inf if steepest is None else steepest,
        radius=math.inf if radius is None else radius,
        not_before=None if not_before is None else not_before.date(),
        **sigmas,
    )
    read = read_soundings(soundings, result.run.ellipsoid, crs=crs, dated=not_before is not None)
    compared = sounded(surfaces_of(result)[0], read, how)
    if not len(compared.rows):
        why = next(iter(compared.reasons.values()), "there is no bottom")
        raise click.ClickException(f"no sounding meets the bottom: {why}")
    text, values = report.listing_of(compared, result), dumps(report.record_of(compared, result))
    files = {listing: text.encode(), record: values.encode()}
    if plots:
        title = f"{soundings.name} and the bottom of {deck.name}"
        files[picture] = difference_picture(compared.differences, compared.xy, title)
    write_files(files)
    if warning := scale_warning(compared.differences):
        complain(f"{name_of(soundings)}: {warning}")
    first = samples(compared.differences)[0]
    tell(
        f"{name_of(soundings)}: {len(compared.rows)} of {count_of(len(compared.soundings.names), 'sounding')}, "
        f"median {first.median:.3f} m, NMAD {first.spread:.3f} m, listing {name_of(listing)}"
    )
