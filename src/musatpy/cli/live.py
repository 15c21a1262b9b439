"""How far a batch is: a block of lines at the foot of a terminal, or a line for each job that ends."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import click

from musatpy.campaign.batch import Event, Watch
from musatpy.campaign.batch_jobs import Job, Outcome
from musatpy.cli.live_line import clock_text
from musatpy.cli.messages import count_of, name_of, on_terminal
from musatpy.errors import printable

_BAR = 24  # characters
_SHOWN = 12  # jobs at work that are shown
_REDRAWN = 0.1  # seconds, at the earliest, where no job has gone a step further


@dataclass
class _Running:
    """A job at work."""

    since: float = field(default_factory=time.monotonic)
    photos: int | None = None
    points: int | None = None
    doing: str = "reading"


class Display(Watch):
    """Shows events of a batch on stderr; the live block only where that is a terminal."""

    def __init__(self) -> None:
        self.jobs: Sequence[Job] = ()
        self.live = on_terminal()
        self.deaf = False  # nobody reads stderr any more
        self.start = time.monotonic()
        self.running: dict[int, _Running] = {}
        self.ended = self.kept = self.bad = 0
        self.height = 0
        self.drawn = 0.0

    def begin(self, jobs: Sequence[Job]) -> None:
        """Take the jobs, and start the clock."""
        self.jobs = jobs
        self.start = time.monotonic()

    def end(self) -> None:
        """Take the block away."""
        self._say(self._clear)

    def event(self, event: Event | None) -> None:
        """Take note of an event, and show it."""
        line = None if event is None else self._note(event)
        step = event is not None and event.iteration is None  # begun, read or ended: once for each job
        self._say(lambda: self._show(line, at_once=step))

    def _say(self, write: Callable[[], None]) -> None:
        """Write to stderr; a terminal or a pipe that has gone away does not end a batch."""
        if self.deaf:
            return
        try:
            write()
        except OSError:
            self.deaf = True

    def _show(self, line: str | None, *, at_once: bool) -> None:
        """Write the line of a job that has ended, if one has, and the block below it, unless it is fresh."""
        if line is not None:
            self._clear()
            click.echo(line, err=True)
        if self.live and (at_once or time.monotonic() - self.drawn > _REDRAWN):
            self._draw()

    def _clear(self) -> None:
        """Take the block away."""
        if self.height:
            click.echo(f"\x1b[{self.height}A\x1b[J", nl=False, err=True)
            self.height = 0

    def _note(self, event: Event) -> str | None:
        """Return the line of a job that has ended."""
        if event.outcome is not None:
            self.running.pop(event.index, None)
            self.ended += 1
            self.kept += event.outcome.kept
            self.bad += not event.outcome.state.has_results
            return ended_line(self.jobs[event.index], event.outcome, self.ended, len(self.jobs))
        job = self.running.setdefault(event.index, _Running())
        if event.photos is not None:
            job.photos, job.points, job.doing = event.photos, event.points, "adjusting"
        if event.iteration is not None:
            job.doing = f"pass {event.iteration[0]}, iteration {event.iteration[1]}"
        return None

    def _draw(self) -> None:
        """Write the block anew, with no more lines than the terminal has, and none longer than it is wide."""
        width, height = shutil.get_terminal_size()
        width, shown = width - 1, max(0, min(_SHOWN, height - 3))
        lines = [self._bar(), *(self._line(n, job) for n, job in list(self.running.items())[:shown])]
        self._clear()
        click.echo("".join(f"{line[:width]}\n" for line in lines), nl=False, err=True)
        self.height = len(lines)
        self.drawn = time.monotonic()

    def _bar(self) -> str:
        total = len(self.jobs)
        full = _BAR * self.ended // total
        spent = time.monotonic() - self.start
        done = self.ended - self.kept  # what was kept took no time
        rest = (
            f", about {clock_text(spent / done * (total - self.ended))} left" if done and self.ended < total else ""
        )
        bad = f", {self.bad} without results" if self.bad else ""
        bar = f"[{'#' * full}{'.' * (_BAR - full)}]"
        return f"{bar} {self.ended} of {count_of(total, 'job')}{bad}, {clock_text(spent)}{rest}"

    def _line(self, n: int, job: _Running) -> str:
        sizes = (
            "" if job.photos is None else f"{count_of(job.photos, 'photo')}, {count_of(job.points or 0, 'point')}, "
        )
        return f"  {name_of(self.jobs[n].deck)}: {sizes}{job.doing}, {clock_text(time.monotonic() - job.since)}"


def ended_line(job: Job, outcome: Outcome, number: int, total: int) -> str:
    """Return what to say of a job that has ended."""
    parts = [f"{outcome.state}, kept from an earlier run" if outcome.kept else str(outcome.state)]
    if outcome.photos is not None:
        parts += [count_of(outcome.photos, "photo"), count_of(outcome.points or 0, "point")]
    if outcome.sigma0 is not None:
        parts.append(f"sigma0 {outcome.sigma0:.4f}")
    if not outcome.kept:
        parts.append(f"{outcome.seconds:.1f} s")
    why = f": {printable(' '.join(outcome.message.split()))}" if outcome.message else ""
    return f"[{number}/{total}] {name_of(job.deck)}: {', '.join(parts)}{why}"
