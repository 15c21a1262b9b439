"""`musat extract`: photos or an area out of a deck."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from musatpy.cli.decks import read_for_editing, write_edited
from musatpy.cli.options import deck_option, formats_option, refuse_overwriting, titles_option

if TYPE_CHECKING:
    from musatpy.arrays import BoolArray
    from musatpy.jobs.plan_positions import Area
    from musatpy.model import Block


@click.command(name="extract", short_help="Take photos or an area out of a deck.")
@click.argument("deck", type=click.Path(path_type=Path))
@deck_option
@click.option("--photos", metavar="LIST", help="Photos and ranges of them: 101-120,131.")
@click.option(
    "--photos-from", type=click.Path(path_type=Path), metavar="FILE", help="Likewise, on the lines of FILE."
)
@click.option("--box", metavar="W,S,E,N", help="Photos in a box: X and Y of local jobs, else degrees.")
@click.option(
    "--area",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Photos in a polygon: GeoJSON, or lines of east and north.",
)
@click.option(
    "--by",
    type=click.Choice(["stations", "points"]),
    default="stations",
    show_default=True,
    help="A photo is in an area by its station, or by any of its points.",
)
@click.option("--height", type=float, metavar="METRES", help="Height of the ground for --by points.")
@click.option("--drop-single", is_flag=True, help="Leave out points that would have one ray and nothing known.")
@titles_option
@formats_option
def command(
    deck: Path,
    out: Path,
    photos: str | None,
    photos_from: Path | None,
    box: str | None,
    area: Path | None,
    by: str,
    height: float | None,
    drop_single: bool,
    titles: tuple[str, ...],
    formats_dir: Path | None,
) -> None:
    """Write the photos of DECK that are named or in the area, with all that belongs to them, as the deck OUT.

    Named photos and those in the area both come along. Says what was left out. Exit status: 0, or 1 where the deck
    cannot be read or no photo is asked for; nothing is written then.
    """
    from musatpy.formats.job_tables import card_family
    from musatpy.jobs.extract import extracted, photos_named
    from musatpy.reports.jobs import extract_text

    if not any((photos, photos_from, box, area)):
        raise click.UsageError("say which photos: --photos, --photos-from, --box or --area")
    if height is not None and by != "points":
        raise click.UsageError("--height is for --by points")
    refuse_overwriting([out], [deck])
    family = card_family(formats_dir)
    (block,) = read_for_editing([deck], family)
    chosen = photos_named(block, _wanted(photos, photos_from))
    for polygon in _areas(block, box, area):
        chosen |= _in_area(block, polygon, by, height)
    part = extracted(block, chosen, drop_single=drop_single)
    write_edited(part.block, titles, out, family, extract_text(part))


def _wanted(photos: str | None, photos_from: Path | None) -> list[str]:
    """Return the names and ranges of photos that the options list."""
    from musatpy.jobs.naming import names_of, text_of

    named = [name.strip() for name in (photos or "").split(",") if name.strip()]
    return named + (names_of(text_of(photos_from)) if photos_from else [])


def _areas(block: Block, box: str | None, area: Path | None) -> list[Area]:
    from musatpy.jobs.naming import text_of
    from musatpy.jobs.plan_positions import Area, area_of
    from musatpy.model import CoordinateSystem

    geographic = block.options.system is not CoordinateSystem.LOCAL
    areas = []
    if box:
        try:
            west, south, east, north = (float(limit) for limit in box.split(","))
        except ValueError as error:
            raise click.UsageError(f"--box {box}: not four numbers W,S,E,N") from error
        areas.append(Area.box(west, south, east, north, geographic=geographic))
    if area:
        areas.append(area_of(text_of(area), str(area), geographic=geographic))
    return areas


def _in_area(block: Block, area: Area, by: str, height: float | None) -> BoolArray:
    from musatpy.jobs.extract import photos_above, photos_showing
    from musatpy.jobs.plan_positions import ground_level

    if by == "stations":
        return photos_above(block, area)
    return photos_showing(block, area, ground_level(block) if height is None else height)
