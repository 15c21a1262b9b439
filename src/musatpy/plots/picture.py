"""What a picture is: what it needs of a record, how it is drawn, and what it says in one sentence."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from musatpy.plots.tables import NothingToShowError, Tables

N = TypeVar("N")


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture(Generic[N]):
    """A picture of a record: its numbers, how these are drawn, and the sentence that says what is seen."""

    name: str  # ending of its file
    title: str
    needs: Mapping[str, Sequence[str]]  # table of the record -> fields of it
    numbers: Callable[[Tables], N]  # raises `NothingToShowError`
    figure: Callable[[N], Any]  # of matplotlib; raises `MusatError` where that is missing
    words: Callable[[N], str]

    def reason(self, tables: Tables) -> str:
        """Return why there is nothing to show of a record; empty where there is."""
        try:
            self._numbers(tables)
        except NothingToShowError as error:
            return str(error)
        return ""

    def draw(self, tables: Tables) -> Any | None:
        """Return the figure of matplotlib, None where there is nothing to show.

        Raises `MusatError` where matplotlib is missing.
        """
        try:
            content = self._numbers(tables)
        except NothingToShowError:
            return None
        return self.figure(content)

    def drawn(self, tables: Tables) -> tuple[Any, str] | None:
        """Return figure and sentence of one look at the numbers, None where there is nothing to show.

        Raises `MusatError` where matplotlib is missing.
        """
        try:
            content = self._numbers(tables)
        except NothingToShowError:
            return None
        return self.figure(content), self.words(content)

    def sentence(self, tables: Tables) -> str:
        """Return what the picture says, in numbers: also its alternative text. Of none, the reason."""
        try:
            return self.words(self._numbers(tables))
        except NothingToShowError as error:
            return str(error)

    def _numbers(self, tables: Tables) -> N:
        for table in self.needs:
            if table not in tables:
                raise NothingToShowError(f"the record has no table {table}")
        return self.numbers(tables)
