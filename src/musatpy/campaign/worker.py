"""A job run, and a process that runs one after another: pickled calls on stdin, what becomes of them on stdout.

It ends with its stdin, even in the middle of a job: a batch that is killed leaves no process at work.
"""

from __future__ import annotations

import contextlib
import faulthandler
import os
import pickle
import queue
import stat
import sys
import threading
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from musatpy.campaign.batch_jobs import GRADES, OUT_OF_MEMORY, BatchJob, JobOutcome, JobState, sha256_of
from musatpy.errors import MusatError, Problem, and_warnings, count_of
from musatpy.files import together
from musatpy.formats.musat import geoid_files
from musatpy.memory import take_working_memory
from musatpy.model import Block, Iteration
from musatpy.runs import run_deck
from musatpy.shown_runs import check_point_rms, show_run

Tell = Callable[[dict[str, Any]], None]
_BETWEEN = 0.1  # seconds from one message about iterations to the next
_STATES = {grade: state for state, grade in GRADES.items()}


def main() -> None:
    """Serve calls until stdin ends. Whatever else writes to stdout goes to stderr."""
    faulthandler.enable()
    channel = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    calls: queue.SimpleQueue[tuple[Any, ...]] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(calls,), daemon=True).start()

    def send(kind: str, content: Any) -> None:
        pickle.dump((kind, content), channel)
        channel.flush()

    warnings.simplefilter("ignore", RuntimeWarning)
    while True:
        function, args, kwargs = calls.get()
        send("result", function(*args, **kwargs, tell=partial(send, "message")))


def _listen(calls: queue.SimpleQueue[tuple[Any, ...]]) -> None:
    """Take calls as they come; without a batch there is nothing left to work for."""
    try:
        while True:
            calls.put(pickle.load(sys.stdin.buffer))
    finally:
        os._exit(0)


def run_job(job: BatchJob, tell: Tell = lambda message: None) -> JobOutcome:
    """Run one job; whatever goes wrong with it is in its outcome. `tell` gets fields of `batch.Event`."""
    start = time.monotonic()
    known: dict[str, Any] = {}
    last = start - _BETWEEN

    def on_read(block: Block) -> None:
        sizes = {"photos": len(block.photos.ids), "points": len(block.points.ids)}
        known.update(sizes, plates=len(block.plates.photo))
        tell(sizes)

    def on_iteration(iteration: Iteration) -> None:
        nonlocal last
        if time.monotonic() - last >= _BETWEEN:
            last = time.monotonic()
            tell({"iteration": (iteration.outer_pass, iteration.number)})

    try:
        take_working_memory()
        ended = _run(job, known, on_read, on_iteration)
    except Exception as error:
        ended = failure_of(error)
    return JobOutcome(**(known | ended), seconds=round(time.monotonic() - start, 3))


def failure_of(error: Exception) -> dict[str, Any]:
    """Return the fields of the outcome of a job that something went wrong with."""
    message = f"unexpected {type(error).__name__}: {error}"
    if isinstance(error, OSError):
        message = f"{error.filename or 'system'}: {error.strerror or error}"
    elif isinstance(error, MusatError):
        message = str(error)
    elif isinstance(error, MemoryError):
        message = OUT_OF_MEMORY + (f" ({error})" if str(error) else "")
    return {"state": JobState.FAILED, "message": message}


@together()  # the hashes are those of what was written
def _run(
    job: BatchJob,
    known: dict[str, Any],
    on_read: Callable[[Block], None],
    on_iteration: Callable[[Iteration], None],
) -> dict[str, Any]:
    """Return the fields of the outcome of a job, the early ones in `known`; raises what `run_deck` does.

    The hashes are those of what was run: a deck that is edited meanwhile has no results.
    """
    check_kind(job.deck)
    with contextlib.suppress(OSError):  # a deck that cannot be read is a problem that the run tells
        known["deck_sha256"] = sha256_of(job.deck)
    known["inputs"] = job.inputs()

    def on_block(block: Block) -> None:
        known["inputs"] = job.inputs(geoid_files(block))
        on_read(block)

    work = _adjusted if job.run is None else _compiled
    problems, fields, files = work(job, on_iteration, on_block)
    if fields is not None or "deck_sha256" in known:
        check_unchanged(job, known.get("deck_sha256"), known["inputs"])
    if fields is None:
        errors = sum(problem.severity == "error" for problem in problems)
        message = count_of(errors, "error")
        return {"state": JobState.UNUSABLE, "problems": problems, "message": message}
    return fields | {
        "problems": problems,
        "fingerprint": job.fingerprint(known["deck_sha256"], known["inputs"]),
        "outputs": {os.path.relpath(path, job.folder): sha256_of(path) for path in files},
    }


_Work = tuple[tuple[Problem, ...], dict[str, Any] | None, list[Path]]
"""Problems, fields of an outcome (None where there are no results), and the files written."""


def _adjusted(job: BatchJob, on_iteration: Callable[[Iteration], None], on_block: Callable[[Block], None]) -> _Work:
    """Run the deck of a triangulation."""
    result = run_deck(job.deck, job.out, progress=on_iteration, on_read=on_block, **job.options.arguments())
    if result.solution is None or result.verdict is None:
        return result.problems, None, []
    shown = list(show_run(result, job.options.shown))
    texts = (text for kind in shown for text in kind.reasons)
    problems = tuple(and_warnings(result.problems, texts, str(job.deck)))
    check_points, check_rms = check_point_rms(result)
    fields = {
        "state": _STATES[result.verdict.grade],
        "sigma0": float(result.solution.sigma0),
        "check_points": check_points,
        "check_rms": check_rms,
        "iterations": len(result.solution.iterations),
        "water_passes": len(result.solution.passes),
        "message": "; ".join(reason.text for reason in result.verdict.reasons),
    }
    return problems, fields, [*result.files, *(path for kind in shown for path in kind.files)]


def _compiled(job: BatchJob, on_iteration: Callable[[Iteration], None], on_block: Callable[[Block], None]) -> _Work:
    """Run the triangulation of a compilation deck in a folder of its own, and compile the deck in its models."""
    from musatpy.as11_runs import compile_deck  # few jobs need it

    assert job.run is not None
    with TemporaryDirectory(prefix="musat-") as folder:
        triangulation = replace(job, deck=job.run, out=Path(folder), run=None)
        problems, fields, _ = _adjusted(triangulation, on_iteration, on_block)
        if fields is None:
            return problems, None, []
        record = Path(folder) / f"{job.run.stem}.json"
        result = compile_deck(record, job.deck, job.out)
    of_run = {str(record): str(job.run)}  # what is wrong with a record that is gone by now
    found = tuple(replace(one, file=of_run.get(one.file or "", one.file)) for one in result.problems)
    return found, None if result.compiled is None else fields, list(result.files)


def check_unchanged(job: BatchJob, deck_sha256: str | None, inputs: dict[str, str]) -> None:
    """Raise `MusatError` where what was read is not there any more as it was."""
    if sha256_of(job.deck) != deck_sha256:
        raise MusatError(f"{job.deck}: the deck was changed while it was run")
    if job.formats_changed() or job.inputs(inputs) != inputs:
        others = "card formats or a geoid model" if job.run is None else f"{job.run}, card formats or a geoid model"
        raise MusatError(f"{job.deck}: {others} were changed while the batch ran")


def check_kind(deck: Path) -> None:
    """Raise `MusatError` for a pipe or a device, on which a run would wait: a job needs a deck that stays."""
    with contextlib.suppress(OSError):
        mode = deck.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise MusatError(f"{deck}: not a file that can be read again")
