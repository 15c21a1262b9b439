"""`musat baseline`: results that are kept, and new runs held against them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from musatpy.cli.batch import ended_by_signals, tell_of_trouble
from musatpy.cli.messages import complain, complain_of_error, count_of, name_of, styled, tell, tell_escaped
from musatpy.cli.options import NamedPath, formats_option, processes_option, set_option
from musatpy.errors import MusatError

if TYPE_CHECKING:
    from musatpy.campaign.baselines import Taken
    from musatpy.campaign.batch import Watch

CANNOT_COMPARE = 2

_base = click.argument("base", metavar="FOLDER", type=NamedPath(file_okay=False))
_names = click.argument("names", metavar="[DECK...]", nargs=-1)
_quiet = click.option("-q", "--quiet", is_flag=True, help="No progress; print nothing where all is well.")
_work = click.option(
    "-o",
    "--out",
    "work",
    metavar="DIR",
    type=NamedPath(file_okay=False),
    help="Where new results go; FOLDER/.new where not given.",
)
_unusable = click.option(
    "--unusable", is_flag=True, help="Keep of decks that cannot be used that they cannot, and what is said of them."
)


@click.group(name="baseline", short_help="Keep results of decks, and hold new runs against them.")
def command() -> None:
    """Keep listings and records of decks in a FOLDER, as plain files, and hold new runs against them."""


@command.command(name="save", short_help="Run decks and keep their results.")
@_base
@click.argument("sources", metavar="DECK...", nargs=-1, required=True, type=NamedPath())
@click.option(
    "--run", metavar="DECK", type=NamedPath(), help="Compilation decks: compile them on the run of this deck."
)
@formats_option
@click.option("--no-records", is_flag=True, help="Keep listings only.")
@click.option("--rules", metavar="FILE", type=NamedPath(), help="Rules (TOML) for the listings.")
@click.option("--record-rules", metavar="FILE", type=NamedPath(), help="Rules (TOML) for the records.")
@click.option("--exact", is_flag=True, help="No rules to start from: every digit counts.")
@set_option
@_unusable
@processes_option
@_quiet
@click.pass_context
def save_command(
    ctx: click.Context,
    /,
    base: Path,
    sources: tuple[Path, ...],
    formats_dir: Path | None,
    no_records: bool,
    quiet: bool,
    **given: Any,
) -> None:
    """Run decks (or folders, globs) and keep their results; decks are added to a baseline that is there.

    Exit status: 0 done, 1 a deck has no results, or the baseline or the rules cannot be used.
    """
    from musatpy.campaign.baselines import save
    from musatpy.campaign.manifest import decks_of

    decks = [deck for source in sources for deck in decks_of(source)]
    with ended_by_signals():
        watch = _display(quiet)
        taken = save(base, decks, formats=formats_dir, records=not no_records, watch=watch, **given)
    _tell_taken(ctx, taken, quiet)


@command.command(name="check", short_help="Run the decks anew; show what differs.")
@_base
@_names
@click.option("--rules", metavar="FILE", type=NamedPath(), help="Other rules for the listings.")
@click.option("--record-rules", metavar="FILE", type=NamedPath(), help="Other rules for the records.")
@set_option
@_work
@click.option("--json", "as_json", is_flag=True, help="Print JSON, with every difference.")
@click.option("--junit", metavar="FILE", type=NamedPath(), help="Write JUnit XML too: a test a deck.")
@click.option("--listed", type=click.IntRange(min=1), default=20, show_default=True, help="Rows of each section.")
@processes_option
@_quiet
@click.pass_context
def check_command(
    ctx: click.Context,
    /,
    base: Path,
    names: tuple[str, ...],
    as_json: bool,
    junit: Path | None,
    listed: int,
    quiet: bool,
    **given: Any,
) -> None:
    """Run the decks of a baseline anew (or those named), and show what differs beyond the rules.

    Decks beside its own that the baseline does not have are named. Exit status: 0 same, 1 a deck is different, has
    no results or is not in the baseline, 2 the baseline or the rules cannot be used.
    """
    from musatpy.campaign.baseline_reports import check_json, check_junit, check_text
    from musatpy.campaign.baselines import check
    from musatpy.files import write_files

    try:
        with ended_by_signals():
            result = check(base, names, watch=_display(quiet), **given)
    except (OSError, MusatError) as error:
        complain_of_error(error)
        ctx.exit(CANNOT_COMPARE)
    tell_of_trouble(result.batch, {n for n, deck in enumerate(result.decks) if deck.same}, resumable=False)
    if junit:
        write_files({junit: check_junit(result).encode()})
    if as_json:
        tell(check_json(result), nl=False)
    elif not (quiet and result.same):
        tell_escaped(check_text(result, listed, styled))
    ctx.exit(0 if result.same else 1)


@command.command(name="accept", short_help="Take new results over.")
@_base
@_names
@_work
@_unusable
@processes_option
@_quiet
@click.pass_context
def accept_command(ctx: click.Context, /, base: Path, names: tuple[str, ...], quiet: bool, **given: Any) -> None:
    """Take new results over, of all decks or of those named: what a check left, else of a new run.

    Exit status: 0 done, 1 a deck has no results, or the baseline cannot be used.
    """
    from musatpy.campaign.baselines import accept

    with ended_by_signals():
        taken = accept(base, names, watch=_display(quiet), **given)
    _tell_taken(ctx, taken, quiet)


@command.command(name="list", short_help="List the decks: as saved or not, by which version.")
@_base
def list_command(base: Path) -> None:
    """List the decks of a baseline: whether they are as they were saved, and by which version of the program."""
    from musatpy.campaign.baseline_index import changed_decks, load_baseline

    baseline = load_baseline(base)
    width = max((len(name) for name in baseline.entries), default=0)
    for name, state in changed_decks(baseline).items():
        entry = baseline.entries[name]
        verdict = "  unusable" if entry.fails else f"  {entry.state}" if entry.state else ""
        program = f"{entry.version} ({entry.sources[:12]})" if entry.sources else entry.version
        line = f"{name:<{width}}  {state:<12}  musatpy {program}  {entry.deck_sha256[:12]}{verdict}"
        tell(line)


def _display(quiet: bool) -> Watch | None:
    """Return what shows the batch, None where that is to be quiet."""
    from musatpy.cli.live import Display

    return None if quiet else Display()


def _tell_taken(ctx: click.Context, taken: Taken, quiet: bool) -> None:
    """Print what became of each deck."""
    same = {taken.baseline.deck(name) for name in taken.unchanged}
    tell_of_trouble(taken.batch, {n for n, job in enumerate(taken.batch.jobs) if job.deck in same})
    outcomes = {job.deck: outcome for job, outcome in zip(taken.batch.jobs, taken.batch.outcomes, strict=True)}
    for name in taken.failed:
        unusable = outcomes[taken.baseline.deck(name)].unusable
        complain(f"{name}: not taken over" + ("; with --unusable that it cannot be used is" if unusable else ""))
    if not quiet:
        for verb in ("new", "changed", "dropped"):
            for name in getattr(taken, verb):
                tell(f"{name}: {verb}")
        held = count_of(len(taken.baseline.entries), "deck")
        tell(f"{name_of(taken.baseline.folder)}: baseline of {held}, {len(taken.unchanged)} unchanged")
    ctx.exit(1 if taken.failed else 0)
