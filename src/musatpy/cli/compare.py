"""`musat compare`: two solutions of one deck side by side."""

from __future__ import annotations

import json
from pathlib import Path

import click

from musatpy.cli.messages import name_of, tell


@click.command(name="compare", short_help="Put two solutions of one deck side by side.")
@click.argument("first", metavar="A", type=click.Path(path_type=Path))
@click.argument("second", metavar="B", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print JSON, with every station, point and wave.")
@click.option("--listed", type=click.IntRange(min=1), default=20, show_default=True, help="Rows of each table.")
@click.option("--limit", type=float, metavar="SIGMAS", help="Exit status 1 where a difference is larger than this.")
@click.pass_context
def command(ctx: click.Context, first: Path, second: Path, as_json: bool, listed: int, limit: float | None) -> None:
    """Compare solution B with solution A of the same deck.

    Each is the record NAME.json that a run left, or a deck, which is then adjusted. Differences are B minus A, in
    metres and in sigmas of B, those that differ most first. Exit status: 0, or 1 where a difference is beyond the
    limit, or a file cannot be used.
    """
    from musatpy.reports.comparison import comparison_record, comparison_text
    from musatpy.runs import compared

    labels = first.stem, second.stem
    if labels[0] == labels[1]:
        labels = name_of(first), name_of(second)
    comparison = compared(first, second, labels)
    whole = json.dumps(comparison_record(comparison), indent=1) + "\n" if as_json else ""
    tell(whole or comparison_text(comparison, listed), nl=False)
    if limit is not None and comparison.largest > limit:
        ctx.exit(1)
