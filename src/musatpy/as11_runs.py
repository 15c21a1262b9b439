"""A compilation deck on the record of a run: read, set up, compile, report (`musat as11 compile`, `setup`)."""

from __future__ import annotations

import datetime
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from musatpy.compilation.against_run import against_run
from musatpy.compilation.bottom import Bottom, bottoms_of
from musatpy.compilation.compiled import Compiled, compiled
from musatpy.compilation.profiles import profiles_of
from musatpy.compilation.setups import model_set_up
from musatpy.compilation.triangulation import of_record
from musatpy.errors import Problem, ProblemsError
from musatpy.files import write_files
from musatpy.formats.compilation_deck import read_compilation
from musatpy.model import CoordinateSystem
from musatpy.model.compilation import AGAIN
from musatpy.reports import compilation, compilation_setup
from musatpy.reports.compilation_bottom import contours_csv, profiles_csv
from musatpy.reports.csv_files import csv_files
from musatpy.reports.record import dumps
from musatpy.runs import ExitStatus, output_paths


@dataclass(frozen=True, kw_only=True, eq=False)
class CompileResult:
    """A compilation deck after its compilation: what came of it, None where nothing did, and the files written."""

    status: ExitStatus
    problems: tuple[Problem, ...]
    compiled: Compiled | None
    warnings: tuple[str, ...] = ()  # what is odd about the readings
    files: tuple[Path, ...] = ()  # the listing first, then the record, tables


def compile_deck(
    run: Path,
    deck: Path,
    out_dir: Path | None = None,
    *,
    carriage_control: bool = False,
    csv: bool = False,
    plots: bool = False,
    gis: bool = False,
    date: datetime.date | None = None,
) -> CompileResult:
    """Compile a deck in stereomodels of the record of a run, and write `NAME.lst` and `NAME.json`.

    With profiles also `NAME.profiles.csv`, with contours `NAME.contours.csv`, and with `plots` their picture,
    `NAME.contours.png`; with `gis` `NAME.gpkg` and `NAME.dxf`; with `csv` the tables of the listing, in
    `NAME_tables`. Where run or deck cannot be used nothing is written, and every reason is in `problems`. Raises
    `OSError` where files cannot be read or written.
    """
    result, problems = _compiled(run, deck)
    if result is not None and not len(result.rows):
        problems.append(Problem(file=str(deck), message="the deck has no readings (no STG or MPT card)"))
        result = None
    if result is None:
        return CompileResult(status=ExitStatus.UNUSABLE, problems=tuple(problems), compiled=None)
    contents = result.deck
    against = [against_run(model, contents.stages.kind[model.rows] == AGAIN) for model in result.models]
    profiles, bottoms = profiles_of(result), bottoms_of(result)
    warnings = (*(text for part in against for text in part.warnings()), *result.warnings())
    sections = compilation.sections_of(result, against, profiles, bottoms, warnings)
    listing, record = output_paths(deck, out_dir)[:2]
    text = compilation.listing_of(result, sections, carriage_control=carriage_control, date=date)
    files = {
        listing: text.encode(),
        record: dumps(compilation.record_of(result, against, profiles, bottoms, warnings)).encode(),
    }
    if csv:
        folder = listing.with_name(f"{deck.stem}_tables")
        files |= {folder / name: table.encode() for name, table in csv_files(sections).items()}
    if profiles:
        angular = result.run.block.options.system is CoordinateSystem.GEOGRAPHIC
        files[listing.with_suffix(".profiles.csv")] = profiles_csv(profiles, angular).encode()
    if bottoms:
        files[listing.with_suffix(".contours.csv")] = contours_csv(bottoms, result.datum.height).encode()
    if plots and bottoms:
        files[listing.with_suffix(".contours.png")] = _picture(result, bottoms)
    write_files(files)
    written = [*files, *(_for_gis(result, bottoms, listing) if gis else ())]
    return CompileResult(
        status=ExitStatus.DONE,
        problems=tuple(problems),
        compiled=result,
        warnings=warnings,
        files=tuple(written),
    )


def set_up_deck(
    run: Path,
    deck: Path,
    out_dir: Path | None = None,
    *,
    carriage_control: bool = False,
    date: datetime.date | None = None,
) -> CompileResult:
    """Set the models of a deck up on the record of a run, and write `NAME.setup.lst` and `NAME.setup.json`.

    Where run or deck cannot be used nothing is written, and every reason is in `problems`. Raises `OSError` where
    files cannot be read or written.
    """
    result, problems = _compiled(run, deck)
    if result is None:
        return CompileResult(status=ExitStatus.UNUSABLE, problems=tuple(problems), compiled=None)
    kind = result.deck.stages.kind
    setups = compilation_setup.SetUps(
        compiled=result,
        models=[model_set_up(model, kind[model.rows]) for model in result.models],
        against=[against_run(model, kind[model.rows] == AGAIN) for model in result.models],
    )
    warnings = (*(text for part in setups.against for text in part.warnings()), *result.warnings())
    listing, record = setup_paths(deck, out_dir)
    text = compilation_setup.listing_of(setups, warnings, carriage_control=carriage_control, date=date)
    values = dumps(compilation_setup.record_of(setups, warnings))
    write_files({listing: text.encode(), record: values.encode()})
    return CompileResult(
        status=ExitStatus.DONE,
        problems=tuple(problems),
        compiled=result,
        warnings=warnings,
        files=(listing, record),
    )


def setup_paths(deck: Path, out_dir: Path | None) -> tuple[Path, Path]:
    """Return where the listing and the record of models set up go."""
    stem = (deck.parent if out_dir is None else out_dir) / f"{deck.stem}.setup"
    return stem.with_name(f"{stem.name}.lst"), stem.with_name(f"{stem.name}.json")


def _compiled(run: Path, deck: Path) -> tuple[Compiled | None, list[Problem]]:
    """Return what came of a deck, None where it or the run cannot be used, and every problem of both."""
    problems: list[Problem] = []
    triangulation = contents = None
    try:
        triangulation = of_record(run)
    except ProblemsError as error:
        problems += error.problems
    try:
        contents, of_cards = read_compilation(deck, triangulation.block if triangulation else None)
        problems += of_cards
    except ProblemsError as error:
        problems += error.problems
    if triangulation is None or contents is None:
        return None, problems
    try:
        return compiled(triangulation, contents), problems
    except ProblemsError as error:
        return None, [*problems, *_of_deck(deck, error)]


def _for_gis(result: Compiled, bottoms: list[Bottom], listing: Path) -> Iterator[Path]:
    """Write points and contours for GIS and CAD, and yield where they are."""
    from musatpy.compilation.gis_layers import layers_of  # few users need these packages
    from musatpy.interchange import dxf, geopackage

    layers = layers_of(result, bottoms)
    for suffix, write in ((".gpkg", geopackage.write), (".dxf", dxf.write)):
        path = listing.with_suffix(suffix)
        write(path, layers)
        yield path


def _picture(result: Compiled, bottoms: list[Bottom]) -> bytes:
    from musatpy.compilation.pictures import contour_picture  # few users draw

    title = result.deck.titles[0] if result.deck.titles else "Bottom"
    return contour_picture(bottoms, title, result.datum.name or "the height 0")


def _of_deck(deck: Path, error: ProblemsError) -> list[Problem]:
    return [Problem(file=str(deck), message=problem.message) for problem in error.problems]
