"""Commands about what runs left: `plot`, `report`, `explain`, `compare`, `diff` and `audit`."""

from __future__ import annotations

import gc
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from musatpy.cli import options
from musatpy.cli.messages import complain, complain_of, complain_of_error, name_of, styled, tell, tell_as_is
from musatpy.cli.options import FILE, NOT_NEGATIVE, POSITIVE, flag, option
from musatpy.errors import MissingPackageError, MusatError, Problem, ProblemsError, printable

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from musatpy.figures import ImageForm
    from musatpy.listings import Rules

CANNOT_READ = 2  # exit status of `diff` and `audit`, of which 1 is an answer


@contextmanager
def _cycles_left_alone() -> Iterator[None]:
    """Look for no cycles: none are among the millions of objects, and the search takes a tenth of the time."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()  # nor at the end of the program
        gc.enable()


def _show_pictures(context: click.Context, _: click.Parameter, shown: bool) -> None:
    """List the pictures of each kind of record."""
    if not shown:
        return
    from musatpy.plots.gallery import KINDS

    for kind in KINDS.values():
        tell(f"of a {kind.what}:")
        for picture in kind.pictures:
            tell(f"  {picture.name:<16}{picture.title}")
    context.exit()


def _pictures_beginning(ctx: click.Context, param: click.Parameter, text: str) -> list[CompletionItem]:
    """Return the pictures that a shell may complete a text to, with their titles."""
    from musatpy.plots.gallery import KINDS

    return options.offered(
        text, {picture.name: picture.title for kind in KINDS.values() for picture in kind.pictures}
    )


@click.command(name="plot", short_help="Draw pictures of a run or a compilation.")
@click.argument("records", metavar="RECORD...", nargs=-1, required=True, type=FILE)
@options.out_option
@option(
    "--only NAME",
    "Draw only this picture; may be repeated.",
    name="names",
    multiple=True,
    shell_complete=_pictures_beginning,
)
@option("--line FILE", "Line of the depth profile (CSV, GeoJSON, DXF, ...).", FILE)
@option("--soundings FILE", "Soundings for the depth profile (CSV, LAS).", FILE)
@option(
    "--within M",
    "Largest distance of points from the line of the profile, m. Default: as large as needed.",
    POSITIVE,
)
@option("--datum H", "Height from which the soundings count, m.", float, default=0.0)
@options.crs_option("Coordinate system of x and y in a file that does not state it, for example EPSG:32620.")
@flag("--list", "List the pictures.", is_eager=True, expose_value=False, callback=_show_pictures)
@options.quiet_as("Do not print what the pictures show.")
@options.picture_options()
@click.pass_context
def plot_command(
    ctx: click.Context,
    /,
    records: tuple[Path, ...],
    out_dir: Path | None,
    names: tuple[str, ...],
    quiet: bool,
    form: ImageForm,
    **given: Any,
) -> None:
    """Draw the pictures of each RECORD, NAME.json of a run or a compilation, as NAME.PICTURE.svg.

    A picture of more than 2,000 marks becomes a .png where no --format is given. RECORD may also be of a comparison
    with soundings.

    Exit status: 0 done, 1 a record cannot be used, or has nothing to show.
    """
    from musatpy.plots.files import check_names, check_stems, drawn, profile_of

    with options.usage_errors():
        check_names(names)
        check_stems(records, out_dir)
    profile = profile_of(**given) if any(given[name] for name in ("line", "soundings", "within")) else None
    failed = False
    for record in records:
        try:
            done = drawn(record, out_dir, names, profile, form)
        except MissingPackageError:
            raise
        except (MusatError, OSError) as error:
            complain_of_error(error)
            failed = True
            continue
        for name, reason in done.reasons.items():
            complain(f"{name_of(record)}: no {name}: {reason}")
        for path, sentence in zip(done.files, done.sentences, strict=True):
            if not quiet:
                tell(f"{name_of(path)}: {printable(sentence)}")
        failed |= not done.files
    ctx.exit(int(failed))


@click.command(name="report", short_help="Make the page of a run: one HTML file to hand over.")
@click.argument("records", metavar="RUN.json...", nargs=-1, required=True, type=FILE)
@option(
    "-o --out NAME.html|DIR",
    "Page to write; folder of the pages of several records. Default: RUN.html.",
    FILE,
    name="out",
)
@option(
    "--input FILE",
    "File that the run has read, such as its deck; the page states its SHA-256.",
    FILE,
    name="inputs",
    multiple=True,
)
@options.date_option
@options.page_options
@options.quiet_option
@click.pass_context
def report_command(
    ctx: click.Context,
    /,
    records: tuple[Path, ...],
    out: Path | None,
    inputs: tuple[Path, ...],
    particulars: dict[str, str],
    quiet: bool,
    **_: object,
) -> None:
    """Make a page of each record of a run, a compilation (`as11 compile`) or a comparison (`compare-soundings`).

    The page is one HTML file with its pictures inside: verdict, data, accuracy, worst observations, tables. It has
    no scripts and needs no network. Needs jinja2 and matplotlib. Exit status: 0, or 1 if a record cannot be used.
    """
    from musatpy.files import write_file
    from musatpy.page.composition import page_of_record

    if inputs and len(records) > 1:
        raise click.UsageError("--input goes with one record")
    if out is None or len(records) > 1:
        places = [(record.parent if out is None else out) / f"{record.stem}.html" for record in records]
    else:
        places = [out]
    options.refuse_overwriting(places, [*records, *inputs])
    if len(set(places)) < len(records):
        raise click.UsageError("pages of two records would have the same name")
    failed = False
    for record, place in zip(records, places, strict=True):
        try:
            with _cycles_left_alone():
                write_file(place, page_of_record(record, inputs, particulars).encode())
        except MissingPackageError:
            raise
        except (MusatError, OSError) as error:
            complain_of_error(error)
            failed = True
        else:
            if not quiet:
                tell(f"{name_of(record)}: page {name_of(place)}")
    ctx.exit(int(failed))


@click.command(name="explain", short_help="Show all that a run knows about one point or photo.")
@click.argument("name", metavar="ID")
@click.argument("record", metavar="RECORD", type=FILE)
def explain_command(name: str, record: Path) -> None:
    """Show all that a run knows about the point or photo ID, from its RECORD NAME.json.

    It shows the images with residuals, tests, redundancy and detectable errors, what would happen without each of
    them (predicted, without a new adjustment), and control, water and neighbours. RECORD may be a deck, which is
    then adjusted. Exit status: 0, or 1 if there is neither a point nor a photo of that name.
    """
    from musatpy.runs import inquiry_text

    tell(inquiry_text(record, name), nl=False)


@click.command(name="compare", short_help="Compare two solutions of one deck.")
@click.argument("first", metavar="A", type=FILE)
@click.argument("second", metavar="B", type=FILE)
@flag("--json", "Print JSON, with every station, point and wave.", name="as_json")
@options.listed_option("table")
@option("--limit SIGMAS", "End with status 1 if a difference is larger than this.", float)
@click.pass_context
def compare_command(
    ctx: click.Context, first: Path, second: Path, as_json: bool, listed: int, limit: float | None
) -> None:
    """Compare solution B with solution A of the same deck.

    Each is the record NAME.json of a run, or a deck, which is then adjusted. Differences are B minus A, in metres
    and in sigmas of B, the largest first. One may be the truth NAME.truth.json of `musat simulate`: the differences
    are then errors, in sigmas of the solution. Exit status: 0, or 1 if a difference is beyond the limit, or a file
    cannot be used.
    """
    from musatpy.reports.comparison import comparison_record, comparison_text
    from musatpy.runs import compared

    labels = first.stem, second.stem
    if labels[0] == labels[1]:
        labels = name_of(first), name_of(second)
    comparison = compared(first, second, labels)
    whole = json.dumps(comparison_record(comparison), indent=1) + "\n" if as_json else ""
    tell(whole or comparison_text(comparison, listed), nl=False)
    if limit is not None and comparison.largest > limit:
        ctx.exit(1)


@click.command(name="diff", short_help="Compare two listings or records number by number.")
@click.argument("first", metavar="A", type=FILE)
@click.argument("second", metavar="B", type=FILE)
@option("--rules FILE", "File of rules (TOML) that say what may differ.", FILE)
@option(
    "--rounding PART",
    "Without rules, numbers of two records may differ by this part of them; 0: every digit counts.",
    NOT_NEGATIVE,
    shown=1e-6,
)
@flag("--json", "Print JSON, with every difference.", name="as_json")
@option("--junit FILE", "Also write JUnit XML, for CI systems.", FILE)
@options.listed_option("section")
@options.quiet_as("Print only the last line, and nothing if A and B are the same.")
@click.pass_context
def diff_command(
    ctx: click.Context,
    first: Path,
    second: Path,
    rules: Path | None,
    rounding: float,
    as_json: bool,
    junit: Path | None,
    listed: int,
    quiet: bool,
) -> None:
    """Compare two listings, two JSON files (whose names end in .json), or a listing with its record.

    One of A and B may be -, a listing that is read from the standard input.

    Differences are B minus A. Without rules every number and word must be the same, numbers of two records but for
    their rounding. Exit status: 0 same,
    1 different, 2 the files cannot be compared or the rules are wrong.
    """
    from musatpy.files import write_files
    from musatpy.listings import compare_bytes, rounding_rules
    from musatpy.listings.findings import json_text, junit_of_problems, junit_text, render, verdict

    names = str(first), str(second)
    try:
        contents, loaded = _read(first, second, rules)
        records = all(name.lower().endswith(".json") for name in names)
        rounded = records and loaded is None and rounding > 0.0
        with _cycles_left_alone():
            comparison = compare_bytes(*contents, rounding_rules(rounding) if rounded else loaded, names=names)
        if rounded:  # that there are no positions is no mistake in a rule
            comparison = replace(comparison, rules=tuple(use for use in comparison.rules if use.matched))
        if not (records or comparison.counts["rows compared"]):
            message = f"and {names[1]} have no row in common: one of them is no listing of such a job"
            raise ProblemsError.of(message, file=names[0])
    except ProblemsError as error:
        complain_of(error.problems)
        if junit:
            write_files({junit: junit_of_problems(error.problems, names).encode()})
        ctx.exit(CANNOT_READ)
    if junit:
        write_files({junit: junit_text(comparison).encode()})
    if as_json:
        tell_as_is(json_text(comparison))
    elif not quiet:
        tell_as_is(render(comparison, listed=listed, style=styled))
    elif not comparison.same:
        tell_as_is(f"{verdict(comparison, styled)}\n")
    ctx.exit(0 if comparison.same else 1)


def _read(first: Path, second: Path, rules: Path | None) -> tuple[tuple[bytes, bytes], Rules | None]:
    """Return what stands in both files, and the rules; raises `ProblemsError` with all that cannot be read."""
    from musatpy.listings import load_rules

    contents: dict[Path, bytes] = {}
    loaded: Rules | None = None
    problems: list[Problem] = []
    if str(first) == str(second) == "-":
        problems.append(Problem(file="-", message="can be one of the two only"))
    for path in dict.fromkeys((first, second)):
        try:
            contents[path] = sys.stdin.buffer.read() if str(path) == "-" else path.read_bytes()
        except OSError as error:
            problems.append(_problem(error))
    try:
        loaded = load_rules(rules) if rules else None
    except ProblemsError as error:
        problems += error.problems
    except OSError as error:
        problems.append(_problem(error))
    for path, data in contents.items():
        if kind := _kind(path, data):
            problems.append(Problem(file=str(path), message=f"is {kind}, no listing"))
    if problems:
        raise ProblemsError(problems)
    return (contents[first], contents[second]), loaded


def _kind(path: Path, data: bytes) -> str:
    """Return what a file is that is no listing, and no record by its name; empty for any other text."""
    from musatpy.formats.job_tables import card_family

    if path.suffix.lower() == ".json":
        return ""
    if data.lstrip().startswith(b"{"):
        return "JSON, whose name would end in .json"
    lines = [line for line in data.splitlines()[:100] if line.strip()]
    cards = {mnemonic.encode() for mnemonic in card_family().cards}
    return "a deck" if lines and sum(line[:3] in cards for line in lines) > len(lines) / 2 else ""


def _problem(error: OSError) -> Problem:
    return Problem(file=str(error.filename or "system"), message=str(error.strerror or error))


@click.command(name="audit", short_help="Find misprints in a listing.")
@click.argument("listing", metavar="LISTING", type=FILE)
@option("--against NEW", "Compare with a newer run: its listing, or its record NAME.json.", FILE)
@flag("--json", "Print JSON.", name="as_json")
@options.listed_option("report with --against", 30)
@click.pass_context
def audit_command(ctx: click.Context, listing: Path, against: Path | None, as_json: bool, listed: int) -> None:
    """Read the standard reports of a LISTING (old or new, scanned or not) and check that their numbers agree.

    The standard reports are the analyses, the plate residuals of the frames and the bathymetric points. Every
    repair of scanned text is reported. Exit status: 0 consistent, 1 inconsistent, 2 if a file or a row of the
    listing cannot be read, or the results cannot be written.
    """
    from musatpy.listings.audit.against import side_by_side, side_record, side_text
    from musatpy.listings.audit.reading import audit, audit_record, audit_text, read_listing

    with _cycles_left_alone():
        structures = read_listing(listing)
        beside = None if against is None else side_by_side(structures, against)
        findings = audit(structures)
    if as_json:
        record = audit_record(structures, findings) | ({} if beside is None else side_record(beside))
        text = json.dumps(record, indent=1) + "\n"
    else:
        text = audit_text(structures, findings)
        if beside is not None:
            text += "\n" + side_text(beside, listed)
    tell(text, nl=False)
    if findings:
        ctx.exit(1)
    if structures.unreadable:
        ctx.exit(CANNOT_READ)
