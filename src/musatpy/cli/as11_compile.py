"""`musat as11 compile`: the points of a compilation deck, with their sigmas."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from musatpy.cli.messages import complain, complain_of, complain_of_each, count_of, name_of, tell
from musatpy.cli.options import (
    NamedPath,
    anyway_option,
    carriage_control_option,
    csv_option,
    date_option,
    out_option,
    refuse_overwriting,
    strict_option,
)

if TYPE_CHECKING:
    from musatpy.as11_runs import CompileResult
    from musatpy.compilation.compiled import Compiled


@click.command(name="compile", short_help="Compile the points of a deck.")
@click.argument("run", type=NamedPath())
@click.argument("deck", type=NamedPath())
@out_option
@anyway_option
@carriage_control_option
@csv_option
@click.option("--plots", is_flag=True, help="Pictures of depths, sigmas, contours too (NAME.depths.svg).")
@click.option("--gis", is_flag=True, help="Points and contours for GIS and CAD too (NAME.gpkg, NAME.dxf).")
@click.option("--las", is_flag=True, help="Points with depths and sigmas as a cloud too (NAME.las).")
@click.option(
    "--crs",
    default="",
    help="System of these files, on the ellipsoid of the job: EPSG:4267; then GeoJSON too.",
)
@strict_option
@date_option
@click.pass_context
def command(
    ctx: click.Context,
    run: Path,
    deck: Path,
    out_dir: Path | None,
    anyway: bool,
    carriage_control: bool,
    csv: bool,
    plots: bool,
    gis: bool,
    las: bool,
    crs: str,
    strict: bool,
    dated: bool,
) -> None:
    """Compile the compilation DECK in stereomodels of RUN.json: the listing NAME.lst and the record NAME.json.

    RUN.json is the record of a run; a punched deck serves too, without covariances. Exit status: 0 done, 1 the run
    or the deck cannot be used, 4 rejected (with --strict: or doubtful).
    """
    if crs and not (gis or las):
        raise click.UsageError("--crs goes with --gis or --las")
    from musatpy.as11_runs import compile_deck
    from musatpy.runs import output_paths

    refuse_overwriting(output_paths(deck, out_dir)[:2], [run, deck])
    date = datetime.date.today() if dated else None
    result = compile_deck(
        run,
        deck,
        out_dir,
        anyway=anyway,
        carriage_control=carriage_control,
        csv=csv,
        plots=plots,
        gis=gis,
        las=las,
        crs=crs,
        strict=strict,
        date=date,
    )
    compiled = report_faults(ctx, deck, result)
    lost = sum(reason is not None for reason in compiled.reasons)
    without = f", {lost} without coordinates" if lost else ""
    of = f"{count_of(len(compiled.rows), 'point')} in {count_of(len(compiled.models), 'model')}"
    grade = "" if result.verdict is None else f"{result.verdict.grade}, "
    tell(f"{name_of(deck)}: {grade}{of}{without}, listing {name_of(result.files[0])}")
    ctx.exit(result.status)


def report_faults(ctx: click.Context, deck: Path, result: CompileResult) -> Compiled:
    """Complain of what is wrong or odd, and return what came of the deck; exit where nothing did."""
    complain_of(result.problems)
    if result.compiled is None:
        errors = sum(problem.severity == "error" for problem in result.problems)
        complain(f"{name_of(deck)}: not compiled, {count_of(errors, 'error')}")
        ctx.exit(result.status)
    reasons = result.verdict.reasons if result.verdict else ()
    complain_of_each(deck, (*(f"{one.grade.lower()}: {one.text}" for one in reasons), *result.warnings))
    return result.compiled
