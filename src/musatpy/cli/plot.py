"""`musat plot`: the pictures of records."""

from __future__ import annotations

from pathlib import Path

import click

from musatpy.cli.messages import complain, complain_of_error, name_of, tell
from musatpy.cli.options import NamedPath, out_option
from musatpy.errors import MusatError, printable


def show_names(context: click.Context, _: click.Parameter, shown: bool) -> None:
    """List the pictures of each kind of record."""
    if not shown:
        return
    from musatpy.plots.gallery import KINDS

    for kind in KINDS.values():
        tell(f"of a {kind.what}:")
        for picture in kind.pictures:
            tell(f"  {picture.name:<16}{picture.title}")
    context.exit()


@click.command(name="plot", short_help="Draw the pictures of records.")
@click.argument("records", metavar="RECORD...", nargs=-1, required=True, type=NamedPath())
@out_option
@click.option("--only", "names", metavar="NAME", multiple=True, help="This picture; may be given again.")
@click.option(
    "--line", metavar="FILE", type=NamedPath(), help="Where the depth profile runs (CSV, GeoJSON, DXF, ...)."
)
@click.option("--soundings", metavar="FILE", type=NamedPath(), help="Soundings in the depth profile (CSV, LAS).")
@click.option(
    "--within",
    metavar="M",
    type=click.FloatRange(min=0.0, min_open=True),
    help="Points so near the line stand in the profile, m; as near as it must be where not given.",
)
@click.option("--datum", metavar="H", type=float, default=0.0, help="Height from which their depths count, m.")
@click.option("--crs", default="", help="System of x and y of a file that says none: EPSG:32620.")
@click.option(
    "--list", is_flag=True, is_eager=True, expose_value=False, callback=show_names, help="List the pictures."
)
@click.option("-q", "--quiet", is_flag=True, help="Do not say what pictures show.")
@click.pass_context
def command(
    ctx: click.Context,
    records: tuple[Path, ...],
    out_dir: Path | None,
    names: tuple[str, ...],
    line: Path | None,
    soundings: Path | None,
    within: float | None,
    datum: float,
    crs: str,
    quiet: bool,
) -> None:
    """Draw the pictures of each RECORD, NAME.json of a run or a compilation, as NAME.PICTURE.svg.

    A picture of more than 2,000 marks becomes a .png. RECORD may also be of a comparison with soundings.

    Exit status: 0 done, 1 a record cannot be used, or has nothing to show.
    """
    from musatpy.plots.files import check_names, check_stems, drawn, profile_of

    try:
        check_names(names)
        check_stems(records, out_dir)
    except MusatError as error:
        raise click.UsageError(str(error)) from error
    profile = profile_of(line, soundings, crs, datum, within) if line or soundings or within else None
    failed = False
    for record in records:
        try:
            done = drawn(record, out_dir, names, profile)
        except (MusatError, OSError) as error:
            complain_of_error(error)
            failed = True
            continue
        for name, reason in done.reasons.items():
            complain(f"{name_of(record)}: no {name}: {reason}")
        for path, sentence in zip(done.files, done.sentences, strict=True):
            if not quiet:
                tell(f"{name_of(path)}: {printable(sentence)}")
        failed |= not done.files
    ctx.exit(int(failed))
