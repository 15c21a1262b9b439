"""How far a run is: a line at the foot of a terminal, never older than a second."""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from musatpy.model import Block, Iteration, Options
    from musatpy.model.progress import Phase

_PATIENCE = 0.5  # seconds before a run counts as long
_REDRAWN = 0.5  # seconds after which the line is written anew, with the time at least
_LEAST_NAME = 12  # characters
_FRESH = 0.1  # seconds in which it is not, whatever happens


class LiveLine:
    """A watcher of a run that says on the terminal where it is: phase, what is left as far as known, and the time.

    A thread keeps the time going while the run is too busy to tell anything. It ends with the `with` block.
    """

    def __init__(self, name: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._name, self._clock = name, clock
        self._start, self._drawn = clock(), -1.0e9
        self._doing = "reading"
        self._options: Options | None = None
        self._width = 0
        self._deaf = False  # nobody reads stderr any more
        self._lock, self._end = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._keep_time, name="musat live line", daemon=True)

    def __enter__(self) -> LiveLine:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end.set()
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
        moved = f"{iteration.rotation / ARC_SECOND:.3f} arc seconds, {iteration.translation:.4f} m"
        if options is None:
            self._tell(f"pass {iteration.outer_pass}, iteration {iteration.number}, largest movement {moved}")
            return
        limits = f"limits {options.rotation_limit / ARC_SECOND:g}, {options.translation_limit:g}"
        number = f"iteration {iteration.number} of {options.max_iterations}"
        self._tell(f"pass {iteration.outer_pass}, {number}, largest movement {moved} ({limits})")

    def phase(self, phase: Phase) -> None:
        """Show a phase that begins."""
        self._tell(f"{phase.name} {phase.number} of {phase.total}" if phase.total else phase.name)

    def _tell(self, doing: str) -> None:
        self._doing = doing
        if self._clock() - self._drawn >= _FRESH:
            self.draw()

    def draw(self) -> None:
        """Write the line anew, once the run has lasted a while."""
        with self._lock:
            now = self._clock()
            if now - self._start < _PATIENCE or self._end.is_set():
                return
            spent = clock_text(now - self._start)
            room = shutil.get_terminal_size().columns - len(spent) - 3
            line = f"{_fitted(self._name, self._doing, room)}, {spent}"
            self._write(f"\r{line:<{self._width}}")
            self._width, self._drawn = len(line), now

    def _keep_time(self) -> None:
        while not self._end.wait(_REDRAWN):
            self.draw()

    def _write(self, text: str) -> None:
        """Write to stderr; a terminal that has gone away does not end a run."""
        if self._deaf:
            return
        try:
            click.echo(text, nl=False, err=True)
        except (OSError, ValueError):
            self._deaf = True


def _fitted(name: str, doing: str, room: int) -> str:
    """Return what a job does in so many characters: folders of its name go first."""
    left = max(room - len(doing) - 2, _LEAST_NAME)
    shown = name if len(name) <= left else f"...{name[3 - left :]}"
    return f"{shown}: {doing}"[:room]


def clock_text(seconds: float) -> str:
    """Return minutes and seconds, and hours where there are any."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
