"""`musat as11 setup`: the stereomodels of a compilation deck, before anything is compiled in them."""

from __future__ import annotations

import datetime
from pathlib import Path

import click

from musatpy.cli.as11_compile import report_faults
from musatpy.cli.messages import count_of, name_of, tell
from musatpy.cli.options import (
    NamedPath,
    anyway_option,
    carriage_control_option,
    date_option,
    out_option,
    refuse_overwriting,
)


@click.command(name="setup", short_help="Set the models of a deck up.")
@click.argument("run", type=NamedPath())
@click.argument("deck", type=NamedPath())
@out_option
@anyway_option
@carriage_control_option
@date_option
@click.pass_context
def command(
    ctx: click.Context,
    run: Path,
    deck: Path,
    out_dir: Path | None,
    anyway: bool,
    carriage_control: bool,
    dated: bool,
) -> None:
    """Set the stereomodels of DECK up on RUN.json: the listing NAME.setup.lst and the record NAME.setup.json.

    They have the axes of the models, what the stages should read of the points of the run, whether the models are
    recovered, and the standard errors to expect. DECK needs no readings. Exit status: 0 done, 1 the run or the deck
    cannot be used.
    """
    from musatpy.as11_runs import set_up_deck, setup_paths

    refuse_overwriting(setup_paths(deck, out_dir), [run, deck])
    date = datetime.date.today() if dated else None
    result = set_up_deck(run, deck, out_dir, anyway=anyway, carriage_control=carriage_control, date=date)
    compiled = report_faults(ctx, deck, result)
    models = count_of(len(compiled.models), "model")
    tell(f"{name_of(deck)}: {models} set up, listing {name_of(result.files[0])}")
