"""How far a run or a batch is: a line or a block of lines at the foot of a terminal."""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import click

from musatpy.cli.messages import LOG, VERBOSE, asked, log, name_of, on_terminal, remark
from musatpy.errors import count_of, printable

if TYPE_CHECKING:
    from musatpy.campaign.batch import Event
    from musatpy.campaign.batch_jobs import BatchJob, JobOutcome
    from musatpy.model import Block, Iteration, Options
    from musatpy.model.progress import Phase

_PATIENCE = 0.5  # seconds before a run counts as long
_REDRAWN = 0.5  # seconds after which the line of a run is written anew, with the time at least
_FRESH = 0.1  # seconds in which neither line nor block is, whatever happens
_LEAST_NAME = 12  # characters
_BAR = 24  # characters
_SHOWN = 12  # jobs at work that are shown


class _Foot:
    """What is written at the foot of a terminal; one that has gone away, or a pipe, does not end the work."""

    deaf = False  # nobody reads stderr any more

    def _write(self, text: str) -> None:
        if not self.deaf:
            try:
                click.echo(text, nl=False, err=True)
            except (OSError, ValueError):
                self.deaf = True


class LiveLine(_Foot):
    """A watcher of a run that says on the terminal where it is: phase, what is left as far as known, and the time.

    A thread keeps the time going while the run is too busy to tell anything. It ends with the `with` block. With -v
    there is a line of each phase in its place, as in the log.
    """

    def __init__(self, name: str, clock: Callable[[], float] = time.monotonic, *, live: bool = True) -> None:
        self._name, self._clock, self._live = name, clock, live
        self._start, self._drawn = clock(), -1.0e9
        self._doing = "reading"
        self._options: Options | None = None
        self._width = 0
        self._lock, self._end = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._keep_time, name="musat live line", daemon=True)

    def __enter__(self) -> LiveLine:
        if self._live:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        if self._live:
            self._thread.join()
        with self._lock:
            if self._width:
                self._write(f"\r{'':<{self._width}}\r")

    def read(self, block: Block) -> None:
        """Take note of the limits of a job."""
        self._options = block.options

    def __call__(self, iteration: Iteration) -> None:
        """Show an iteration that has ended."""
        from musatpy.units import ARC_SECOND  # here, because it loads numpy, which `--help` can do without

        options = self._options
        moved = [f"{iteration.rotation / ARC_SECOND:.3f} arc seconds", f"{iteration.translation:.4f} m"]
        number = f"iteration {iteration.number}"
        if options is not None:
            limits = (options.rotation_limit / ARC_SECOND, options.translation_limit)
            moved = [f"{text} (limit {limit:g})" for text, limit in zip(moved, limits, strict=True)]
            number += f" of {options.max_iterations}"
        self._tell(f"pass {iteration.outer_pass}, {number}, largest movement {', '.join(moved)}")

    def phase(self, phase: Phase) -> None:
        """Show a phase that begins."""
        doing = f"{phase.name} {phase.number} of {phase.total}" if phase.total else phase.name
        self._tell(doing, remarked=phase.number <= 1)

    def _tell(self, doing: str, *, remarked: bool = True) -> None:
        self._doing = doing
        if remarked:
            remark(f"{self._name}: {doing}, {clock_text(self._clock() - self._start)}")
        if self._live and self._clock() - self._drawn >= _FRESH:
            self.draw()

    def draw(self) -> None:
        """Write the line anew, once the run has lasted a while."""
        with self._lock:
            now = self._clock()
            if now - self._start < _PATIENCE or self._end.is_set():
                return
            spent = clock_text(now - self._start)
            room = shutil.get_terminal_size().columns - len(spent) - 3
            left = max(room - len(self._doing) - 2, _LEAST_NAME)  # folders of a name go first
            name = self._name if len(self._name) <= left else f"...{self._name[3 - left :]}"
            line = f"{f'{name}: {self._doing}'[:room]}, {spent}"
            self._write(f"\r{line:<{self._width}}")
            self._width, self._drawn = len(line), now

    def _keep_time(self) -> None:
        while not self._end.wait(_REDRAWN):
            self.draw()


