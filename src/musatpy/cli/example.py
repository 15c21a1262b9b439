"""`musat example`: jobs to begin with."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from musatpy.cli.messages import name_of, tell
from musatpy.cli.options import NamedPath

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem


def _beginning(ctx: click.Context, param: click.Parameter, text: str) -> list[CompletionItem]:
    """Return the examples that a shell may complete a text to."""
    from click.shell_completion import CompletionItem

    from musatpy.examples import examples

    return [CompletionItem(one.name, help=one.title) for one in examples().values() if one.name.startswith(text)]


@click.command(name="example", short_help="Write an example to begin with.")
@click.argument("name", metavar="[NAME]", required=False, shell_complete=_beginning)
@click.option(
    "-o",
    "--out",
    "out_dir",
    metavar="DIR",
    type=NamedPath(file_okay=False),
    help="Where the files go; a folder NAME where not given.",
)
def command(name: str | None, out_dir: Path | None) -> None:
    """List the examples; with a NAME, write its files and say how to go on.

    Exit status: 0, or 1 where a file cannot be written or another one of its name is there.
    """
    from musatpy.errors import MusatError
    from musatpy.examples import example_named, examples, write_example

    if name is None:
        every = examples()
        width = max(map(len, every))
        for example in every.values():
            tell(f"{example.name:<{width}}  {example.title}")
        tell("\nmusat example NAME -o DIR writes one")
        return
    try:
        chosen = example_named(name)
    except MusatError as error:
        raise click.UsageError(str(error)) from error
    folder = out_dir or Path(name)
    for path in write_example(chosen, folder):
        tell(f"wrote {name_of(path)}")
    tell("\nGo on with")
    for line in (f"cd {shlex.quote(os.fspath(folder))}", *chosen.commands):
        tell(f"  {line}")
