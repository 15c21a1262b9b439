"""One field of a record <-> its text: what cards can do, and packed angles, codes, numbers that mean "none"."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from musatpy import units
from musatpy.formats.cards.spec import UNITS, FieldSpec
from musatpy.fortran import Edit, FieldError, fit_number, read_number, write_number
from musatpy.specs import key, require

PACKED = "dms"  # unit of angles DDDMMSS.sss in one number
JOB_UNIT = "job"  # packed angles in a geographic job, metres in a rectangular one
LONGEST = 128  # letters of a name, as a job has them
RECORD_UNITS = (*UNITS, "rad", "gon", PACKED, JOB_UNIT)


def pairs_of(table: Any) -> tuple[tuple[str, str], ...]:
    """Return the keys and values of a table as texts; raises `ValueError`."""
    require(isinstance(table, dict), f"{table!r} is not a dict")
    return tuple((str(name), str(value)) for name, value in table.items())


@dataclass(frozen=True, kw_only=True)
class RecordField(FieldSpec):
    """A field of a record; `first` and `last` are its columns, or both the number of its word in a free layout.

    A packed angle decodes to radians. `codes` are pairs of the text in the file and the letter that a deck has for
    the same; `none` is a number that stands for no value, `part` the place of the field in a text of several,
    `same_as` the field before it that it says again.
    """

    columns: tuple[int, int] = key((0, 0), "`[first, last]`, counted from 1 (fixed layout only)")
    unit: str = key(
        "",
        f"one of {', '.join(f'`{unit}`' for unit in RECORD_UNITS if unit)}, or empty; `dms` is "
        "DDDMMSS.s in one number, `job` is `dms` in a geographic job and `m` in others",
        choices=RECORD_UNITS,
    )
    codes: tuple[tuple[str, str], ...] = key(
        (), "texts of the file and the letters that a deck has for the same", convert=pairs_of
    )
    justify: Literal["left", "right"] = key(
        "left", "texts stand `left` (so without the key) or `right` in their columns", choices=("left", "right")
    )
    none: float | None = key(None, "a number that stands for no value")
    same_as: str = key("", "the field of the same row that it says again; its target is empty")
    part: int = key(0, "place of the field in a target of several fields, which hyphens join")
    free: bool = False

    def check(self) -> None:
        """Raise `ValueError` for a field that contradicts itself."""
        given = self.columns != (0, 0)
        require(not self.free or not given, "columns: words of a free layout have none")
        if not self.free:
            require(given, "columns: not [first, last]")
            require(1 <= self.first <= self.last, f"columns: {self.first}-{self.last} are no columns")
            self.check_width()
        require(self.blank in ("error", "missing"), "blank: not error or missing")
        require(self.bound is None, "bound: what files say is checked as the cards of their deck")
        text_keys = bool(self.codes or self.part or self.justify != "left")
        require(not self.edit.is_number or not text_keys, "a number has no such key")
        require(self.edit.is_number or not (self.unit or self.none is not None), "a text has no such key")

    @property
    def is_plain(self) -> bool:
        """Whether it is any word, or any number with no further meaning."""
        special = self.codes or self.part or self.same_as or self.none is not None or self.unit == PACKED
        return self.free and not special and self.blank == "error" and self.edit.letter != "I"

    @property
    def expected(self) -> str:
        """What the field wants, for messages."""
        if self.codes:
            return f"{self.edit} (one of {', '.join(text for text, _ in self.codes)})"
        if self.unit == PACKED:
            return f"{self.edit} as DDDMMSS.s"
        return super().expected

    def decode(self, text: str) -> float | str:
        """Return the value of a text; raises `FieldError`. Words of a free layout may have any width."""
        if not self.edit.is_number:
            value = text.strip(" ") if self.free else str(super().decode(text))
            if len(value) > LONGEST:
                raise FieldError(value, f"a name of at most {LONGEST} letters")
            letters = dict(self.codes)
            if (letters and value not in letters) if value else self.blank == "error":
                raise FieldError(value or text, self.expected)
            return letters.get(value, value)
        if not self.free or not text.strip():
            number = float(super().decode(text))
        else:
            letter: Literal["I", "F"] = "I" if self.edit.letter == "I" else "F"
            try:
                number = read_number(text, Edit(letter=letter, width=len(text)))
            except FieldError as error:
                raise FieldError(text, "an integer" if letter == "I" else "a number") from error
        if number == self.none:
            return math.nan
        return self._unpacked(number, text) if self.unit == PACKED else number

    def _unpacked(self, value: float, text: str) -> float:
        """Return radians of the packed angle DDDMMSS.sss; the sign of zero degrees is that of the number."""
        if math.isnan(value):
            return value
        minutes, seconds = divmod(abs(value), 100.0)
        degrees, minutes = divmod(minutes, 100.0)
        if minutes >= 60.0 or seconds >= 60.0:
            raise FieldError(text.strip(), self.expected)
        return float(units.radians_from_dms(math.copysign(degrees, value), minutes, seconds))

    def encode(self, value: float | str) -> str:
        """Return the text of a value, as wide as the field; raises `FieldError`."""
        if isinstance(value, str):
            texts = {letter: text for text, letter in reversed(self.codes)}
            if texts and value not in texts:
                raise FieldError(value, f"one of {', '.join(letter or 'blank' for _, letter in self.codes)}")
            if self.free and not texts and " " in value:
                raise FieldError(value, "a text without blanks")
            text = texts[value].ljust(self.edit.width) if texts else super().encode(value)
            return text.strip(" ").rjust(self.edit.width) if self.justify == "right" else text
        if math.isnan(value) and self.none is not None:
            return fit_number(self.none, self.edit)
        if self.unit == PACKED and not math.isnan(value):
            return self._packed(value)
        if self.edit.letter == "I":
            value = float(round(value)) if math.isfinite(value) else value
        # a number below its last decimal is zero, but no standard deviation
        small = self.edit.letter == "F" and abs(value) * 10.0**self.edit.decimals < 0.5
        return super().encode(0.0 if small and not self.is_sigma else value)

    def _packed(self, value: float) -> str:
        """Return DDDMMSS.sss with the decimals that the field has room for."""
        if self.is_sigma and abs(value) < units.ARC_MINUTE:
            return fit_number(value / units.ARC_SECOND, self.edit, all_digits=True)
        for decimals in range(self.edit.decimals, -1, -1):
            degrees, minutes, seconds = (float(part) for part in units.dms_from_radians(value, decimals))
            number = math.copysign(abs(degrees) * 1e4 + minutes * 100.0 + seconds, degrees)
            text = write_number(number, Edit(letter="F", width=self.edit.width, decimals=decimals))
            if "*" not in text:
                return text
        raise FieldError(repr(value), f"an angle that fits {self.edit}")
