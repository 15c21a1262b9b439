"""Commands about many decks: `batch` runs them in parallel, `baseline` keeps results to hold new runs against."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Container, Iterator
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

import click

from musatpy.cli import messages, options
from musatpy.cli.options import FILE, FOLDER, LazyGroup, flag, option, options_of
from musatpy.cli.progress import Display
from musatpy.cli.run import check_shown, shown_options
from musatpy.errors import MissingPackageError, MusatError, count_of

if TYPE_CHECKING:
    from musatpy.campaign.baselines import Taken
    from musatpy.campaign.batch import BatchResult

_IMPATIENCE = 3.0  # seconds in which an interruption that comes again is the same one
_CANNOT_CHECK = 2  # exit status


@contextlib.contextmanager
def _ended_by_signals() -> Iterator[None]:
    """Let SIGTERM (a system that shuts down, a queue whose time is over) and SIGHUP do what Ctrl-C does.

    What comes again while the batch ends does not keep it from ending in order.
    """
    never = last = -_IMPATIENCE

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal last
        again = time.monotonic() - last < _IMPATIENCE
        if not again:
            last = time.monotonic()
            raise KeyboardInterrupt

    before = {}
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        # `nohup` has SIGHUP ignored, a shell SIGINT of what it starts in the background
        if number is not None and signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            before[number] = signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number, handler in before.items():
            # one that comes again would give the program that ends anyway another exit status
            signal.signal(number, handler if last == never else signal.SIG_IGN)


def _tell_of_trouble(
    result: BatchResult, expected: Container[int] = (), *, resumable: bool = True, known: bool = False
) -> None:
    """Print to stderr what is wrong with jobs, but those whose outcome is `expected`, and what else happened.

    Warnings of jobs that were kept are `known`, and only counted then.
    """
    from musatpy.campaign.batch_jobs import JobState

    for n, (job, outcome) in enumerate(zip(result.jobs, result.outcomes, strict=True)):
        if n in expected:
            continue
        if not (known and outcome.kept):
            messages.complain_of(outcome.problems)
        if outcome.message and not (messages.asked(messages.QUIET) and outcome.state is JobState.UNUSABLE):
            messages.complain(f"{messages.name_of(job.deck)}: {outcome.state}: {outcome.message}")
    messages.complain_of_each(None, result.notes)
    warnings = sum(len(outcome.problems) for outcome in result.outcomes if outcome.kept)
    if known and warnings and not messages.asked(messages.QUIET):
        messages.complain(
            f"{count_of(warnings, 'warning')} of jobs that were kept from an earlier run; --warnings prints them"
        )
    if result.interrupted:
        kept = "; what is finished is kept, and the same command goes on from there" if resumable else ""
        messages.complain(f"interrupted{kept}")


@click.command(name="batch", short_help="Run many decks in parallel; can be interrupted.")
@click.argument("sources", metavar="MANIFEST|FOLDER|DECK...", nargs=-1, required=True, type=FILE)
@options.out_option
@options.formats_option
@options.set_option
@options.dry_option
@options.submerged_option
@options.processes_option
@option(
    "--cluster ADDRESS", "Run the jobs on the workers of a Dask scheduler, such as tcp://host:8786.", name="address"
)
@options.record_option
@options.causes_option
@shown_options
@flag("--again", "Also run jobs again that are finished.")
@options.warnings_option
@options.strict_option
@options.quiet_as("Print no progress and no table, only errors and warnings, one line for each.")
@click.pass_context
def batch_command(
    ctx: click.Context,
    /,
    sources: tuple[Path, ...],
    out_dir: Path | None,
    processes: int | None,
    address: str | None,
    again: bool,
    repeated: bool,
    strict: bool,
    quiet: bool,
    **chosen: Any,
) -> None:
    """Run the jobs of a MANIFEST (TOML), or decks, folders of decks and globs, in parallel processes.

    Jobs that an earlier run of the same batch has finished are not run again. With --html there is also an index
    page of all jobs (musat-batch.html). Exit status: that of `musat run` for the worst job; 1 also if a job crashed
    or the batch was interrupted.
    """
    from musatpy.campaign.batch import run_batch
    from musatpy.campaign.batch_jobs import JobOptions
    from musatpy.campaign.batch_reports import table, verdict
    from musatpy.campaign.carried import cluster
    from musatpy.campaign.manifest import ManifestError, plan_of

    if address is not None and processes is not None:
        raise click.UsageError("-j counts jobs on this machine; a cluster runs as many as it has workers")
    given = JobOptions(**chosen)
    check_shown(given.shown)
    try:
        plan = plan_of(sources, out_dir, given)
    except (ManifestError, MissingPackageError):
        raise
    except MusatError as error:
        raise click.UsageError(str(error)) from error
    for stated in {job.options for job in plan.jobs} - {given}:
        check_shown(stated.shown)
    workers = contextlib.nullcontext() if address is None else cluster(address, messages.complain)
    with _ended_by_signals(), workers as executor:
        watch = None if quiet else Display()
        result = run_batch(plan, processes=processes, again=again, strict=strict, watch=watch, executor=executor)
        _tell_of_trouble(result, known=not repeated)
        if not quiet:
            messages.tell(table(result.jobs, result.outcomes), nl=False)
            summary = f"; summary {messages.name_of(result.summary)}" if result.summary else ""
            index = f", index {messages.name_of(result.index)}" if result.index else ""
            messages.tell(f"{verdict(result.outcomes)}{summary}{index}")
    ctx.exit(result.status)


_base = click.argument("base", metavar="FOLDER", type=FOLDER)
_base_and_names = options_of(_base, click.argument("names", metavar="[DECK...]", nargs=-1))
_quiet = options.quiet_as("Print no progress, and nothing at all if all is well.")
_work = option("-o --out DIR", "Folder of the new results. Default: FOLDER/.new.", FOLDER, name="work")
_unusable = flag("--unusable", "Also keep the messages of decks that cannot be used.")


@click.group(name="baseline", cls=LazyGroup, short_help="Keep results of decks and compare new runs with them.")
def baseline_command() -> None:
    """Keep listings and records of decks in a FOLDER, as plain files, and compare new runs with them."""


@baseline_command.command(name="save", short_help="Run decks and keep their results.")
@_base
@click.argument("sources", metavar="DECK...", nargs=-1, required=True, type=FILE)
@option("--run DECK", "The decks are compilation decks: compile them on the run of this deck.", FILE)
@options.formats_option
@flag("--no-records", "Keep only the listings.")
@option("--rules FILE", "Rules (TOML) for the listings.", FILE)
@option("--record-rules FILE", "Rules (TOML) for the records.", FILE)
@flag("--exact", "Start without rules, so that every digit counts.")
@options.set_option
@_unusable
@options.processes_option
@_quiet
@click.pass_context
def save_command(
    ctx: click.Context, /, base: Path, sources: tuple[Path, ...], no_records: bool, quiet: bool, **given: Any
) -> None:
    """Run decks (or folders, globs) and keep their results. Decks are added to an existing baseline.

    Exit status: 0 done, 1 a deck has no results, or the baseline or the rules cannot be used.
    """
    from musatpy.campaign.baselines import save
    from musatpy.campaign.manifest import decks_of

    decks = [deck for source in sources for deck in decks_of(source)]
    with _ended_by_signals():
        taken = save(base, decks, records=not no_records, watch=None if quiet else Display(), **given)
    _tell_taken(ctx, taken, quiet)


@baseline_command.command(name="check", short_help="Run the decks anew; show what differs.")
@_base_and_names
@option("--rules FILE", "Rules (TOML) for the listings, in place of those of the baseline.", FILE)
@option("--record-rules FILE", "Rules (TOML) for the records, in place of those of the baseline.", FILE)
@options.set_option
@_work
@flag("--json", "Print JSON, with every difference.", name="as_json")
@flag("--summary", "Print how many differences each deck has, but not the differences.")
@option("--junit FILE", "Also write JUnit XML, with a test for each deck.", FILE)
@options.listed_option("section")
@options.processes_option
@_quiet
@click.pass_context
def check_command(
    ctx: click.Context,
    /,
    base: Path,
    names: tuple[str, ...],
    as_json: bool,
    summary: bool,
    junit: Path | None,
    listed: int,
    quiet: bool,
    **given: Any,
) -> None:
    """Run the decks of a baseline anew (or those named), and show what differs beyond the rules.

    Decks that lie beside its own and are not in the baseline are named. Exit status: 0 same, 1 a deck is
    different, has no results or is not in the baseline, 2 the baseline or the rules cannot be used.
    """
    from musatpy.campaign.baseline_checks import check, check_json, check_junit, check_text
    from musatpy.files import write_files

    try:
        with _ended_by_signals():
            result = check(base, names, watch=None if quiet else Display(), **given)
    except (OSError, MusatError) as error:
        messages.complain_of_error(error)
        ctx.exit(_CANNOT_CHECK)
    _tell_of_trouble(result.batch, {n for n, deck in enumerate(result.decks) if deck.same}, resumable=False)
    if junit:
        write_files({junit: check_junit(result).encode()})
    if as_json:
        messages.tell(check_json(result), nl=False)
    elif not (quiet and result.same):
        messages.tell_as_is(check_text(result, 0 if summary else listed, messages.styled))
    ctx.exit(0 if result.same else 1)


@baseline_command.command(name="accept", short_help="Accept the new results.")
@_base_and_names
@_work
@_unusable
@options.processes_option
@_quiet
@click.pass_context
def accept_command(ctx: click.Context, /, base: Path, names: tuple[str, ...], quiet: bool, **given: Any) -> None:
    """Accept new results of all decks or of those named: those that a check left, else those of a new run.

    Exit status: 0 done, 1 a deck has no results, or the baseline cannot be used.
    """
    from musatpy.campaign.baselines import accept

    with _ended_by_signals():
        taken = accept(base, names, watch=None if quiet else Display(), **given)
    _tell_taken(ctx, taken, quiet)


@baseline_command.command(name="list", short_help="List the decks: as saved or not, by which version.")
@_base
def list_command(base: Path) -> None:
    """List the decks of a baseline: whether they have changed since they were saved, and by which version of the
    program that was."""
    from musatpy.campaign.baseline_checks import changed_decks
    from musatpy.campaign.baselines import load_baseline

    baseline = load_baseline(base)
    width = max((len(name) for name in baseline.entries), default=0)
    for name, state in changed_decks(baseline).items():
        entry = baseline.entries[name]
        verdict = "unusable" if entry.fails else entry.state
        program = f"{entry.version} ({entry.sources[:12]})" if entry.sources else entry.version
        messages.tell(f"{name:<{width}}  {state:<12}  musatpy {program}  {entry.deck_sha256[:12]}  {verdict}")


def _tell_taken(ctx: click.Context, taken: Taken, quiet: bool) -> None:
    """Print what became of each deck."""
    same = {taken.baseline.deck(name) for name in taken.unchanged}
    _tell_of_trouble(taken.batch, {n for n, job in enumerate(taken.batch.jobs) if job.deck in same})
    outcomes = {job.deck: outcome for job, outcome in zip(taken.batch.jobs, taken.batch.outcomes, strict=True)}
    for name in taken.failed:
        unusable = outcomes[taken.baseline.deck(name)].unusable
        messages.complain(
            f"{name}: not taken over" + ("; with --unusable that it cannot be used is" if unusable else "")
        )
    if not quiet:
        for verb in ("new", "changed", "dropped"):
            for name in getattr(taken, verb):
                messages.tell(f"{name}: {verb}")
        held = count_of(len(taken.baseline.entries), "deck")
        messages.tell(
            f"{messages.name_of(taken.baseline.folder)}: baseline of {held}, {len(taken.unchanged)} unchanged"
        )
    ctx.exit(1 if taken.failed else 0)
