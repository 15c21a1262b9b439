"""One job from deck to listing: read, adjust, analyse, report."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from musatpy.errors import MusatError, PlatesError, Problem, ProblemsError, numerics
from musatpy.files import real_path, write_files
from musatpy.formats.cards.settings import deck_with
from musatpy.formats.job_tables import card_family
from musatpy.formats.musat import CheckedDeck, checked_deck, deck_files, read_deck
from musatpy.jobs.point_flags import PointFlags, flags_set
from musatpy.memory import give_back
from musatpy.model import Block, CauseSearch, Grade, RecordContent, Solution, Verdict
from musatpy.model.progress import Progress, begin
from musatpy.pipeline import adjust
from musatpy.reports.listing import in_columns, printed, sections_of
from musatpy.reports.pages import csv_files
from musatpy.reports.record import record_of, texts_of
from musatpy.statistics import Statistics

if TYPE_CHECKING:
    from musatpy.comparison import ComparedRuns
    from musatpy.formats.cards.settings import Setting
    from musatpy.formats.cards.spec import Family
    from musatpy.formats.families import FormatFamily
    from musatpy.jobs.punch import Punch


class ExitStatus(IntEnum):
    """What a run comes to; the exit status of the command."""

    DONE = 0  # converged, accepted or doubtful
    UNUSABLE = 1  # the deck or the data cannot be used
    USAGE = 2  # wrong command line
    NOT_CONVERGED = 3  # the listing says why, and is written
    REJECTED = 4  # converged, but not to be used; doubtful where that is asked for

    @classmethod
    def worst(cls, statuses: Iterable[ExitStatus]) -> ExitStatus:
        """Return the one that tells of several decks: 1 before 3 before 4."""
        order = (cls.USAGE, cls.UNUSABLE, cls.NOT_CONVERGED, cls.REJECTED, cls.DONE)
        return min(statuses, key=order.index, default=cls.DONE)

    @classmethod
    def of(cls, grade: Grade, *, strict: bool = False) -> ExitStatus:
        """Return what a run with this verdict ends with; `strict`: a doubtful answer is not to be used."""
        if grade is Grade.DOUBTFUL:
            return cls.REJECTED if strict else cls.DONE
        return {Grade.FAILED: cls.NOT_CONVERGED, Grade.REJECTED: cls.REJECTED}.get(grade, cls.DONE)


@dataclass(frozen=True, kw_only=True, eq=False)
class RunResult:
    """One deck after its run."""

    deck: Path
    status: ExitStatus
    problems: tuple[Problem, ...]  # every reason of an unusable deck; else warnings
    checked: tuple[Problem, ...] = ()  # those among them that the check of the deck gives, before it is adjusted
    solution: Solution | None = None  # None: unusable
    verdict: Verdict | None = None  # likewise
    listing: Path | None = None  # where the listing is
    punched: tuple[Path, ...] = ()  # where the deck to go on with is, or the files of another family
    files: tuple[Path, ...] = ()  # all that were written

    @property
    def record(self) -> Path | None:
        """Return where the JSON record is, if there was to be one."""
        return next((path for path in self.files if path.suffix == ".json"), None)

    @property
    def edited(self) -> Path | None:
        """Return where the edited deck is, if one was to be punched."""
        return next((path for path in self.files if path.name.endswith(".edited.crd")), None)


def run_deck(
    deck: Path | str,
    out_dir: Path | str | None = None,
    *,
    carriage_control: bool = False,
    brief: bool = False,
    csv: bool = False,
    strict: bool = False,
    date: datetime.date | None = None,
    progress: Progress | None = None,
    family: Family | None = None,
    punch_edits: bool = False,
    punch: Punch | None = None,
    punch_family: FormatFamily | None = None,
    on_read: Callable[[Block], None] | None = None,
    settings: Sequence[Setting] = (),
    flags: PointFlags | None = None,
    record: RecordContent = RecordContent.FULL,
    causes: CauseSearch = CauseSearch.USUAL,
) -> RunResult:
    """Run one deck and write `NAME.lst` and `NAME.json` beside it, or in `out_dir` (made where it is missing).

    With `punch_edits` also `NAME.edited.crd`, the deck without the blunders that were found, where its options have
    these looked for; a warning says where they do not. With `punch` also `NAME.pun`, a deck to go on with, or the
    files of `punch_family` that hold as much of it as they can.
    `csv` writes the tables of the listing too, in the folder `NAME_tables`. `record` says what the record has: with
    `NONE` there is none, nor one of an earlier run. `brief` leaves the echo of the input and the residuals out of
    the listing; `strict` makes the status of a doubtful answer that of a rejected one. `causes` says how far those
    of a run that is not accepted are looked for.
    A deck that cannot be read or adjusted leaves no files; every reason is in `problems`. `on_read` is called with
    the block before it is adjusted, `progress` after each iteration, and as each phase begins where it is a
    `Watcher`; `family` and `settings` are those of `musatpy.formats.musat.checked_deck`, `flags` stand beside those
    of the cards. Raises `MusatError` where the results would overwrite what is read, and `OSError`.
    """
    deck, punching = Path(deck), punch is not None
    check_outputs([deck], out_dir, punch_edits=punch_edits, punch=punching, punch_family=punch_family, flags=flags)
    begin(progress, "reading")
    checked = _checked(deck, family, settings, flags)
    if (block := checked.block) is None:
        return RunResult(deck=deck, status=ExitStatus.UNUSABLE, problems=checked.problems)
    if on_read is not None:
        on_read(block)
    solution, problems = _adjusted(checked, block, progress, causes)
    if solution is None:
        return RunResult(deck=deck, status=ExitStatus.UNUSABLE, problems=problems)
    listing, place = output_paths(deck, out_dir)
    edited, notes = _edited_deck(deck, settings, solution, listing, family) if punch_edits else ({}, ())
    punched, more = _punched(solution, punch, listing.with_suffix(".pun"), family, punch_family)
    try:
        with numerics("the statistics of the solution"):
            begin(progress, "statistics")
            statistics = Statistics(solution)
            shown, sections = in_columns(statistics, brief=brief, progress=progress)
            pages = map(str.encode, printed(shown, sections, carriage_control=carriage_control, date=date))
            tables = csv_files(sections if shown is statistics else sections_of(statistics), listing) if csv else {}
            del sections  # they are gone when they are printed
        begin(progress, "record")
        recorded = {place: map(str.encode, texts_of(statistics, record))} if record != RecordContent.NONE else {}
        files: dict[Path, bytes | Iterable[bytes]] = {listing: pages, **recorded, **tables, **edited, **punched}
        with numerics("the record of the solution"):  # made while it is written
            write_files(files, outdated=() if recorded else (place,))
    except ProblemsError as error:
        return RunResult(deck=deck, status=ExitStatus.UNUSABLE, problems=(*error.problems, *problems))
    return RunResult(
        deck=deck,
        status=ExitStatus.of(statistics.verdict.grade, strict=strict),
        problems=(*problems, *_warnings(deck, *notes, *more)),
        checked=checked.problems,
        solution=solution,
        verdict=statistics.verdict,
        listing=listing,
        punched=tuple(punched),
        files=tuple(files),
    )


def _checked(
    deck: Path, family: Family | None, settings: Sequence[Setting], wanted: PointFlags | None
) -> CheckedDeck:
    """Return a deck with its problems; its cards only where the reduction of raw plates may have more to say."""
    checked = checked_deck(deck, family, settings=settings)
    if checked.block is not None and wanted not in (None, PointFlags()):
        try:
            more = flags_set(checked.block, wanted)
        except ProblemsError as error:
            return CheckedDeck(block=None, problems=(*error.problems, *checked.problems))
        checked = checked_deck(deck, family, settings=settings, flags=more.flags)
        if checked.block is not None:
            block = replace(checked.block, settings=(*checked.block.settings, *more.settings))
            checked = replace(checked, block=block, problems=(*checked.problems, *_warnings(deck, *more.undecided)))
    return checked if checked.block is None or checked.block.raw else replace(checked, draft=None)


def _warnings(deck: Path, *notes: str) -> Iterator[Problem]:
    return (Problem(file=str(deck), message=note, severity="warning") for note in notes)


def _adjusted(
    deck: CheckedDeck, block: Block, progress: Progress | None, causes: CauseSearch
) -> tuple[Solution | None, tuple[Problem, ...]]:
    """Return the solution of the block of a deck, None where there is none, and all problems, those of it first."""
    if causes is not CauseSearch.USUAL:
        block = replace(block, settings=(*block.settings, f"causes={causes}"))
    give_back()
    try:
        with numerics("the job"):
            solution = adjust(block, progress, causes=causes)
    except PlatesError as error:
        return None, (*deck.plate_problems(error.refusals, error.by_heights), *deck.problems)
    except ProblemsError as error:
        return None, (*error.problems, *deck.problems)
    give_back()
    if solution.reduced is None or not solution.reduced.refusals:
        return solution, deck.problems
    left_out = {photo: f"left out: {why}" for photo, why in solution.reduced.refusals.items()}
    by_heights = solution.reduced.by_heights
    return solution, (*deck.plate_problems(left_out, by_heights, "warning"), *deck.problems)


def _edited_deck(
    deck: Path, settings: Sequence[Setting], solution: Solution, listing: Path, family: Family | None
) -> tuple[dict[Path, bytes], tuple[str, ...]]:
    """Return the deck without the blunders that were found, and why there is none, or it is another one."""
    if solution.edited is None:
        return {}, ("no edited deck: the options do not ask for a search for blunders (OP2 editing)",)
    from musatpy.formats.edited_deck import edited_deck

    place = listing.with_suffix(".edited.crd")
    if deck.is_dir():  # a job
        return deck_files(solution.edited, place, family), ()
    data = edited_deck(deck_with(deck.read_bytes(), settings), solution.edited, family or card_family())
    if data is None:
        note = "the edited deck has all its cards anew: not all of the edits are changes of single cards"
        return deck_files(solution.edited, place, family), (note,)
    return {place: data}, ()


def _punched(
    solution: Solution, punch: Punch | None, place: Path, family: Family | None, other: FormatFamily | None
) -> tuple[dict[Path, bytes], tuple[str, ...]]:
    """Return the deck to go on with, or the files of the family `other`, if asked for, and notes about them."""
    if punch is None:
        return {}, ()
    from musatpy.jobs.punch import punched  # costs the start of every run else

    block, lines = punched(solution, punch)
    notes = tuple(f"punched deck: {note}" for note in lines)
    try:
        if other is None:
            return deck_files(block, place, family), notes
        from musatpy.formats.parts import parts_of

        rendered = other.render(parts_of(block), place, place.stem)
    except ProblemsError as error:
        return {}, notes + tuple(f"no punched deck: {problem.headline()}" for problem in error.problems)
    return rendered.contents, notes + tuple(f"punched files: {line}" for line in rendered.left_out)


def compared(first: Path, second: Path, labels: tuple[str, str]) -> ComparedRuns:
    """Return the comparison of two solutions, each a record that a run left (`.json`), or a deck that is adjusted.

    One of them may be the truth of a simulation: it is then the first. Raises `MusatError` where a file is none of
    these, or they are not of one block, and `OSError`.
    """
    from musatpy.comparison import compare

    records = [_solution_or_truth(path) for path in (first, second)]
    if "solution" not in records[1]:
        records, labels = records[::-1], labels[::-1]
    one, other = records
    return compare(one, other, labels)


def _solution_or_truth(path: Path) -> Mapping[str, Any]:
    from musatpy.comparison import OPTIONAL, TABLES, is_truth_record, tables_of_truth
    from musatpy.records.json_files import read_json_file, tables_of

    if path.suffix != ".json":
        return _record_at(path, TABLES, OPTIONAL)
    content = read_json_file(path)
    return (
        tables_of_truth(content, path) if is_truth_record(content) else tables_of(content, path, TABLES, OPTIONAL)
    )


def _record_at(path: Path, tables: Sequence[str], optional: Sequence[str] = ()) -> dict[str, Any]:
    """Return tables of a record, or of that of a deck, which is adjusted."""
    if path.suffix != ".json":
        return record_of(Statistics(adjust(read_deck(path))), {*tables, *optional})
    from musatpy.records.json_files import read_record

    return read_record(path, tables, optional)


def inquiry_text(path: Path, name: str) -> str:
    """Return what a run knows of the point and the photo of a name: of its record (`.json`), or its deck.

    Raises `MusatError` where there is neither, or the file cannot be used, and `OSError`.
    """
    from musatpy.records.inquiry import TABLES, inquire
    from musatpy.reports import inquiry

    record = _record_at(path, TABLES)
    return "\n".join(inquiry.inquiry_text(record, about) for about in inquire(record, name))


def output_paths(
    deck: Path,
    out_dir: Path | str | None = None,
    *,
    punch_edits: bool = False,
    punch: bool = False,
    punch_family: FormatFamily | None = None,
) -> tuple[Path, ...]:
    """Return where the listing and the record of a deck go, and the decks or files that are punched."""
    folder = deck.parent if out_dir is None else Path(out_dir)
    paths = [folder / f"{deck.stem}.{ending}" for ending in ("lst", "json")]
    if punch_edits:
        paths.append(folder / f"{deck.stem}.edited.crd")
    if punch:
        place = folder / f"{deck.stem}.pun"
        paths += [place] if punch_family is None else punch_family.targets(place, deck.stem).values()
    return tuple(paths)


def check_outputs(
    decks: Iterable[Path],
    out_dir: Path | str | None = None,
    *,
    punch_edits: bool = False,
    punch: bool = False,
    punch_family: FormatFamily | None = None,
    flags: PointFlags | None = None,
) -> None:
    """Raise `MusatError` where two decks would write the same file, or one would overwrite what is read."""
    decks = list(decks)
    sources = {real_path(deck): f"the deck {deck}" for deck in decks}
    sources |= {real_path(path): f"{path}, which is read" for path in (flags or PointFlags()).files.values()}
    written: dict[Path, Path] = {}
    for deck in decks:
        for path in output_paths(deck, out_dir, punch_edits=punch_edits, punch=punch, punch_family=punch_family):
            place = real_path(path)
            if place in sources:
                raise MusatError(f"the results of {deck} would overwrite {sources[place]}")
            if place in written:
                raise MusatError(f"the results of {written[place]} and {deck} would both go to {path}")
            written[place] = deck
