"""Tables of points, stations and lines as text: columns by all their names, and every fault by line and column.

Commas, semicolons, tabs, bars or blanks part values, whichever makes most of the wanted names, or else most
numbers; where commas do not, a number may have a decimal comma. A line of names comes first, in any order and
case; it may stand behind #, and some tables do without. Other lines that begin with # are comments.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, islice
from pathlib import Path

import numpy as np

from musatpy.arrays import DateArray, FloatArray
from musatpy.errors import Problem, ProblemsError, in_order
from musatpy.pointfiles.columns import ABOVE_ZERO, FileColumn, Wanted, number, numbers, parted

csv.field_size_limit(2**31 - 1)  # what is no number is told with its line, and not as an error of the package
ENCODING = {"encoding": "utf-8", "errors": "surrogateescape"}  # whatever the texts are, they come out as they were
CHUNK = 16384  # lines at a time
_MOST_PROBLEMS = 100  # of a file of any size: then the rest of it is not looked at
_OPEN = "a text in quotes does not end on its line"
_SEPARATORS = (",", ";", "\t", "|", "")  # the last: blanks


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How a file is laid out: its separator ('' for blanks), its names, and where the wanted columns stand."""

    source: str
    line: int | None  # of the names
    header: str  # the line of names as it stands, '' for none
    separator: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: Mapping[int, FileColumn]  # those of the wanted ones that are read, by their places

    def place(self, name: str) -> int:
        """Return where a wanted column stands."""
        return next(place for place, column in self.columns.items() if column.name == name)

    def header_with(self, added: Sequence[str]) -> str:
        """Return the line of names of the file with columns added, of a file without names too."""
        separator = self.separator or ","
        header = self.header if self.header and self.separator else separator.join(map(quoted, self.names))
        return f"{header}{separator}{separator.join(added)}\n"

    def rows_with(self, texts: Iterable[str], added: Iterable[Sequence[str]]) -> str:
        """Return rows as they stand with values behind them, by commas where blanks parted them.

        The numbers among these values have a decimal comma where those of the row have one.
        """
        return "".join(self._row_with(text, values) for text, values in zip(texts, added, strict=True))

    def _row_with(self, text: str, values: Sequence[str]) -> str:
        cells, numeric = _cells(text, self.separator), [p for p, c in self.columns.items() if c.kind == "number"]
        if not self.separator:
            cells = [cell.replace(",", ".") if p in numeric else quoted(cell) for p, cell in enumerate(cells)]
            return ",".join([*cells, *values]) + "\n"
        if self.separator != "," and any("," in cells[place] for place in numeric):
            values = [value.replace(".", ",") if math.isfinite(number(value)) else value for value in values]
        return f"{text}{self.separator}{self.separator.join(values)}\n"

    def fault(self, row: tuple[int, str], name: str, message: str, expected: str | None = None) -> Problem:
        """Return what is wrong in a wanted column of a line of the file, with where it stands on it."""
        (line, text), place = row, self.place(name)
        return Problem(
            file=self.source,
            line=line,
            columns=_span(text, self.separator, place),
            field=self.names[place].lower(),
            message=message,
            found=_cells(text, self.separator)[place].strip(),
            expected=expected,
            text=text,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PointTable:
    """n rows of a file with as many values as it has columns, and what is wrong with these and the others."""

    layout: Layout
    lines: Sequence[int]  # where they stand in the file
    rows: Sequence[str]  # the n lines
    values: Mapping[str, FloatArray]  # (n,) of each column of numbers, NaN where blank
    problems: list[Problem]
    size: int  # bytes of the file, with lines that are no rows

    @cached_property
    def cells(self) -> list[tuple[str, ...]]:
        """The texts (n,) of each place, none where there are no rows."""
        return list(zip(*(_cells(text, self.layout.separator) for text in self.rows), strict=True))

    def has(self, *names: str) -> bool:
        """Tell whether these of the wanted columns are there."""
        return {*names} <= {column.name for column in self.layout.columns.values()}

    def numbers(self, *names: str) -> FloatArray:
        """Return the numbers (n,) of a column, (n, k) of several; NaN where blank, or without such a column."""
        columns = [self.values.get(name, np.full(len(self.rows), np.nan)) for name in names]
        return columns[0] if len(columns) == 1 else np.column_stack(columns)

    def texts(self, name: str) -> list[str]:
        """Return the texts (n,) of a column."""
        return [cell.strip() for cell in self.cells[self.layout.place(name)]] if self.rows else []

    def dates(self, name: str) -> DateArray:
        """Return the days (n,) of a column, no day where blank."""
        return np.array([text or "NaT" for text in self.texts(name)], dtype="datetime64[D]")

    def others(self) -> dict[str, tuple[list[str], str]]:
        """Return the texts and the units of the columns that were not asked for, by their names."""
        layout = self.layout
        places = [place for place in range(len(layout.names)) if place not in layout.columns]
        return {layout.names[p]: ([cell.strip() for cell in self.cells[p]], layout.units[p]) for p in places}

    def refuse(self, message: str, row: int | None = None, name: str = "") -> None:
        """Add what else is wrong, with the names or in a column of a row."""
        if row is None:
            self.problems.append(Problem(file=self.layout.source, line=self.layout.line, message=message))
        else:
            self.problems.append(self.layout.fault((self.lines[row], self.rows[row]), name, message))

    def require(self, error: type[ProblemsError], empty: str = "") -> None:
        """Raise `error` with all that is wrong by line and column, or with a message where there is no row."""
        if self.problems:
            raise error(in_order(self.problems))
        if empty and not self.rows:
            raise error([Problem(file=self.layout.source, message=empty)])


def read_table(path: Path, wanted: Wanted) -> PointTable:
    """Return the table of a file, with all that is wrong with it in `PointTable.problems`. Raises `OSError`."""
    return next(_tables(path, wanted, None, "replace"))


def read_chunks(path: Path, wanted: Wanted, error: type[ProblemsError]) -> Iterator[PointTable]:
    """Yield the rows of a file of any size, `CHUNK` lines at a time; one table at least, for its layout.

    After what is wrong no more is yielded, but the rest is still looked through. Raises `error` with every fault,
    or the first hundred, and `OSError`.
    """
    problems = list[Problem]()
    for table in _tables(path, wanted, CHUNK, ENCODING["errors"]):
        problems += in_order(table.problems)
        if len(problems) >= _MOST_PROBLEMS:
            break
        if not problems:
            yield table
    if problems:
        raise error(problems[:_MOST_PROBLEMS])


def _tables(path: Path, wanted: Wanted, size: int | None, errors: str) -> Iterator[PointTable]:
    """Yield the chunks of a file with what is wrong with each; none of its rows where its names are wrong."""
    with path.open("rb") as binary, io.TextIOWrapper(binary, ENCODING["encoding"], errors, newline="") as file:
        layout, faults, first, lines = _layout_of(str(path), file, wanted)
        if faults:
            lines = iter(())
        done, seen = 0, dict[tuple[str, str], int]()
        chunks = iter(lambda: list(islice(lines, size)), [])
        for chunk in chain([next(chunks, [])], chunks):
            numbered = enumerate((text.rstrip("\r\n") for text in chunk), first)
            rows = [(line, text) for line, text in numbered if _is_row(text)]
            problems = [Problem(file=layout.source, line=layout.line, message=message) for message in faults]
            values = _by_numpy(layout, [text for _, text in rows])
            if values is None:
                rows, values = _one_by_one(layout, rows, seen, problems)
            yield PointTable(
                layout=layout,
                lines=[line for line, _ in rows],
                rows=[text for _, text in rows],
                values=values,
                problems=problems,
                size=binary.tell() - done,
            )
            first, done = first + len(chunk), binary.tell()


def _by_numpy(layout: Layout, rows: Sequence[str]) -> dict[str, FloatArray] | None:
    """Return the numbers of rows where nothing else is wanted; None where a row must be looked at by itself."""
    separator, columns = layout.separator, layout.columns.values()
    counts = {text.count(separator) + 1 if separator else len(text.split()) for text in rows}
    if counts != {len(layout.names)} or any(column.kind != "number" for column in columns) or '"' in "".join(rows):
        return None
    plain, places = _decimal(rows, separator), list(layout.columns)
    try:
        read = np.loadtxt(plain, delimiter=separator or None, usecols=places, comments=None, ndmin=2)
    except ValueError:
        return None
    read[np.abs(read) < ABOVE_ZERO] = 0.0
    values = {column.name: read[:, place] for place, column in enumerate(columns)}
    fit = all(((values[c.name] >= c.least) & (values[c.name] <= c.most)).all() for c in columns)
    return values if fit else None


def _one_by_one(
    layout: Layout, rows: Sequence[tuple[int, str]], seen: dict[tuple[str, str], int], problems: list[Problem]
) -> tuple[list[tuple[int, str]], dict[str, FloatArray]]:
    """Return the rows with all their values, and the numbers of these; faults are added to the problems.

    `seen`: the texts of unique columns so far, with their lines.
    """
    good, cells = list[tuple[int, str]](), list[list[str]]()
    for line, text in rows:
        values = _cells(text, layout.separator)
        if len(values) == len(layout.names):
            good.append((line, text))
            cells.append(values)
        else:
            message = f"{len(values)} values for {len(layout.names)} columns" if values else _OPEN
            problems.append(Problem(file=layout.source, line=line, message=message, text=text))
    read = dict[str, FloatArray]()
    for place, column in layout.columns.items():
        texts = [row[place].strip() for row in cells]
        if column.kind == "number":
            read[column.name] = numbers(_decimal(texts, layout.separator))
        for row in column.wrong(texts, read.get(column.name)):
            message = "" if texts[row] else "is missing"
            problems.append(layout.fault(good[row], column.name, message, column.expected))
        for row, text in enumerate(texts) if column.unique else ():
            before = seen.setdefault((column.name, text), good[row][0])
            if text and before != good[row][0]:
                problems.append(layout.fault(good[row], column.name, f"'{text}' stands in line {before} already"))
    return good, read


def _layout_of(source: str, lines: Iterator[str], wanted: Wanted) -> tuple[Layout, list[str], int, Iterator[str]]:
    """Return how a file is laid out, what is wrong with its names, and its rows with the number of the first."""
    above, text, count = deque[tuple[int, str]](maxlen=50), "", 0
    for count, text in enumerate(lines, 1):
        text = text.removeprefix("\ufeff").removeprefix("//").rstrip("\r\n")  # as CloudCompare begins
        if _is_row(text):
            break
        if text := text.strip("# "):
            above.appendleft((count, text))
        text = ""
    heads = [(count, text), *above]
    named = next((at for at in heads if wanted.are_named(_cells(at[1], _separator(at[1], wanted)))), None)
    # else a comment with some of the names, above as many values: then those that are missing are told
    width = len(_cells(text, _separator(text, wanted)))
    partly = (
        at
        for at in above
        if len(cells := _cells(at[1], _separator(at[1], wanted))) == width > len(wanted.places(cells)) > 1
    )
    line, header = named or next(partly, (count, text))
    separator = _separator(header, wanted)
    headings = _cells(header, separator) if header else []
    if not named and wanted.bare and np.isfinite(numbers(_decimal(headings, separator))).any():
        line, header, bare = 0, "", len(wanted.bare)
        headings = [*wanted.bare, *(f"column{n}" for n in range(bare + 1, len(headings) + 1))][: len(headings)]
    if text and line != count:
        lines = chain([text], lines)
    parts = [parted(heading) for heading in headings]
    layout = Layout(
        source=source,
        line=line or None if headings else None,
        header=header,
        separator=separator,
        names=tuple(name for name, _ in parts),
        units=tuple(unit for _, unit in parts),
        columns=wanted.read(headings),
    )
    return layout, [*wanted.faults(headings)], count + (line == count), lines


def _is_row(text: str) -> bool:
    """Tell whether a line has values: it is no comment, and not blanks and separators alone."""
    if text[:1].isalnum() or text[:1] == "-":  # as nearly every row begins
        return True
    return bool(text.strip(" \t,;|")) and not text.lstrip().startswith("#")


def _decimal(cells: Sequence[str], separator: str) -> Sequence[str]:
    """Return values with decimal points, where numbers parted by something else than commas may have commas."""
    return cells if separator == "," else [cell.replace(",", ".") for cell in cells]


def _cells(text: str, separator: str) -> list[str]:
    """Return the values of a line, none where a text in quotes does not end on it."""
    if '"' not in text:
        return text.split(separator or None)
    try:
        return next(csv.reader([text], delimiter=separator or " ", skipinitialspace=True, strict=True))
    except csv.Error as error:
        if "end of data" in str(error):
            return []
        return next(csv.reader([text], delimiter=separator or " ", skipinitialspace=True))


def _separator(text: str, wanted: Wanted) -> str:
    """Return what parts the values of a line: that which makes most wanted names of it, or else most numbers."""

    def score(separator: str) -> tuple[int, int]:
        cells = _cells(text, separator)
        return len(wanted.places(cells)), int(np.isfinite(numbers(_decimal(cells, separator))).sum())

    return max(_SEPARATORS, key=score)


def quoted(text: str) -> str:
    """Return a value as it stands between commas."""
    return '"' + text.replace('"', '""') + '"' if "," in text or '"' in text else text


def _span(text: str, separator: str, place: int) -> tuple[int, int] | None:
    """Return the first and last column, from 1, of a value on a line; None where quotes hide it."""
    if '"' in text:
        return None
    if not separator:
        first, end = [cell.span() for cell in re.finditer(r"\S+", text)][place]
    else:
        cells = text.split(separator)
        first = sum(len(cell) + 1 for cell in cells[:place])
        end = first + len(cells[place])
    return first + 1, max(end, first + 1)
