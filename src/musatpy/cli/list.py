"""`musat list`: what is in a deck, before it is run."""

from __future__ import annotations

from pathlib import Path

import click

from musatpy.cli.decks import read_for_editing
from musatpy.cli.messages import name_of, tell, tell_escaped
from musatpy.cli.options import decks_argument, formats_option
from musatpy.errors import printable


@click.command(name="list", short_help="List what is in decks.")
@decks_argument
@click.option("--json", "as_json", is_flag=True, help="Print JSON, a list with an entry for each deck.")
@click.option(
    "--few", type=click.IntRange(min=1), default=5, show_default=True, help="Points in common that are enough."
)
@formats_option
def command(decks: tuple[Path, ...], as_json: bool, few: int, formats_dir: Path | None) -> None:
    """List photos, rays, overlaps, control and submerged points of each DECK, which need not be ready for a run.

    A DECK - is the standard input. Exit status: 0, or 1 where a deck cannot be read.
    """
    import json

    from musatpy.formats.job_tables import card_family
    from musatpy.jobs.summary import summary
    from musatpy.reports.jobs import list_record, list_text

    jobs = [summary(block, few) for block in read_for_editing(decks, card_family(formats_dir))]
    names = [name_of(deck) for deck in decks]
    if as_json:
        records = [list_record(job, name) for job, name in zip(jobs, names, strict=True)]
        tell(json.dumps(records, indent=1))
        return
    pages = "\f".join(list_text(job, name) for job, name in zip(jobs, names, strict=True))
    tell_escaped("\f".join(map(printable, pages.split("\f"))))
