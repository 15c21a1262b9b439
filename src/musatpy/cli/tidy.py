"""`musat tidy`: cards that were typed freely, put into their columns."""

from __future__ import annotations

from pathlib import Path

import click

from musatpy.cli.decks import STREAM, source_of
from musatpy.cli.messages import complain_of, count_of, name_of, tell, tell_file
from musatpy.cli.options import NamedPath, formats_option, quiet_option


@click.command(name="tidy", short_help="Put cards typed freely into their columns.")
@click.argument("deck", type=NamedPath())
@click.option("-o", "--out", required=True, type=NamedPath(), help="The deck to write; - is the standard output.")
@formats_option
@quiet_option
@click.pass_context
def command(ctx: click.Context, deck: Path, out: Path, formats_dir: Path | None, quiet: bool) -> None:
    """Put the words of cards that were typed with blanks between them into their columns.

    A card of DECK (- is the standard input) that reads well stays as it is, byte by byte. The words of another one
    go to the fields of its card in their order, from the first on; where they do not fit so, to the only fields
    that take them in that order. Where there is no such way, or more than one, the card stays as it is and is told.

    Exit status: 0 every card stands in its columns, 1 some do not.
    """
    from musatpy.files import write_files
    from musatpy.formats.job_tables import card_family
    from musatpy.keypunch.words import tidied

    source = source_of(deck)
    data = source if isinstance(source, bytes) else source.read_bytes()
    result = tidied(data, card_family(formats_dir), name_of(deck))
    if out == STREAM:
        tell_file(result.data)
    else:
        write_files({out: result.data})
    if not quiet:
        for line, before, after in result.changed:
            tell(f"{name_of(deck)}:{line}: {before.strip()}\n    {after}", err=True)
        tell(f"{name_of(out)}: {count_of(len(result.changed), 'card')} put into their columns", err=True)
    complain_of(result.problems)
    ctx.exit(1 if result.problems else 0)
