"""The families of formats between which jobs are converted: native decks, those of other agencies, a user's own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from musatpy.errors import DeckError, Problem
from musatpy.formats import musat, parts
from musatpy.formats.cards.deck import write_cards
from musatpy.formats.cards.spec import Family, card_formats_folder
from musatpy.formats.job_tables import Tables
from musatpy.formats.records.layout import is_record_folder
from musatpy.formats.recordset import RecordSet, Rendered


@dataclass(frozen=True)
class DeckFamily:
    """Decks of cards: one file, which holds everything."""

    name: str
    cards: Family
    patterns: tuple[str, ...] = musat.PATTERNS

    def matches(self, path: Path) -> bool:
        """Return whether a file is named as a deck."""
        return any(path.match(pattern) for pattern in self.patterns)

    def targets(self, path: Path, stem: str) -> dict[Any, Path]:
        """Return the deck that is written."""
        return {self.name: path / self.patterns[0].replace("*", stem) if path.is_dir() else path}

    def read(self, path: Path, given: Tables) -> tuple[Tables, tuple[Problem, ...]]:
        """Return what a deck says; raises `DeckError` with every problem."""
        block, problems = musat.check_deck(path, self.cards)
        if block is None:
            raise DeckError(problems)
        return parts.parts_of(block), problems

    def render(self, given: Tables, path: Path, stem: str) -> Rendered:
        """Return a deck; what keeps it from running as it stands is a warning."""
        missing = parts.missing_parts(given)
        if missing:
            raise DeckError(missing)
        data = write_cards(parts.cards_of_parts(given, self.cards))
        _, problems = musat.check_deck(data, self.cards)
        (place,) = self.targets(path, stem).values()
        if "systems" in given:
            message = "SYS cards are left out: coordinates and attitudes are converted as the adjustment has them"
            problems = (Problem(message=message), *problems)
        warnings = tuple(replace(one, file=str(place), severity="warning") for one in problems)
        return Rendered(contents={place: data}, left_out=(), warnings=warnings)


FormatFamily = DeckFamily | RecordSet  # what both can do: name, patterns, matches, targets, read, render


def agencies() -> dict[str, RecordSet]:
    """Return the families of other agencies by name: the folders of card_formats that state files of records."""
    folders = [folder for folder in sorted(card_formats_folder().iterdir()) if is_record_folder(folder)]
    return {folder.name: RecordSet(folder) for folder in folders}


def families(own: Path | None = None) -> dict[str, FormatFamily]:
    """Return the families by name, and the one in the folder `own` of TOML files, which comes first.

    Raises `CardFormatError` for formats that are wrong.
    """
    families: dict[str, FormatFamily] = {}
    if own is not None:
        name = own.resolve().name
        families[name] = RecordSet(own) if is_record_folder(own) else DeckFamily(name, musat.card_family(own))
        families[name].patterns  # noqa: B018 - wrong formats are found now
    families.setdefault("musat", DeckFamily("musat", musat.card_family()))
    for name, family in agencies().items():
        families.setdefault(name, family)
    return families
