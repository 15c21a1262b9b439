"""Worker processes, as many as wanted: jobs in, events out, and no job that fails stops another."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import musatpy
from musatpy.campaign.job import OUT_OF_MEMORY, Job, Outcome, State
from musatpy.errors import MusatError

_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_START = "import sys; sys.path.append(sys.argv[1]); from musatpy.campaign.worker import main; main()"
_TAIL = 300  # characters of a line that a process said before it ended


@dataclass(frozen=True, kw_only=True)
class Event:
    """Something that happened to a job. An event without a field that is set says that the job was begun."""

    index: int  # of the job
    photos: int | None = None  # the deck was read
    points: int | None = None
    iteration: tuple[int, int] | None = None  # pass and number
    outcome: Outcome | None = None  # the job has ended


class _DiedError(Exception):
    """A process ended before its job did."""


class _Worker:
    """One process. It inherits `fds` (locks), which are held until it has ended too."""

    def __init__(self, fds: Sequence[int]) -> None:
        self.said = tempfile.TemporaryFile()  # noqa: SIM115 (closed with the process)
        # -P and -c: a file in the folder of the user that is named as a module is not taken for it
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", _START, str(Path(musatpy.__file__).parents[1])],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.said,
            text=True,
            encoding="utf-8",
            env=os.environ | _ONE_THREAD,
            pass_fds=fds,
            start_new_session=True,  # Ctrl-C is for the batch, which then ends its processes
        )

    def run(self, job: Job) -> Iterator[dict[str, Any]]:
        """Yield what the process tells of a job; raises `_DiedError`."""
        assert self.process.stdin and self.process.stdout
        try:
            self.process.stdin.write(json.dumps(job.as_data()) + "\n")
            self.process.stdin.flush()
            for line in self.process.stdout:
                message = json.loads(line)
                yield message
                if "outcome" in message:
                    return
        except (OSError, ValueError):
            self.process.kill()
        raise _DiedError(self.epitaph())

    def epitaph(self) -> str:
        """Return how the process ended, and the last that it said."""
        code = self.process.wait()
        how = f"ended with status {code}"
        if code < 0:
            how = f"was killed by {_signal_name(-code)}"
            if -code == signal.SIGKILL:
                how += " (the system does so when memory runs out)"
        self.said.seek(0)
        said = last_words(self.said.read().decode("utf-8", "replace"))
        return f"its process {how}" + (f": {said}" if said else "")

    def close(self, *, kill: bool = False) -> None:
        """End the process: an idle one by itself, otherwise at once."""
        if kill:
            self.process.kill()
        for stream in (self.process.stdin, self.process.stdout):
            if stream:
                with contextlib.suppress(OSError):
                    stream.close()
        self.process.wait()
        self.said.close()


class Pool:
    """Processes at work on a list of jobs; `events` yields what happens until all jobs have ended."""

    def __init__(self, jobs: Iterable[tuple[int, Job]], processes: int, fds: Sequence[int] = ()) -> None:
        self._jobs = deque(jobs)
        self._left = len(self._jobs)
        self._fds = fds
        self._queue: queue.Queue[Event] = queue.Queue()
        self._workers: set[_Worker] = set()
        self._stopped = False
        self._guard = threading.Lock()
        count = min(processes, self._left)
        self._threads = [threading.Thread(target=self._serve, daemon=True) for _ in range(count)]

    def events(self, tick: float = 0.2) -> Generator[Event | None, None, None]:
        """Yield events, and None every `tick` seconds in which none came; whoever leaves ends all processes."""
        try:
            self._start()
            while self._left:
                try:
                    event = self._queue.get(timeout=tick)
                except queue.Empty:
                    yield None
                    continue
                self._left -= event.outcome is not None
                yield event
        finally:
            self._stop()

    def _start(self) -> None:
        """Start as many threads as the system allows; raises `MusatError` where that is not even one."""
        for n, thread in enumerate(self._threads):
            try:
                thread.start()
            except RuntimeError as error:
                if n == 0:
                    raise MusatError(f"no job can be started, processes or memory are limited: {error}") from error
                return

    def _stop(self) -> None:
        with self._guard:
            self._stopped = True
            self._jobs.clear()
            for worker in self._workers:
                worker.process.kill()
        for thread in self._threads:
            if thread.ident is not None:  # else it was not started any more, and will find no job
                thread.join()

    def _serve(self) -> None:
        """Keep one process at work, a new one after each that died."""
        worker: _Worker | None = None
        while True:
            try:
                index, job = self._jobs.popleft()
            except IndexError:
                break
            self._queue.put(Event(index=index))
            start = time.monotonic()
            try:
                worker = worker or self._hire()
                for message in worker.run(job):
                    self._queue.put(_event(index, message))
            except Exception as error:  # whatever it is: a thread that ends here leaves the batch waiting
                state = State.CRASHED if isinstance(error, _DiedError) else State.FAILED
                why = _reason(error)
                seconds = round(time.monotonic() - start, 3)
                self._queue.put(Event(index=index, outcome=Outcome(state=state, message=why, seconds=seconds)))
                self._dismiss(worker, kill=True)
                worker = None
        self._dismiss(worker)

    def _hire(self) -> _Worker:
        with self._guard:
            if self._stopped:
                raise _DiedError("the batch was interrupted")
            worker = _Worker(self._fds)
            self._workers.add(worker)
            return worker

    def _dismiss(self, worker: _Worker | None, *, kill: bool = False) -> None:
        if worker is not None:
            with self._guard:
                self._workers.discard(worker)
            worker.close(kill=kill)


def last_words(said: str) -> str:
    """Return of all that a process said the line that tells most: where a fault was, else the last one."""
    fault = re.search(r'^Current thread .*\n\s*(File ".*", line \d+ in .*)', said, re.MULTILINE)
    lines = [fault[1]] if fault else said.split("\n")
    return next((" ".join(line.split())[-_TAIL:] for line in reversed(lines) if line.strip()), "")


def _reason(error: Exception) -> str:
    """Return why a process did not do its job."""
    if isinstance(error, OSError):
        return f"no process can be started: {error.strerror or error}; fewer --jobs need less"
    if isinstance(error, MemoryError):
        return OUT_OF_MEMORY
    return str(error) if isinstance(error, _DiedError) else f"unexpected {type(error).__name__}: {error}"


def _signal_name(number: int) -> str:
    """Return the name of a signal; those for programs' own use have none."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _event(index: int, message: dict[str, Any]) -> Event:
    """Return what a process told as an event."""
    if "outcome" in message:
        return Event(index=index, outcome=Outcome.of_data(message["outcome"]))
    if "read" in message:
        return Event(index=index, **message["read"])
    outer, number = message["iteration"]
    return Event(index=index, iteration=(outer, number))
