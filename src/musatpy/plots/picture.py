"""What a picture is: what it needs of a record, how it is drawn, and what it says in one sentence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from musatpy.figures import lay_out, styled
from musatpy.records.tables import Tables, part

N = TypeVar("N")
_SMALLEST = 5e-5  # what does not print as zero


class NothingToShowError(Exception):
    """Why a record has nothing of what a picture shows."""


@dataclass(frozen=True, eq=False)
class Picture(Generic[N]):
    """A picture of a record: its numbers, how these are drawn, and the sentence that says what is seen."""

    name: str  # ending of its file
    title: str
    needs: Sequence[str]  # tables of the record
    numbers: Callable[[Tables], N]  # raises `NothingToShowError`
    figure: Callable[[N], Any]  # of matplotlib; raises `MusatError` where that is missing
    words: Callable[[N], str]

    def drawn(self, tables: Tables, job: str = "") -> tuple[Any, str] | None:
        """Return the figure, with the job in its title, and its sentence; None where there is nothing to show.

        `job` names one whose record has no title. Raises `MusatError` where matplotlib is missing.
        """
        try:
            content = self._numbers(tables)
        except NothingToShowError:
            return None
        titles = tables.get("titles") or part(tables, "job").get("titles") or [job]
        return self._figure(content, " ".join(titles[0].split())), self.words(content)

    def sentence(self, tables: Tables) -> str:
        """Return what the picture says, in numbers: also its alternative text. Of none, the reason."""
        try:
            return self.words(self._numbers(tables))
        except NothingToShowError as error:
            return str(error)

    @styled
    def _figure(self, content: N, job: str) -> Any:
        figure = self.figure(content)
        figure.suptitle(f"{figure.get_suptitle()}\n{job}".strip())
        lay_out(figure)
        return figure

    def _numbers(self, tables: Tables) -> N:
        for table in self.needs:
            if table not in tables:
                raise NothingToShowError(f"the record has no table {table}")
        return self.numbers(tables)


def counted(number: int, noun: str, many: str = "") -> str:
    """Return a number with its noun, in the plural where it needs it."""
    return f"{number:,} {noun}" if number == 1 else f"{number:,} {many or f'{noun}s'}"


def measure(value: float, unit: str) -> str:
    """Return a value to three figures and four decimals at most, with its unit."""
    if abs(value) < _SMALLEST:
        return f"0 {unit}".rstrip()
    digits = np.clip(2 - np.floor(np.log10(abs(value))), 0, 4) if np.isfinite(value) else 0
    return f"{value:z.{int(digits)}f} {unit}".rstrip()
