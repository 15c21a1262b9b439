"""How far a run is, for whoever watches it: a callback of iterations, and of phases where it listens to them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from musatpy.model.solution import Iteration

Progress = Callable[[Iteration], None]


@dataclass(frozen=True, kw_only=True)
class Phase:
    """What a run does now: the step `number` of `total`, of at most so many; 0 where nobody counts."""

    name: str
    number: int = 0
    total: int = 0


class Watcher(Protocol):
    """A callback of iterations that is told of phases too."""

    def __call__(self, iteration: Iteration) -> None:
        """Take note of an iteration that has ended."""
        ...

    def phase(self, phase: Phase) -> None:
        """Take note of a phase that begins."""
        ...


def begin(progress: Progress | None, name: str, number: int = 0, total: int = 0) -> None:
    """Tell whoever watches that a phase begins."""
    if (phase := getattr(progress, "phase", None)) is not None:  # which a `Watcher` has
        phase(Phase(name=name, number=number, total=total))
