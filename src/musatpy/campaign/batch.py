"""A batch: what is finished is kept, the rest is run, and nothing that happens to one job stops another."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from musatpy.campaign.batch_jobs import OUT_OF_MEMORY, BatchJob, JobOutcome, JobState, sha256_of
from musatpy.campaign.batch_reports import index_page, summary_json
from musatpy.campaign.carried import delivered, parcel_of, run_parcel
from musatpy.campaign.local import LocalExecutor, ProcessDiedError
from musatpy.campaign.locks import FolderLocks
from musatpy.campaign.manifest import BatchPlan
from musatpy.campaign.worker import failure_of, run_job
from musatpy.errors import MusatError
from musatpy.files import NO_LINK, real_path, remove_leftovers, write_files
from musatpy.memory import cores
from musatpy.runs import ExitStatus

_ELSEWHERE = "; --out, or out in a manifest, takes results elsewhere"
_AHEAD = 1000  # jobs that an executor has at a time: decks that wait for a worker take memory
_TICK = 0.2  # seconds
_LEDGER = ".musat-batch.jsonl"  # which jobs of a folder are finished


@dataclass(frozen=True, kw_only=True)
class Event:
    """Something that happened to a job. An event without a field that is set says that the job was begun."""

    index: int  # of the job
    photos: int | None = None  # the deck was read
    points: int | None = None
    iteration: tuple[int, int] | None = None  # pass and number
    outcome: JobOutcome | None = None  # the job has ended


class Watch(Protocol):
    """Who looks on while a batch runs."""

    def begin(self, jobs: Sequence[BatchJob]) -> None:
        """Called with all jobs before the first event."""

    def event(self, event: Event | None) -> None:
        """Called with everything that happens; None: nothing has for a while."""

    def end(self) -> None:
        """Called when the batch has ended, however it did."""


@dataclass(frozen=True, kw_only=True)
class BatchResult:
    """A batch after its run: an outcome of each job, in their order."""

    jobs: tuple[BatchJob, ...]
    outcomes: tuple[JobOutcome, ...]
    seconds: float
    summary: Path | None  # where the summary is; None: it could not be written
    index: Path | None = None  # where the index page is; None: there is none
    notes: tuple[str, ...] = ()  # what else is to be told: locks taken over, a state that could not be kept
    interrupted: bool = False
    strict: bool = False  # doubtful answers are not to be used

    @property
    def status(self) -> ExitStatus:
        """Return what `musat run` would give for the worst job."""
        statuses = {outcome.state.status_if(strict=self.strict) for outcome in self.outcomes}
        if self.summary is None:
            statuses.add(ExitStatus.UNUSABLE)
        return ExitStatus.worst(statuses)


def run_batch(
    plan: BatchPlan,
    *,
    processes: int | None = None,
    again: bool = False,
    strict: bool = False,
    watch: Watch | None = None,
    locks: FolderLocks | None = None,
    executor: Executor | None = None,
) -> BatchResult:
    """Run the jobs of a plan in parallel processes (as many as there are cores) and write the summary.

    With an `executor` they go to that one, which may be of other machines: decks go with the jobs, and results come
    back (`musatpy.campaign.carried`); `processes` do not count then. Jobs that an earlier run finished are kept
    unless `again`; `strict` is that of `musatpy.runs.run_deck`. `watch` is told everything that happens. An
    interruption (Ctrl-C) ends it early; what was finished is kept then. Folders are locked until the batch ends, or
    by `locks` until their owner gives them up. Raises `LockedError` where another batch is at work in a folder of
    this one, and `OSError` where the folder of the batch cannot be used.
    """
    with contextlib.ExitStack() as stack:
        locks = locks or stack.enter_context(FolderLocks())
        start = time.monotonic()
        locks.take(plan.folder, _ELSEWHERE)
        batch = _Batch(plan, locks, watch)
        interrupted = False
        if watch:
            watch.begin(plan.jobs)
        try:
            batch.prepare(again)
            batch.run(processes or cores(), executor)
        except KeyboardInterrupt:
            interrupted = True
        finally:
            if watch:
                watch.end()
        not_run = JobOutcome(state=JobState.NOT_RUN)
        result = BatchResult(
            jobs=plan.jobs,
            outcomes=tuple(batch.outcomes.get(n, not_run) for n in range(len(plan.jobs))),
            seconds=round(time.monotonic() - start, 3),
            summary=plan.folder / f"{plan.name}.json",
            index=plan.index,
            notes=tuple(dict.fromkeys([*locks.taken_over, *batch.notes])),
            interrupted=interrupted,
            strict=strict,
        )
        return _summarized(result)


def _summarized(result: BatchResult) -> BatchResult:
    """Write the summary; where that is not possible the result says so."""
    assert result.summary is not None
    text = summary_json(result.jobs, result.outcomes, result.seconds, result.status)
    files = {result.summary: text.encode()}
    if result.index is not None:
        folder, name = result.index.parent, result.index.stem
        files = {result.index: index_page(name, folder, result.jobs, result.outcomes), **files}
    try:
        write_files(files)
    except OSError as error:
        note = f"the summary cannot be written: {error.filename or result.summary}: {error.strerror or error}"
        return replace(result, summary=None, index=None, notes=(*result.notes, note))
    return result


class Ledger:
    """The finished jobs of a folder, each known by its results: their folder, seen from here, and their name.

    It is a file of JSON lines that is only ever appended to. A line that a kill or a full disk left unfinished is
    not read, and the next one does not stand behind it.
    """

    def __init__(self, folder: Path) -> None:
        """Read the ledger of a folder; raises `OSError` where there is one that cannot be read.

        One with outdated lines is written anew; where that is not possible (a full disk) they stay.
        """
        self.path = folder / _LEDGER
        self.entries: dict[str, dict[str, Any]] = {}
        data = self.path.read_bytes() if self.path.exists() else b""
        lines = data.split(b"\n")
        for line in lines:
            try:
                entry = json.loads(line)
                self.entries[entry["job"]] = entry["outcome"]
            except (ValueError, KeyError, TypeError):
                continue
        if len(self.entries) < len(lines) - 1 or lines[-1]:  # outdated lines, or one that is not whole
            with contextlib.suppress(OSError):
                text = "".join(_line(key, outcome) for key, outcome in self.entries.items())
                write_files({self.path: text.encode()})

    def finished(self, job: BatchJob) -> JobOutcome | None:
        """Return the outcome of a job that is finished, None where it has to be run.

        It is finished where the bytes of the deck and of its other inputs, the program's version and the options
        are those of the entry, and every file that it left is there and as it was.
        """
        entry = self.entries.get(self._key(job))
        if entry is None:
            return None
        try:
            outcome = JobOutcome.of_data(entry | {"kept": True})
            intact = (
                outcome.fingerprint == job.fingerprint(sha256_of(job.deck), job.inputs(outcome.inputs))
                and bool(outcome.outputs)
                and all(sha256_of(job.folder / name) == sha for name, sha in outcome.outputs.items())
            )
        except (OSError, ValueError, KeyError, TypeError, AttributeError, MusatError):
            return None
        return outcome if intact else None

    def add(self, job: BatchJob, outcome: JobOutcome) -> None:
        """Append a job that is finished; raises `OSError`, and leaves the ledger as it was then."""
        key = self._key(job)
        line = _line(key, asdict(outcome)).encode()
        fd = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND | NO_LINK, 0o666)
        try:
            before = os.fstat(fd).st_size
            if before and os.pread(fd, 1, before - 1) != b"\n":
                line = b"\n" + line
            try:
                while line:
                    line = line[os.write(fd, line) :]
            except OSError as error:
                os.ftruncate(fd, before)
                raise OSError(error.errno, error.strerror, str(self.path)) from error
        finally:
            os.close(fd)
        self.entries[key] = asdict(outcome)

    def _key(self, job: BatchJob) -> str:
        here = real_path(self.path.parent)
        return os.path.relpath(real_path(job.folder) / job.deck.stem, here)


def _line(key: str, outcome: dict[str, Any]) -> str:
    return json.dumps({"job": key, "outcome": outcome}) + "\n"


_ENDED = object()  # after the messages of a job


class _Batch:
    """The jobs of a plan on their way."""

    def __init__(self, plan: BatchPlan, locks: FolderLocks, watch: Watch | None) -> None:
        self.plan = plan
        self.locks = locks
        self.tell: Callable[[Event | None], None] = watch.event if watch else lambda event: None
        self.ledger = Ledger(plan.folder)
        self.outcomes: dict[int, JobOutcome] = {}
        self.notes: list[str] = []
        self.begun: dict[int, float] = {}  # when
        self.happened: queue.SimpleQueue[tuple[Future[Any], Any]] = queue.SimpleQueue()

    def prepare(self, again: bool) -> None:
        """Lock the folders of results, tidy up after a batch that was killed, find what is finished."""
        for n, job in enumerate(self.plan.jobs):
            if job.out is None and not os.path.isdir(job.folder):
                continue  # of a deck that is not there, which its run tells
            try:
                self.locks.take(job.folder, _ELSEWHERE)
            except OSError as error:
                self.end(n, JobOutcome(**failure_of(error)))
        jobs = [job for n, job in enumerate(self.plan.jobs) if n not in self.outcomes]
        summary = self.plan.folder / f"{self.plan.name}.json"
        index = [] if self.plan.index is None else [self.plan.index]
        remove_leftovers([summary, *index, self.ledger.path, *(path for job in jobs for path in job.outputs())])
        for n, job in enumerate(self.plan.jobs):
            if n not in self.outcomes and not again and (outcome := self.ledger.finished(job)) is not None:
                self.end(n, outcome)

    def end(self, n: int, outcome: JobOutcome) -> None:
        """Keep the outcome of a job."""
        self.outcomes[n] = outcome
        self.tell(Event(index=n, outcome=outcome))

    def run(self, processes: int, executor: Executor | None) -> None:
        """Run what is left, by processes of our own where there is no executor."""
        left = [(n, job) for n, job in enumerate(self.plan.jobs) if n not in self.outcomes]
        try:
            if executor is not None:
                self._run(left, executor)
            elif left:
                fds = tuple(self.locks.fds.values())
                with LocalExecutor(min(processes, len(left)), lambda *what: self.happened.put(what), fds) as own:
                    self._run(left, own)
        finally:
            # whose processes may have ended before they did, and left temporary files
            ended = {n for n, outcome in self.outcomes.items() if outcome.state is not JobState.CRASHED}
            killed = [job for n, job in left if n not in ended]
            remove_leftovers(path for job in killed for path in job.outputs())

    def _run(self, jobs: Sequence[tuple[int, BatchJob]], executor: Executor) -> None:
        """Hand out jobs, and take what comes back until all have ended."""
        left, futures = deque(jobs), dict[Future[Any], int]()
        try:
            while left or futures:
                while left and len(futures) < _AHEAD:
                    n, job = left.popleft()
                    future = self._submitted(job, executor)
                    futures[future] = n
                    future.add_done_callback(lambda future: self.happened.put((future, _ENDED)))
                try:
                    future, message = self.happened.get(timeout=_TICK)
                except queue.Empty:
                    self.tell(None)
                    continue
                n = futures[future]
                if message is not _ENDED:
                    self.begun.setdefault(n, time.monotonic())
                    self.tell(Event(index=n, **(message or {})))
                    continue
                del futures[future]
                outcome = self._outcome(n, future)
                self._record(self.plan.jobs[n], outcome)
                self.end(n, outcome)
        finally:
            for future in futures:
                future.cancel()

    def _submitted(self, job: BatchJob, executor: Executor) -> Future[Any]:
        """Return the future of a job; of a deck that cannot be read here it is what its run says of it."""
        if isinstance(executor, LocalExecutor):
            return executor.submit(run_job, job)
        future: Future[Any] = Future()
        try:
            return executor.submit(run_parcel, parcel_of(job))
        except (OSError, MusatError):
            future.set_result((run_job(job), {}))
        except Exception as error:  # an executor that is broken
            future.set_exception(error)
        return future

    def _outcome(self, n: int, future: Future[Any]) -> JobOutcome:
        """Return the outcome of a job whose future is done."""
        try:
            result = future.result()
        except Exception as error:
            seconds = round(time.monotonic() - self.begun[n], 3) if n in self.begun else 0.0
            return replace(_lost(error), seconds=seconds)
        return result if isinstance(result, JobOutcome) else delivered(self.plan.jobs[n], *result)

    def _record(self, job: BatchJob, outcome: JobOutcome) -> None:
        """Note in the ledger what is finished; a job that cannot be noted is done again, and nothing is lost."""
        if not outcome.state.has_results:
            return
        try:
            self.ledger.add(job, outcome)
        except OSError as error:
            why = failure_of(error)["message"]
            self.notes.append(f"{why}: finished jobs are done again when the batch is resumed")


def _lost(error: Exception) -> JobOutcome:
    """Return the outcome of a job that its executor has no result of: jobs themselves raise nothing."""
    if isinstance(error, ProcessDiedError):
        return JobOutcome(state=JobState.CRASHED, message=str(error))
    if isinstance(error, MemoryError):
        return JobOutcome(state=JobState.FAILED, message=OUT_OF_MEMORY)
    if isinstance(error, OSError):
        why = f"no process can be started: {error.strerror or error}; fewer --jobs need less"
        return JobOutcome(state=JobState.FAILED, message=why)
    what = str(error) if isinstance(error, MusatError) else f"{type(error).__name__}: {error}"
    return JobOutcome(state=JobState.CRASHED, message=f"its worker was lost: {what}")
