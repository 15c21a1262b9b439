"""`musat as11`: points compiled in stereomodels of a run; its commands are loaded when used."""

from __future__ import annotations

import click

from musatpy.cli.lazy import LazyGroup

COMMANDS = {
    "compile": "musatpy.cli.as11_compile",
    "contours": "musatpy.cli.as11_grid_contours",
    "correct": "musatpy.cli.as11_correct",
    "compare-points": "musatpy.cli.as11_points",
    "compare-contours": "musatpy.cli.as11_contours",
    "compare-soundings": "musatpy.cli.as11_soundings",
    "drive": "musatpy.cli.as11_drive",
    "setup": "musatpy.cli.as11_setup",
}


@click.group(name="as11", cls=LazyGroup, modules=COMMANDS, short_help="Compile points in stereomodels of a run.")
def command() -> None:
    """Set stereomodels up from a run, and compile points in them through the water."""
