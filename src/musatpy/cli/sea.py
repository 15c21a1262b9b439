"""`musat sea`: what waves do to a map, estimated and taken away; its commands are loaded when used."""

from __future__ import annotations

import click

from musatpy.cli.lazy import LazyGroup

COMMANDS = {
    "fit": "musatpy.cli.sea_fit",
    "correct": "musatpy.cli.sea_correct",
    "interpolate": "musatpy.cli.sea_interpolate",
}


@click.group(name="sea", cls=LazyGroup, modules=COMMANDS, short_help="Take away what waves do to a map.")
def command() -> None:
    """Estimate what waves do to a map, and take it away."""
