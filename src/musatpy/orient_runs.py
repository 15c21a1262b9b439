"""One deck from its cards to the orientation of its photos: read, orient, report (`musat orient`)."""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from pathlib import Path

from musatpy.errors import MusatError, Problem, ProblemsError
from musatpy.figures import FORM, ImageForm
from musatpy.files import write_files
from musatpy.formats.cards.spec import Family
from musatpy.formats.musat import checked_deck, deck_bytes
from musatpy.orientation.twomedia.oriented import NotConvergedError
from musatpy.orienting.answer import Answer, answer_of
from musatpy.orienting.placement import punched
from musatpy.orienting.strip_answer import StripAnswer
from musatpy.orienting.task import NO_CARD
from musatpy.reports import orientation, orientation_strip
from musatpy.reports.pages import csv_files
from musatpy.reports.record import dumps
from musatpy.runs import ExitStatus, output_paths


@dataclass(frozen=True, kw_only=True, eq=False)
class OrientResult:
    """One deck after its orientation: the answer, None where there is none, and the files that were written."""

    deck: Path
    status: ExitStatus
    problems: tuple[Problem, ...]
    answer: Answer | StripAnswer | None
    files: tuple[Path, ...] = ()  # the listing first, then the record, the punched deck, tables


def orient_deck(
    deck: Path,
    out_dir: Path | None = None,
    *,
    carriage_control: bool = False,
    csv: bool = False,
    punch: bool = False,
    study: bool = False,
    form: ImageForm = FORM,
    strict: bool = False,
    date: datetime.date | None = None,
    family: Family | None = None,
) -> OrientResult:
    """Orient the photos of a deck and write `NAME.lst` and `NAME.json` beside it, or in `out_dir`.

    With `punch` also `NAME.pun`, a deck that a run starts from; with `csv` the tables of the listing, in
    `NAME_tables`; with `study` what starts and depths do to the orientation, as `NAME.study.txt` and pictures in a
    `form` (the extra `plots`); `strict` makes the status of a doubtful answer that of a rejected one. A deck that
    gives no orientation leaves no files, and every reason is in `problems`. Raises `OSError` where files cannot be
    written.
    """
    checked = checked_deck(deck, family, for_run=False)
    if checked.draft is not None and not checked.draft.to_orient:
        return _unusable(deck, Problem(file=str(deck), message=NO_CARD), *checked.problems)
    if checked.block is None:
        return _unusable(deck, *checked.problems)
    try:
        answer = answer_of(checked.block)
    except ProblemsError as error:
        return _unusable(deck, *error.problems, *checked.problems)
    except MusatError as error:
        failed = isinstance(error, NotConvergedError)
        status = ExitStatus.NOT_CONVERGED if failed else ExitStatus.UNUSABLE
        return _unusable(deck, Problem(file=str(deck), message=str(error)), *checked.problems, status=status)
    if isinstance(answer, StripAnswer):
        sections, values = orientation_strip.sections_of(answer), orientation_strip.DOCUMENT.record(answer)
    else:
        sections, values = orientation.sections_of(answer), orientation.DOCUMENT.record(answer)
    paths = output_paths(deck, out_dir, punch=punch)
    texts = [
        orientation.listing_of(answer, sections, carriage_control=carriage_control, date=date),
        dumps(values),
    ]
    files = {path: text.encode() for path, text in zip(paths, texts, strict=False)}
    if punch:
        files[paths[2]] = deck_bytes(punched(answer.task, answer.at), family)
    if csv:
        files |= csv_files(sections, paths[0])
    if study:
        files |= _studied(answer, paths[0], form)
    write_files(files)
    return OrientResult(
        deck=deck,
        status=ExitStatus.of(answer.verdict.grade, strict=strict),
        problems=checked.problems,
        answer=answer,
        files=tuple(files),
    )


def _studied(answer: Answer | StripAnswer, listing: Path, form: ImageForm) -> dict[Path, bytes]:
    """Return the study of an orientation, as text and pictures beside the listing.

    Pictures are of the correlations, the basins, the precision where the water is free. The study of a strip is
    that of the triplet that determines the water least, with a picture of its sigmas where it has any. Raises
    `MusatError` without the extra `plots`.
    """
    from musatpy.orientation.twomedia import pictures  # few users draw
    from musatpy.orientation.twomedia.study import study

    title = answer.block.titles[0] if answer.block.titles else listing.stem
    limit = answer.task.spec.limit
    of = answer.oriented if isinstance(answer, Answer) else answer.strip.triplets[answer.strip.weakest].oriented
    result = study(of)
    drawn = {
        "correlations": pictures.correlation_picture(of, title, form),
        "basins": pictures.basins_picture(result.basins, title, form),
    }
    if result.precision is not None:
        drawn["precision"] = pictures.precision_picture(result.precision, title, limit, form)
    if isinstance(answer, StripAnswer) and answer.solution is not None:
        drawn["strip"] = pictures.strip_picture(
            answer.photos, answer.position_sigma, answer.chain_difference, title, form
        )
    text = orientation_strip.study_text(result, title, limit)
    pictured = {listing.with_suffix(f".{name}.{suffix}"): image for name, (suffix, image) in drawn.items()}
    return {listing.with_suffix(".study.txt"): text.encode()} | pictured


def _unusable(deck: Path, *problems: Problem, status: ExitStatus = ExitStatus.UNUSABLE) -> OrientResult:
    return OrientResult(deck=deck, status=status, problems=problems, answer=None)