def clock_text(seconds: float) -> str:
    """Return minutes and seconds, and hours where there are any."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


@dataclass
class _Running:
    """A job at work."""

    since: float = field(default_factory=time.monotonic)
    photos: int | None = None
    points: int | None = None
    doing: str = "reading"


class Display(_Foot):
    """Shows events of a batch on stderr; the live block only where that is a terminal."""

    def __init__(self) -> None:
        self.jobs: Sequence[BatchJob] = ()
        self.live = on_terminal()
        self.start = time.monotonic()
        self.running: dict[int, _Running] = {}
        self.ended = self.kept = self.bad = 0
        self.height = 0
        self.drawn = 0.0

    def begin(self, jobs: Sequence[BatchJob]) -> None:
        """Take the jobs, and start the clock."""
        self.jobs = jobs
        self.start = time.monotonic()

    def end(self) -> None:
        """Take the block away."""
        self._write(self._cleared())

    def event(self, event: Event | None) -> None:
        """Take note of an event, show the line of a job that has ended, and the block anew unless it is fresh."""
        line = None if event is None else self._note(event)
        if line is not None:
            log(line)
            self._write(f"{self._cleared()}{line}\n")
        elif event is not None and event.iteration is None and (asked(VERBOSE) or asked(LOG)):
            self._write(self._cleared())
            remark(self._line(event.index, self.running[event.index]).strip())
        step = event is not None and event.iteration is None  # begun, read or ended: once for each job
        if self.live and (step or time.monotonic() - self.drawn > _FRESH):
            self._draw()

    def _cleared(self) -> str:
        """Return what takes the block away."""
        height, self.height = self.height, 0
        return f"\x1b[{height}A\x1b[J" if height else ""

    def _note(self, event: Event) -> str | None:
        """Return the line of a job that has ended."""
        if event.outcome is not None:
            self.running.pop(event.index, None)
            self.ended += 1
            self.kept += event.outcome.kept
            self.bad += not event.outcome.state.has_results
            return _ended_line(self.jobs[event.index], event.outcome, self.ended, len(self.jobs))
        job = self.running.setdefault(event.index, _Running())
        if event.photos is not None:
            job.photos, job.points, job.doing = event.photos, event.points, "adjusting"
        if event.iteration is not None:
            job.doing = f"pass {event.iteration[0]}, iteration {event.iteration[1]}"
        return None

    def _draw(self) -> None:
        """Write the block anew, with no more lines than the terminal has, and none longer than it is wide."""
        width, height = shutil.get_terminal_size()
        shown = list(self.running.items())[: max(0, min(_SHOWN, height - 3))]
        lines = [self._bar(), *(self._line(n, job) for n, job in shown)]
        self._write(self._cleared() + "".join(f"{line[: width - 1]}\n" for line in lines))
        self.height = len(lines)
        self.drawn = time.monotonic()

    def _bar(self) -> str:
        total, spent = len(self.jobs), time.monotonic() - self.start
        full = _BAR * self.ended // total
        done = self.ended - self.kept  # what was kept took no time
        left = spent / done * (total - self.ended) if done else 0.0
        rest = f", about {clock_text(left)} left" if done and self.ended < total else ""
        bad = f", {self.bad} without results" if self.bad else ""
        bar = f"[{'#' * full}{'.' * (_BAR - full)}]"
        return f"{bar} {self.ended} of {count_of(total, 'job')}{bad}, {clock_text(spent)}{rest}"

    def _line(self, n: int, job: _Running) -> str:
        photos, points = count_of(job.photos or 0, "photo"), count_of(job.points or 0, "point")
        sizes = "" if job.photos is None else f"{photos}, {points}, "
        return f"  {name_of(self.jobs[n].deck)}: {sizes}{job.doing}, {clock_text(time.monotonic() - job.since)}"


def _ended_line(job: BatchJob, outcome: JobOutcome, number: int, total: int) -> str:
    """Return what to say of a job that has ended."""
    parts = [f"{outcome.state}, kept from an earlier run" if outcome.kept else str(outcome.state)]
    if outcome.photos is not None:
        parts += [count_of(outcome.photos, "photo"), count_of(outcome.points or 0, "point")]
    if outcome.sigma0 is not None:
        parts.append(f"sigma0 {outcome.sigma0:.4f}")
    if not outcome.kept:
        parts.append(f"{outcome.seconds:.1f} s")
    why = f": {printable(outcome.reason)}" if outcome.reason else ""
    return f"[{number}/{total}] {name_of(job.deck)}: {', '.join(parts)}{why}"
