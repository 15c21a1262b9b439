"""One job from deck to listing: read, adjust, analyse, report. The only pipeline."""

from __future__ import annotations

import datetime
import json
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from musatpy.blunders import adjust
from musatpy.errors import MusatError, PlatesError, Problem, ProblemsError
from musatpy.formats.musat import check_deck, deck_bytes, plate_problems, read_deck
from musatpy.model import Iteration, Solution
from musatpy.reports.listing import listing_of
from musatpy.reports.record import dumps, record_of
from musatpy.statistics import Statistics

if TYPE_CHECKING:
    from musatpy.comparison import Comparison
    from musatpy.formats.cards.spec import Family
    from musatpy.jobs.punch import Punch


class ExitStatus(IntEnum):
    """What a run comes to; the exit status of the command."""

    CONVERGED = 0
    UNUSABLE = 1  # the deck or the data cannot be used
    USAGE = 2  # wrong command line
    NOT_CONVERGED = 3  # the listing says why, and is written


@dataclass(frozen=True, kw_only=True, eq=False)
class RunResult:
    """One deck after its run."""

    deck: Path
    status: ExitStatus
    problems: tuple[Problem, ...]  # every reason of an unusable deck; else the warnings of its check
    solution: Solution | None  # None: unusable
    listing: Path | None  # where the listing is
    record: Path | None  # where the JSON record is
    edited: Path | None = None  # where the edited deck is, if one was to be punched
    punched: Path | None = None  # where the deck to go on with is, likewise


def run_deck(
    deck: Path | str,
    out_dir: Path | str | None = None,
    *,
    carriage_control: bool = False,
    date: datetime.date | None = None,
    progress: Callable[[Iteration], None] | None = None,
    family: Family | None = None,
    punch_edits: bool = False,
    punch: Punch | None = None,
) -> RunResult:
    """Run one deck and write `NAME.lst` and `NAME.json` beside it, or in `out_dir` (made where it is missing).

    With `punch_edits` also `NAME.edited.crd`, the deck without the blunders that were found, where its options have
    these looked for; a warning says where they do not. With `punch` also `NAME.pun`, a deck to go on with.
    A deck that cannot be read or adjusted leaves no files; every reason is in `problems`. `progress` is called
    after each iteration; `family` is that of `musatpy.formats.musat.check_deck`. Raises `MusatError` where the
    results would overwrite the deck, and `OSError` where they cannot be written.
    """
    deck = Path(deck)
    check_outputs([deck], out_dir, punch_edits=punch_edits, punch=punch is not None)
    block, problems = check_deck(deck, family)
    if block is None:
        return _unusable(deck, problems)
    try:
        solution = adjust(block, progress)
    except PlatesError as error:
        return _unusable(deck, (*plate_problems(deck, error.refusals, family=family), *problems))
    except ProblemsError as error:
        return _unusable(deck, (*error.problems, *problems))
    if solution.reduced is not None and solution.reduced.refusals:
        left_out = {photo: f"left out: {why}" for photo, why in solution.reduced.refusals.items()}
        problems = (*problems, *plate_problems(deck, left_out, family=family, severity="warning"))
    statistics = Statistics(solution)
    paths = _paths(deck, out_dir, punch_edits, punch is not None)
    listing, record = paths["lst"], paths["json"]
    text = listing_of(statistics, carriage_control=carriage_control, date=date)
    files = {listing: text.encode(), record: dumps(record_of(statistics)).encode()}
    decks, notes = _punched_decks(solution, punch_edits, punch, family)
    files |= {paths[ending]: data for ending, data in decks.items()}
    write_files(files)
    warnings = (Problem(file=str(deck), message=note, severity="warning") for note in notes)
    return RunResult(
        deck=deck,
        status=ExitStatus.CONVERGED if solution.converged else ExitStatus.NOT_CONVERGED,
        problems=(*problems, *warnings),
        solution=solution,
        listing=listing,
        record=record,
        edited=paths["edited.crd"] if "edited.crd" in decks else None,
        punched=paths["pun"] if "pun" in decks else None,
    )


