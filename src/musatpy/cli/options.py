"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click


class NamedPath(click.Path):
    """A path with a name: an empty one, of a variable that is not set, would be the folder in which we are."""

    def __init__(self, **more: Any) -> None:
        super().__init__(path_type=Path, **more)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path; fails where the name is empty."""
        if value == "":
            self.fail("the name is empty", param, ctx)
        return super().convert(value, param, ctx)


decks_argument = click.argument("decks", metavar="DECK...", nargs=-1, required=True, type=NamedPath())
out_option = click.option(
    "-o",
    "--out",
    "out_dir",
    metavar="DIR",
    type=NamedPath(file_okay=False),
    help="Where results go; beside the input where not given.",
)
formats_option = click.option(
    "--formats",
    "formats_dir",
    metavar="DIR",
    type=NamedPath(exists=True, file_okay=False),
    help="A family of your own: read the decks by the card formats (TOML) of this folder.",
)
deck_option = click.option(
    "-o",
    "--out",
    "out",
    metavar="OUT",
    required=True,
    type=NamedPath(),
    help="The deck to be written.",
)
titles_option = click.option(
    "--title",
    "titles",
    multiple=True,
    metavar="TEXT",
    help="A line of the job title, in place of those of the decks.",
)
processes_option = click.option(
    "-j",
    "--jobs",
    "processes",
    metavar="N",
    type=click.IntRange(min=1),
    help="Jobs at work at the same time; as many as there are cores where not given.",
)
