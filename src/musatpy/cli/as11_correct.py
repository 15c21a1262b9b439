"""`musat as11 correct`: what `musat correct` does, by the two photos of a model, under the name that it had."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from musatpy.cli.correct import correct, correction_options
from musatpy.cli.options import NamedPath


@click.command(name="correct", hidden=True)
@click.argument("run", type=NamedPath())
@click.argument("left")
@click.argument("right")
@click.argument("points", type=NamedPath())
@correction_options
@click.pass_context
def command(ctx: click.Context, /, run: Path, left: str, right: str, points: Path, **given: Any) -> None:
    """Correct POINTS as `musat correct --run RUN.json --photos LEFT,RIGHT` does, whose name this was."""
    given["photos"] = f"{left},{right}"
    given["surface"] |= {points.suffix.lower(), given["out"].suffix.lower()} <= {".tif", ".tiff"}
    correct(ctx, points, run, is_run=True, **given)
