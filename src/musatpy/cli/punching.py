"""The options of `musat run` that say what is punched."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from musatpy.cli.options import family_named, options_of

if TYPE_CHECKING:
    from musatpy.formats.cards.spec import Family
    from musatpy.formats.families import FormatFamily
    from musatpy.jobs.punch import Punch

punch_options = options_of(  # of punching; `punch_of` takes their values
    click.option(
        "--punch",
        "content",
        type=click.Choice(["restart", "result"]),
        help="Write NAME.pun too: the deck to start again from, or adjusted values with sigmas for another job.",
    ),
    click.option(
        "--punch-family",
        "family",
        metavar="FAMILY",
        help="Punch the files of this family in place of a deck: giant, patb, bingo, jfk, or that of --formats.",
    ),
    click.option(
        "--punch-points",
        "points",
        type=click.Choice(["none", "control", "all"]),
        help="Ground points punched as control; all of a result and none of a restart where not given.",
    ),
    click.option(
        "--punch-kind",
        "kind",
        type=click.Choice(["F", "H", "V", "C"]),
        help="Kind of control of the points of a result; F where not given.",
    ),
    click.option(
        "--punch-sigmas/--no-punch-sigmas",
        "sigmas",
        default=None,
        help="A result has its sigmas; without, stations are approximations and control is without error.",
    ),
    click.option(
        "--punch-plates/--no-punch-plates",
        "plates",
        default=None,
        help="Plate coordinates are punched; those of a restart only where not given.",
    ),
)


def punch_of(formats_dir: Path | None, given: Mapping[str, Any]) -> tuple[Punch | None, FormatFamily | None]:
    """Return what is to be punched by the options, and the family of files that it goes to, None for a deck.

    Raises `click.UsageError` for options that do not go together, and `CardFormatError`.
    """
    content, family = given["content"], given["family"]
    details = {name: given[name] for name in ("points", "kind", "sigmas", "plates")}
    if content is None:
        if any(value is not None for value in (family, *details.values())):
            raise click.UsageError("what is punched is said by --punch restart or --punch result")
        return None, None
    from musatpy.jobs.punch import Punch

    try:
        punch = Punch.of(content, **details)
    except ValueError as error:
        raise click.UsageError(str(error)) from error
    return punch, None if family is None else _family(family, formats_dir)


def _family(name: str, formats_dir: Path | None) -> FormatFamily | None:
    """Return the family of a name, None for that of the decks that are read."""
    from musatpy.formats.families import DeckFamily, families

    family = family_named(families(formats_dir), name, "--punch-family")
    return None if isinstance(family, DeckFamily) else family


def run_cards(formats_dir: Path | None, punch_family: FormatFamily | None) -> Family:
    """Return the cards by which decks are read: those of `formats_dir` unless it is the family that is punched.

    Raises `CardFormatError`.
    """
    from musatpy.formats.job_tables import card_family

    own = formats_dir is not None and punch_family is not None and punch_family.name == formats_dir.resolve().name
    return card_family(None if own else formats_dir)
