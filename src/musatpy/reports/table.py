"""Printed tables, stated as data: columns side by side, and reports of tables of the record."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Generic, Literal, TypeVar

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.model.tables import falling
from musatpy.reports.editing import edited, field_width, prints_as_zero, with_unit
from musatpy.reports.fields import Each, Field, FieldGroup, Rows, unrecorded
from musatpy.reports.pages import PAGE_WIDTH, Cells, Section, wrapped
from musatpy.reports.values import Values, array_of, at, in_rows, nothing, unnested

Source = TypeVar("Source")
Layout = Literal["rows", "across", "xyz", "texts"]

_GAP = "  "  # between columns
_FINE = 0.0005  # m
_ROWS = 20_000  # that are edited at a time


@dataclass(frozen=True, eq=False)
class Table(Generic[Source]):
    """Columns side by side, two blanks apart."""

    columns: tuple[Any, ...]  # fields with one heading each

    def head(self) -> tuple[str, ...]:
        """Return the heading lines, and a rule below them; text headings stand left, those of numbers right."""
        height = max(len(column.heading.split("\n")) for column in self.columns)
        rows: list[list[str]] = [[] for _ in range(height)]
        for column in self.columns:
            lines = column.heading.split("\n")
            for row, line in zip(rows, [""] * (height - len(lines)) + lines, strict=True):
                left = column.edit.startswith("A")
                row.append(line.ljust(column.width) if left else line.rjust(column.width))
        rule = _GAP.join("-" * column.width for column in self.columns)
        return (*(_join(row) for row in rows), rule)

    def lines(self, source: Source) -> list[str]:
        """Return one printed line per row of `source`."""
        columns = [column.printed(source) for column in self.columns]
        lines: list[str] = []
        for start in range(0, len(columns[0]), _ROWS):
            chunk = [values[start : start + _ROWS] for values in columns]
            texts = [_texts(*pair) for pair in zip(self.columns, chunk, strict=True)]
            lines += [_join(row) for row in zip(*texts, strict=True)]
        return lines

    def text(self, source: Any = None) -> list[str]:
        """Return the heading lines, and below them those of the rows."""
        return [*self.head(), *self.lines(source)]


@dataclass(frozen=True, eq=False)
class Report(Generic[Source]):
    """A printed table, and the table of the record that it shows."""

    title: str
    table: Rows[Source, Any] | Each[Source, Any] | FieldGroup[Source, Any] | None = None
    columns: str | Sequence[Any] = ()  # names of the table, fields; empty: all fields of the table that are printed
    path: str = ""  # of the table in the record, where that is not its own
    pattern: str = ""  # a regular expression for the title where that is not always the same
    which: Callable[[Values], IntArray] | None = None  # rows that are printed, in their order; None: all
    worst: Callable[[Values], FloatArray] | None = None  # how bad these are
    layout: Layout = "rows"
    nested: str = ""
    expand: Sequence[str] = ()
    some: bool = False

    @property
    def place(self) -> str:
        """The path of the table in the record, empty where that has nothing of it."""
        return self.path or (self.table.place if self.table else "")

    def values(self, source: Any) -> Values:
        """Return the rows that are printed, computed from a source, or as they are."""
        if isinstance(source, Values):
            return source
        table = self.table
        if table is None:  # columns of what no record has
            return Values([], lambda name: None, _system_of(source), source)
        found = self._values_of(table.raw(source, self.nested), _system_of(source), source)
        return found if self.which is None else found.taken(self.which(found))

    def read(self, content: Mapping[str, Any], system: str) -> Values:
        """Return the rows that are printed of a record."""
        table = _columns_at(content, self.place, is_object=isinstance(self.table, FieldGroup))
        if self.nested:
            inside = [_columns_at(row, "", is_object=False) for row in table.get(self.nested, ())]
            table = unnested(table, inside, self.nested)
        found = self._values_of(table, system, None)
        return found if self.which is None or self.some or not found else found.taken(self.which(found))

    def _values_of(self, table: Mapping[str, Any], system: str, source: Any) -> Values:
        assert self.table is not None
        parts = [node for node in self.table.fields if node.name == self.nested]
        nodes = [*self.table.fields, *(field for part in parts for field in getattr(part, "fields", ()))]
        kinds = {node.name: node.kind for node in nodes if isinstance(node, Field)}
        kinds |= {name: _of_entries(kinds[name]) for name in self.expand}
        rows = in_rows(table, self.expand)
        count = len(next(iter(rows.values()), ()))

        def column(name: str) -> Any:
            return array_of(kinds[name], rows[name]) if name in rows else nothing(kinds[name], count)

        return Values([*kinds] if rows else [], column, system, source)

    def stated(self, values: Values | None = None) -> list[Field[Any]]:
        """Return its columns, those that a table has where its values are given, and all that there may be."""
        parts = [self.columns] if isinstance(self.columns, str) else self.columns
        parts = [name for part in parts for name in (part.split() if isinstance(part, str) else [part])]
        printed = self.table.printed if self.table else ()
        found = [self.column(part) if isinstance(part, str) else part for part in parts or printed]
        is_read = values is None or values.source is None
        found = [column for column in found if not (is_read and column.of_run)]
        return [column for column in found if values is None or column.when is None or column.when(values)]

    def column(self, path: str) -> Field[Any]:
        """Return a column of its table, or of that which is nested in it."""
        assert self.table is not None
        inner: Any = next((node for node in self.table.fields if node.name == self.nested), self.table)
        try:
            found: Field[Any] = inner.column(path)
        except KeyError:
            found = self.table.column(path)
        return found

    def side_by_side(self, values: Values) -> tuple[Field[Any], ...]:
        """Return what is printed side by side."""
        columns = [part for column in self.stated(values) for part in column.columns(values.system)]
        if any(_is_fine(column, values) for column in columns):
            columns = [_in_micrometres(column) for column in columns]
        width = sum(column.width + len(_GAP) for column in columns) - len(_GAP)
        for n, column in enumerate(columns):
            columns[n] = column.fitted(values, PAGE_WIDTH - width)
            width += columns[n].width - column.width
        return tuple(columns)

    def section(self, source: Source | Values, below: str | Sequence[str] = (), **layout: Any) -> Section:
        """Return the printed section, with a note or lines `below` the rows; `layout` is that of `Section`."""
        values = self.values(source)
        below = ["", *wrapped([below])] if below and isinstance(below, str) else below
        printed: Any = Table(self.side_by_side(values))
        stated: dict[str, Any] = {
            "title": self.title,
            "head": printed.head(),
            "lines": [*printed.lines(values), *below],
            "values": lambda: self.cells(values),
        }
        if self.worst:
            stated["worst"] = worst_first(self.worst(values)).tolist()
        return Section(**stated | layout)

    def cells(self, source: Source | Values) -> Cells:
        """Return heads with units, and the rows, ids first: numbers as the record has them, in its units."""
        values = self.values(source)
        columns = sorted(self.side_by_side(values), key=lambda column: not column.is_id)
        exact = [_plain(column.exactly(values)) for column in columns]
        return [[with_unit(str(column.heading)) for column in columns], *map(list, zip(*exact, strict=True))]


def _plain(values: Any) -> list[Any]:
    plain = values.tolist() if isinstance(values, np.ndarray) else list(values)
    return [" ".join(value.split()) if isinstance(value, str) else value for value in plain]


def _system_of(source: Any) -> str:
    """Return the coordinate system of the job of a source, empty where it has none."""
    if getattr(getattr(source, "scene", None), "in_model", False):
        return "MODEL"
    block = getattr(source, "block", None) or getattr(getattr(source, "run", None), "block", None)
    return str(block.options.system) if block else ""


def _is_fine(column: Field[Any], values: Values) -> bool:
    """Tell whether a column has sigmas of lengths most of which would print as zero."""
    heading = str(column.heading)
    if not (heading.startswith("Sigma") and heading.endswith("\nm")):
        return False
    return is_fine(np.asarray(column.exactly(values), dtype=float))


def is_fine(sigma: FloatArray) -> bool:
    """Tell whether most sigmas of lengths (n,) m are too small for three decimals."""
    sigma = sigma[sigma > 0.0]
    return bool(sigma.size) and bool(np.median(sigma) < _FINE)


def _in_micrometres(column: Field[Any]) -> Field[Any]:
    """Return a column of lengths with six decimals in its width, any other as it is."""
    lengths = str(column.heading).endswith("\nm") and str(column.edit).endswith((".3", ".4"))
    return replace(column, edit=f"{str(column.edit)[:-1]}6") if lengths else column


def _texts(column: Field[Any], values: Any) -> list[str]:
    """Return what a column prints, as wide as that."""
    edit, width = str(column.edit), column.width
    texts = edited(edit, values)
    if field_width(edit) == width:
        return texts
    return [text.ljust(width) if edit.startswith("A") else text.rjust(width) for text in texts]


def _of_entries(kind: str) -> str:
    """Return the kind of the entries of a list: of `3x2 number` `2 number`."""
    sizes, _, base = kind.rpartition(" ")
    return f"{sizes.partition('x')[2]} {base}".strip()


def sheet(*columns: tuple[str | Sequence[str], str, Any]) -> Table[Any]:
    """Return a table of what no record has: heading (of a vector headings), descriptor, values of each column."""
    found: list[Field[Any]] = []
    for heading, edit, values in columns:
        if isinstance(heading, str):
            found.append(unrecorded(heading, edit, partial(_given, values)))
        else:
            found += [unrecorded(name, edit, partial(_given, values[:, n])) for n, name in enumerate(heading)]
    return Table(tuple(found))


def _given(values: Any, source: Any) -> Any:
    return values


def filled(reports: Iterable[Report[Any]], source: Any) -> list[Section]:
    """Return the sections of those reports of a source that have rows."""
    return [section for report in reports if (section := report.section(source)).lines]


def unless_zero(names: Sequence[str], edit: str, numbers: Any) -> list[str]:
    """Return names, blank where the number beside them prints as zero: whose it is, is then rounding error."""
    return ["" if prints_as_zero(edit, number) else name for name, number in zip(names, numbers, strict=True)]


def _columns_at(content: Any, path: str, *, is_object: bool) -> Mapping[str, Any]:
    """Return the columns of a table of a record, of an object one row; none where the record has none of it."""
    table = at(content, path)
    if isinstance(table, list) and table and isinstance(table[0], Mapping):
        return {name: [row.get(name) for row in table] for name in table[0]}
    if not isinstance(table, Mapping):
        return {}
    return {name: [value] for name, value in table.items()} if is_object else table


def _join(cells: Iterable[str]) -> str:
    return _GAP.join(cells).rstrip()


def worst_first(badness: FloatArray, decimals: int | None = None, *, lines: int = 1) -> IntArray:
    """Return the rows (n * lines,) by falling badness (n,), as it is printed (`falling`), where there is none last.

    Each row may have several `lines`.
    """
    return (falling(badness, decimals)[:, None] * lines + np.arange(lines)).reshape(-1)


Content = Mapping[str, Any]  # of a record


@dataclass(frozen=True)
class Labels:
    """Lines of a label and one or more numbers."""

    title: str
    numbers: Callable[
        [Content], Mapping[str, Sequence[float | None]]
    ]  # in printed units; None: the record has none


@dataclass(frozen=True)
class Texts:
    """Sentences, however their lines are broken."""

    title: str
    texts: Callable[[Content], Iterable[str]]
    table: str  # without which a record has none of them


def numbers_at(content: Content, *paths: str, unit: float = 1.0) -> list[float | None]:
    """Return the numbers at some paths of a record, in units of one that is `unit` in units of the record."""
    values = [at(content, path) for path in paths]
    is_number = [isinstance(value, int | float) and not isinstance(value, bool) for value in values]
    return [value / unit if known else None for value, known in zip(values, is_number, strict=True)]


def count_at(content: Content, path: str, flag: str = "") -> int:
    """Return how many rows a table of a record has, or a list entries; with a flag those of which it is true."""
    table = at(content, path)
    if isinstance(table, list) and flag:
        return sum(bool(row.get(flag)) for row in table if isinstance(row, Mapping))
    if isinstance(table, Mapping):
        column = table.get(flag) if flag else next(iter(table.values()), ())
        return sum(map(bool, column or ())) if flag else len(column or ())
    return len(table) if isinstance(table, list) else 0


def sentences_at(content: Content, *paths: str) -> Iterable[str]:
    """Yield the texts of lists of a record, or what `text` is in each row of a table."""
    for path in paths:
        entries = at(content, path)
        if isinstance(entries, Mapping):
            entries = entries.get("text")
        for entry in entries if isinstance(entries, list) else ():
            yield str(entry.get("text", "") if isinstance(entry, Mapping) else entry)
