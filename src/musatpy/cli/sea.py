"""`musat sea`: the surface of the water; its commands are loaded when used."""

from __future__ import annotations

import click

from musatpy.cli.options import LazyGroup

COMMANDS = {
    "fit": "musatpy.cli.sea_fit",
    "correct": "musatpy.cli.sea_correct",
    "interpolate": "musatpy.cli.sea_interpolate",
}


@click.group(name="sea", cls=LazyGroup, modules=COMMANDS, short_help="Estimate the surface of the water.")
def command() -> None:
    """Estimate the surface of the water, through which `musat correct --sea` corrects the points of a map."""
