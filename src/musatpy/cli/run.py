"""Commands that compute: `run` adjusts decks and writes their listings, `orient` orients photos from nothing."""

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

from musatpy.cli import messages, options
from musatpy.cli.decks import STREAM
from musatpy.cli.options import flag, option, options_of
from musatpy.cli.progress import LiveLine
from musatpy.errors import MusatError, ProblemsError, count_of
from musatpy.files import together

if TYPE_CHECKING:
    from musatpy.model import Solution
    from musatpy.runs import ExitStatus, RunResult
    from musatpy.shown_runs import Shown

_CAUSES = 3  # that are named
_LARGE = 500  # photos of a block, from which on numpy alone is not what is chosen where there is a choice
_FAST = "pip install 'musatpy[fast]'"

shown_options = options_of(  # what people look at
    options.csv_option,
    flag("--plots", "Also draw the pictures of 'musat plot' (NAME.plan.svg, ...)."),
    flag("--html", "Also write the page of 'musat report' (NAME.html)."),
    flag("--gis", "Also write stations, points and observations for GIS (NAME.gpkg, GeoJSON)."),
    options.crs_option(
        "With --gis: coordinate system of these files, on the ellipsoid of the job, for example EPSG:4267."
    ),
)
_punch_options = options_of(
    option(
        "--punch",
        "Also write NAME.pun: a deck to start again from (restart), or the adjusted values with their sigmas "
        "for another job (result).",
        click.Choice(["restart", "result"]),
    ),
    option(
        "--punch-family FAMILY",
        "Punch the files of this family and not a deck: giant, patb, bingo, jfk, job, or that of --formats.",
    ),
    option(
        "--punch-points",
        "Ground points to punch as control. Default: all in a result, none in a restart.",
        click.Choice(["none", "control", "all"]),
    ),
    option(
        "--punch-kind", "Kind of control of the points of a result. Default: F.", click.Choice(["F", "H", "V", "C"])
    ),
    option(
        "--punch-sigmas/--no-punch-sigmas",
        "Punch a result with its sigmas (default); without them stations are starting values and control has "
        "no error.",
        default=None,
    ),
    option(
        "--punch-plates/--no-punch-plates", "Punch the plate coordinates. Default: only in a restart.", default=None
    ),
)


@click.command(name="run", short_help="Adjust decks and write their listings.")
@options.decks_argument
@options.out_option
@options.formats_option
@options.set_option
@options.dry_option
@options.submerged_option
@options.quiet_run_option
@options.warnings_option
@options.carriage_control_option
@flag("--brief", "Write a short listing, of at most 40 pages, without the input and residuals.")
@options.record_option
@options.causes_option
@shown_options
@options.strict_option
@options.date_option
@options.picture_options("plots")
@options.page_options
@flag("--punch-edits", "Also write NAME.edited.crd, the deck without the blunders found.")
@_punch_options
@click.pass_context
def run_command(
    ctx: click.Context,
    /,
    decks: tuple[Path, ...],
    out_dir: Path | None,
    quiet: bool,
    repeated: bool,
    strict: bool,
    date: datetime.date | None,
    **given: Any,
) -> None:
    """Adjust each DECK and write its listing NAME.lst and its record NAME.json.

    If DECK is -, the deck is read from the standard input, and the listing goes to the standard output, or with -o
    to stdin.lst. Exit status: 0 all accepted or doubtful, 1 a deck or its data cannot be used, 3 a run did not
    converge, 4 an answer is rejected (with --strict: or doubtful).
    """
    from musatpy.campaign.batch_jobs import JobOptions
    from musatpy.formats.cards.settings import SettingError
    from musatpy.runs import ExitStatus, check_outputs, output_paths, run_deck

    form, particulars = given.pop("form"), given.pop("particulars")
    job = JobOptions(**given)
    wanted = replace(job.shown, form=form, particulars=particulars)
    check_shown(wanted)
    details = [name for name in given if name.startswith("punch_") and given[name] is not None]
    if job.punch is None and details != ["punch_edits"]:
        raise click.UsageError("say what to punch: --punch restart or --punch result")
    more = job.punch_edits or job.csv or job.punch or wanted.anything
    if STREAM in decks and out_dir is None and (len(decks) > 1 or more):
        raise click.UsageError("- with other decks, or with files besides the listing, needs -o")
    with options.usage_errors(), options.usage_errors(SettingError, "--set"):
        arguments = job.arguments()
        outputs = {name: arguments[name] for name in ("punch_edits", "punch_family", "flags")}
        check_outputs(decks, out_dir, punch=job.punch is not None, **outputs)
    run = partial(run_deck, out_dir=out_dir, date=date, strict=strict, **arguments)
    repeated |= any((job.settings, job.formats, job.dry, job.submerged))
    statuses = []
    for deck in decks:
        if deck == STREAM:
            statuses.append(_status_of_stream(run, wanted, out_dir, quiet))
        else:
            known = not repeated and _is_older(deck, output_paths(deck, out_dir)[0])
            statuses.append(_status_of(deck, run, wanted, quiet, known=known))
    ctx.exit(ExitStatus.worst(statuses))


