"""What commands say: messages and problems, made safe for a terminal."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from musatpy.errors import MusatError, Problem, ProblemsError, of_each_kind, printable, shortened

if TYPE_CHECKING:
    from musatpy.model.findings import Verdict

_COLOURS: dict[str, dict[str, Any]] = {"title": {"bold": True}, "a": {"fg": "red"}, "b": {"fg": "green"}}
_COLOURS |= {"same": {"fg": "green"}, "different": {"fg": "red"}, "warning": {"fg": "yellow"}}


def tell(text: str, *, nl: bool = True, err: bool = False) -> None:
    """Print a text to stdout, or to stderr."""
    click.echo(printable(text), nl=nl, err=err)


def tell_as_is(content: str | bytes) -> None:
    """Print a file, or a text whose parts went through `printable` already, for colours or page breaks in it."""
    click.echo(content, nl=False)


def complain(message: str) -> None:
    """Print a message to stderr as one line."""
    click.echo(f"musat: {printable(shortened(' '.join(message.split())))}", err=True)


def complain_of_each(file: Path | None, texts: Iterable[str]) -> None:
    """Print what is said of a file, or of several, to stderr, each as one line; of a kind a hundred."""
    of = "" if file is None else f"{name_of(file)}: "
    for problem in of_each_kind(Problem(message=text) for text in texts):
        complain(f"{of}{problem.message}")


def complain_of(problems: Iterable[Problem]) -> None:
    """Print problems to stderr, each with ruler and carets where its card is known; of a kind a hundred."""
    for problem in of_each_kind(problems):
        click.echo(printable(problem.render()), err=True)


def complain_of_error(error: MusatError | OSError) -> None:
    """Print an error to stderr: each of its problems, or a line, as what the system said about a file."""
    if isinstance(error, ProblemsError):
        complain_of(error.problems)
    elif isinstance(error, OSError):
        complain(f"{error.filename or 'system'}: {error.strerror or error}")
    else:
        complain(str(error))


def complain_of_verdict(file: Path, verdict: Verdict | None) -> None:
    """Print to stderr why an answer is not accepted."""
    reasons = () if verdict is None else verdict.reasons
    complain_of_each(file, (f"{reason.grade.lower()}: {reason.text}" for reason in reasons))


def not_done(file: Path, what: str, problems: Collection[Problem]) -> None:
    """Print the problems of a file to stderr, and that it was not run, compiled or oriented for their errors."""
    complain_of(problems)
    errors = sum(problem.severity == "error" for problem in problems)
    complain(f"{name_of(file)}: not {what}, {count_of(errors, 'error')}")


def styled(text: str, kind: str) -> str:
    """Return a text in its colour, which `click.echo` takes away where there is no terminal; none with NO_COLOR."""
    return printable(text) if os.environ.get("NO_COLOR") else click.style(printable(text), **_COLOURS[kind])


def name_of(path: Path) -> str:
    """Return a file name as it can be printed, in one line."""
    return printable(click.format_filename(path)).replace("\n", "\\n")


def on_terminal() -> bool:
    """Tell whether stderr is a terminal, on which lines can be written anew."""
    return sys.stderr is not None and sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


@contextmanager
def progress_through(points: Path, quiet: bool) -> Iterator[Callable[[int], None] | None]:
    """Give what takes how much of a file is done, points of a cloud or bytes; None where no bar can be shown."""
    if quiet or not on_terminal():
        yield None
        return
    from musatpy.pointfiles.las_files import SUFFIXES, point_count

    length = point_count(points) if points.suffix.lower() in SUFFIXES else points.stat().st_size
    with click.progressbar(length=length, label=name_of(points), file=sys.stderr) as bar:
        yield bar.update


def count_of(number: int, noun: str) -> str:
    """Return a number with its noun, in the plural where it needs it."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
