"""`musat card`: what stands on a card, and a card made of names and values."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from musatpy.cli.messages import complain_of, tell
from musatpy.cli.options import formats_option

if TYPE_CHECKING:
    from musatpy.formats.cards.spec import Family


@click.command(name="card", short_help="Explain cards; make one of names and values.")
@click.argument("name", metavar="[CARD]", required=False)
@click.argument("values", metavar="[FIELD=VALUE...]", nargs=-1)
@formats_option
@click.pass_context
def command(ctx: click.Context, name: str | None, values: tuple[str, ...], formats_dir: Path | None) -> None:
    """List the cards, or the fields of a CARD with columns, values and defaults; with values, print that card.

    What is wrong with the values of the card itself stands on stderr. Exit status: 0, or 1 where a value is wrong.
    """
    from musatpy.formats.card_texts import card_of, card_text, list_of_cards
    from musatpy.formats.cards.settings import SettingError, card_named, setting_of

    families = _families(formats_dir)
    if name is None:
        tell(list_of_cards(families), nl=False)
        return
    try:
        cards = {mnemonic: card for family in reversed(families) for mnemonic, card in family.cards.items()}
        spec = card_named(cards, name)
        settings = [setting_of(spec, *_said(text)) for text in values]
    except SettingError as error:
        raise click.UsageError(str(error)) from error
    if not values:
        tell(card_text(spec), nl=False)
        return
    family = next(family for family in families if spec.mnemonic in family.cards)
    card, problems = card_of(spec, settings, family)
    tell(card)
    complain_of(problems)
    ctx.exit(1 if any(problem.severity == "error" for problem in problems) else 0)


def _families(formats_dir: Path | None) -> list[Family]:
    """Return the cards of decks, and those that only compilation decks have."""
    from musatpy.formats.cards.spec import card_formats_folder, load_family
    from musatpy.formats.musat import card_family

    if formats_dir is not None:
        return [card_family(formats_dir)]
    return [card_family(), load_family(card_formats_folder() / "as11")]


def _said(text: str) -> tuple[str, str]:
    """Return name and value of `water_level=ONE`."""
    name, equals, value = text.partition("=")
    if not equals:
        raise click.UsageError(f"'{text}' is not FIELD=VALUE, such as water_level=ONE")
    return name.strip(), value
