"""`musat orient`: photos oriented through the water, from nothing."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from musatpy.cli.messages import complain, complain_of, complain_of_each, complain_of_error, count_of, name_of, tell
from musatpy.cli.options import (
    carriage_control_option,
    csv_option,
    date_option,
    decks_argument,
    formats_option,
    out_option,
    strict_option,
)
from musatpy.errors import MusatError

if TYPE_CHECKING:
    from musatpy.orient_runs import OrientResult


@click.command(name="orient", short_help="Orient photos through an unknown water surface, from nothing.")
@decks_argument
@out_option
@formats_option
@click.option("-q", "--quiet", is_flag=True, help="No summary; messages of errors only.")
@carriage_control_option
@csv_option
@strict_option
@date_option
@click.option("--punch", is_flag=True, help="Write NAME.pun too: the deck that a run starts from.")
@click.option(
    "--study",
    is_flag=True,
    help="Where starts lead, and what depths and dry points do: NAME.study.txt, pictures; needs the extra 'plots'.",
)
@click.pass_context
def command(
    ctx: click.Context,
    /,
    decks: tuple[Path, ...],
    out_dir: Path | None,
    formats_dir: Path | None,
    quiet: bool,
    dated: bool,
    strict: bool,
    **outputs: bool,
) -> None:
    """Orient the photos of each DECK as its ORI card says, and write the listing NAME.lst and the record NAME.json.

    Exit status: 0 all accepted or doubtful, 1 a deck or its data cannot be used, 3 not
    converged, 4 an answer is rejected (with
    --strict: or doubtful).
    """
    from musatpy.formats.job_tables import card_family
    from musatpy.orient_runs import orient_deck
    from musatpy.runs import ExitStatus, check_outputs

    try:
        check_outputs(decks, out_dir, punch=outputs["punch"])
    except MusatError as error:
        raise click.UsageError(str(error)) from error
    family, date = card_family(formats_dir), datetime.date.today() if dated else None
    statuses = []
    for deck in decks:
        try:
            result = orient_deck(deck, out_dir, strict=strict, date=date, family=family, **outputs)
        except OSError as error:
            complain_of_error(error)
            statuses.append(ExitStatus.UNUSABLE)
            continue
        _tell(result, quiet)
        statuses.append(result.status)
    ctx.exit(ExitStatus.worst(statuses))


def _tell(result: OrientResult, quiet: bool) -> None:
    """Print problems to stderr and, unless `quiet`, the summary to stdout."""
    complain_of(result.problems)
    name, answer = name_of(result.deck), result.answer
    if answer is None:
        errors = sum(problem.severity == "error" for problem in result.problems)
        complain(f"{name}: not oriented, {count_of(errors, 'error')}")
        return
    complain_of_each(result.deck, (f"{reason.grade.lower()}: {reason.text}" for reason in answer.verdict.reasons))
    if not quiet:
        photos = answer.photos.tolist()
        of = ", ".join(photos) if len(photos) <= 3 else f"{len(photos)} photos"
        tell(
            f"{name}: {answer.verdict.grade}, {answer.task.spec.method} of {of}, "
            f"sigma0 {answer.sigma0:.4f}, {answer.summary}, listing {name_of(result.files[0])}"
        )
