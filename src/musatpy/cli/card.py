"""`musat card`: what stands on a card, and a card made of names and values."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from musatpy.cli.messages import complain_of, tell
from musatpy.cli.options import formats_option

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from musatpy.formats.cards.spec import Family


def _cards_beginning(ctx: click.Context, param: click.Parameter, text: str) -> list[CompletionItem]:
    """Return the cards that a shell may complete a text to, with their titles."""
    from click.shell_completion import CompletionItem

    cards = [card for family in _families(ctx.params.get("formats_dir")) for card in family.cards.values()]
    fitting = [card for card in cards if card.mnemonic.startswith(text.upper())]
    return [CompletionItem(card.mnemonic, help=card.title) for card in fitting]


def _values_beginning(ctx: click.Context, param: click.Parameter, text: str) -> list[CompletionItem]:
    """Return the fields of the card, and behind the sign of equality the words that a field may have."""
    from click.shell_completion import CompletionItem

    families = _families(ctx.params.get("formats_dir"))
    cards = [family.cards.get((ctx.params.get("name") or "").upper()) for family in families]
    fields = [field for card in cards if card is not None for field in card.fields]
    words = [f"{field.name}={word}" for field in fields for word in field.allowed]
    known = words if "=" in text else [f"{field.name}=" for field in fields]
    return [CompletionItem(one) for one in known if one.startswith(text)]


@click.command(name="card", short_help="Explain cards; make one of names and values.")
@click.argument("name", metavar="[CARD]", required=False, shell_complete=_cards_beginning)
@click.argument("values", metavar="[FIELD=VALUE...]", nargs=-1, shell_complete=_values_beginning)
@formats_option
@click.pass_context
def command(ctx: click.Context, name: str | None, values: tuple[str, ...], formats_dir: Path | None) -> None:
    """List the cards, or the fields of a CARD with columns, values and defaults; with values, print that card.

    What is wrong with the values of the card itself stands on stderr. Exit status: 0, or 1 where a value is wrong.
    """
    from musatpy.formats.cards.manual import card_of, card_text, list_of_cards
    from musatpy.formats.cards.settings import SettingError, card_named, setting_of

    families = _families(formats_dir)
    if name is None:
        tell(list_of_cards(families), nl=False)
        return
    try:
        cards = {mnemonic: card for family in reversed(families) for mnemonic, card in family.cards.items()}
        spec = card_named(cards, name)
        settings = [setting_of(spec, *_name_and_value(text)) for text in values]
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
    from musatpy.formats.job_tables import card_family

    if formats_dir is not None:
        return [card_family(formats_dir)]
    return [card_family(), load_family(card_formats_folder() / "as11")]


def _name_and_value(text: str) -> tuple[str, str]:
    """Return name and value of `water_level=ONE`."""
    name, equals, value = text.partition("=")
    if not equals:
        raise click.UsageError(f"'{text}' is not FIELD=VALUE, such as water_level=ONE")
    return name.strip(), value
