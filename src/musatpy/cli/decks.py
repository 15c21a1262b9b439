"""Decks that are edited: read though they could not be run yet, and written only where they can be read again."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from musatpy.cli.messages import complain, count_of, name_of, tell, tell_file
from musatpy.errors import DeckError, Problem, of_each_kind

if TYPE_CHECKING:
    from collections.abc import Iterable

    from musatpy.formats.cards.spec import Family
    from musatpy.model import Block


STREAM = Path("-")  # as a deck: the standard input; as an output: the standard output


def source_of(deck: Path) -> Path | bytes:
    """Return where a deck is read from: its path, or of `-` the bytes of the standard input."""
    return sys.stdin.buffer.read() if deck == STREAM else deck


def read_for_editing(decks: Iterable[Path], family: Family) -> list[Block]:
    """Return the blocks of decks, which may lack a datum. Raises `DeckError` with every error of all of them."""
    from musatpy.formats.musat import check_deck

    blocks, errors = [], []
    for deck in decks:
        block, problems = check_deck(source_of(deck), family, for_run=False)
        errors += [problem for problem in problems if problem.severity == "error"]
        if block is not None:
            blocks.append(block)
    if errors:
        raise DeckError(errors)
    return blocks


def sizes_of(block: Block) -> list[str]:
    """Return how many photos, points, measurements and control points a block has, in words."""
    tables = {
        "photo": block.photos,
        "point": block.points,
        "plate measurement": block.plates,
        "control point": block.control,
    }
    return [count_of(table.count, noun) for noun, table in tables.items()]


def write_edited(block: Block, titles: tuple[str, ...], path: Path, family: Family, report: str) -> None:
    """Write the deck of a block, and print the report of the editing, what is in the deck, and what it lacks.

    The deck has `titles` where there are any, else those of the block; `-` goes to stdout, and what is said to
    stderr. Raises `DeckError` where it cannot be written or would contradict itself; nothing is written and printed
    then.
    """
    from musatpy.files import write_files
    from musatpy.formats.musat import check_deck, deck_bytes

    try:
        data = deck_bytes(replace(block, titles=titles or block.titles), family)
    except DeckError as error:
        raise DeckError(_once_each(_of(path, error.problems))) from error
    again, problems = check_deck(data, family, for_run=False)
    if again is None:
        raise DeckError(_of(path, problems))
    if path == STREAM:
        tell_file(data)
    else:
        write_files({path: data})
    about = partial(tell, err=path == STREAM)  # of what stands on stdout itself
    about(report, nl=False)
    _, of_a_run = check_deck(data, family)
    missing = [problem for problem in _of(path, of_a_run) if problem.severity == "error"]
    warnings = count_of(len(of_a_run) - len(missing), "warning")
    about(f"{name_of(path)}: {', '.join(sizes_of(again))}; {warnings} of musat check")
    for problem in of_each_kind(missing):
        complain(f"{problem.headline()}: it cannot be run yet")


def _once_each(problems: Iterable[Problem]) -> list[Problem]:
    """Return one problem of each value that does not fit its field, however many cards have it."""
    first: dict[str | None, Problem] = {}
    for problem in problems:
        first.setdefault(problem.found, problem)
    return list(first.values())


def _of(path: Path, problems: Iterable[Problem]) -> list[Problem]:
    return [replace(problem, file=str(path)) for problem in problems]
