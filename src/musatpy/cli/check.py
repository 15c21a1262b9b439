"""`musat check`: every problem of decks, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from musatpy.cli.decks import sizes_of, source_of
from musatpy.cli.messages import count_of, name_of, tell
from musatpy.cli.options import decks_argument, formats_option, set_option, settings_for
from musatpy.errors import of_each_kind

if TYPE_CHECKING:
    from musatpy.errors import Problem
    from musatpy.model import Block


@click.command(name="check", short_help="Print every problem of decks.")
@decks_argument
@formats_option
@set_option
@click.pass_context
def command(
    ctx: click.Context, decks: tuple[Path, ...], formats_dir: Path | None, settings: tuple[str, ...]
) -> None:
    """Print every problem of each DECK (- is the standard input), with ruler and carets, and how many there are.

    Exit status: 0 no errors (there may be warnings), 1 errors.
    """
    from musatpy.formats.job_tables import card_family
    from musatpy.formats.musat import check_deck

    family = card_family(formats_dir)
    instead = settings_for(settings, family)
    usable = True
    for deck in decks:
        block, problems = check_deck(source_of(deck), family, settings=instead)
        for problem in of_each_kind(problems):
            tell(problem.render())
        tell(f"{name_of(deck)}: {_verdict(block, problems)}")
        usable = usable and block is not None
    ctx.exit(0 if usable else 1)


def _verdict(block: Block | None, problems: Sequence[Problem]) -> str:
    errors = sum(problem.severity == "error" for problem in problems)
    counts = f"{count_of(errors, 'error')}, {count_of(len(problems) - errors, 'warning')}"
    if block is None:
        return counts
    return f"{counts}; {', '.join(sizes_of(block)[:3])}"
