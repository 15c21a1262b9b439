"""`musat sea`: what can be done about waves: its subcommands, loaded when used."""

from __future__ import annotations

from importlib import import_module

import click

COMMANDS = {
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


@click.group(name="sea", cls=_Commands, short_help="Corrections for waves.")
def command() -> None:
    """What can be done about the errors of a map that takes a wavy sea for level."""
