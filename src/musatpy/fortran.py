"""One value <-> text under one FORTRAN edit descriptor: `Iw`, `Fw.d`, `Ew.d`, `Dw.d`, `Aw`.

The rules are those of FORTRAN 66 and FORTRAN 77 (X3.9-1978, 13.5), with three decisions that card decks need:

- A number is a float whatever its descriptor, so that `-0` degrees keep their sign; NaN is "no value".
- Blanks between the characters of a number are errors. A field that is all blank follows a `Blank` rule, and so do
  blanks after a number: they are zeros under "zero" (FORTRAN 66 and BLANK='ZERO': `12  ` under I4 is 1200), and
  nothing under "missing" and "error" (BLANK='NULL': 12).
- The exponent letters E and D are read in lower case as well, as every later compiler does.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, cast

Letter = Literal["I", "F", "E", "D", "A"]
Blank = Literal["error", "missing", "zero"]

EXACT_INTEGERS = 2**53  # beyond, not every integer is a float
_TOLD = 12  # digits of a value that a person gave: what a change of unit leaves of them

_DIGITS_OF_A_WIDTH = 4  # no line is as long
_DESCRIPTOR = re.compile(
    r"(?P<plain>[IA])(?P<plain_width>[1-9]\d*)"
    r"|(?P<real>[FED])(?P<real_width>[1-9]\d*)\.(?P<decimals>\d+)",
    re.ASCII,
)
_INTEGER = re.compile(r" *([+-]?)(\d+)( *)", re.ASCII)
_REAL = re.compile(r" *([+-]?)(\d*)(?:(\.)(\d*))?(?:[EDed]([+-]?\d+)|([+-]\d+))?( *)", re.ASCII)


class FieldError(ValueError):
    """Text that is not of its descriptor, or a value that its descriptor cannot write."""

    def __init__(self, found: str, expected: str) -> None:
        self.found = found
        self.expected = expected
        super().__init__(f"'{found}' is not {expected}")


@dataclass(frozen=True, kw_only=True)
class Edit:
    """One edit descriptor. `decimals` is the d of `Fw.d`, `Ew.d` and `Dw.d`, else 0."""

    letter: Letter
    width: int  # columns
    decimals: int = 0

    @property
    def is_number(self) -> bool:
        """True for I, F, E and D."""
        return self.letter in "IFED"

    def __str__(self) -> str:
        return f"{self.letter}{self.width}" + (f".{self.decimals}" if self.letter in "FED" else "")


@lru_cache(maxsize=1024)
def parse_edit(text: str) -> Edit:
    """Return the descriptor that `text` spells, such as `F12.6`.

    Raises `FieldError` where it is none, or is too narrow to print any value: w is at least d + 1 for F and d + 5,
    for point and exponent, for E and D, whose d is at least 1.
    """
    match = _DESCRIPTOR.fullmatch(text)
    if match is None:
        raise FieldError(text, "an edit descriptor (Iw, Fw.d, Ew.d, Dw.d or Aw)")
    groups = match.groupdict()
    letter = cast(Letter, groups["plain"] or groups["real"])
    width = groups["plain_width"] or groups["real_width"]
    if len(width) > _DIGITS_OF_A_WIDTH:
        raise FieldError(text[:40], f"a descriptor of less than {10**_DIGITS_OF_A_WIDTH} columns")
    edit = Edit(letter=letter, width=int(width), decimals=int(groups["decimals"] or 0))
    room = {"F": 1, "E": 5, "D": 5}.get(letter, 0)
    if edit.width < edit.decimals + room or (room == 5 and not edit.decimals):
        raise FieldError(text, "a descriptor wide enough for its decimals")
    return edit


def read_number(field: str, edit: Edit, *, blank: Blank = "error", asterisks: bool = False) -> float:
    """Return the number in `field` under an I, F, E or D descriptor; NaN is no value, -0.0 keeps its sign.

    A field shorter than the descriptor is filled with blanks on the right, as a short record is. An explicit point
    beats the implied one; an exponent is `E+3`, `D3`, or a signed integer alone (`1.5+3`). A field of asterisks
    (an overflow printed by FORTRAN) is no value where `asterisks` allows it. Raises `FieldError`.
    """
    field = field.ljust(edit.width)
    content = field.strip(" ")
    if not content:
        if blank == "error":
            raise FieldError(field, str(edit))
        return 0.0 if blank == "zero" else math.nan
    if asterisks and not content.strip("*"):
        return math.nan
    if len(field) > edit.width:
        raise FieldError(field, f"{edit} ({len(field)} characters)")
    zeros = blank == "zero"
    return _read_integer(field, edit, zeros) if edit.letter == "I" else _read_real(field, edit, zeros)


def _read_integer(field: str, edit: Edit, trailing_zeros: bool) -> float:
    match = _INTEGER.fullmatch(field)
    if match is None:
        raise FieldError(field, str(edit))
    sign, digits, after = match.groups()
    if trailing_zeros:
        digits += "0" * len(after)
    if int(digits) > EXACT_INTEGERS:
        raise FieldError(field, f"{edit} of magnitude up to 2**53")
    return float(sign + digits)


def _read_real(field: str, edit: Edit, trailing_zeros: bool) -> float:
    match = _REAL.fullmatch(field)
    if match is None or not (match[2] or match[4]):
        raise FieldError(field, str(edit))
    sign, whole, point, fraction, exponent, bare_exponent, after = match.groups()
    exponent = exponent or bare_exponent
    if trailing_zeros and exponent:
        exponent += "0" * len(after)
    elif trailing_zeros and not point:
        whole += "0" * len(after)
    power = int(exponent or 0) - (0 if point else edit.decimals)
    value = float(f"{sign}{whole}.{fraction or ''}E{power}")
    if math.isinf(value):
        raise FieldError(field, f"{edit} within the range of a float")
    return value


def write_number(value: float, edit: Edit) -> str:
    """Return `value` under an I, F, E or D descriptor, right-justified; NaN prints blanks.

    Rounding is decimal and of the exact binary value, ties to even. The zero before the point is left out where
    the width has no room for it. A zero, and what rounds to zero, prints without sign under F, E and D, as FORTRAN
    77 has it; under I, -0.0 prints `-0`, because the degrees of a deck carry the sign of their angle. What does
    not fit prints asterisks. Raises `FieldError` for a value under I that is no integer.
    """
    if math.isnan(value):
        return " " * edit.width
    if math.isinf(value):
        return "*" * edit.width
    if edit.letter == "I":
        if value != math.trunc(value):
            raise FieldError(repr(value), f"an integer ({edit})")
        text = f"{value:.0f}"
    else:
        text = (_fixed_text if edit.letter == "F" else _exponent_text)(value, edit)
    return text.rjust(edit.width) if len(text) <= edit.width else "*" * edit.width


def _fixed_text(value: float, edit: Edit) -> str:
    whole, _, fraction = f"{abs(value):.{edit.decimals}f}".partition(".")
    zero = not (whole + fraction).strip("0")
    sign = "-" if value < 0 and not zero else ""
    text = f"{sign}{whole}.{fraction}"
    if len(text) > edit.width and whole == "0" and fraction:
        return f"{sign}.{fraction}"
    return text


def _exponent_text(value: float, edit: Edit) -> str:
    """Return `0.ddddE+ee`; an exponent of three digits drops the letter: `0.dddd+eee`."""
    scientific, _, tens = f"{abs(value):.{edit.decimals - 1}e}".partition("e")
    power = int(tens) + 1 if value else 0
    exponent = f"{edit.letter}{power:+03d}" if abs(power) <= 99 else f"{power:+04d}"
    sign = "-" if value < 0 else ""
    text = f".{scientific.replace('.', '')}{exponent}"
    return f"{sign}0{text}" if len(sign) + 1 + len(text) <= edit.width else sign + text


def decimals_of(value: float, least: int) -> int:
    """Return how many decimals, `least` at least, tell a finite value to twelve digits: d for an `Fw.d` of it."""
    digits, _, exponent = f"{value:.{_TOLD - 1}e}".partition("e")
    return max(least, len(digits.partition(".")[2].rstrip("0")) - int(exponent))


def fit_number(value: float, edit: Edit, *, all_digits: bool = False) -> str:
    """Return `value` as `write_number` does, but never as asterisks, nor as zero when it is not.

    F drops decimals as far as needed; a number too small for its decimals gets more of them, or an exponent. With
    `all_digits` F has as many decimals as the value needs and the width holds: an explicit point beats the implied
    one. Raises `FieldError` where the value does not fit even so (its point is always written).
    """
    if edit.letter != "F" or not math.isfinite(value) or not value:
        text = write_number(value, edit)
        if "*" in text:
            raise FieldError(repr(value), f"a number that fits {edit}")
        return text
    width = edit.width
    more = range(min(decimals_of(value, edit.decimals), width - 1), edit.decimals, -1) if all_digits else ()
    for decimals in more:
        text = write_number(value, Edit(letter="F", width=width, decimals=decimals))
        if text[-1] not in "*0":
            return text
    forms: list[tuple[Letter, int]] = [("F", decimals) for decimals in range(edit.decimals, -1, -1)]
    if abs(value) < 1.0:
        forms.append(("F", max(width - 1 - (value < 0), 0)))
        forms += [("E", decimals) for decimals in range(width - 5, 0, -1)]
    for letter, decimals in forms:
        text = write_number(value, Edit(letter=letter, width=width, decimals=decimals))
        if "*" not in text and text.strip(" -.0"):
            return text
    raise FieldError(repr(value), f"a number that fits {edit}")
