"""Values of the record as texts of a page: numbers with their decimals, angles, names."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from musatpy.fortran import parse_edit
from musatpy.reports.editing import SEXAGESIMAL
from musatpy.units import dms_from_radians

# Units as a page writes them.
UNITS: Mapping[str, str] = {
    "um": "µm",
    "arc sec": "″",
    "degrees": "°",
    "deg": "°",
    "m2": "m²",
    SEXAGESIMAL: "° ′ ″",
}
_LARGEST = 1e12  # numbers beyond have an exponent: of runs that have lost their way


def cell_text(edit: str, value: Any) -> str:
    """Return the text of a value by an edit descriptor of the listing; empty for what does not exist.

    A descriptor says the decimals, and here not the width. Angles of `S` are radians. A page has a zero before the
    decimal point, which the listing, as ETL-0306, has not.
    """
    if isinstance(value, list):
        return " ".join(str(part) for part in value)
    if not isinstance(value, int | float) or isinstance(value, bool):
        return "" if value is None else str(value)
    if not math.isfinite(value):
        return ""
    if edit.startswith("S"):
        return angle_text(value, int(edit.partition(".")[2]))
    form = parse_edit(edit)
    if form.letter == "E" or abs(value) >= _LARGEST:
        return f"{value:.{form.decimals or 3}e}"
    return number_text(value, form.decimals if form.letter == "F" else 0)


def number_text(value: float | None, decimals: int) -> str:
    """Return a number with its decimals, zero without sign; empty where there is none."""
    if value is None or not math.isfinite(value):
        return ""
    text = f"{value:.{decimals}f}"
    return text.removeprefix("-") if not text.strip("-0.") else text


def angle_text(angle: float, decimals: int) -> str:
    """Return an angle (rad) in degrees, minutes and seconds: `-0° 30′ 45.200″`."""
    degrees, minutes, seconds = (float(part) for part in dms_from_radians(angle, decimals))
    zero = not (degrees or minutes or seconds)
    sign = "-" if math.copysign(1.0, degrees) < 0.0 and not zero else ""
    width = decimals + 3 if decimals else 2
    return f"{sign}{abs(degrees):.0f}° {minutes:02.0f}′ {seconds:0{width}.{decimals}f}″"


def significant(value: float | None, digits: int = 6) -> str:
    """Return a number with at most so many digits; empty where there is none."""
    return "" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"


def size_text(value: float) -> str:
    """Return a number in the text of a sentence: three digits."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:#.3g}".rstrip(".")
