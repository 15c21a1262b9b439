"""`musat run`: adjust decks and write their listings."""

from __future__ import annotations

import datetime
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from musatpy.cli.decks import STREAM
from musatpy.cli.live_line import LiveLine
from musatpy.cli.messages import (
    complain,
    complain_of,
    complain_of_each,
    complain_of_error,
    count_of,
    name_of,
    on_terminal,
    tell_file,
)
from musatpy.cli.options import (
    carriage_control_option,
    causes_option,
    csv_option,
    date_option,
    decks_argument,
    dry_option,
    formats_option,
    out_option,
    record_option,
    set_option,
    settings_for,
    strict_option,
    submerged_option,
)
from musatpy.cli.punching import punch_of, punch_options, run_cards
from musatpy.cli.shown import show, shown_of, shown_options
from musatpy.errors import MusatError
from musatpy.files import together

if TYPE_CHECKING:
    from musatpy.model import Solution
    from musatpy.runs import ExitStatus, RunResult
    from musatpy.shown_runs import Shown

_CAUSES = 3  # that are named
_LARGE = 500  # photos of a block, from which on numpy alone is not what is chosen where there is a choice
_FAST = "pip install 'musatpy[fast]'"


@click.command(name="run", short_help="Adjust decks and write their listings.")
@decks_argument
@out_option
@formats_option
@set_option
@dry_option
@submerged_option
@click.option("-q", "--quiet", is_flag=True, help="No progress and no summary; messages of errors only.")
@carriage_control_option
@click.option("--brief", is_flag=True, help="A listing without echo of the input and residuals: 40 pages at most.")
@record_option
@causes_option
@csv_option
@shown_options
@strict_option
@date_option
@click.option("--punch-edits", is_flag=True, help="Write NAME.edited.crd too: the deck without the blunders found.")
@punch_options
@click.pass_context
def command(
    ctx: click.Context,
    /,
    decks: tuple[Path, ...],
    out_dir: Path | None,
    formats_dir: Path | None,
    settings: tuple[str, ...],
    quiet: bool,
    dated: bool,
    punch_edits: bool,
    record: str | None,
    causes: str | None,
    dry: Path | None,
    submerged: Path | None,
    **given: Any,
) -> None:
    """Adjust each DECK and write its listing NAME.lst and its record NAME.json.

    A DECK - is the standard input; its listing goes to the standard output, or with -o to stdin.lst. Exit status: 0
    all accepted or doubtful, 1 a deck or its data cannot be used, 3 a run did not converge, 4 an answer is rejected
    (with --strict: or doubtful).
    """
    from musatpy.jobs.point_flags import PointFlags
    from musatpy.model import CauseSearch, RecordContent
    from musatpy.runs import ExitStatus, check_outputs, run_deck

    wanted = shown_of(given)
    punch, punch_family = punch_of(formats_dir, given)
    more = punch_edits or given["csv"] or punch or wanted.anything
    if STREAM in decks and out_dir is None and (len(decks) > 1 or more):
        raise click.UsageError("- with other decks, or with files besides the listing, needs -o")
    flags, punching = PointFlags(dry=dry, submerged=submerged), punch is not None
    try:
        check_outputs(
            decks, out_dir, punch_edits=punch_edits, punch=punching, punch_family=punch_family, flags=flags
        )
    except MusatError as error:
        raise click.UsageError(str(error)) from error
    family = run_cards(formats_dir, punch_family)
    run = partial(
        run_deck,
        out_dir=out_dir,
        date=datetime.date.today() if dated else None,
        family=family,
        settings=settings_for(settings, family),
        flags=flags,
        punch_edits=punch_edits,
        punch=punch,
        punch_family=punch_family,
        record=RecordContent(record or "full"),
        causes=CauseSearch(causes or "usual"),
        **{name: given[name] for name in ("carriage_control", "brief", "csv", "strict")},
    )
    statuses = [
        _filtered(run, wanted, out_dir, quiet) if deck == STREAM else _status_of(deck, run, wanted, quiet)
        for deck in decks
    ]
    ctx.exit(ExitStatus.worst(statuses))


