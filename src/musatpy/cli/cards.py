"""Commands about cards: `card` explains and makes them, `tidy` puts them right, `tide` writes their tides."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from musatpy.cli import options
from musatpy.cli.decks import STREAM, data_of, write_deck
from musatpy.cli.messages import complain, complain_of, complain_of_each, name_of, tell
from musatpy.cli.options import FILE, NOT_NEGATIVE, option
from musatpy.errors import DeckError, count_of

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from musatpy.formats.cards.spec import Family

_deck_to_write = option("-o --out", "Deck to write; - is the standard output.", FILE, required=True)


def _cards_beginning(ctx: click.Context, param: click.Parameter, text: str) -> list[CompletionItem]:
    """Return the cards that a shell may complete a text to, with their titles."""
    families = _card_families(ctx.params.get("formats"))
    cards = {name: card.title for family in families for name, card in family.cards.items()}
    return options.offered(text.upper(), cards)


def _values_beginning(ctx: click.Context, param: click.Parameter, text: str) -> list[CompletionItem]:
    """Return the fields of the card, and behind the sign of equality the words that a field may have."""
    families = _card_families(ctx.params.get("formats"))
    cards = [family.cards.get((ctx.params.get("name") or "").upper()) for family in families]
    return [item for card in cards if card is not None for item in options.offered_fields(text, card)]


@click.command(name="card", short_help="Explain cards, or make one from names and values.")
@click.argument("name", metavar="[CARD]", required=False, shell_complete=_cards_beginning)
@click.argument("values", metavar="[FIELD=VALUE...]", nargs=-1, shell_complete=_values_beginning)
@option(
    "--csv FILE",
    "Make a card from each row of this table; its columns have the names of the fields.",
    FILE,
    name="table",
)
@options.formats_option
@click.pass_context
def card_command(
    ctx: click.Context, name: str | None, values: tuple[str, ...], table: Path | None, formats: Path | None
) -> None:
    """List the cards, or the fields of a CARD with columns, values and defaults; with values, print that card.

    With --csv, print a card for each row of a table, whose values have the units of the card; a field without a
    column is blank. Wrong values are reported on stderr. Exit status: 0, or 1 if a value is wrong.
    """
    from musatpy.formats.cards.manual import card_of, card_text, list_of_cards
    from musatpy.formats.cards.settings import SettingError, card_named, setting_of

    families = _card_families(formats)
    if table is not None and (name is None or values):
        raise click.UsageError("--csv goes with a CARD, and without FIELD=VALUE")
    if name is None:
        tell(list_of_cards(families), nl=False)
        return
    cards = {mnemonic: card for family in reversed(families) for mnemonic, card in family.cards.items()}
    settings = []
    with options.usage_errors(SettingError):
        spec = card_named(cards, name)
        for text in values:
            field, equals, value = text.partition("=")
            if not equals:
                raise click.UsageError(f"'{text}' is not FIELD=VALUE, such as water_level=ONE")
            settings.append(setting_of(spec, field.strip(), value))
    family = next(family for family in families if spec.mnemonic in family.cards)
    if table is not None:
        from musatpy.keypunch.typed import cards_of_table

        tell("\n".join(cards_of_table(table, spec, family)))
        return
    if not values:
        tell(card_text(spec), nl=False)
        return
    card, problems = card_of(spec, settings, family)
    tell(card)
    complain_of(problems)
    ctx.exit(1 if any(problem.severity == "error" for problem in problems) else 0)


def _card_families(formats: Path | None) -> list[Family]:
    """Return the cards of decks, and those that only compilation decks have."""
    from musatpy.formats.cards.spec import card_formats_folder, load_family
    from musatpy.formats.job_tables import card_family

    if formats is not None:
        return [card_family(formats)]
    return [card_family(), load_family(card_formats_folder() / "as11")]


@click.command(name="tidy", short_help="Move the words of a freely typed deck into their columns.")
@click.argument("deck", type=FILE)
@_deck_to_write
@options.formats_option
@options.quiet_option
@click.pass_context
def tidy_command(ctx: click.Context, deck: Path, out: Path, formats: Path | None, quiet: bool) -> None:
    """Move the words of cards that were typed with blanks between them into their columns.

    A card of DECK (- is the standard input) that reads well is not changed. The words of any other card go to its
    fields in their order or, where that does not fit, to the only fields that can take them in that order. If there
    is no such way, or more than one, the card is not changed, and a message says why.

    Exit status: 0 every card is in its columns, 1 some are not.
    """
    from musatpy.formats.job_tables import card_family
    from musatpy.keypunch.typed import tidied

    result = tidied(data_of(deck), card_family(formats), name_of(deck))
    write_deck(out, result.data)
    if not quiet:
        for line, before, after in result.changed:
            tell(f"{name_of(deck)}:{line}: {before.strip()}\n    {after}", err=True)
        tell(f"{name_of(out)}: {count_of(len(result.changed), 'card')} put into their columns", err=True)
    complain_of(result.problems)
    ctx.exit(1 if result.problems else 0)


@click.command(name="tide", short_help="Write the tides of a deck from the readings of a gauge.")
@click.argument("deck", type=FILE)
@option("--series CSV", "Readings of the gauge, with columns time and level (m).", FILE, required=True)
@option("--datum M", "Height of the zero of the gauge in the heights of the deck.", float, required=True)
@option("--sigma M", "Sigma of a reading. Default: 0.", NOT_NEGATIVE, default=0.0)
@option("--times CSV", "Times of exposure, with columns photo and time. Default: those of the deck.", FILE)
@option("--zone ZONE", "Zone of times that state none: UTC, +hh:mm, or a name such as Europe/Berlin.", default="")
@option(
    "--clock TIME",
    "Time at which the seconds on the cards of the deck are zero, if the series has dates.",
    default="0",
)
@_deck_to_write
@options.formats_option
@options.quiet_option
def tide_command(
    deck: Path, series: Path, datum: float, sigma: float, times: Path | None, zone: str, clock: str, out: Path,
    formats: Path | None, quiet: bool,
) -> None:  # fmt: skip
    """Write the height of the water at each exposure of DECK (- is the standard input) on its card of tides.

    Heights are interpolated between the readings by a piecewise cubic, never before the first or after the last
    reading, nor in a gap of more than 30 minutes. Their sigmas combine that of a reading with that of the
    interpolation. Times of readings and exposures are either seconds or dates as in ISO 8601
    (2024-05-01T09:30:00+02:00). Nothing else in the deck changes.

    Exit status: 0, or 1 if a photo gets no tide; then nothing is written.
    """
    from musatpy.formats.job_tables import card_family
    from musatpy.keypunch.tides import deck_with_tides
    from musatpy.pointfiles.gauges import moment, read_exposures, read_tide, zone_of

    readings = read_tide(series, DeckError, zone, sigma)
    readings = replace(readings, level=readings.level + datum)
    exposures = None if times is None else read_exposures(times, DeckError, zone)
    try:
        start = moment(clock, zone_of(zone, DeckError))
    except ValueError as error:
        raise click.UsageError(f"--clock: '{clock}' {error}") from error
    data, tides = deck_with_tides(data_of(deck), card_family(formats), readings, exposures, clock=start)
    write_deck(out, data)
    strangers = [photo for photo in exposures or () if photo not in tides]
    complain_of_each(times, [f"photo {photo} is not in the deck" for photo in strangers])
    if not tides:
        complain(f"{name_of(deck)}: no photos")
    elif not quiet:
        heights, sigmas = zip(*tides.values(), strict=True)
        tell(
            f"{name_of(out)}: tides of {count_of(len(tides), 'photo')}, {min(heights):.3f} to "
            f"{max(heights):.3f} m, largest sigma {max(sigmas):.3f} m",
            err=out == STREAM,
        )
