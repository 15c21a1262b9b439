"""The tables of blocks and solutions: frozen arrays, one row per entity, each column with its meaning.

A column is stated once, with its shape, its links and its letters on cards; whoever reads, writes, merges, orders
or renumbers tables loops over these statements. Rows in order of numbers: by falling ones they are as these are
printed, for rounding errors, which differ by kernels, order nothing.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from musatpy.arrays import BoolArray, FloatArray, IntArray

_KINDS: dict[str, type] = {"TextArray": str, "IntArray": int, "FloatArray": float, "BoolArray": bool}
_MEANING = "column"
Rows = TypeVar("Rows", bound="Table")
Codes = Mapping[str, Any]  # letter of a deck -> value; the first is that of a blank field
POSITION_UNIT = "rad, rad, m (GEOG) or m"  # of positions in the system of a job
_DIGITS = 6  # significant ones, of numbers that are not printed


@dataclass(frozen=True, kw_only=True)
class Column:
    """What a column of a table, or the only value of a part of a block, means."""

    components: tuple[int, ...] = ()  # of each row: (3,) of a position
    link: str = ""  # table of the block of whose rows it has the numbers
    identity: bool = False  # the names of the rows themselves, to which others link
    key: bool = False  # one of the columns by which a row is known, in files as on cards
    sort: bool = False  # orders rows of equal links
    unit: str = ""
    rows: str = ""  # columns of other rows than the table's first: which
    role: str = ""  # the cards that say it, where several kinds of cards share a table
    noun: str = ""  # what it is called where a file cannot hold it; empty: its name
    codes: Codes | None = None
    blank: Any = None  # what a table has that is made without the column; None: it must be given
    starts: str = ""  # cards of photos in whose place photos start by it
    used_by: str = ""  # column of another table, `antenna_positions.line`, that names the rows which matter


def per_row(*components: int, **meaning: Any) -> Any:
    """Return the dataclass field of a column: the sizes of a row, and what else `Column` says of it."""
    about = {_MEANING: Column(components=components, **meaning)}
    if meaning.get("blank") is None:
        return field(metadata=about)
    return field(default_factory=lambda: np.zeros(0), metadata=about)


def per_job(default: Any = dataclasses.MISSING, **meaning: Any) -> Any:
    """Return the dataclass field of a value that a block has only once."""
    return field(default=default, metadata={_MEANING: Column(**meaning)})


def columns(kind: Any) -> Mapping[str, Column]:
    """Return the columns of a table, or the values of another part of a block, by name."""
    return _columns(kind)


@lru_cache(maxsize=64)
def _columns(kind: Any) -> Mapping[str, Column]:
    return {column.name: column.metadata.get(_MEANING, Column()) for column in dataclasses.fields(kind)}


@lru_cache(maxsize=64)
def types_of(kind: Any) -> Mapping[str, type]:
    """Return the types of the values of a table by its columns: str, int, float or bool."""
    types = {column.name: str(column.type) for column in dataclasses.fields(kind)}
    return {name: _KINDS[annotation] for name, annotation in types.items() if annotation in _KINDS}


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """Columns (n,) or (n, k, ...), checked and frozen. Raises `ValueError` for wrong shapes.

    A row is called by its `row_noun`, if not by the name of the table; `about` is the table of observations that
    the table says more of, and without which it means nothing.
    """

    row_noun: ClassVar[str]
    about: ClassVar[str]

    def __init_subclass__(cls, noun: str = "", about: str = "") -> None:
        """Let every table say what it has: a dataclass would write a `__repr__` of its own, with all numbers."""
        cls.__repr__ = Table.__repr__  # type: ignore[method-assign]
        cls.row_noun, cls.about = noun, about

    def __repr__(self) -> str:
        """Return the name of the table with the number of its rows and its columns: `Points(22: ids, ...)`."""
        return f"{type(self).__name__}({self.count}: {', '.join(columns(type(self)))})"

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        kind: Any = type(self)
        types = types_of(kind)
        for name in types:
            about = columns(kind)[name]
            size = sizes.get(about.rows, -1)
            if about.blank is not None and np.size(getattr(self, name)) == 0:
                object.__setattr__(self, name, np.full((size, *about.components), about.blank))
            freeze(self, name, types[name], size, *about.components)
            sizes.setdefault(about.rows, len(getattr(self, name)))

    @property
    def count(self) -> int:
        """The number of rows."""
        return len(getattr(self, next(iter(columns(type(self))))))

    def links_to(self, table: str) -> dict[str, IntArray]:
        """Return the columns with links to a table."""
        return {name: getattr(self, name) for name, about in columns(type(self)).items() if about.link == table}

    def check_links(self, sizes: Mapping[str, int]) -> None:
        """Raise `ValueError` where a link points outside its table; `sizes` are the rows of the tables."""
        for name, about in columns(type(self)).items():
            links = getattr(self, name) if about.link else np.zeros(0)
            if links.size and not (0 <= links.min() and links.max() < sizes[about.link]):
                raise ValueError(f"{type(self).__name__}.{name} links outside 0..{sizes[about.link] - 1}")


class InCommon:
    """What one card says of all observations of a kind: the decks of a job agree in it."""


def no_rows(kind: type[Table]) -> dict[str, NDArray[Any]]:
    """Return the columns of a table without rows."""
    any_kind: Any = kind
    types = types_of(any_kind)
    return {name: np.zeros((0, *about.components), dtype=types[name]) for name, about in columns(kind).items()}


def empty(kind: type[Rows]) -> Rows:
    """Return a table without rows."""
    return kind(**no_rows(kind))


def taken(table: Rows, rows: IntArray | BoolArray) -> Rows:
    """Return some rows of a table whose columns all have one row per entity, in the order of `rows`."""
    return replace(table, **{name: getattr(table, name)[rows] for name in columns(type(table))})


def stacked(tables: Sequence[Rows]) -> Rows:
    """Return the rows of tables of one kind, one table below the other."""
    names = columns(type(tables[0]))
    return replace(
        tables[0], **{name: np.concatenate([getattr(table, name) for table in tables]) for name in names}
    )


def renumbered(table: Rows, numbers: Mapping[str, IntArray]) -> Rows:
    """Return a table with the links to some tables, by their names, numbered anew."""
    links = ((link, name, rows) for link in numbers for name, rows in table.links_to(link).items())
    return replace(table, **{name: numbers[link][rows] for link, name, rows in links})


def freeze(owner: object, name: str, dtype: DTypeLike, *shape: int) -> None:
    """Replace attribute `name` of the frozen dataclass `owner` by a read-only array of `dtype` and `shape`.

    A size of -1 stands for any. Raises `ValueError` naming the class, the attribute and both shapes.
    """
    array: NDArray[Any] = np.asarray(getattr(owner, name), dtype=dtype)
    if array.size == 0 and shape[0] in (0, -1):
        array = array.reshape([max(size, 0) for size in shape])
    fits = array.ndim == len(shape) and all(want in (-1, got) for want, got in zip(shape, array.shape, strict=True))
    if not fits:
        raise ValueError(f"{type(owner).__name__}.{name} has shape {array.shape}, not {shape}")
    if array.flags.writeable:
        array = array.view()
        array.flags.writeable = False
    object.__setattr__(owner, name, array)


def parts_of(values: NDArray[Any]) -> list[NDArray[Any]]:
    """Return the components of values (n,) or (n, k, ...), each (n,)."""
    return list(values.reshape(len(values), -1).T) if values.size else [values.reshape(-1)]


def order_of(numbers: IntArray) -> IntArray:
    """Return the order (k,) of whole numbers (k,), equal ones as they stand.

    They are sorted as one number with their rows, which is several times as fast as a stable `argsort`.
    """
    bits = len(numbers).bit_length()
    if len(numbers) and max(int(numbers.max()), -int(numbers.min())) >> (63 - bits):
        return np.argsort(numbers, kind="stable")  # there is no room for the rows
    key = (numbers << bits) | np.arange(len(numbers))
    key.sort()
    return key & ((1 << bits) - 1)


def finite_rows(rows: FloatArray) -> BoolArray:
    """Return which rows (n,) of three components (n, 3) are finite: their sum is, in a tenth of the time."""
    return np.isfinite(rows[:, 0] + rows[:, 1] + rows[:, 2])


def falling(size: ArrayLike, decimals: int | None = None) -> IntArray:
    """Return the rows (n,) by falling size (n,), equal ones in their own order, those without one (NaN) last.

    Equal are sizes that print alike in so many `decimals`; without these, in six significant digits.
    """
    given = np.nan_to_num(np.asarray(size, dtype=float), nan=-np.inf, posinf=np.inf, neginf=-np.inf)
    with np.errstate(over="ignore"):  # of runs that have lost their way
        rounded = _significant(given) if decimals is None else np.round(given, decimals)
    return np.lexsort((np.arange(len(given)), -rounded))


def largest(size: ArrayLike) -> int:
    """Return the row of the largest size (n,), the first of equal ones in six significant digits."""
    return int(falling(size)[0])


def _significant(size: FloatArray) -> FloatArray:
    """Return sizes rounded to six significant digits."""
    finite = np.isfinite(size) & (size != 0.0)
    place = np.floor(np.log10(np.abs(size), where=finite, out=np.zeros_like(size))) - (_DIGITS - 1)
    unit = 10.0**place
    return np.where(finite, np.round(size / unit) * unit, size)
