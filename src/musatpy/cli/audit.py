"""`musat audit`: are printed reports consistent with themselves, and what does a newer run say?"""

from __future__ import annotations

import errno
import json
from pathlib import Path

import click

from musatpy.cli.diff import cycles_left_alone
from musatpy.cli.messages import complain, complain_of, complain_of_system, tell
from musatpy.errors import MusatError, ProblemsError

INCONSISTENT, UNREADABLE = 1, 2


@click.command(name="audit", short_help="Find the misprints of a listing.")
@click.argument("listing", metavar="LISTING", type=click.Path(path_type=Path))
@click.option(
    "--against",
    metavar="NEW",
    type=click.Path(path_type=Path),
    help="Put the statistics beside those of a newer run: its listing, or its record NAME.json.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option(
    "--listed",
    type=click.IntRange(min=1),
    default=30,
    show_default=True,
    help="Rows of each report that --against shows.",
)
@click.pass_context
def command(ctx: click.Context, listing: Path, against: Path | None, as_json: bool, listed: int) -> None:
    """Read the standard reports of a LISTING, legacy or ours, scanned or not, and check that their numbers agree.

    These are the analyses, plate residuals of the frames and bathymetric points. Every repair of scanned text is
    reported. Exit status: 0 consistent, 1 inconsistent, 2 where a file, or a row of
    the listing, cannot be read, or the results not be written.
    """
    from musatpy.listings.audit.against import side_by_side, side_record, side_text
    from musatpy.listings.audit.reading import audit, audit_record, audit_text, read_listing

    try:
        with cycles_left_alone():
            structures = read_listing(listing)
            beside = None if against is None else side_by_side(structures, against)
            findings = audit(structures)
    except ProblemsError as error:
        complain_of(error.problems)
        ctx.exit(UNREADABLE)
    except MusatError as error:
        complain(str(error))
        ctx.exit(UNREADABLE)
    except OSError as error:
        complain_of_system(error)
        ctx.exit(UNREADABLE)
    if as_json:
        record = audit_record(structures, findings) | ({} if beside is None else side_record(beside))
        text = json.dumps(record, indent=1) + "\n"
    else:
        text = audit_text(structures, findings)
        if beside is not None:
            text += "\n" + side_text(beside, listed)
    try:
        tell(text, nl=False)
    except OSError as error:
        if error.errno == errno.EPIPE:
            raise  # click ends quietly
        complain_of_system(error)
        ctx.exit(UNREADABLE)  # 1 would say that the listing is inconsistent
    if findings:
        ctx.exit(INCONSISTENT)
    if structures.unreadable:
        ctx.exit(UNREADABLE)
