"""What commands say: messages and problems, made safe for a terminal."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import click

from musatpy.errors import MusatError, Problem, ProblemsError, count_of, of_each_kind, printable, shortened

if TYPE_CHECKING:
    from musatpy.model.findings import Verdict

_COLOURS: dict[str, dict[str, Any]] = {"title": {"bold": True}, "a": {"fg": "red"}, "b": {"fg": "green"}}
_COLOURS |= {
    "same": {"fg": "green"},
    "different": {"fg": "red"},
    "warning": {"fg": "yellow"},
    "error": {"fg": "red"},
}
QUIET, VERBOSE, LOG = (f"musatpy.{name}" for name in ("quiet", "verbose", "log"))  # in the `meta` of a context


def asked(key: str) -> Any:
    """Return what options of the command that is at work ask for: QUIET, VERBOSE, or the file of a LOG."""
    context = click.get_current_context(silent=True)
    return None if context is None else context.meta.get(key)


def _print(content: str | bytes, *, nl: bool = True, err: bool = False) -> None:
    """Print to stdout or stderr; a reader that has gone away (`| head`) ends what is printed, not the work."""
    try:
        click.echo(content, nl=nl, err=err)
    except BrokenPipeError:
        read_no_more(sys.stderr if err else sys.stdout)


def read_no_more(stream: IO[str]) -> None:
    """Have the rest of a stream that nobody reads go nowhere, with what is still in its buffer."""
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())


def log(text: str) -> None:
    """Write a text to the log, where there is one, with the time; a full disk ends the log, not the work."""
    if file := asked(LOG):
        with suppress(OSError):
            print(time.strftime("%Y-%m-%dT%H:%M:%S"), click.unstyle(text).rstrip("\n"), file=file, flush=True)


def remark(text: str) -> None:
    """Tell of a phase of the work: with -v on stderr, and in the log."""
    log(printable(text))
    if asked(VERBOSE):
        _print(f"musat: {printable(text)}", err=True)


def tell(text: str, *, nl: bool = True, err: bool = False) -> None:
    """Print a text to stdout, or to stderr."""
    log(printable(text))
    _print(printable(text), nl=nl, err=err)


def tell_as_is(content: str | bytes) -> None:
    """Print a file, or a text whose parts went through `printable` already, for colours or page breaks in it."""
    _print(content, nl=False)


def _tell_of(text: str) -> None:
    """Print to stderr a text whose parts went through `printable` already."""
    log(text)
    _print(text, err=True)


def complain(message: str) -> None:
    """Print a message to stderr as one line."""
    _tell_of(f"musat: {printable(shortened(' '.join(message.split())))}")


def complain_of_each(file: Path | None, texts: Iterable[str]) -> None:
    """Print what is said of a file, or of several, to stderr, each as one line; of a kind a hundred."""
    of = "" if file is None else f"{name_of(file)}: "
    for problem in of_each_kind(Problem(message=text) for text in texts):
        complain(f"{of}{problem.message}")


def complain_of(problems: Iterable[Problem]) -> None:
    """Print problems to stderr; of a kind a hundred, of one that stands on lines three."""
    for problem in of_each_kind(problems):
        _tell_of(problem_text(problem))


def problem_text(problem: Problem) -> str:
    """Return a problem as it is printed: with ruler and carets where its card is known, with -q as one line."""
    head, *card = problem.render().split("\n")
    lines = [styled(head, problem.severity), *([] if asked(QUIET) else map(printable, card))]
    if len(lines) > 1 and "^" in lines[-1]:
        lines[-1] = styled(lines[-1], problem.severity)
    return "\n".join(lines)


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
    if asked(QUIET) and problems:
        return
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