def check_shown(wanted: Shown) -> None:
    """Raise `click.UsageError` for a system of layers that cannot be, `MissingPackageError` without a package."""
    from musatpy.shown_runs import check_packages

    if wanted.crs and not wanted.gis:
        raise click.UsageError("--crs goes with --gis")
    with options.usage_errors(ProblemsError, "--crs"):
        check_packages(wanted)


@together()  # pictures, pages and layers are those of the listing and the record
def _status_of_stream(
    run: Callable[..., RunResult], wanted: Shown, out_dir: Path | None, quiet: bool
) -> ExitStatus:
    """Run the deck of the standard input; without a folder its listing goes to stdout, what is said to stderr."""
    from tempfile import TemporaryDirectory  # rarely needed

    from musatpy.runs import ExitStatus

    with TemporaryDirectory() as folder:
        deck = Path(folder, "stdin.crd")
        deck.write_bytes(sys.stdin.buffer.read())
        try:
            result = run(deck, **({"out_dir": Path(folder)} if out_dir is None else {}))
        except OSError as error:
            messages.complain_of_error(error)
            return ExitStatus.UNUSABLE
        problems = tuple(
            replace(problem, file=str(STREAM)) if problem.file == str(deck) else problem
            for problem in result.problems
        )
        listing = result.listing
        if listing is not None and out_dir is None:
            messages.tell_as_is(listing.read_bytes())
            result = replace(result, listing=STREAM)
        _tell(replace(result, deck=STREAM, problems=problems), quiet, err=out_dir is None)
        return result.status if _show(result, wanted, quiet) else ExitStatus.UNUSABLE


def _is_older(deck: Path, listing: Path) -> bool:
    """Tell whether a deck is as it was when its listing was written; a copy or checkout has a later `ctime`."""
    try:
        return deck.stat().st_ctime < listing.stat().st_mtime
    except OSError:
        return False


@together()
def _status_of(deck: Path, run: Callable[..., RunResult], wanted: Shown, quiet: bool, *, known: bool) -> ExitStatus:
    """Run one deck and say what came of it; results that cannot be written keep no other deck from its run.

    Warnings of its check that are `known` from the run before are only counted.
    """
    from musatpy.runs import ExitStatus

    try:
        live = messages.on_terminal() and not quiet and not messages.asked(messages.VERBOSE)
        if live or messages.asked(messages.VERBOSE) or messages.asked(messages.LOG):
            with LiveLine(messages.name_of(deck), live=live) as line:
                result = run(deck, progress=line, on_read=line.read)
        else:
            result = run(deck)
    except OSError as error:
        messages.complain_of_error(error)
        return ExitStatus.UNUSABLE
    if known and result.checked and result.solution is not None:
        count = count_of(len(result.checked), "warning")
        if not quiet:
            counted = f"{count} of the unchanged deck, as at its last run; --warnings prints them"
            messages.complain(f"{messages.name_of(deck)}: {counted}")
        result = replace(result, problems=tuple(one for one in result.problems if one not in result.checked))
    _tell(result, quiet)
    if not _show(result, wanted, quiet):
        return ExitStatus.worst([result.status, ExitStatus.UNUSABLE])
    return result.status


def _tell(result: RunResult, quiet: bool, *, err: bool = False) -> None:
    """Print problems to stderr and, unless `quiet`, the summary to stdout; or to stderr too."""
    solution, verdict = result.solution, result.verdict
    if solution is None or verdict is None or result.listing is None:
        messages.not_done(result.deck, "run", result.problems)
        return
    name = messages.name_of(result.deck)
    messages.complain_of(result.problems)
    messages.complain_of_verdict(result.deck, verdict)
    for cause in solution.causes[:_CAUSES] if verdict.reasons else ():
        messages.complain(f"{name}: possible cause: {cause}")
    if verdict.reasons and result.deck.suffix.lower() == ".job":
        from musatpy.sfm.tides import clock_note

        messages.complain_of_each(result.deck, filter(None, [clock_note(result.deck, solution)]))
    if quiet:
        return
    messages.complain_of_each(result.deck, (f"note: {note}" for note in verdict.notes))
    if _would_gain(solution):
        messages.complain(f"{name}: note: with its extra 'fast' such blocks take half the time: {_FAST}")
    kernels = "" if solution.kernels == "numpy" else f"{solution.kernels} kernels, "
    decks = ", ".join(map(messages.name_of, result.punched))
    decks = f", punched deck{'' if len(result.punched) == 1 else 's'} {decks}"
    messages.tell(
        f"{name}: {verdict.grade}, sigma0 {solution.sigma0:.4f}, {_depths_text(solution)}"
        f"{count_of(len(solution.iterations), 'iteration')}, "
        f"water passes: {len(solution.passes)}, {kernels}listing {messages.name_of(result.listing)}"
        f"{decks if result.punched else ''}",
        err=err,
    )
    if solution.edited is not None:
        edited = f", edited deck {messages.name_of(result.edited)}" if result.edited else ""
        messages.tell(f"{name}: {count_of(len(solution.findings), 'blunder')} found{edited}", err=err)


