"""A compilation deck on the record of a run: read, set up, compile, report (`musat as11 compile`, `setup`)."""

from __future__ import annotations

import datetime
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from musatpy.compilation.against_run import against_run
from musatpy.compilation.bottom import Bottom, bottom_of
from musatpy.compilation.compiled import Compiled, compiled
from musatpy.compilation.profiles import CompiledProfile, profiles_of
from musatpy.compilation.run_records import of_record
from musatpy.compilation.setups import model_set_up
from musatpy.compilation.triangulation import Triangulation, of_block
from musatpy.errors import CompilationError, DeckError, Problem, ProblemsError
from musatpy.files import write_files
from musatpy.formats.compilation_deck import read_compilation
from musatpy.formats.musat import check_deck
from musatpy.interchange.geojson import write_each
from musatpy.interchange.layers import Lines, Points
from musatpy.model import CoordinateSystem
from musatpy.model.compilation import AGAIN
from musatpy.reports import compilation, compilation_setup, run_comparison
from musatpy.reports.compilation_bottom import contours_csv, grid_csv, profiles_csv
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
    anyway: bool = False,
    carriage_control: bool = False,
    csv: bool = False,
    plots: bool = False,
    gis: bool = False,
    las: bool = False,
    crs: str = "",
    date: datetime.date | None = None,
) -> CompileResult:
    """Compile a deck in stereomodels of the record of a run, and write `NAME.lst` and `NAME.json`.

    With profiles also `NAME.profiles.csv`, with contours `NAME.contours.csv`, with grids of posts `NAME.GRID.csv`,
    with `plots` the pictures of the record and that of contours, `NAME.contours.png` and `.pdf`; with `gis`
    `NAME.gpkg`, `NAME.dxf` and `NAME.GRID.tif`, with `las` `NAME.las`, all in the system `crs` where it is given;
    with `csv` the
    tables of the listing, in `NAME_tables`; `anyway` also on a run that has not converged. Where run or deck
    cannot be used nothing is written, and every reason is in `problems`. Raises `OSError` where files cannot be
    read or written.
    """
    result, bottom, problems = _with_bottom(run, deck, anyway)
    if result is None:
        return CompileResult(status=ExitStatus.UNUSABLE, problems=tuple(problems), compiled=None)
    kind = result.deck.stages.kind
    against = [against_run(model, kind[model.rows] == AGAIN) for model in result.models]
    profiles = profiles_of(result)
    warnings = (*(text for part in against for text in part.warnings()), *result.warnings())
    sections = compilation.sections_of(result, against, profiles, bottom, warnings)
    listing, record = output_paths(deck, out_dir)[:2]
    text = compilation.listing_of(result, sections, carriage_control=carriage_control, date=date)
    values = compilation.record_of(result, against, profiles, bottom, warnings)
    files = {listing: text.encode(), record: dumps(values).encode()}
    if csv:
        folder = listing.with_name(f"{deck.stem}_tables")
        files |= {folder / name: table.encode() for name, table in csv_files(sections).items()}
    files |= {listing.with_suffix(f".{name}"): data for name, data in _extracts(result, profiles, bottom)}
    if plots:
        files |= {listing.with_suffix(f".{name}"): data for name, data in _pictures(result, bottom, values)}
    layers = _layers(result, bottom, crs) if gis or las else {}
    write_files(files)
    written = [*files, *(_for_gis(result, bottom, layers, listing) if gis else ())]
    written += _point_cloud(layers, listing) if las else ()
    of_globe, refused = write_each(layers, listing.with_suffix("")) if gis and crs else ([], [])
    return CompileResult(
        status=ExitStatus.DONE,
        problems=tuple(problems),
        compiled=result,
        warnings=(*warnings, *refused),
        files=(*written, *of_globe),
    )


def _with_bottom(run: Path, deck: Path, anyway: bool) -> tuple[Compiled | None, Bottom | None, list[Problem]]:
    """Return what came of a deck with readings and its bottom, None where it cannot be used, and every problem."""
    result, problems = _compiled(run, deck, anyway)
    if result is None:
        return None, None, problems
    if not len(result.rows):
        message = "the deck has no readings (no STG or MPT card)"
        return None, None, [*problems, Problem(file=str(deck), message=message)]
    try:
        return result, bottom_of(result), problems
    except ProblemsError as error:
        slips = [Problem(file=str(deck), message=slip, severity="warning") for slip in result.slips()]
        return None, None, [*problems, *slips, *_of_file(deck, error)]


def _extracts(
    result: Compiled, profiles: list[CompiledProfile], bottom: Bottom | None
) -> Iterator[tuple[str, bytes]]:
    """Yield the names and contents of the files that a deck asks for: profiles, contours, grids of posts."""
    angular = result.run.block.options.system is CoordinateSystem.GEOGRAPHIC
    datum = result.datum.height
    if profiles:
        yield "profiles.csv", profiles_csv(profiles, angular).encode()
    if bottom is None:
        return
    if result.deck.contours is not None:
        yield "contours.csv", contours_csv(bottom, angular, datum).encode()
    for grid in bottom.grids:
        yield f"{grid.name}.csv", grid_csv(grid, angular, datum).encode()


def set_up_deck(
    run: Path,
    deck: Path,
    out_dir: Path | None = None,
    *,
    anyway: bool = False,
    carriage_control: bool = False,
    date: datetime.date | None = None,
) -> CompileResult:
    """Set the models of a deck up on the record of a run, and write `NAME.setup.lst` and `NAME.setup.json`.

    `anyway` also on a run that has not converged. Where run or deck cannot be used nothing is written, and every
    reason is in `problems`. Raises `OSError` where files cannot be read or written.
    """
    result, problems = _compiled(run, deck, anyway)
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


