"""Every option of every command stands in an example of the manual or in options.md."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click

from frozen.manual import commands
from musatpy.cli.main import main
from musatpy.cli.options import COMMON

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *(ROOT / "docs").glob("*.md"), Path(__file__).with_name("options.md")]


def surface(command: click.Command, name: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], click.Option]]:
    """Yield the options of all commands below one that are not hidden, nor those of every command."""
    if isinstance(command, click.Group):
        for below, member in command.commands.items():
            if not member.hidden:
                yield from surface(member, (*name, below))
    for parameter in command.params:
        if isinstance(parameter, click.Option) and not parameter.hidden and name and parameter not in COMMON:
            yield name, parameter


def calls() -> Iterator[list[str]]:
    """Yield the words of the calls of the program in all pages."""
    for page in PAGES:
        for command in commands(page.read_text(encoding="utf-8")):
            for call in re.findall(r"\bmusat ([^|;&]*)", command):
                lexer = shlex.shlex(call, posix=True, punctuation_chars=">")
                lexer.whitespace_split = True
                try:
                    yield list(lexer)
                except ValueError:  # a quote goes on behind a separator: it has no option of ours
                    yield call.split()


def test_examples_have_every_option():
    called = list(calls())
    missing = [
        f"musat {' '.join(name)} {option.opts[-1]}"
        for name, option in surface(main)
        if not any(
            tuple(words[: len(name)]) == name and {word.split("=")[0] for word in words} & set(option.opts)
            for words in called
        )
    ]
    assert missing == []
