"""What commands say: messages and problems, made safe for a terminal."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from pathlib import Path

import click

from musatpy.errors import Problem


def complain(message: str) -> None:
    """Print a message to stderr as one line."""
    click.echo(f"musat: {printable(' '.join(message.split()))}", err=True)


def complain_of(problems: Iterable[Problem]) -> None:
    """Print problems to stderr, each with ruler and carets where its card is known."""
    for problem in problems:
        click.echo(printable(problem.render()), err=True)


def complain_of_system(error: OSError) -> None:
    """Print what the system said about a file to stderr, as one line."""
    complain(f"{error.filename or 'system'}: {error.strerror or error}")


def printable(text: str) -> str:
    """Return the text with a question mark for each character that would disturb the terminal, line feeds kept."""
    return "".join(character if character.isprintable() or character == "\n" else "?" for character in text)


def name_of(path: Path) -> str:
    """Return a file name as it can be printed, in one line."""
    return printable(click.format_filename(path)).replace("\n", "?")


def on_terminal() -> bool:
    """Tell whether stderr is a terminal, on which lines can be written anew."""
    return sys.stderr is not None and sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


def count_of(number: int, noun: str) -> str:
    """Return a number with its noun, in the plural where it needs it."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
