"""The native deck: 80-column cards of the musat family <-> `Block`."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from musatpy import model
from musatpy.errors import DeckError, Problem, in_order
from musatpy.files import write_files
from musatpy.formats import assembly
from musatpy.formats.cards.deck import read_cards, until, write_cards
from musatpy.formats.cards.settings import Setting, deck_with
from musatpy.formats.cards.spec import Family
from musatpy.formats.checks import check_entered, cross_check
from musatpy.formats.draft import Draft, draft_of
from musatpy.formats.job_folder import draft_of_tables, is_job, placed, read_job
from musatpy.formats.job_tables import Flags, Tables, card_family
from musatpy.formats.short_ids import names_csv, short_block
from musatpy.formats.statements import answer_problems, entered_draft

PATTERNS = ("*.crd",)
_GEOCENTRIC = model.CoordinateSystem.GEOCENTRIC


def geoid_files(block: model.Block) -> tuple[str, ...]:
    """Return the grid files of the geoid models of a block, as its deck names them."""
    specs = (block.given_in, block.stated_in)
    return tuple(dict.fromkeys(spec.geoid for spec in specs if spec is not None and spec.geoid))


def geoid_file(name: str) -> Path:
    """Return where the grid file of a geoid model is. Raises `SystemsError` where there is none of that name."""
    from musatpy.geometry.projected import grid_file  # more of PROJ than other jobs need

    return grid_file(name)


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckedDeck:
    """A deck as read: its block, None where it has errors, and every problem of its cards and between them."""

    block: model.Block | None
    problems: tuple[Problem, ...]
    draft: Draft | None = None  # None where it has no card

    def plate_problems(
        self,
        refusals: Mapping[str, str],
        by_heights: Collection[str] = (),
        severity: Literal["error", "warning"] = "error",
    ) -> tuple[Problem, ...]:
        """Return what is wrong with raw plates at their cards: `refusals` says why of each photo.

        A plate is shown by the first mark that is measured on it, else by its first point. Those of the photos
        `by_heights` are refused by the heights of camera and ground: they are shown by that of their station, or,
        where they are all plates, once by that of the ground, which they share.
        """
        draft = self.draft
        assert draft is not None  # there are plates
        high = [photo for photo in refusals if photo in by_heights]
        measured = np.unique(draft.photo["plates"])
        if 1 < len(high) == np.count_nonzero(measured >= 0):
            message = f"photo {high[0]}, like {len(high) - 1} more: {refusals[high[0]]}"
            return (draft.problem("reduction", 0, message, path="reduction.ground_height", severity=severity),)
        problems = []
        for photo, why in refusals.items():
            roles = ("stations",) * (photo in by_heights) + ("fiducial_measurements", "plates")
            cards = ((role, np.flatnonzero((draft.photo_ids == photo)[draft.photo[role]])) for role in roles)
            role, row = next((role, int(rows[0])) for role, rows in cards if len(rows))
            path, component = f"{role}.photo", None
            if role == "stations":  # its height, which all three make in a geocentric job
                path, component = "photos.position", None if draft.system is _GEOCENTRIC else 2
            message = f"photo {photo}: {why}"
            problems.append(draft.problem(role, row, message, path=path, component=component, severity=severity))
        return tuple(problems)


def check_deck(
    source: Path | str | bytes | Tables,
    family: Family | None = None,
    *,
    for_run: bool = True,
    settings: Sequence[Setting] = (),
) -> tuple[model.Block | None, tuple[Problem, ...]]:
    """Return the block of a deck, None where it has errors, and its problems: see `checked_deck`."""
    checked = checked_deck(source, family, for_run=for_run, settings=settings)
    return checked.block, checked.problems


def checked_deck(
    source: Path | str | bytes | Tables,
    family: Family | None = None,
    *,
    for_run: bool = True,
    settings: Sequence[Setting] = (),
    flags: Flags | None = None,
) -> CheckedDeck:
    """Return a deck with every problem of its cards and between them.

    `source` is a path, the bytes of a deck, or the tables of a job. A file that cannot be read is a problem
    like any other. A deck that is not to be run as it is may lack measurements and a datum. `settings` stand in
    place of what its cards say, `flags` beside those of its cards.
    """
    family = family or card_family()
    try:
        name = None if isinstance(source, bytes | dict) else str(source)
        if name is not None and is_job(source):
            source = read_job(Path(name)).tables
        if isinstance(source, dict):
            draft = draft_of_tables(source, name or "", family, settings, flags)
            checked = _between_cards(draft, [], settings, for_run)
            return replace(checked, problems=tuple(placed(problem, draft) for problem in checked.problems))
        if settings:
            source = deck_with(source if isinstance(source, bytes) else Path(source).read_bytes(), settings)
        deck = read_cards(source, family, name)
    except DeckError as error:
        return CheckedDeck(block=None, problems=error.problems)
    except OSError as error:
        problem = Problem(file=str(source), message=error.strerror or str(error))
        return CheckedDeck(block=None, problems=(problem,))
    if not any(map(len, deck.lines.values())):
        return CheckedDeck(block=None, problems=deck.problems)
    draft = draft_of(deck, family, flags)
    no_plates = [spec.mnemonic for spec in draft.rows["plates"].specs] if not for_run else []
    problems = [problem for problem in deck.problems if problem.line is not None or problem.card not in no_plates]
    return _between_cards(draft, problems, settings, for_run)


def _between_cards(
    draft: Draft, problems: list[Problem], settings: Sequence[Setting], for_run: bool
) -> CheckedDeck:
    """Return a deck with the problems of its cards, and those between them."""
    problems = list(until(draft.deck.end, [*problems, *cross_check(draft, for_run=for_run)]))
    block = None if has_errors(problems) else assembly.block_of(draft)
    entered = draft
    if block is not None and draft.given_in is not None:
        entered, block, of_system = entered_draft(draft, block)
        problems += of_system if has_errors(of_system) else [*of_system, *check_entered(entered, for_run=for_run)]
    if block is not None and draft.stated_in is not None and not has_errors(problems):
        problems += answer_problems(entered, block)
    if block is not None and settings:
        block = replace(block, settings=tuple(map(str, settings)))
    return CheckedDeck(block=None if has_errors(problems) else block, problems=in_order(problems), draft=draft)


def has_errors(problems: Iterable[Problem]) -> bool:
    """Return whether problems keep what they are of from being used."""
    return any(problem.severity == "error" for problem in problems)


def read_deck(source: Path | str | bytes, family: Family | None = None) -> model.Block:
    """Return the block that a deck describes; raises `DeckError` with every problem where there is an error."""
    block, problems = check_deck(source, family)
    if block is None:
        raise DeckError(problems)
    return block


def deck_bytes(block: model.Block, family: Family | None = None) -> bytes:
    """Return the canonical deck of a block; raises `DeckError` with every value that its field cannot hold.

    Raises `SystemsError` where a block cannot be stated as its deck is to be.
    """
    return write_cards(assembly.cards_of(block, family or card_family()))


def deck_files(block: model.Block, place: Path, family: Family | None = None) -> dict[Path, bytes]:
    """Return the deck of a block, and NAME.ids.csv where its names do not go into cards. Raises as `deck_bytes`."""
    block, renamed = short_block(block)
    names = {place.with_suffix(".ids.csv"): names_csv(renamed)} if renamed else {}
    return {place: deck_bytes(block, family), **names}


def write_deck(block: model.Block, path: Path | str, family: Family | None = None) -> None:
    """Write the canonical deck of a block under a temporary name and rename it: never half a file.

    Raises `DeckError` as `deck_bytes` does, and `OSError`.
    """
    write_files({Path(path): deck_bytes(block, family)})
