"""`musat batch`: many decks in parallel, resumable."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Container, Iterator
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

import click

from musatpy.cli.messages import complain, complain_of, complain_of_each, name_of, tell
from musatpy.cli.options import (
    NamedPath,
    causes_option,
    dry_option,
    formats_option,
    out_option,
    processes_option,
    record_option,
    set_option,
    strict_option,
    submerged_option,
)

if TYPE_CHECKING:
    from musatpy.campaign.batch import BatchResult

_IMPATIENCE = 3.0  # seconds in which an interruption that comes again is the same one


@click.command(name="batch", short_help="Run many decks in parallel; resumable.")
@click.argument("sources", metavar="MANIFEST|FOLDER|DECK...", nargs=-1, required=True, type=NamedPath())
@out_option
@formats_option
@set_option
@dry_option
@submerged_option
@processes_option
@click.option(
    "--cluster",
    "address",
    metavar="ADDRESS",
    help="Run the jobs by the workers of a Dask scheduler, such as tcp://host:8786.",
)
@record_option
@causes_option
@click.option("--html", is_flag=True, help="A page of each job too, and an index page of all (musat-batch.html).")
@click.option("--again", is_flag=True, help="Run finished jobs again too.")
@strict_option
@click.option("-q", "--quiet", is_flag=True, help="No progress and no table; messages of errors only.")
@click.pass_context
def command(
    ctx: click.Context,
    sources: tuple[Path, ...],
    out_dir: Path | None,
    formats_dir: Path | None,
    settings: tuple[str, ...],
    dry: Path | None,
    submerged: Path | None,
    processes: int | None,
    address: str | None,
    record: str | None,
    causes: str | None,
    html: bool,
    again: bool,
    strict: bool,
    quiet: bool,
) -> None:
    """Run the jobs of a MANIFEST (TOML), or decks, folders of decks and globs, in parallel processes.

    What was finished by an earlier run of the same batch, however that ended, is not done again. Exit status: that
    of `musat run` for the worst job; 1 too where a job crashed or the batch was interrupted.
    """
    from musatpy.campaign.batch import run_batch
    from musatpy.campaign.batch_jobs import JobOptions
    from musatpy.campaign.carried import cluster
    from musatpy.campaign.manifest import ManifestError, plan_of
    from musatpy.cli.live import Display
    from musatpy.errors import MusatError
    from musatpy.page.rendering import check_packages

    if address is not None and processes is not None:
        raise click.UsageError("-j is of this machine: how many jobs a cluster runs at a time its workers say")
    try:
        options = JobOptions(
            formats=formats_dir,
            settings=settings,
            dry=dry,
            submerged=submerged,
            record=record,
            causes=causes,
            html=html,
        )
        plan = plan_of(sources, out_dir, options)
    except ManifestError:
        raise
    except MusatError as error:
        raise click.UsageError(str(error)) from error
    if plan.index is not None:
        check_packages()
    workers = contextlib.nullcontext() if address is None else cluster(address, complain)
    with ended_by_signals(), workers as executor:
        watch = None if quiet else Display()
        result = run_batch(plan, processes=processes, again=again, strict=strict, watch=watch, executor=executor)
        tell_of_trouble(result)
        if not quiet:
            _tell(result)
    ctx.exit(result.status)


@contextlib.contextmanager
def ended_by_signals() -> Iterator[None]:
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


def tell_of_trouble(result: BatchResult, expected: Container[int] = (), *, resumable: bool = True) -> None:
    """Print to stderr what is wrong with jobs, but those whose outcome is `expected`, and what else happened."""
    for n, (job, outcome) in enumerate(zip(result.jobs, result.outcomes, strict=True)):
        if n in expected:
            continue
        complain_of(outcome.problems)
        if outcome.message:
            complain(f"{name_of(job.deck)}: {outcome.state}: {outcome.message}")
    complain_of_each(None, result.notes)
    if result.interrupted:
        kept = "; what is finished is kept, and the same command goes on from there" if resumable else ""
        complain(f"interrupted{kept}")


def _tell(result: BatchResult) -> None:
    """Print the table to stdout."""
    from musatpy.campaign.batch_summary import table, verdict

    tell(table(result.jobs, result.outcomes), nl=False)
    summary = f"; summary {name_of(result.summary)}" if result.summary else ""
    index = f", index {name_of(result.index)}" if result.index else ""
    tell(f"{verdict(result.outcomes)}{summary}{index}")
