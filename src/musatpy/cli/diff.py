"""`musat diff`: two listings or records, number by number."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from musatpy.cli.messages import complain_of, styled, tell_escaped
from musatpy.errors import Problem, ProblemsError

if TYPE_CHECKING:
    from musatpy.listings import Difference, Rules

CANNOT_COMPARE = 2


@click.command(name="diff", short_help="Compare two listings or records number by number.")
@click.argument("first", metavar="A", type=click.Path(path_type=Path))
@click.argument("second", metavar="B", type=click.Path(path_type=Path))
@click.option("--rules", metavar="FILE", type=click.Path(path_type=Path), help="Rules (TOML): what may differ.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON, with every difference.")
@click.option(
    "--junit", metavar="FILE", type=click.Path(path_type=Path), help="Write JUnit XML too, for CI systems."
)
@click.option("--listed", type=click.IntRange(min=1), default=20, show_default=True, help="Rows of each section.")
@click.option(
    "-q", "--quiet", is_flag=True, help="Print nothing where A and B are the same, else the last line only."
)
@click.pass_context
def command(
    ctx: click.Context,
    first: Path,
    second: Path,
    rules: Path | None,
    as_json: bool,
    junit: Path | None,
    listed: int,
    quiet: bool,
) -> None:
    """Compare two listings, two JSON files (names end in .json), or a listing with its record.

    A or B may be `-`, a listing that is read from standard input.

    Differences are B minus A. Without rules every number and word must be the same. Exit status: 0 same,
    1 different, 2 the files cannot be compared or the rules are wrong.
    """
    from musatpy.files import write_files
    from musatpy.listings import compare_bytes
    from musatpy.listings.output import json_text, junit_of_problems, junit_text

    try:
        data, loaded = _read(first, second, rules)
        with cycles_left_alone():
            comparison = compare_bytes(*data, loaded, names=(str(first), str(second)))
    except ProblemsError as error:
        problems = error.problems
        complain_of(problems)
        if junit:
            write_files({junit: junit_of_problems(problems, (str(first), str(second))).encode()})
        ctx.exit(CANNOT_COMPARE)
    if junit:
        write_files({junit: junit_text(comparison).encode()})
    if as_json:
        tell_escaped(json_text(comparison))
    elif quiet:
        _tell_shortly(comparison)
    else:
        from musatpy.listings.output import render

        tell_escaped(render(comparison, listed=listed, style=styled))
    ctx.exit(0 if comparison.same else 1)


@contextmanager
def cycles_left_alone() -> Iterator[None]:
    """Look for no cycles: none are among the millions of objects, and the search takes a tenth of the time."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()  # nor at the end of the program
        gc.enable()


def _tell_shortly(found: Difference) -> None:
    from musatpy.listings.output import verdict

    if not found.same:
        tell_escaped(f"{verdict(found, styled)}\n")


def _read(first: Path, second: Path, rules: Path | None) -> tuple[tuple[bytes, bytes], Rules | None]:
    """Return what stands in both files, and the rules; raises `ProblemsError` with all that cannot be read."""
    from musatpy.listings import load_rules

    found: dict[Path, bytes] = {}
    problems: list[Problem] = []
    if str(first) == str(second) == "-":
        problems.append(Problem(file="-", message="can be one of the two only"))
    for path in dict.fromkeys((first, second)):
        try:
            found[path] = sys.stdin.buffer.read() if str(path) == "-" else path.read_bytes()
        except OSError as error:
            problems.append(_problem(error))
    try:
        loaded = load_rules(rules) if rules else None
    except ProblemsError as error:
        problems += error.problems
    except OSError as error:
        problems.append(_problem(error))
    if problems:
        raise ProblemsError(problems)
    return (found[first], found[second]), loaded


def _problem(error: OSError) -> Problem:
    return Problem(file=str(error.filename or "system"), message=str(error.strerror or error))
