"""Jobs for executors whose processes may see no folder of ours: decks go with their jobs, results come back.

Only the batch writes, so that a worker that is lost, or runs a job again that was thought lost, leaves nothing half
written; whether workers share a folder makes no difference.
"""

from __future__ import annotations

import logging
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, InvalidStateError
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from musatpy.campaign.batch_jobs import BatchJob, JobOutcome, JobState, program
from musatpy.campaign.worker import check_kind, check_unchanged, failure_of, run_job
from musatpy.errors import MusatError, Problem
from musatpy.extras import package
from musatpy.files import write_files

_PATIENCE = 30  # seconds until a scheduler must answer, or a worker come after the last one was lost
_NONE_YET = 3.0  # seconds until it is told that there are no workers


@dataclass(frozen=True, kw_only=True)
class Parcel:
    """A job and what it reads; the grid of a geoid model has to be among the worker's own."""

    job: BatchJob
    deck: bytes
    formats: tuple[tuple[str, bytes], ...]  # names and contents of its card formats
    points: tuple[tuple[str, str, bytes], ...]  # lists and polygons of points: option, name, content
    program: str  # version and hash of the program here


def parcel_of(job: BatchJob) -> Parcel:
    """Return a job with what it reads; raises `OSError`, and `MusatError` for what is no file."""
    check_kind(job.deck)
    folder = job.options.formats
    paths = () if folder is None else sorted(folder.glob("*.toml"))
    return Parcel(
        job=job,
        deck=job.deck.read_bytes(),
        formats=tuple((path.name, path.read_bytes()) for path in paths),
        points=tuple((name, path.name, path.read_bytes()) for name, path in job.options.flags.files.items()),
        program=program(),
    )


def run_parcel(parcel: Parcel) -> tuple[JobOutcome, dict[str, bytes]]:
    """Return the outcome of a job and the files that it leaves, by their names in its folder; run by a worker."""
    if parcel.program != program():
        message = f"its worker has version {program()} of the program, not {parcel.program}: install one everywhere"
        return JobOutcome(state=JobState.FAILED, message=message), {}
    with TemporaryDirectory(prefix="musat-") as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        deck, out = Path(folder) / parcel.job.deck.name, Path(folder) / "out"
        deck.write_bytes(parcel.deck)
        given = parcel.job.options
        formats = given.formats and _formats(given.formats.name, parcel.formats)
        points = {option: Path(folder, option, name) for option, name, _ in parcel.points}
        write_files({points[option]: content for option, _, content in parcel.points})
        options = replace(
            given, formats=formats, dry=points.get("dry"), submerged=points.get("submerged", given.submerged)
        )
        outcome = run_job(BatchJob(deck=deck, out=out, options=options))
        files = {name: (out / name).read_bytes() for name in outcome.outputs}
    return _renamed(outcome, str(deck), str(parcel.job.deck)), files


@cache
def _formats(name: str, files: tuple[tuple[str, bytes], ...]) -> Path:
    """Return a folder of card formats, which this process reads once, however many jobs it runs."""
    folder = TemporaryDirectory(prefix="musat-")
    _kept.append(folder)
    write_files({Path(folder.name) / name / file: data for file, data in files})
    return Path(folder.name) / name


_kept: list[TemporaryDirectory[str]] = []


def _renamed(outcome: JobOutcome, there: str, here: str) -> JobOutcome:
    """Return an outcome whose texts name the deck as it is named here."""

    def renamed(problem: Problem) -> Problem:
        file = problem.file and problem.file.replace(there, here)
        return replace(problem, file=file, message=problem.message.replace(there, here))

    problems = tuple(map(renamed, outcome.problems))
    return replace(outcome, problems=problems, message=outcome.message.replace(there, here))


def delivered(job: BatchJob, outcome: JobOutcome, files: dict[str, bytes]) -> JobOutcome:
    """Write the files of a job that a worker ran, and return what became of it."""
    try:
        if outcome.deck_sha256 is not None and outcome.state is not JobState.FAILED:
            check_unchanged(job, outcome.deck_sha256, outcome.inputs)
        write_files({job.folder / name: data for name, data in files.items()})
    except (OSError, MusatError) as error:
        return replace(outcome, **failure_of(error), fingerprint=None, outputs={})
    return outcome


class _Workers(Executor):
    """The workers of a scheduler. Calls for which none is left end with `MusatError`; `say` is told of none yet."""

    def __init__(self, client: Any, address: str, say: Callable[[str], None]) -> None:
        self._client, self._executor = client, client.get_executor(pure=False)
        self._address, self._say = address, say
        self._calls: set[Future[Any]] = set()
        self._ended = threading.Event()
        threading.Thread(target=self._look, args=(bool(client.nthreads()), self._come()), daemon=True).start()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Return the future of a call."""
        future: Future[Any] = self._executor.submit(fn, *args, **kwargs)
        self._calls.add(future)
        future.add_done_callback(self._calls.discard)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Look at the workers no more."""
        self._ended.set()

    def _come(self) -> int:
        """Return how many workers have come to the scheduler since it was started."""
        events = (event for _, event in self._client.get_events("all"))
        return sum(isinstance(event, dict) and event.get("action") == "add-worker" for event in events)

    def _look(self, ever: bool, before: int) -> None:
        """Count the workers every second: the engine waits for them without a word, and for ever.

        `ever`: whether there were workers at the start; `before`: how many had come by then. Those that die as they
        load may be gone before they are counted.
        """
        last, told = time.monotonic(), False
        while not self._ended.wait(1.0):
            try:
                there = bool(self._client.nthreads())
                ever = ever or there or self._come() > before
            except Exception:  # a scheduler that is lost, which the calls say
                return
            alone = time.monotonic() - last
            if there:
                last = time.monotonic()
            elif not ever and not told and alone > _NONE_YET:
                told = True
                self._say(f"{self._address}: the scheduler has no workers yet, the jobs wait for the first one")
            elif ever and alone > _PATIENCE:
                for future in self._calls.copy():
                    with suppress(InvalidStateError):
                        message = f"all workers were lost, and none came in {_PATIENCE} s: their logs say why"
                        future.set_exception(MusatError(message))


@contextmanager
def cluster(address: str, say: Callable[[str], None] = lambda message: None) -> Iterator[Executor]:
    """Give the workers of a Dask scheduler; `say` is told where there are none.

    Raises `MusatError` where the scheduler does not answer, or dask is missing.
    """
    distributed = package("cluster", "distributed", "a cluster needs")
    try:
        client = distributed.Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise MusatError(f"{address}: no scheduler can be reached: {' '.join(str(error).split())}") from error
    logging.disable()  # what the engine says of workers and schedulers that are lost, the outcomes of jobs say
    try:
        with client, _Workers(client, address, say) as workers:
            yield workers
    finally:
        logging.disable(logging.NOTSET)
