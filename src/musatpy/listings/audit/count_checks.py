"""Is every photo, point and measurement there, and there once? Our own listings say how many there are."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import repeat

from musatpy.listings.audit.headings import KEYS, Title
from musatpy.listings.audit.job_options import CONTROL_COUNT, MEASUREMENT_COUNT, PHOTO_COUNT, POINT_COUNT
from musatpy.listings.audit.misprints import Misprint
from musatpy.listings.audit.structures import Listing, Table

_UNIQUE = (  # tables without a row that is there twice
    *(Title.INITIAL_POSITIONS, Title.POSITIONS, Title.ATTITUDES, Title.POINTS, Title.DEPTHS, Title.CHECKS),
    *(Title.GIVEN_PLATES, Title.RESIDUALS),
)
_PHOTOS = (Title.INITIAL_POSITIONS, Title.GIVEN_ATTITUDES, Title.POSITIONS, Title.ATTITUDES)  # tables of all photos
_ROWS = (  # title of a table, and what the size of the job calls the number of its rows
    (Title.GIVEN_PLATES, MEASUREMENT_COUNT),
    (Title.RESIDUALS, MEASUREMENT_COUNT),
    (Title.GIVEN_CONTROL, CONTROL_COUNT),
)


def check_counts(listing: Listing) -> Iterator[Misprint]:
    """Yield rows that are missing or there twice."""
    for title in _UNIQUE:
        table = listing.table(title)
        if table is not None:
            yield from _twice(table, KEYS[title])
    for plates in listing.plates:
        for frame, count in Counter(plates.frames).items():
            if count > 1:
                yield Misprint(plates.line, plates.name, f"frame {frame}", f"is there {count} times")
    yield from _photos(listing)
    yield from _row_counts(listing)
    yield from _control_count(listing)
    yield from _points(listing)
    yield from _submerged(listing)


def _ids(table: Table | None, heading: str) -> Sequence[str]:
    return table.columns.get(heading, ()) if table else ()


def _size(listing: Listing, name: str) -> int | None:
    text = listing.options.get(name, "")
    return int(text) if re.fullmatch(r"\d{1,15}", text) else None


def _twice(table: Table, key: Sequence[str]) -> Iterator[Misprint]:
    names = [name for name in key if name in table.headings]
    columns = [table.columns[name] for name in names]
    seen: dict[tuple[str, ...], int] = {}
    for line, ids in zip(table.lines, zip(*columns, strict=True) if columns else repeat(()), strict=False):
        if seen.setdefault(ids, line) != line:
            item = ", ".join(f"{name.lower()} {cell}" for name, cell in zip(names, ids, strict=True))
            yield Misprint(line, table.name, item, f"is there twice, in line {seen[ids]} before")


def _photos(listing: Listing) -> Iterator[Misprint]:
    """Yield photos that are in some of the tables of all photos and not in others, or too few of them."""
    tables = [(table.name, table.line, _ids(table, "Photo")) for table in listing.tables_titled(*_PHOTOS)]
    if not tables or (Title.POSITIONS not in {table.title for table in listing.tables} and not listing.plates):
        return
    tables += [(plates.name, plates.line, list(plates.frames)) for plates in listing.plates[:1]]
    counts = Counter(name for _, _, names in tables for name in set(names))
    common = {name for name, count in counts.items() if 2 * count > len(tables)}
    for table, line, names in tables:
        for name in sorted(common - set(names)):
            yield Misprint(line, table, f"photo {name}", "is missing here")
        for name in sorted(set(names) - common):
            yield Misprint(line, table, f"photo {name}", "is in no other table")
    size = _size(listing, PHOTO_COUNT)
    if size is not None and size != len(common):
        message = f"the job has {size}, the tables have {len(common)}"
        yield Misprint(tables[0][1], "size of the job", "photos", message)


def _row_counts(listing: Listing) -> Iterator[Misprint]:
    for title, name in _ROWS:
        table, size = listing.table(title), _size(listing, name)
        if table is not None and size is not None and size != len(table.lines):
            message = f"the job has {size} of them, the table {len(table.lines)}"
            yield Misprint(table.line, table.name, name.lower(), message)


def _control_count(listing: Listing) -> Iterator[Misprint]:
    """Yield residuals of control and differences of check points that are not as many as the job has."""
    tables = listing.tables_titled(Title.CONTROL, Title.CHECKS)
    size, rows = _size(listing, CONTROL_COUNT), sum(len(table.lines) for table in tables)
    if tables and not listing.cut and size is not None and size != rows:
        message = f"the job has {size}, {rows} have residuals"
        yield Misprint(tables[0].line, tables[0].name, CONTROL_COUNT.lower(), message)


def _points(listing: Listing) -> Iterator[Misprint]:
    """Yield points of the tables that the adjusted points lack, and the other way round."""
    adjusted, size = listing.table(Title.POINTS), _size(listing, POINT_COUNT)
    if adjusted is None:
        return
    known = {*_ids(adjusted, "Point"), *listing.undetermined}
    for table in listing.tables_titled(Title.RESIDUALS, Title.CONTROL, Title.CHECKS, Title.DEPTHS):
        for line, point in zip(table.lines, _ids(table, "Point") or repeat(""), strict=False):
            if point not in known:
                yield Misprint(line, table.name, f"point {point}", "is not among the adjusted points")
    if size is not None and size != len(known):
        message = f"the job has {size}, {len(known)} are adjusted or said to have no position"
        yield Misprint(adjusted.line, adjusted.name, "points", message)


def _submerged(listing: Listing) -> Iterator[Misprint]:
    """Yield submerged points that one of the tables of them lacks; those without a position are not in all."""
    adjusted, depths = listing.table(Title.POINTS), listing.table(Title.DEPTHS)
    tables: list[tuple[str, int, Sequence[str]]] = [
        (table.name, table.line, [point.name for point in table.points]) for table in listing.submerged[:1]
    ]
    if depths is not None:
        tables.append((depths.name, depths.line, _ids(depths, "Point")))
    if adjusted is not None and {"Point", "Bath"} <= set(adjusted.headings):
        columns = adjusted.columns
        wet = [point for point, bath in zip(columns["Point"], columns["Bath"], strict=True) if bath == "B"]
        tables.append((adjusted.name, adjusted.line, wet))
    if len(tables) < 2:
        return
    counts = Counter(name for _, _, names in tables for name in dict.fromkeys(names))
    undetermined = set(listing.undetermined)
    for table, line, names in tables:
        known = undetermined.union(names)
        for name in counts:
            if name not in known:
                message = "is missing here" if 2 * counts[name] > len(tables) else "is submerged elsewhere"
                yield Misprint(line, table, f"point {name}", message)