@together()  # pictures, pages and layers are those of the listing and the record
def _filtered(run: Callable[..., RunResult], wanted: Shown, out_dir: Path | None, quiet: bool) -> ExitStatus:
    """Run the deck of the standard input; without a folder its listing goes to stdout, what is said to stderr."""
    from tempfile import TemporaryDirectory  # rarely needed

    from musatpy.runs import ExitStatus

    with TemporaryDirectory() as folder:
        deck = Path(folder, "stdin.crd")
        deck.write_bytes(sys.stdin.buffer.read())
        try:
            result = run(deck, **({"out_dir": Path(folder)} if out_dir is None else {}))
        except OSError as error:
            complain_of_error(error)
            return ExitStatus.UNUSABLE
        problems = tuple(
            replace(one, file=str(STREAM)) if one.file == str(deck) else one for one in result.problems
        )
        listing = result.listing
        if listing is not None and out_dir is None:
            tell_file(listing.read_bytes())
            result = replace(result, listing=STREAM)
        _tell(replace(result, deck=STREAM, problems=problems), quiet, err=out_dir is None)
        return result.status if show(result, wanted, quiet) else ExitStatus.UNUSABLE


@together()
def _status_of(deck: Path, run: Callable[..., RunResult], wanted: Shown, quiet: bool) -> ExitStatus:
    """Run one deck and say what came of it; results that cannot be written keep no other deck from its run."""
    from musatpy.runs import ExitStatus

    try:
        if quiet or not on_terminal():
            result = run(deck)
        else:
            with LiveLine(name_of(deck)) as line:
                result = run(deck, progress=line, on_read=line.read)
    except OSError as error:
        complain_of_error(error)
        return ExitStatus.UNUSABLE
    _tell(result, quiet)
    if not show(result, wanted, quiet):
        return ExitStatus.worst([result.status, ExitStatus.UNUSABLE])
    return result.status


def _tell(result: RunResult, quiet: bool, *, err: bool = False) -> None:
    """Print problems to stderr and, unless `quiet`, the summary to stdout; or to stderr too."""
    complain_of(result.problems)
    solution, verdict = result.solution, result.verdict
    if solution is None or verdict is None or result.listing is None:
        errors = sum(problem.severity == "error" for problem in result.problems)
        complain(f"{name_of(result.deck)}: not run, {count_of(errors, 'error')}")
        return
    complain_of_each(result.deck, (f"{reason.grade.lower()}: {reason.text}" for reason in verdict.reasons))
    for cause in solution.causes[:_CAUSES] if verdict.reasons else ():
        complain(f"{name_of(result.deck)}: possible cause: {cause}")
    if not quiet:
        complain_of_each(result.deck, (f"note: {note}" for note in verdict.notes))
        if _would_gain(solution):
            complain(f"{name_of(result.deck)}: note: with its extra 'fast' such blocks take half the time: {_FAST}")
        click.echo(
            f"{name_of(result.deck)}: {verdict.grade}, sigma0 {solution.sigma0:.4f}, "
            f"{count_of(len(solution.iterations), 'iteration')}, water passes: {len(solution.passes)}, "
            f"{'' if solution.kernels == 'numpy' else f'{solution.kernels} kernels, '}"
            f"listing {name_of(result.listing)}"
            f"{_punched(result.punched)}",
            err=err,
        )
        if solution.edited is not None:
            punched = f", edited deck {name_of(result.edited)}" if result.edited else ""
            found = count_of(len(solution.findings), "blunder")
            click.echo(f"{name_of(result.deck)}: {found} found{punched}", err=err)


def _would_gain(solution: Solution) -> bool:
    """Return whether a block is so large that the extra `fast`, which is not installed, would be worth it."""
    plain = solution.kernels == "numpy" and not os.environ.get("MUSAT_KERNELS")
    return plain and len(solution.block.photos.ids) > _LARGE


def _punched(files: tuple[Path, ...]) -> str:
    """Return what to say of punched files."""
    if not files:
        return ""
    return f", punched deck{'' if len(files) == 1 else 's'} {', '.join(name_of(file) for file in files)}"