def compare_points(
    run: Path, deck: Path, listing: Path, record: Path, anyway: bool = False
) -> tuple[int, tuple[float, float, float], list[Problem]]:
    """Compile a deck, and write its points beside those of the run by the same names.

    Returns how many there are, the least, mean and largest length of their differences (m), and warnings. Raises
    `ProblemsError` where run or deck cannot be used, and where they have no point in common, and `OSError`.
    """
    result, problems = compiled_deck(run, deck, anyway)
    kind = result.deck.stages.kind
    against = [against_run(model, kind[model.rows] == AGAIN) for model in result.models]
    count = sum(len(part.rows) for part in against)
    if not count:
        raise CompilationError([Problem(file=str(deck), message="no point of it has a position in the run too")])
    values = dumps(run_comparison.record_of(result, against))
    write_files({listing: run_comparison.listing_of(result, against).encode(), record: values.encode()})
    return count, run_comparison.vectors(against), problems


def setup_paths(deck: Path, out_dir: Path | None) -> tuple[Path, Path]:
    """Return where the listing and the record of models set up go."""
    stem = (deck.parent if out_dir is None else out_dir) / f"{deck.stem}.setup"
    return stem.with_name(f"{stem.name}.lst"), stem.with_name(f"{stem.name}.json")


def run_of(path: Path, anyway: bool = False) -> Triangulation:
    """Return the triangulation of the record of a run, or of a punched deck; `anyway` also of one unconverged.

    Raises `CompilationError` or `DeckError` where it cannot be compiled from, and `OSError`.
    """
    with path.open("rb") as file:
        is_record = path.suffix.lower() == ".json" or file.read(64).lstrip().startswith(b"{")
    if is_record:
        return of_record(path, anyway)
    block, problems = check_deck(path, for_run=False)
    if block is None:
        raise DeckError(problems)
    try:
        return of_block(block)
    except CompilationError as error:
        raise CompilationError(_of_file(path, error)) from error


def compiled_deck(run: Path, deck: Path, anyway: bool = False) -> tuple[Compiled, list[Problem]]:
    """Return what came of a deck on a run, and warnings.

    Raises `ProblemsError` with every problem of both where they cannot be used, and `OSError`.
    """
    problems: list[Problem] = []
    triangulation = contents = None
    try:
        triangulation = run_of(run, anyway)
    except ProblemsError as error:
        problems += error.problems
    try:
        contents, of_cards = read_compilation(deck, triangulation.block if triangulation else None)
        problems += of_cards
    except ProblemsError as error:
        problems += error.problems
    if triangulation is None or contents is None:
        raise ProblemsError(problems)
    try:
        return compiled(triangulation, contents), problems
    except ProblemsError as error:
        raise ProblemsError([*problems, *_of_file(deck, error)]) from error


def _compiled(run: Path, deck: Path, anyway: bool) -> tuple[Compiled | None, list[Problem]]:
    """Return what came of a deck, None where it or the run cannot be used, and every problem of both."""
    try:
        return compiled_deck(run, deck, anyway)
    except ProblemsError as error:
        return None, list(error.problems)


def _layers(result: Compiled, bottom: Bottom | None, crs: str) -> dict[str, Points | Lines]:
    from musatpy.compilation.gis_layers import layers_of  # few users need these packages

    return layers_of(result, bottom, crs)


def _for_gis(
    result: Compiled, bottom: Bottom | None, layers: dict[str, Points | Lines], listing: Path
) -> Iterator[Path]:
    """Write layers and grids for GIS and CAD, and yield where they are."""
    from musatpy.compilation.gis_layers import raster_of
    from musatpy.interchange import dxf, geopackage, geotiff

    for suffix, write in ((".gpkg", geopackage.write), (".dxf", dxf.write)):
        path = listing.with_suffix(suffix)
        write(path, layers)
        yield path
    for grid in () if bottom is None else bottom.grids:
        path = listing.with_suffix(f".{grid.name}.tif")
        geotiff.write(path, raster_of(grid, result.datum))
        yield path


def _point_cloud(layers: dict[str, Points | Lines], listing: Path) -> Iterator[Path]:
    """Write the points with their columns of numbers as a LAS file, and yield where it is."""
    from musatpy.interchange import las

    points, path = layers["points"], listing.with_suffix(".las")
    assert isinstance(points, Points)
    columns = {name: column for name, column in points.columns.items() if not column.is_text}
    las.write(path, replace(points, columns=columns))
    yield path


def _pictures(result: Compiled, bottom: Bottom | None, record: dict[str, Any]) -> Iterator[tuple[str, bytes]]:
    """Yield the names and contents of the pictures of a record, and of the contours as a PNG and a page of PDF."""
    from musatpy.compilation.pictures import contour_pictures  # few users draw
    from musatpy.plots.gallery import COMPILED, rendered

    for picture in COMPILED:
        if found := rendered(picture, record):
            yield f"{picture.name}.{found[0]}", found[1]
    if bottom is not None:
        for kind, data in contour_pictures(result, bottom).items():
            yield f"contours.{kind}", data


def _of_file(path: Path, error: ProblemsError) -> list[Problem]:
    return [Problem(file=str(path), message=problem.message) for problem in error.problems]
