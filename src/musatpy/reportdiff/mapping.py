"""Where the numbers of a listing stand in its record: `listing_record.toml`, read and checked."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal

from musatpy.specs import read_toml

_FILE = Path(__file__).with_name("listing_record.toml")


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where one printed value comes from; the keys are explained in `listing_record.toml`."""

    field: str
    minus: str = ""
    then: Sequence[str] = ()
    unit: str = ""
    where: str = ""
    unless: str = ""
    true: str = ""
    false: str = ""
    null: float | None = None
    count: bool = False
    sum: bool = False
    norm: bool = False
    ellipse: str = ""
    unit_in: str = ""
    angles: str = ""
    marks: str = ""
    blank: bool = False

    @cached_property
    def is_field(self) -> bool:
        """True where the value is that of one field, as it is."""
        changed = self.minus or self.where or self.true or self.false or self.count or self.sum
        return not (changed or self.norm or self.ellipse or self.unit_in or self.angles)


@dataclass(frozen=True, kw_only=True)
class Mapped:
    """One section of a listing and the table of the record that it shows."""

    title: str
    table: str = ""
    layout: Literal["rows", "across", "xyz", "labels", "texts"] = "rows"
    ids: Mapping[str, str] = field(default_factory=dict)
    columns: Mapping[str, Source] = field(default_factory=dict)
    nested: str = ""
    expand: Sequence[str] = ()
    take: Mapping[str, Sequence[str]] = field(default_factory=dict)
    leave: Mapping[str, Sequence[str]] = field(default_factory=dict)
    words: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    also: Sequence[str] = ()
    some: bool = False
    unnamed: str = ""

    def source_of(self, label: str) -> Source | None:
        """Return the source of a column or label; a label `Unknowns, *` stands for all that begin so."""
        if label in self.columns:
            return self.columns[label]
        for pattern, source in self.columns.items():
            if pattern.endswith("*") and label.startswith(pattern[:-1]):
                return Source(field=source.field[:-1] + label[len(pattern) - 1 :])
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


@lru_cache(maxsize=1)
def mapped_sections() -> tuple[Mapped, ...]:
    """Return all sections that have numbers in the record."""
    content = read_toml(_FILE)
    return tuple(_mapped(table, content["sets"]) for table in content["section"])


def mapped_section(title: str) -> Mapped | None:
    """Return what is known of the section of a title, None where it has no numbers in the record."""
    return next((one for one in mapped_sections() if re.fullmatch(one.title, title)), None)


def _mapped(table: Mapping[str, Any], sets: Mapping[str, Mapping[str, int]]) -> Mapped:
    columns = {heading: _source(value) for heading, value in table.get("columns", {}).items()}
    for name, value in table.get("sets", {}).items():
        columns.update(_of_set(sets[name], _source(value)))
    others = {key: value for key, value in table.items() if key not in ("columns", "sets")}
    return Mapped(**others, columns=columns)


def _source(value: str | Mapping[str, Any]) -> Source:
    return Source(field=value) if isinstance(value, str) else Source(**value)


def _of_set(headings: Mapping[str, int], source: Source) -> Iterator[tuple[str, Source]]:
    for heading, index in headings.items():
        where = f"{source.where}[{index}]" if source.where else ""
        yield heading, Source(field=f"{source.field}[{index}]", where=where)
