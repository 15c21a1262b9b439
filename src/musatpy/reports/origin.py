"""Where the numbers of the listing stand in the record: of a printed value, and of a section."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

Layout = Literal["rows", "across", "xyz", "labels", "texts"]


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Where one printed value comes from: a path in the row of the record, and what is done with what is there."""

    field: str
    minus: str = ""  # a field to be subtracted
    then: Sequence[str] = ()  # of labels: the fields of the next numbers of the line, as those of a sigma
    unit: str = ""  # of the printed number where the heading does not say it as its last line
    where: str = ""  # of a count, a field that is true in its entries; of a vector: blank where it is false
    unless: str = ""  # a heading: blank where the number under it prints as zero
    true: str = ""  # what stands for true; nothing stands for false
    false: str = ""  # what stands for false; nothing stands for true
    null: float | None = None  # the number that is printed where there is none
    count: bool = False  # the number of entries of `field`, a table, or a list of a row
    sum: bool = False  # the sum of the values of `field`
    norm: bool = False  # the length of a vector
    ellipse: str = ""  # major, minor or bearing, of the error ellipse of a covariance of east and north
    unit_in: str = ""  # the heading of the column that says the unit of the row, behind a comma where it says more
    angles: str = ""  # first ids, a regular expression, of rows with angles: their numbers are arc seconds
    marks: str = ""  # printed (`across`) in the column of the entry that `field`, a path in the record, names
    blank: bool = False  # may be left blank whatever the number is

    @cached_property
    def is_field(self) -> bool:
        """True where the value is that of one field, as it is."""
        changed = self.minus or self.where or self.true or self.false or self.count or self.sum
        return not (changed or self.norm or self.ellipse or self.unit_in or self.angles)


@dataclass(frozen=True, kw_only=True)
class Mapped:
    """One section of a listing and the table of the record that it shows.

    Its layout is `rows` (a row per entry), `across` (a label per row, an entry per column), `xyz` (three rows per
    entry), `labels` (a label per row; columns are labels, fields paths in the record; `Unknowns, *` stands for all
    that begin so) or `texts` (sentences: texts of a list, or the ids of each entry one behind the other).
    """

    title: str  # a regular expression for all of it
    table: str = ""  # by its path
    layout: Layout = "rows"
    ids: Mapping[str, str] = field(default_factory=dict)  # heading -> field; a second one of a name is `Photo#2`
    columns: Mapping[str, Origin] = field(default_factory=dict)  # heading (or label) -> origin
    nested: str = ""  # a field that is a table itself: a row for each of its rows, with the fields of both
    expand: Sequence[str] = ()  # fields that are lists of one length: a row for each of their entries
    take: Mapping[str, Sequence[str]] = field(default_factory=dict)  # only entries with these values are printed
    leave: Mapping[str, Sequence[str]] = field(default_factory=dict)  # entries with these are not
    words: Mapping[str, Mapping[str, str]] = field(default_factory=dict)  # field -> what it says -> what is printed
    also: Sequence[str] = ()  # of texts: further lists of texts, or tables whose field `text` is printed
    some: bool = False  # only some entries are printed
    unnamed: str = ""  # what is printed for an entry whose id is blank

    def source_of(self, label: str) -> Origin | None:
        """Return the origin of a column or label."""
        if label in self.columns:
            return self.columns[label]
        for pattern, source in self.columns.items():
            if pattern.endswith("*") and label.startswith(pattern[:-1]):
                return Origin(field=source.field[:-1] + label[len(pattern) - 1 :])
        return None

    def prints(self, row: Mapping[str, Any]) -> bool:
        """Tell whether an entry is one of those that are printed."""
        return all(str(row.get(key)) in values for key, values in self.take.items()) and not any(
            str(row.get(key)) in values for key, values in self.leave.items()
        )

    def worded(self, row: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return an entry with the words that are printed for what some of its fields say."""
        if not self.words:
            return row
        said = {key: str(row.get(key)) for key in self.words}
        return {**row, **{key: self.words[key].get(text, text) for key, text in said.items()}}
