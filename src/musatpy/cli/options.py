"""Arguments and options that several commands share."""

from __future__ import annotations

from pathlib import Path

import click

decks_argument = click.argument(
    "decks", metavar="DECK...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
out_option = click.option(
    "-o",
    "--out",
    "out_dir",
    metavar="DIR",
    type=click.Path(file_okay=False, path_type=Path),
    help="Where results go; beside the input where not given.",
)
formats_option = click.option(
    "--formats",
    "formats_dir",
    metavar="DIR",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="A family of your own: read the decks by the card formats (TOML) of this folder.",
)
deck_option = click.option(
    "-o",
    "--out",
    "out",
    metavar="OUT",
    required=True,
    type=click.Path(path_type=Path),
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
