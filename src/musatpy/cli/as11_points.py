"""`musat as11 compare-points`: compiled points beside those of the run."""

from __future__ import annotations

from pathlib import Path

import click

from musatpy.cli.messages import complain_of, count_of, name_of, tell
from musatpy.cli.options import NamedPath, anyway_option, out_option, refuse_overwriting


@click.command(name="compare-points", short_help="Hold the points of a deck against those of the run.")
@click.argument("run", type=NamedPath())
@click.argument("deck", type=NamedPath())
@out_option
@anyway_option
def command(run: Path, deck: Path, out_dir: Path | None, anyway: bool) -> None:
    """Compile DECK in stereomodels of RUN.json, and hold its points against those of the run by the same names.

    The listing NAME.points.lst has the differences, compiled less run, their sigmas and tests, and their analysis;
    the record goes to NAME.points.json.
    """
    from musatpy.as11_runs import compare_points

    stem = (deck.parent if out_dir is None else out_dir) / f"{deck.stem}.points"
    listing, record = (stem.with_name(f"{stem.name}.{kind}") for kind in ("lst", "json"))
    refuse_overwriting([listing, record], [run, deck])
    count, lengths, problems = compare_points(run, deck, listing, record, anyway)
    complain_of(problems)
    least, mean, largest = lengths
    tell(
        f"{name_of(deck)}: {count_of(count, 'point')} of the run, vectors {least:.4f} to {largest:.4f} m, "
        f"mean {mean:.4f} m, listing {name_of(listing)}"
    )
