"""Commands that read decks which need not be ready for a run: `check`, `list`, `merge` and `extract`."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from musatpy.cli import options
from musatpy.cli.messages import complain, name_of, problem_text, tell, tell_as_is
from musatpy.cli.options import FILE, flag, option
from musatpy.errors import DeckError, Problem, count_of, of_each_kind, printable

if TYPE_CHECKING:
    from musatpy.formats.cards.spec import Family
    from musatpy.formats.job_tables import Tables
    from musatpy.geometry.areas import Area
    from musatpy.jobs.agreement import Part
    from musatpy.jobs.naming import NamedKind
    from musatpy.model import Block

STREAM = Path("-")  # as a deck: the standard input; as an output: the standard output


def _source_of(deck: Path) -> Path | bytes:
    """Return where a deck is read from: its path, or of `-` the bytes of the standard input."""
    return data_of(deck) if deck == STREAM else deck


def data_of(deck: Path) -> bytes:
    """Return the bytes of a deck, or of the standard input."""
    return sys.stdin.buffer.read() if deck == STREAM else deck.read_bytes()


def write_deck(path: Path, data: bytes) -> None:
    """Write the bytes of a deck to a file, or to the standard output."""
    from musatpy.files import write_files

    if path == STREAM:
        tell_as_is(data)
    else:
        write_files({path: data})


def _blocks_of(decks: Iterable[Path], family: Family) -> list[Block]:
    """Return the blocks of decks, which may lack a datum. Raises `DeckError` with every error of all of them."""
    from musatpy.formats.musat import check_deck

    blocks, errors = [], []
    for deck in decks:
        block, problems = check_deck(_source_of(deck), family, for_run=False)
        errors += [problem for problem in problems if problem.severity == "error"]
        if block is not None:
            blocks.append(block)
    if errors:
        raise DeckError(errors)
    return blocks


def _sizes_of(block: Block) -> list[str]:
    """Return how many photos, points, measurements and control points a block has, in words."""
    tables = {
        "photo": block.photos,
        "point": block.points,
        "plate measurement": block.plates,
        "control point": block.control,
    }
    return [count_of(table.count, noun) for noun, table in tables.items()]


@click.command(name="check", short_help="Print every problem of a deck.")
@options.decks_argument
@options.formats_option
@options.set_option
@options.quiet_as("One line for each problem, and no counts.")
@click.pass_context
def check_command(
    ctx: click.Context, decks: tuple[Path, ...], formats: Path | None, settings: tuple[str, ...], quiet: bool
) -> None:
    """Print every problem of each DECK (- is the standard input), with ruler and carets, and how many there are.

    Exit status: 0 no errors (there may be warnings), 1 errors.
    """
    from musatpy.formats.job_tables import card_family
    from musatpy.formats.musat import check_deck

    family = card_family(formats)
    instead = options.settings_for(settings, family)
    usable = True
    for deck in decks:
        block, problems = check_deck(_source_of(deck), family, settings=instead)
        for problem in of_each_kind(problems):
            tell_as_is(f"{problem_text(problem)}\n")
        errors = sum(problem.severity == "error" for problem in problems)
        counts = f"{count_of(errors, 'error')}, {count_of(len(problems) - errors, 'warning')}"
        sizes = "" if block is None else f"; {', '.join(_sizes_of(block)[:3])}"
        if not quiet:
            tell(f"{name_of(deck)}: {counts}{sizes}")
        usable = usable and block is not None
    ctx.exit(0 if usable else 1)


@click.command(name="list", short_help="List the contents of decks.")
@options.decks_argument
@flag("--json", "Print JSON, a list with an entry for each deck.", name="as_json")
@option("--few", "Number of common points that join two photos.", click.IntRange(min=1), shown=5)
@options.formats_option
def list_command(decks: tuple[Path, ...], as_json: bool, few: int, formats: Path | None) -> None:
    """List photos, rays, overlaps, control and submerged points of each DECK, even if it cannot be run yet.

    A DECK - is the standard input. Exit status: 0, or 1 where a deck cannot be read.
    """
    from musatpy.formats.job_tables import card_family
    from musatpy.jobs.summary import summary
    from musatpy.reports.jobs import list_record, list_text

    jobs = [summary(block, few) for block in _blocks_of(decks, card_family(formats))]
    names = [name_of(deck) for deck in decks]
    if as_json:
        records = [list_record(job, name) for job, name in zip(jobs, names, strict=True)]
        tell(json.dumps(records, indent=1))
        return
    pages = "\f".join(list_text(job, name) for job, name in zip(jobs, names, strict=True))
    tell_as_is("\f".join(map(printable, pages.split("\f"))))


@click.command(name="merge", short_help="Merge several decks into one.")
@options.decks_argument
@options.deck_option
@option("--prefix DECK=TEXT", "Put TEXT before the names of the photos of DECK.", name="prefixes", multiple=True)
@option(
    "--point-prefix DECK=TEXT",
    "Put TEXT before the names of the points of DECK, except the --shared ones.",
    name="point_prefixes",
    multiple=True,
)
@option("--shared ID,ID...", "Points whose names --point-prefix does not change.", default="")
@option("--rename FILE", "File of new names, with lines DECK KIND OLD NEW.", FILE, name="renames", multiple=True)
@flag("--join-photos", "Accept that a photo is in several decks, as one photo.")
@option("--options-from DECK", "Deck whose options and water are taken where they differ.")
@option("--prefer DECK", "Deck whose stations, measurements and control are taken where they differ.")
@option("--near METRES", "List control points of different names that are nearer than this.", float)
@options.titles_option
@options.formats_option
def merge_command(
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
    formats: Path | None,
) -> None:
    """Merge two or more DECKs into the deck OUT, and say what was merged, renamed and found to be the same.

    Equal names are taken as one camera, one point, one group. Options name a deck by its path or its file name.
    Exit status: 0, or 1 if decks contradict one another or cannot be read; nothing is written then.
    """
    from musatpy.formats.job_tables import card_family
    from musatpy.jobs.agreement import Part
    from musatpy.jobs.merge import MergeOptions, merged
    from musatpy.jobs.naming import NamedKind, assigned, new_names, prefixed, renamed, text_of
    from musatpy.reports.jobs import merge_text

    if len(decks) < 2:
        raise click.UsageError("a merged deck needs two decks at least")
    options.refuse_overwriting([out], decks)
    family, files = card_family(formats), [str(deck) for deck in decks]
    chosen = MergeOptions(
        join_photos=join_photos,
        options_from=_number("--options-from", options_from, files) if options_from else -1,
        prefer=_number("--prefer", prefer, files) if prefer else -1,
    )
    prefix: dict[NamedKind, tuple[dict[int, str], set[str]]] = {
        NamedKind.PHOTO: (_by_deck("--prefix", prefixes, files), set()),
        NamedKind.POINT: (
            _by_deck("--point-prefix", point_prefixes, files),
            {name.strip() for name in shared.split(",")},
        ),
    }
    blocks = _blocks_of(decks, family)
    lines = [line for path in renames for line in new_names(text_of(path), str(path))]
    names = assigned(lines, list(zip(files, blocks, strict=True)))
    for kind, (texts, but) in prefix.items():
        for n, text in texts.items():
            names[n][kind] = prefixed(blocks[n], kind, text, names[n], but)
    parts = [
        Part(name=file, block=renamed(block, new, file))
        for file, block, new in zip(files, blocks, names, strict=True)
    ]
    job = merged(parts, chosen)
    report = merge_text(parts, names, job) + ("" if near is None else _near_text(parts, near))
    _write_edited(job.block, titles, decks, out, family, report)


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

    with options.usage_errors(DeckError, option):
        return deck_number(deck, files)


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


@click.command(name="extract", short_help="Take photos or an area out of a deck.")
@click.argument("deck", type=FILE)
@options.deck_option
@option("--photos LIST", "Photos and ranges of photos, for example 101-120,131.", default="")
@option("--photos-from FILE", "File with such photos, one or more on a line.", FILE)
@option("--box W,S,E,N", "Photos in a box: X and Y of local jobs, else degrees.")
@option("--area FILE", "Photos in a polygon: GeoJSON, or lines of east and north.", FILE)
@option(
    "--by",
    "What must be in the area for a photo to be taken: its station, or any of its points.",
    click.Choice(["stations", "points"]),
    shown="stations",
)
@option("--height METRES", "Height of the ground, for --by points.", float)
@flag("--drop-single", "Leave out points that would have a single ray and no known coordinate.")
@options.titles_option
@options.formats_option
def extract_command(
    deck: Path,
    out: Path,
    photos: str,
    photos_from: Path | None,
    box: str | None,
    area: Path | None,
    by: str,
    height: float | None,
    drop_single: bool,
    titles: tuple[str, ...],
    formats: Path | None,
) -> None:
    """Write the photos of DECK that are named or lie in an area, with all that belongs to them, as the deck OUT.

    Prints what was left out. Exit status: 0, or 1 if the deck cannot be read or no photo is asked for; nothing is
    written then.
    """
    from musatpy.formats.job_tables import card_family
    from musatpy.jobs.extract import extracted, photos_above, photos_named, photos_showing
    from musatpy.jobs.naming import names_of, text_of
    from musatpy.jobs.plan_positions import ground_level
    from musatpy.reports.jobs import extract_text

    if not any((photos, photos_from, box, area)):
        raise click.UsageError("say which photos: --photos, --photos-from, --box or --area")
    if height is not None and by != "points":
        raise click.UsageError("--height is for --by points")
    options.refuse_overwriting([out], [deck])
    family = card_family(formats)
    (block,) = _blocks_of([deck], family)
    named = [name.strip() for name in photos.split(",") if name.strip()]
    chosen = photos_named(block, named + (names_of(text_of(photos_from)) if photos_from else []))
    for polygon in _areas(block, box, area):
        if by == "stations":
            chosen |= photos_above(block, polygon)
        else:
            chosen |= photos_showing(block, polygon, ground_level(block) if height is None else height)
    part = extracted(block, chosen, drop_single=drop_single)
    _write_edited(part.block, titles, [deck], out, family, extract_text(part))


def _areas(block: Block, box: str | None, area: Path | None) -> list[Area]:
    """Return the areas of two options, in longitude and latitude but for a local job."""
    from musatpy.geometry.areas import Area, area_of
    from musatpy.jobs.naming import text_of
    from musatpy.model import CoordinateSystem

    geographic = block.options.system is not CoordinateSystem.LOCAL
    areas = []
    if box:
        try:
            west, south, east, north = map(float, box.split(","))
        except ValueError as error:
            raise click.UsageError(f"--box {box}: not four numbers W,S,E,N") from error
        areas.append(Area.box(west, south, east, north, geographic=geographic))
    if area:
        areas.append(area_of(text_of(area), str(area), geographic=geographic))
    return areas


def _write_edited(
    block: Block, titles: tuple[str, ...], decks: Sequence[Path], path: Path, family: Family, report: str
) -> None:
    """Write the deck of a block, and print the report of the editing, what is in the deck, and what it lacks.

    `decks`: what it was made of. Where `path` is called NAME.job, a job is written; else long names of jobs become
    short ones, as by `musat convert`.

    The deck has `titles` where there are any, else those of the block; `-` goes to stdout, and what is said to
    stderr. Raises `DeckError` where it cannot be written or would contradict itself; nothing is written and printed
    then.
    """
    from musatpy.files import write_files
    from musatpy.formats.job_folder import SUFFIX, files_of_tables, is_job, read_job, tables_of_job
    from musatpy.formats.musat import check_deck, deck_bytes, deck_files

    def of_deck(problems: Iterable[Problem]) -> list[Problem]:
        return [replace(problem, file=str(path)) for problem in problems]

    block, of_job = replace(block, titles=titles or block.titles), any(map(is_job, decks))
    data: Tables | bytes
    try:
        if path.suffix.lower() == SUFFIX:
            data = tables_of_job(block)
            whole = read_job(decks[0]) if of_job and len(decks) == 1 else None
            files = files_of_tables(data, path, *((whole.source, whole.inputs) if whole else ()))
        else:
            shorten = of_job and path != STREAM
            files = deck_files(block, path, family) if shorten else {path: deck_bytes(block, family)}
            data = files[path]
    except DeckError as error:
        first: dict[str | None, Problem] = {}  # of each value that does not fit, however many cards have it
        for problem in error.problems:
            first.setdefault(problem.found, problem)
        raise DeckError(of_deck(first.values())) from error
    again, problems = check_deck(data, family, for_run=False)
    if again is None:
        raise DeckError(of_deck(problems))
    if path == STREAM:
        tell_as_is(files[path])
    else:
        write_files(files)
    about = partial(tell, err=path == STREAM)  # of what stands on stdout itself
    about(report, nl=False)
    _, of_a_run = check_deck(data, family)
    missing = [problem for problem in of_deck(of_a_run) if problem.severity == "error"]
    warnings = count_of(len(of_a_run) - len(missing), "warning")
    about(f"{name_of(path)}: {', '.join(_sizes_of(again))}; {warnings} of musat check")
    for problem in of_each_kind(missing):
        complain(f"{problem.headline()}: it cannot be run yet")
