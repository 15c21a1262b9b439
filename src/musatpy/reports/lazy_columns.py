"""Columns of tables of the record that are worked out where they are looked at: most readers need a few of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from musatpy.reports.encoding import Json, plain, rounded


@dataclass(frozen=True, eq=False)
class LazyColumn(Sequence[Json]):
    """A column of a table, whose entries are those of the record."""

    of: Callable[[], Any]  # its values, an array or a list
    digits: int | None  # significant ones, as of `rounded`

    @cached_property
    def _values(self) -> Any:
        values = rounded(self.of(), self.digits)
        return values if isinstance(values, np.ndarray) else list(values)

    @property
    def array(self) -> NDArray[Any] | None:
        """The column as an array, whose numbers that do not exist are not finite; None where it is a list."""
        return self._values if isinstance(self._values, np.ndarray) else None

    def __len__(self) -> int:
        return len(self._values)

    def __iter__(self) -> Iterator[Json]:
        return iter(self[:])

    def __getitem__(self, rows: Any) -> Any:
        found = self._values[rows]
        if isinstance(found, np.ndarray):
            return plain(found)
        entry = found.item() if isinstance(found, np.generic) else found
        return None if isinstance(entry, float) and not math.isfinite(entry) else entry
