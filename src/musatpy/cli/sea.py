"""`musat sea`: what waves do to a map, estimated and taken away; its commands are loaded when used."""

from __future__ import annotations

from importlib import import_module

import click

COMMANDS = {
    "fit": "musatpy.cli.sea_fit",
    "correct": "musatpy.cli.sea_correct",
    "interpolate": "musatpy.cli.sea_interpolate",
}


class _Commands(click.Group):
    """A group whose commands are modules with a `command`, imported when they are needed."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of the help page."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command of a name, None where there is none."""
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = import_module(COMMANDS[cmd_name]).command
        return command


@click.group(name="sea", cls=_Commands, short_help="Take away what waves do to a map.")
def command() -> None:
    """Estimate what waves do to a map, and take it away."""
