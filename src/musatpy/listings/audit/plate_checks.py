"""Plate residuals: all points against triangulated and not triangulated ones, and the stars.

Of a frame with RMS t of its triangulated points, n of the others and a of all, a^2 = (1 - w) t^2 + w n^2, where w
is the share of the others: within 0 and 1, and the same in x and in y.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

from musatpy.listings.audit.misprints import Misprint, Suspect, range_like
from musatpy.listings.audit.plate_tables import AXES, GROUPS
from musatpy.listings.audit.samples import Interval
from musatpy.listings.audit.structures import Listing, PlateTable, Printed

_NAMES = {"trig": "RMS of triangulated", "nontrig": "RMS of not triangulated", "all": "RMS of all"}
_SLACK = 1e-9  # mm^2 relative: a number exactly between two prints may have gone either way


def check_plates(listing: Listing) -> Iterator[Misprint]:
    """Yield what contradicts in the plate tables of a listing."""
    for table in listing.plates:
        for frame, count in Counter(table.frames).items():
            if count > 1:
                yield Misprint(table.line, table.name, f"frame {frame}", f"is there {count} times")
            yield from _negative(table, frame)
            yield from _frame(table, frame)
        for group in GROUPS:
            yield from _stars(table, group)


def _cell(table: PlateTable, group: str, axis: str, frame: str) -> Printed | None:
    return table.rms.get((group, axis), {}).get(frame)


def _negative(table: PlateTable, frame: str) -> Iterator[Misprint]:
    """Yield cells below zero."""
    for (group, axis), row in table.rms.items():
        cell = row.get(frame)
        if cell and cell.high < 0.0:
            suspect = Suspect.of(f"{_NAMES[group]}, {axis}", cell)
            yield Misprint(cell.line, table.name, f"frame {frame}", "an RMS is never negative", (suspect,))


def _frame(table: PlateTable, frame: str) -> Iterator[Misprint]:
    shares: dict[str, Interval | None] = {}
    for axis in AXES:
        cells = [_cell(table, group, axis, frame) for group in GROUPS]
        if all(cell and cell.high >= 0.0 for cell in cells):
            shares[axis] = _share(*[cell for cell in cells if cell])
    known = [share for share in shares.values() if share]
    if len(known) == len(shares) and max([0.0, *(low for low, _ in known)]) <= min(
        [1.0, *(high for _, high in known)]
    ):
        return
    doubtful = [axis for axis in shares if not shares[axis]] or list(shares)
    suspects = []
    for axis in doubtful:
        others = [share for other, share in shares.items() if other != axis and share]
        for group in GROUPS:
            cell = _cell(table, group, axis, frame)
            if cell:
                expected = _expected(table, axis, frame, others) if group == "all" else ""
                suspects.append(Suspect.of(f"{_NAMES[group]}, {axis}", cell, expected))
    message = f"the RMS of all points, {' and '.join(doubtful)}, is no mean of the two parts"
    yield Misprint(suspects[0].line, table.name, f"frame {frame}", message, tuple(suspects))


def _share(trig: Printed, nontrig: Printed, together: Printed) -> Interval | None:
    """Return within what the share w of points not triangulated is; None where there is no such share."""
    low, high = 0.0, 1.0
    t, n, a = trig, nontrig, together
    # (1 - w) t^2 + w n^2 <= a^2 for the smallest t and n, >= for the largest: each is linear in w.
    for sign, (t2, n2, a2) in (
        (1.0, (max(t.low, 0.0) ** 2, max(n.low, 0.0) ** 2, a.high**2 * (1.0 + _SLACK))),
        (-1.0, (t.high**2, n.high**2, max(a.low, 0.0) ** 2 * (1.0 - _SLACK))),
    ):
        slope, room = sign * (n2 - t2), sign * (a2 - t2)  # slope w <= room
        if slope > 0.0:
            high = min(high, room / slope)
        elif slope < 0.0:
            low = max(low, room / slope)
        elif room < 0.0:
            return None
    return (low, high) if low <= high else None


def _expected(table: PlateTable, axis: str, frame: str, others: list[Interval]) -> str:
    """Return what the RMS of all points would be with the share of the other axis."""
    t, n, a = (_cell(table, group, axis, frame) for group in GROUPS)
    if not (t and n and a and others):
        return ""
    shares = others[0]
    low = min((1.0 - w) * max(t.low, 0.0) ** 2 + w * max(n.low, 0.0) ** 2 for w in shares)
    high = max((1.0 - w) * t.high**2 + w * n.high**2 for w in shares)
    return range_like(math.sqrt(low), math.sqrt(high), a)


def _stars(table: PlateTable, group: str) -> Iterator[Misprint]:
    """Yield stars that are missing, too many, or not at the frame with the largest sqrt(x^2 + y^2)."""
    if group not in table.stars:
        return
    stars = table.stars[group]
    bounds = {}
    for frame in table.frames:
        x, y = (_cell(table, group, axis, frame) for axis in AXES)
        if x is None or y is None:
            return
        low, high = (math.hypot(max(x.low, 0.0), max(y.low, 0.0)), math.hypot(x.high, y.high))
        bounds[frame] = (low, high) if x.value or y.value else (0.0, high)
    largest = max(bounds, key=lambda frame: bounds[frame][0])
    item = f"star of {_NAMES[group].removeprefix('RMS of ')} points"
    message = ""
    if not stars and bounds[largest][0] > 0.0:
        message = f"no frame is starred, though {largest} has an RMS"
    elif len(stars) > 1:
        message = f"{len(stars)} frames are starred: {', '.join(frame for frame, _ in stars)}"
    elif stars and bounds[stars[0][0]][1] * (1.0 + _SLACK) < bounds[largest][0]:
        message = f"frame {stars[0][0]} is starred, the largest RMS is that of {largest}"
    if message:
        yield Misprint(stars[0][1] if stars else table.line, table.name, item, message)
