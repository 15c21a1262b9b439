"""`musat report`: the page of a run."""

from __future__ import annotations

from pathlib import Path

import click

from musatpy.cli.diff import cycles_left_alone
from musatpy.cli.messages import name_of, tell
from musatpy.cli.options import NamedPath, quiet_option, refuse_overwriting


@click.command(name="report", short_help="Make the page of a run: one HTML file to hand over.")
@click.argument("record", metavar="RUN.json", type=NamedPath())
@click.option(
    "-o", "--out", "out", metavar="NAME.html", type=NamedPath(), help="The page; RUN.html where not given."
)
@click.option(
    "--input",
    "inputs",
    metavar="FILE",
    multiple=True,
    type=NamedPath(),
    help="A file that the run has read, such as its deck: the page states its SHA-256.",
)
@quiet_option
def command(record: Path, out: Path | None, inputs: tuple[Path, ...], quiet: bool) -> None:
    """Make a page of the record of a run, a compilation (`as11 compile`) or a comparison (`compare-soundings`).

    One HTML file with pictures, without scripts, that needs no network: verdict, data, accuracy, pictures, worst
    observations, tables. Needs jinja2 and matplotlib.
    """
    from musatpy.files import write_file
    from musatpy.page.composition import page_of_record

    place = record.with_suffix(".html") if out is None else out
    refuse_overwriting([place], [record, *inputs])
    with cycles_left_alone():
        write_file(place, page_of_record(record, inputs).encode())
    if not quiet:
        tell(f"{name_of(record)}: page {name_of(place)}")
