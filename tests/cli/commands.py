"""The commands, run in this process."""

from typing import Any

from click.testing import CliRunner, Result

from musatpy.cli.main import main


def musat(*arguments: object, **options: Any) -> Result:
    """Run the program with arguments; `options` are those of `CliRunner.invoke`."""
    return CliRunner().invoke(main, [str(argument) for argument in arguments], **options)
