"""Printed tables, stated as data: columns (heading, edit descriptor, what of the record they show), and reports."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate, chain
from typing import Any, Generic, Literal, TypeVar

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.model.tables import falling
from musatpy.reports.characters import blank, strings
from musatpy.reports.editing import MANY, characters, edited, field_width, prints_as_zero
from musatpy.reports.fields import Each, Field, Group, Rows
from musatpy.reports.headings import PRINTED, SEXAGESIMAL, with_unit
from musatpy.reports.origin import Origin
from musatpy.reports.pages import PAGE_WIDTH, Cells, Section
from musatpy.reports.values import Values, array_of, at, in_rows, nothing, unnested

Source = TypeVar("Source")
Layout = Literal["rows", "across", "xyz", "texts"]

_GAP = "  "  # between columns
_ROWS = 20_000  # that are edited at a time
_RECORDED = {"um": "mm", "arc sec": "rad", "degrees": "rad"}
_UNITS = frozenset({*_RECORDED.values(), "m", "s", "m/s", "unit", "mm/unit", "deg", "gon", "sigmas"})


@dataclass(frozen=True, eq=False)
class Column(Generic[Source]):
    """One column: `values` takes its values out of the source of the table, one per row.

    Without `values` they are those of the record that the column shows, in the unit of its heading.
    """

    heading: str  # one or two lines, parted by a line feed
    edit: str  # edit descriptor (see `musatpy.reports.editing`)
    values: Callable[[Source], Iterable[Any]] | None = None
    shows: Origin | str = ""  # of the record: a field, or more than that; nothing that the record has
    is_id: bool = False  # names what the row is about

    @cached_property
    def origin(self) -> Origin | None:
        """What of the record it shows, None where that has nothing of it."""
        return Origin(field=self.shows) if isinstance(self.shows, str) and self.shows else self.shows or None

    @cached_property
    def width(self) -> int:
        """Columns of print: as many as the descriptor or the longer heading line needs."""
        return max(field_width(self.edit), *(len(line) for line in self.heading.split("\n")))

    @property
    def unit(self) -> float:
        """What one of its printed unit is in units of the record."""
        return PRINTED.get(self.heading.split("\n")[-1], 1.0)

    @property
    def named(self) -> tuple[str, str]:
        """Its heading in one line, and the unit that its numbers are printed in: `East`, `m`; empty without one."""
        *words, last = self.heading.split("\n")
        name, _, inside = last.rpartition(" ")
        if words and last.startswith(SEXAGESIMAL):
            return " ".join(words).strip(), SEXAGESIMAL
        if words and _RECORDED.get(last, last) in _UNITS:
            return " ".join(words).strip(), last
        if self.unit != 1.0 and inside in _RECORDED:  # `RMS x um`
            return " ".join([*words, name]).strip(), inside
        return " ".join((*words, last)).strip(), ""

    @property
    def head(self) -> str:
        """Its heading in one line, with the unit of the record in brackets: `East (m)`."""
        words, unit = self.named
        unit = "rad" if unit == SEXAGESIMAL else _RECORDED.get(unit, unit)
        return f"{words} ({unit})" if unit else words


def key(
    heading: str, edit: str, shows: str, values: Callable[[Source], Iterable[Any]] | None = None
) -> Column[Source]:
    """Return a column that names what the row is about."""
    return Column(heading, edit, values, shows, is_id=True)


@dataclass(frozen=True, eq=False)
class Choice(Generic[Source]):
    """Columns that depend on the job: all that there may be, and those of a job."""

    variants: Sequence[tuple[Any, ...]]
    of: Callable[[Source], tuple[Any, ...]]
    second_in: tuple[str, ...] = ()  # coordinate systems in which the second variant stands, not the first


@dataclass(frozen=True, eq=False)
class Table(Generic[Source]):
    """Columns side by side, two blanks apart."""

    columns: tuple[Any, ...]  # of `Column` or `Field`

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
        columns = [self._values(column, source) for column in self.columns]
        count = len(columns[0])
        if count < MANY:
            texts = [self._texts(*pair) for pair in zip(self.columns, columns, strict=True)]
            return [_join(row) for row in zip(*texts, strict=True)]
        chunks = (slice(start, start + _ROWS) for start in range(0, count, _ROWS))
        return list(chain.from_iterable(self._lines([values[rows] for values in columns]) for rows in chunks))

    def text(self, source: Source) -> list[str]:
        """Return the heading lines, and below them those of the rows."""
        return [*self.head(), *self.lines(source)]

    def _lines(self, columns: Sequence[Any]) -> list[str]:
        """Return one printed line per row of columns of values."""
        ends = list(accumulate(column.width + len(_GAP) for column in self.columns))
        table = blank(len(columns[0]), ends[-1])
        for column, values, end in zip(self.columns, columns, ends, strict=True):
            if len(values) != len(table):
                raise ValueError(f"the column {column.heading} has {len(values)} values, the first {len(table)}")
            printed = characters(column.edit, values)
            start = end - len(_GAP) - (column.width if column.edit.startswith("A") else printed.shape[1])
            table[:, start : start + printed.shape[1]] = printed
        return [line.rstrip() for line in strings(table)]

    @staticmethod
    def _values(column: Column[Source] | Field[Any], source: Any) -> Any:
        if isinstance(column, Field):
            return column.printed(source)
        if column.values is None:
            raise ValueError(f"the column {column.heading} has no values without its report")
        values = column.values(source)
        return values if isinstance(values, np.ndarray) else list(values)

    @staticmethod
    def _texts(column: Column[Source], values: Any) -> list[str]:
        texts = edited(column.edit, values)
        if field_width(column.edit) == column.width:
            return texts
        if column.edit.startswith("A"):
            return [text.ljust(column.width) for text in texts]
        return [text.rjust(column.width) for text in texts]


@dataclass(frozen=True, kw_only=True, eq=False)
class Report(Generic[Source]):
    """A printed table, and the table of the record that it shows."""

    title: str
    columns: Sequence[Any]  # a name of the table, a field, or what there is to choose of
    table: Rows[Source, Any] | Each[Source, Any] | Group[Source, Any] | None = None
    path: str = ""  # of the table in the record, where that is not its name
    rows: Callable[[Source], IntArray] | None = None  # of the table that are printed; None: all
    pattern: str = ""  # a regular expression for the title where that is not always the same
    which: Callable[[Values], IntArray] | None = None  # rows that are printed, in their order; None: all
    worst: Callable[[Values], FloatArray] | None = None  # how bad these are
    layout: Layout = "rows"
    nested: str = ""
    expand: Sequence[str] = ()
    words: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    some: bool = False

    @property
    def place(self) -> str:
        """The path of the table in the record, empty where that has nothing of it."""
        return self.path or (self.table.name if self.table else "")

    @property
    def is_new(self) -> bool:
        return any(isinstance(part, str | Field) for part in self.columns)

    def values(self, source: Any) -> Values:
        """Return the rows that are printed, computed from a source."""
        table = self.table
        if table is None:  # columns of what no record has
            return Values([], lambda name: None, _system_of(source), source)
        if isinstance(table, Rows) and not self.expand:
            item, fields = table.of(source), {field.name: field for field in table.fields}
            found = Values(
                list(fields),
                lambda name: array_of(fields[name].kind, [] if item is None else fields[name].of(item)),
                _system_of(source),
                source,
            )
        else:
            found = self._values_of(table.raw(source, self.nested), _system_of(source), source)
        return found if self.which is None else found.taken(self.which(found))

    def read(self, content: Mapping[str, Any], system: str) -> Values:
        """Return the rows that are printed of a record."""
        table = _columns_at(content, self.place, is_object=isinstance(self.table, Group))
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
        found: list[Field[Any]] = []
        for part in self.columns:
            if isinstance(part, Choice):
                found += part.of(values.source) if values and values.source else part.variants[0]
            else:
                found.append(self.column(part) if isinstance(part, str) else part)
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
        width = sum(column.width + len(_GAP) for column in columns) - len(_GAP)
        for n, column in enumerate(columns):
            columns[n] = column.fitted(values, PAGE_WIDTH - width)
            width += columns[n].width - column.width
        return tuple(columns)

    def layouts(self) -> list[tuple[Column[Source], ...]]:
        """Return the columns as they may stand in jobs of any kind."""
        most = max((len(part.variants) if isinstance(part, Choice) else 1 for part in self.columns), default=0)
        return [self._variant(number) for number in range(most)]

    def printed(self, source: Source) -> Table[Source]:
        """Return the table as it is printed of a job."""
        return Table(tuple(self._bound(column) for column in self._chosen(lambda choice: choice.of(source))))

    def section(self, source: Source, below: Sequence[str] = (), **layout: Any) -> Section:
        """Return the printed section, with lines `below` the rows; `layout` is that of `Section`."""
        if self.is_new:
            return self.section_of(self.values(source), below, **layout)
        table = self.printed(source)
        stated: dict[str, Any] = {
            "title": self.title,
            "head": table.head(),
            "lines": [*table.lines(source), *below],
            "values": lambda: self.cells(source),
        }
        return Section(**stated | layout)

    def section_of(self, values: Values, below: Sequence[str] = (), **layout: Any) -> Section:
        """Return the printed section of rows, as `section` does."""
        sheet: Any = Table(self.side_by_side(values))
        stated: dict[str, Any] = {
            "title": self.title,
            "head": sheet.head(),
            "lines": [*sheet.lines(values), *below],
            "values": lambda: self.cells_of(values),
        }
        if self.worst:
            stated["worst"] = worst_first(self.worst(values)).tolist()
        return Section(**stated | layout)

    def cells_of(self, values: Values) -> Cells:
        """Return heads with units, and the rows, ids first: numbers as the record has them, in its units."""
        columns = sorted(self.side_by_side(values), key=lambda column: not column.is_id)
        exact = [_plain(column.exactly(values)) for column in columns]
        return [[with_unit(str(column.heading)) for column in columns], *map(list, zip(*exact, strict=True))]

    def cells(self, source: Source) -> Cells:
        """Return heads with units, and the rows, ids first: numbers as the record has them, in its units."""
        if self.is_new:
            return self.cells_of(self.values(source))
        columns = sorted(self._chosen(lambda choice: choice.of(source)), key=lambda column: not column.is_id)
        values = [self._exact(column, source) for column in columns]
        heads = [with_unit(str(column.heading)) if isinstance(column, Field) else column.head for column in columns]
        return [heads, *map(list, zip(*values, strict=True))]

    def _exact(self, column: Column[Source], source: Source) -> list[Any]:
        """Return what a column shows, in units of the record."""
        if isinstance(column, Field):
            return _plain(column.exactly(source))
        values = self._recorded(column, source) if column.values is None else column.values(source)
        if column.values is not None and column.unit != 1.0:
            values = np.asarray(values, dtype=float) * column.unit
        plain = values.tolist() if isinstance(values, np.ndarray) else list(values)
        return [" ".join(value.split()) if isinstance(value, str) else value for value in plain]

    def _variant(self, number: int) -> tuple[Column[Source], ...]:
        return self._chosen(lambda choice: choice.variants[min(number, len(choice.variants) - 1)])

    def _chosen(self, of: Callable[[Choice[Source]], tuple[Column[Source], ...]]) -> tuple[Column[Source], ...]:
        parts = (of(part) if isinstance(part, Choice) else (part,) for part in self.columns)
        return tuple(column for part in parts for column in part)

    def _bound(self, column: Column[Source]) -> Column[Source]:
        if isinstance(column, Field) or column.values:
            return column
        return replace(column, values=lambda source: self._values(column, source))

    def _values(self, column: Column[Source], source: Source) -> Any:
        """Return what a column shows of the record, in its printed unit."""
        values = self._recorded(column, source)
        return values if column.unit == 1.0 else np.asarray(values, dtype=float) / column.unit

    def _recorded(self, column: Column[Source], source: Source) -> Any:
        """Return what a column shows of the record."""
        origin = column.origin
        if origin is None or self.table is None:
            raise ValueError(f"the column {column.heading} has neither values nor a field of the record")
        values = self._listed(origin.field, source)
        if origin.true or origin.false:
            return np.where(values, origin.true, origin.false)
        if words := self.words.get(origin.field):
            return [words.get(str(value), value) for value in values]
        return ["" if value is None else value for value in values] if isinstance(values, list) else values

    def _listed(self, path: str, source: Source) -> Any:
        """Return the values of a field of the record in the rows that are printed."""
        table: Any = self.table
        values: Any = table.of_path(path, source)
        if self.rows is None:
            return values
        rows = self.rows(source)
        return values[rows] if isinstance(values, np.ndarray) else [values[row] for row in rows.tolist()]


def _plain(values: Any) -> list[Any]:
    plain = values.tolist() if isinstance(values, np.ndarray) else list(values)
    return [" ".join(value.split()) if isinstance(value, str) else value for value in plain]


def _system_of(source: Any) -> str:
    """Return the coordinate system of the job of a source, empty where it has none."""
    if getattr(getattr(source, "scene", None), "in_model", False):
        return "MODEL"
    block = getattr(source, "block", None) or getattr(getattr(source, "run", None), "block", None)
    return str(block.options.system) if block else ""


def _of_entries(kind: str) -> str:
    """Return the kind of the entries of a list: of `3x2 number` `2 number`."""
    sizes, _, base = kind.rpartition(" ")
    return f"{sizes.partition('x')[2]} {base}".strip()


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
