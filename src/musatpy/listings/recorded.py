"""What a record has of a printed value: found in its fields, and rounded as it is printed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from decimal import ROUND_HALF_EVEN, Decimal
from typing import Any

from musatpy.listings.judge import EXACTLY
from musatpy.listings.records import Number, at
from musatpy.listings.tokens import Token
from musatpy.reports.origin import Origin
from musatpy.reports.table import PRINTED
from musatpy.units import ARC_SECOND, dms_from_radians

_IN_ROWS = {'"': "arc sec", "deg": "degrees"}  # what rows call them
LONGEST = 30  # decimals
SHOWN_DIGITS = 4  # of the record's number beyond those printed


def unit_named(text: str) -> str:
    """Return the unit that a row says, by itself or behind a comma, as headings call it."""
    unit = text.rpartition(", ")[2]
    return _IN_ROWS.get(unit, unit)


def value_of(source: Origin, fields: Mapping[str, Any]) -> Any:
    """Return the number, text or flag of the record, in units of the record; None where there is none."""
    found = at(fields, source.field)
    if source.is_field and isinstance(found, Number):
        return float(found)
    if source.count:
        entries = found if isinstance(found, list) else []
        return float(sum(1 for entry in entries if not source.where or at(entry, source.where)))
    if source.sum:
        counts = found.values() if isinstance(found, dict) else ()
        return float(sum(float(one) for one in counts if isinstance(one, Number)))
    if source.norm:
        return math.hypot(*found) if (found := _numbers(found)) else None
    if source.ellipse:
        return _ellipse(source.ellipse, found)
    if source.where and at(fields, source.where) is False:
        return None
    if source.true or source.false:
        return source.true if found is True else source.false
    if isinstance(found, Number):
        if not source.minus:
            return float(found)
        minus = at(fields, source.minus)
        return float(found) - float(minus) if isinstance(minus, Number) else None
    return source.null if found is None else found


def _numbers(values: Any) -> list[float]:
    """Return a list of numbers, an empty one where any of them is none."""
    if not isinstance(values, list) or not all(isinstance(one, Number) for one in values):
        return []
    return [float(one) for one in values]


def _ellipse(part: str, covariance: Any) -> float | None:
    """Return an axis of the ellipse of a covariance of east, north, ..., or the bearing of its longer axis."""
    values = _numbers([at(covariance, place) for place in ("[0][0]", "[0][1]", "[1][1]")])
    if not values:
        return None
    ee, en, nn = values
    mean, half = 0.5 * (ee + nn), math.hypot(0.5 * (nn - ee), en)
    if mean + half < 0.0:
        return None
    if part == "bearing":
        bearing = 0.5 * math.atan2(2.0 * en, nn - ee)
        return bearing + math.pi if bearing < 0.0 else bearing
    return math.sqrt(mean + half) if part == "major" else math.sqrt(max(mean - half, 0.0))


def token_of(value: Any, printed: Token, unit: str) -> Token:
    """Return the record's value as a token: a number rounded to the digits of `printed`, shown with some more."""
    if value is None:
        return Token("word", "")
    if isinstance(value, str):
        return Token("word", value.replace("_", " "))
    if not isinstance(value, int | float) or not math.isfinite(value):
        return Token("word", str(value))
    if printed.kind == "angle":
        return _angle(value, printed)
    number = value / PRINTED.get(unit, 1.0)
    step = printed.step if printed.kind == "number" else -SHOWN_DIGITS
    if -LONGEST <= step <= 0:
        rounded = f"{number:.{-step}f}"
        text = rounded if number.is_integer() else f"{number:.{SHOWN_DIGITS - step}f}"
        return Token("number", text, Decimal(rounded), step)
    exact = Decimal(number)
    if abs(step) > LONGEST:  # no field that a listing of ours has
        return Token("number", str(exact), exact, step)
    tens = exact.quantize(Decimal(1).scaleb(step), ROUND_HALF_EVEN, EXACTLY)
    return Token("number", f"{tens:f}" if number.is_integer() else f"{number:.{SHOWN_DIGITS}f}", tens, step)


def _angle(value: float, printed: Token) -> Token:
    """Return an angle in radians as degrees, minutes and seconds, rounded to those printed, shown with more."""
    decimals = max(-printed.step, 0)
    # as `dms_from_radians` rounds, without arrays
    size = Decimal(round(abs(value) / ARC_SECOND * 10.0**decimals)).scaleb(-decimals).copy_sign(Decimal(value))
    if size == printed.value:
        return printed
    degrees, minutes, seconds = (float(one) for one in dms_from_radians(value, decimals + SHOWN_DIGITS))
    sign = "-" if size.is_signed() else ""
    text = f"{sign}{abs(degrees):.0f} {minutes:.0f} {seconds:.{decimals + SHOWN_DIGITS}f}"
    return Token("angle", text, size, printed.step)


def expanded(row: Mapping[str, Any], lists: Sequence[str]) -> Iterator[Mapping[str, Any]]:
    """Yield a row for each entry of the lists of a row; the row itself without lists."""
    if not lists:
        yield row
        return
    entries = row.get(lists[0])
    for n in range(len(entries) if isinstance(entries, list) else 0):
        yield {**row, **{name: at(row, f"{name}[{n}]") for name in lists}}


def nested(row: Mapping[str, Any], name: str) -> Iterator[Mapping[str, Any]]:
    """Yield the rows of the table in a field of a row, each with the fields of that; without a name the row."""
    entries = row.get(name) if name else [{}]
    for entry in entries if isinstance(entries, list) else []:
        if isinstance(entry, dict):
            yield {**row, **entry}


def id_text(value: Any) -> str:
    """Return what names a row as it is printed: of several names one behind the other."""
    return "" if value is None else " ".join(map(str, value)) if isinstance(value, list) else str(value)
