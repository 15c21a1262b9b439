"""`musat merge`: strips and blocks into one deck."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from musatpy.cli.decks import read_for_editing, write_edited
from musatpy.cli.options import deck_option, decks_argument, formats_option, refuse_overwriting, titles_option
from musatpy.errors import DeckError

if TYPE_CHECKING:
    from musatpy.jobs.agreement import Part
    from musatpy.jobs.naming import NamedKind
    from musatpy.model import Block


@click.command(name="merge", short_help="Put decks together into one.")
@decks_argument
@deck_option
@click.option(
    "--prefix", "prefixes", multiple=True, metavar="DECK=TEXT", help="TEXT before the names of the photos of DECK."
)
@click.option(
    "--point-prefix",
    "point_prefixes",
    multiple=True,
    metavar="DECK=TEXT",
    help="TEXT before the names of the points of DECK, except the --shared ones.",
)
@click.option("--shared", default="", metavar="ID,ID...", help="Points that --point-prefix leaves as they are.")
@click.option(
    "--rename",
    "renames",
    multiple=True,
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="New names: lines of DECK KIND OLD NEW.",
)
@click.option("--join-photos", is_flag=True, help="A photo that several decks have is one photo, and no error.")
@click.option("--options-from", metavar="DECK", help="Whose options and water hold where they differ.")
@click.option("--prefer", metavar="DECK", help="Whose stations, measurements and control hold where they differ.")
@click.option("--near", type=float, metavar="METRES", help="List control of different names that is this near.")
@titles_option
@formats_option
def command(
    decks: tuple[Path, ...],
    out: Path,
    prefixes: tuple[str, ...],
    point_prefixes: tuple[str, ...],
    shared: str,
    renames: tuple[Path, ...],
    join_photos: bool,
    options_from: str | None,
    prefer: str | None,
    near: float | None,
    titles: tuple[str, ...],
    formats_dir: Path | None,
) -> None:
    """Merge two or more DECKs into the deck OUT, and say what was merged, renamed and found to be the same.

    Equal names are one camera, one point, one group. A deck is named by its path or its file name. Exit status: 0,
    or 1 where decks contradict one another or cannot be read; nothing is written then.
    """
    from musatpy.formats.job_tables import card_family
    from musatpy.jobs.merge import MergeOptions, merged
    from musatpy.jobs.naming import NamedKind
    from musatpy.reports.jobs import merge_text

    if len(decks) < 2:
        raise click.UsageError("a merged deck needs two decks at least")
    refuse_overwriting([out], decks)
    family, files = card_family(formats_dir), [str(deck) for deck in decks]
    chosen = MergeOptions(
        join_photos=join_photos,
        options_from=_number("--options-from", options_from, files) if options_from else -1,
        prefer=_number("--prefer", prefer, files) if prefer else -1,
    )
    prefix = {
        NamedKind.PHOTO: _by_deck("--prefix", prefixes, files),
        NamedKind.POINT: _by_deck("--point-prefix", point_prefixes, files),
    }
    blocks = read_for_editing(decks, family)
    parts, names = _renamed(files, blocks, renames, prefix, {name.strip() for name in shared.split(",")})
    job = merged(parts, chosen)
    report = merge_text(parts, names, job) + ("" if near is None else _near_text(parts, near))
    write_edited(job.block, titles, out, family, report)


def _by_deck(option: str, given: Sequence[str], files: list[str]) -> dict[int, str]:
    """Return the texts of options DECK=TEXT by the number of their deck."""
    texts: dict[int, str] = {}
    for prefix in given:
        deck, equals, text = prefix.rpartition("=")
        if not (equals and deck and text):
            raise click.UsageError(f"{option} {prefix}: not DECK=TEXT")
        texts[_number(option, deck, files)] = text
    return texts


def _number(option: str, deck: str, files: list[str]) -> int:
    """Return which deck the text of an option means."""
    from musatpy.jobs.naming import deck_number

    try:
        return deck_number(deck, files)
    except DeckError as error:
        raise click.UsageError(f"{option}: {error}") from error


def _renamed(
    files: list[str],
    blocks: list[Block],
    renames: Sequence[Path],
    prefix: dict[NamedKind, dict[int, str]],
    shared: set[str],
) -> tuple[list[Part], list[dict[NamedKind, dict[str, str]]]]:
    """Return the parts with their new names, and these."""
    from musatpy.jobs.agreement import Part
    from musatpy.jobs.naming import assigned, new_names, prefixed, renamed, text_of

    lines = [line for path in renames for line in new_names(text_of(path), str(path))]
    names = assigned(lines, list(zip(files, blocks, strict=True)))
    for kind, texts in prefix.items():
        for number, text in texts.items():
            names[number][kind] = prefixed(
                blocks[number], kind, text, names[number], shared if kind == "point" else ()
            )
    parts = [
        Part(name=file, block=renamed(block, new, file))
        for file, block, new in zip(files, blocks, names, strict=True)
    ]
    return parts, names


def _near_text(parts: Sequence[Part], limit: float) -> str:
    """Return the control points of different names that are near each other, as lines of a file for --rename."""
    from musatpy.jobs.plan_positions import near_control

    pairs = near_control([part.block for part in parts], limit)
    lines = [
        f"    {shlex.join([parts[second].name, 'point', other, one])}"
        f"  # {distance:.3f} m from that of {parts[first].name}\n"
        for first, one, second, other, distance in pairs
    ]
    return "".join([f"control of different names nearer than {limit:g} m: {len(pairs)}\n", *lines])