def _punched_decks(
    solution: Solution, punch_edits: bool, punch: Punch | None, family: Family | None
) -> tuple[dict[str, bytes], tuple[str, ...]]:
    """Return the decks that are punched of a solution, by their endings, and what to note about them."""
    decks: dict[str, bytes] = {}
    notes: list[str] = []
    if punch_edits and solution.edited is None:
        notes.append("no edited deck: the options do not have blunders looked for (OP2 editing)")
    elif solution.edited is not None and punch_edits:
        decks["edited.crd"] = deck_bytes(solution.edited, family)
    if punch is not None:
        from musatpy.jobs.punch import punched  # costs the start of every run else

        block, found = punched(solution, punch)
        notes += [f"punched deck: {note}" for note in found]
        try:
            decks["pun"] = deck_bytes(block, family)
        except ProblemsError as error:
            notes += [f"no punched deck: {problem.headline()}" for problem in error.problems]
    return decks, tuple(notes)


def compared(first: Path, second: Path, labels: tuple[str, str]) -> Comparison:
    """Return the comparison of two solutions, each a record that a run left (`.json`), or a deck that is adjusted.

    Raises `MusatError` where a file is neither, or they are not of one block, and `OSError`.
    """
    from musatpy.comparison import compare

    return compare(_record_at(first), _record_at(second), labels)


def _record_at(path: Path) -> dict[str, Any]:
    if path.suffix != ".json":
        return record_of(Statistics(adjust(read_deck(path))))
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise MusatError(f"{path} is no JSON: {error}") from error
    if not isinstance(record, dict) or not {"options", "stations", "points", "solution"} <= record.keys():
        raise MusatError(f"{path} is not the record of a run")
    return record


def comparison_text(found: Comparison, listed: int) -> str:
    """Return a comparison as text, `listed` rows of each table."""
    from musatpy.reports import comparison

    return comparison.comparison_text(found, listed)


def comparison_json(found: Comparison) -> str:
    """Return a whole comparison as JSON text."""
    from musatpy.reports import comparison

    return json.dumps(comparison.comparison_record(found), indent=1) + "\n"


def output_paths(
    deck: Path, out_dir: Path | str | None = None, *, punch_edits: bool = False, punch: bool = False
) -> tuple[Path, ...]:
    """Return where the listing and the record of a deck go, and the decks that are punched."""
    return tuple(_paths(deck, out_dir, punch_edits, punch).values())


def _paths(deck: Path, out_dir: Path | str | None, punch_edits: bool, punch: bool) -> dict[str, Path]:
    """Return where all that a run leaves goes, by its ending."""
    folder = deck.parent if out_dir is None else Path(out_dir)
    endings = ("lst", "json", *(["edited.crd"] if punch_edits else []), *(["pun"] if punch else []))
    return {ending: folder / f"{deck.stem}.{ending}" for ending in endings}


def check_outputs(
    decks: Iterable[Path], out_dir: Path | str | None = None, *, punch_edits: bool = False, punch: bool = False
) -> None:
    """Raise `MusatError` where two decks would write the same file, or one would overwrite a deck."""
    decks = list(decks)
    sources = {deck.resolve(): deck for deck in decks}
    written: dict[Path, Path] = {}
    for deck in decks:
        for path in output_paths(deck, out_dir, punch_edits=punch_edits, punch=punch):
            place = path.resolve()
            if place in sources:
                raise MusatError(f"the results of {deck} would overwrite the deck {sources[place]}")
            if place in written:
                raise MusatError(f"the results of {written[place]} and {deck} would both go to {path}")
            written[place] = deck


def write_files(files: Mapping[Path, bytes]) -> None:
    """Write all files under temporary names in their folders, then rename them: never half a file.

    None is renamed before all are written, so that a full disk leaves the files of an earlier run as they were.
    Folders that are missing are made. Raises `OSError`.
    """
    temporary = {path: path.with_name(f".{path.name}.{os.getpid()}") for path in files}
    try:
        for path, data in files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary[path].write_bytes(data)
        for path in files:
            temporary[path].replace(path)
    finally:
        for leftover in temporary.values():
            leftover.unlink(missing_ok=True)


def _unusable(deck: Path, problems: tuple[Problem, ...]) -> RunResult:
    return RunResult(
        deck=deck, status=ExitStatus.UNUSABLE, problems=problems, solution=None, listing=None, record=None
    )
