"""`musat explain`: one point or photo of a run."""

from __future__ import annotations

from pathlib import Path

import click

from musatpy.cli.messages import tell
from musatpy.cli.options import NamedPath


@click.command(name="explain", short_help="Show all that a run knows of one point or photo.")
@click.argument("name", metavar="ID")
@click.argument("record", metavar="RECORD", type=NamedPath())
def command(name: str, record: Path) -> None:
    """Show all that a run knows of the point or photo ID, on one screen, from its RECORD NAME.json.

    Images with residuals and tests, redundancy and detectable errors; what would happen without them, as predicted
    from redundancy and influence, without a new adjustment; control, water and neighbours. RECORD may be a deck,
    which is then adjusted. Exit status: 0, or 1 where there is neither a point nor a photo of that name.
    """
    from musatpy.runs import inquiry_text

    tell(inquiry_text(record, name), nl=False)
