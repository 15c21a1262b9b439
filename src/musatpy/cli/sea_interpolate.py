"""`musat sea interpolate`: errors of heights interpolated between control points in the water."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from musatpy.cli.depth_options import POSITIVE, Finite, system_options
from musatpy.cli.messages import name_of, progress_through, tell
from musatpy.cli.options import columns_of, columns_option, quiet_option, refuse_overwriting

if TYPE_CHECKING:
    from musatpy.sea.interpolation.control_tables import Control, ControlTable, RecordPoint
    from musatpy.sea.interpolation.interpolate import Interpolation
    from musatpy.sea.interpolation.mapped_points import Progress, Tally


@dataclass(frozen=True, kw_only=True, eq=False)
class _Job:
    """The records and the deck among the files, None where they are none, and the system of the points."""

    record: dict[str, Any] | None  # of POINTS
    known: dict[str, Any] | None  # of CONTROL
    deck: Any
    system: Any


FAMILIES = ("none", "gaussian", "exponential", "elliptic", "bessel", "swell")
UNHELPFUL = 3  # exit status where the interpolation does not help
_RECORD, _TABLES, _LAS = ".json", (".csv", ".txt"), (".las", ".laz")


@click.command(name="interpolate", short_help="Correct heights by what is wrong at control points.")
@click.argument("points", type=click.Path(path_type=Path))
@click.argument("control", type=click.Path(path_type=Path))
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path), help="The file of corrected points.")
@columns_option
@system_options
@click.option("--trend", type=click.Choice(["constant", "plane"]), default="constant", show_default=True)
@click.option(
    "--function",
    "families",
    multiple=True,
    type=click.Choice(FAMILIES),
    help="A covariance function to be tried; all where not given.",
)
@click.option("--sigma", type=Finite(0.0), metavar="M", help="Of control points without their own; 0 if not given.")
@click.option("--no-noise", is_flag=True, help="Estimate no noise: the sigmas of the control points say all.")
@click.option("--keep-outliers", is_flag=True, help="Use control points that contradict the others too.")
@click.option(
    "--reach",
    type=POSITIVE,
    metavar="M",
    help="Correct what lies so near to a control point; that of the covariance where not given.",
)
@click.option("--plots", is_flag=True, help="A picture too (NAME.png); needs the extra 'plots'.")
@quiet_option
def command(points: Path, control: Path, out: Path, quiet: bool, **given: Any) -> None:
    """Correct the heights of POINTS by their errors at CONTROL, interpolated by least-squares collocation.

    POINTS are comma-separated values under a line of names, a LAS or LAZ file, or the record NAME.json of a run.
    CONTROL has columns id,x,y,dz (mapped minus true) or id,x,y,z_mapped,z_true or id,z_true, and sigma where known;
    or it is a deck or record, whose check points count. The report goes beside the result, NAME.txt. Exit status 3
    where the interpolation does not help; the files are written all the same.
    """
    from musatpy.files import write_files
    from musatpy.reports.sea import collocation_text, verdict_line
    from musatpy.sea.interpolation.control_tables import on_plan
    from musatpy.sea.interpolation.interpolate import Benefit, interpolate
    from musatpy.sea.interpolation.mapped_points import corrected_record

    columns = columns_of(points, given["columns"])
    report, picture = out.with_suffix(".txt"), out.with_suffix(".png")
    if (points.suffix.lower() in _LAS) != (out.suffix.lower() in _LAS):
        raise click.UsageError(f"{name_of(points)} and {name_of(out)} are not of one kind")
    _check_outputs([out, report, *([picture] if given["plots"] else [])], [points, control])
    job = _of_job(points, control, given)
    known, mapped = _control(points, control, columns, job, given["sigma"])
    known, plan = on_plan(known, job.system)
    result = interpolate(known.observed, _options(given))
    files = {report: collocation_text(result, known.ids, (points.name, control.name)).encode()}
    if given["plots"]:
        from musatpy.sea.pictures import interpolation_picture

        files[picture] = interpolation_picture(result)
    if mapped is None:
        with progress_through(points, quiet) as progress:
            tally = _correct(points, out, result, columns, plan, progress)
    else:
        tally = corrected_record(out, result, mapped, plan)
    write_files(files)
    if not quiet:
        tell(f"{name_of(out)}: {tally.in_words()}\n{verdict_line(result)}")
    if result.verdict == Benefit.NOT:
        click.get_current_context().exit(UNHELPFUL)


def _check_outputs(results: Sequence[Path], inputs: Sequence[Path]) -> None:
    from musatpy.files import real_path

    places = [real_path(path) for path in results]
    if len(set(places)) < len(places):
        raise click.UsageError(
            f"{name_of(results[0])}: the report and the picture stand beside it as .txt and .png"
        )
    refuse_overwriting(results, inputs)


def _options(given: dict[str, Any]) -> Any:
    from musatpy.sea.interpolation.correlation import SignalKind
    from musatpy.sea.interpolation.interpolate import InterpolationOptions
    from musatpy.sea.interpolation.prediction import Trend

    families = tuple(family for family in SignalKind if not given["families"] or family in given["families"])
    return InterpolationOptions(
        trend=Trend.PLANE if given["trend"] == "plane" else Trend.CONSTANT,
        families=families,
        free_noise=not given["no_noise"],
        reject=not given["keep_outliers"],
        reach=given["reach"],
    )


def _of_job(points: Path, control: Path, given: dict[str, Any]) -> _Job:
    """Return records and deck among the files, and the system of points: as it is said, else that of the job."""
    from musatpy.depth.cameras import system_alone
    from musatpy.depth.point_positions import LOCAL
    from musatpy.formats.musat import read_deck
    from musatpy.sea.interpolation.control_tables import deck_system, record_system, run_tables

    record, known = (run_tables(path) if path.suffix.lower() == _RECORD else None for path in (points, control))
    is_deck = control.suffix.lower() not in (_RECORD, *_TABLES)
    deck = read_deck(control) if is_deck else None
    system: Any = system_alone(given["crs"], given["geoid"])
    if system is not None and (record is not None or not system.plane_alone):
        why = "a record has its own system" if record is not None else f"{system.text} has no heights"
        raise click.UsageError(f"--crs: {why}")
    if system is None and (record or known):
        system = record_system(record or known or {})
    if system is None:
        system = LOCAL if deck is None else deck_system(deck)
    return _Job(record=record, known=known, deck=deck, system=system)


def _control(
    points: Path, control: Path, columns: Sequence[str], job: _Job, sigma: float | None
) -> tuple[Control, list[RecordPoint] | None]:
    """Return the control points, and the points of a record, None where POINTS are none."""
    from musatpy.sea.interpolation.control_tables import control_of, record_points
    from musatpy.sea.interpolation.mapped_points import read_mapped

    mapped = None if job.record is None else record_points(job.record, job.system)
    table = _control_table(control, job)
    known: Any = {}
    if table.needs_mapped and mapped is not None:
        known = {point.id: point.position for point in mapped if point.position is not None}
    elif table.needs_mapped and points.suffix.lower() in _LAS:
        message = f"points of {name_of(points)} have no ids: the control points need x, y and dz, or both heights"
        raise click.UsageError(message)
    elif table.needs_mapped:
        known = read_mapped(points, [row.id for row in table.rows], columns, job.system)
    return control_of(table, known, str(points), sigma), mapped


def _control_table(control: Path, job: _Job) -> ControlTable:
    """Return the control points of a CSV file, or the check points of a record or a deck."""
    from musatpy.sea.interpolation.control_tables import deck_control, read_control, record_control

    if job.known is not None:
        return record_control(job.known, str(control), job.system)
    return (
        read_control(control, job.system) if job.deck is None else deck_control(job.deck, str(control), job.system)
    )


def _correct(
    points: Path, out: Path, result: Interpolation, columns: Sequence[str], plan: Any, progress: Progress | None
) -> Tally:
    from musatpy.sea.interpolation.mapped_points import correct_csv, correct_las

    if points.suffix.lower() in _LAS:
        return correct_las(points, out, result, plan=plan, progress=progress)
    return correct_csv(points, out, result, columns=columns, plan=plan, progress=progress)