def _depths_text(solution: Solution) -> str:
    """Return the sigmas of depths in words, where the run knew of the water."""
    sigmas = solution.bathymetric.sigmas_of_depths
    if not sigmas.size or solution.block.options.refraction == "NONE":
        return ""
    return f"sigma of depths {sigmas[0]:.3f} m (median), {sigmas[1]:.3f} m (largest), "


def _would_gain(solution: Solution) -> bool:
    """Return whether a block is so large that the extra `fast`, which is not installed, would be worth it."""
    plain = solution.kernels == "numpy" and not os.environ.get("MUSAT_KERNELS")
    return plain and len(solution.block.photos.ids) > _LARGE


def _show(result: RunResult, wanted: Shown, quiet: bool) -> bool:
    """Write what is wanted of a run, say so, and return whether all of it could be."""
    if result.listing is None or not wanted.anything:
        return True
    from musatpy.shown_runs import show_run

    name = messages.name_of(result.deck)
    try:
        for shown in show_run(result, wanted):
            messages.complain_of_each(result.deck, shown.reasons)
            files = list(map(messages.name_of, shown.files))
            if shown.kind == "pictures":
                files = [f"{count_of(len(files), 'picture')}, {files[0]} the first"] if files else []
            if files and not quiet:
                messages.tell(f"{name}: {'' if shown.kind == 'pictures' else f'{shown.kind} '}{', '.join(files)}")
    except ProblemsError as error:
        messages.complain_of_each(result.deck, (problem.message for problem in error.problems))
        return False
    except (OSError, MusatError) as error:
        messages.complain_of_error(error)
        return False
    return True


@click.command(name="orient", short_help="Orient photos through unknown water, without starting values.")
@options.decks_argument
@options.out_option
@options.formats_option
@options.quiet_run_option
@options.carriage_control_option
@options.csv_option
@options.strict_option
@options.date_option
@flag("--punch", "Also write NAME.pun, a deck from which a run can start.")
@flag(
    "--study",
    "Also study where random starts lead, and how depths and dry points change the precision: NAME.study.txt "
    "and pictures; needs the extra 'plots'.",
)
@options.picture_options("study")
@click.pass_context
def orient_command(
    ctx: click.Context,
    /,
    decks: tuple[Path, ...],
    out_dir: Path | None,
    formats: Path | None,
    quiet: bool,
    punch: bool,
    **given: Any,
) -> None:
    """Orient the photos of each DECK as its ORI card says, and write the listing NAME.lst and the record NAME.json.

    Exit status: 0 all accepted or doubtful, 1 a deck or its data cannot be used, 3 not
    converged, 4 an answer is rejected (with
    --strict: or doubtful).
    """
    from musatpy.formats.job_tables import card_family
    from musatpy.orient_runs import orient_deck
    from musatpy.runs import ExitStatus, check_outputs

    with options.usage_errors():
        check_outputs(decks, out_dir, punch=punch)
    family, statuses = card_family(formats), []
    for deck in decks:
        try:
            result = orient_deck(deck, out_dir, family=family, punch=punch, **given)
        except OSError as error:
            messages.complain_of_error(error)
            statuses.append(ExitStatus.UNUSABLE)
            continue
        statuses.append(result.status)
        answer = result.answer
        if answer is None:
            messages.not_done(deck, "oriented", result.problems)
            continue
        messages.complain_of(result.problems)
        messages.complain_of_verdict(deck, answer.verdict)
        if not quiet:
            photos = answer.photos.tolist()
            of = ", ".join(photos) if len(photos) <= 3 else f"{len(photos)} photos"
            messages.tell(
                f"{messages.name_of(deck)}: {answer.verdict.grade}, {answer.task.spec.method} of {of}, "
                f"sigma0 {answer.sigma0:.4f}, {answer.summary}, listing {messages.name_of(result.files[0])}"
            )
    ctx.exit(ExitStatus.worst(statuses))
