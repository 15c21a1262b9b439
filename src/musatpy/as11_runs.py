"""A compilation deck on the record of a run: read, set up, compile, report (`musat as11 compile`, `setup`)."""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from musatpy.compilation.against_run import against_run, model_set_up
from musatpy.compilation.answers import places_of
from musatpy.compilation.bottom import Bottom, bottoms_of
from musatpy.compilation.compiled import Compiled, compiled
from musatpy.compilation.profiles import oddities, profiles_of, scans_of
from musatpy.compilation.stereomodels import faults_of_pair, unadjusted
from musatpy.compilation.triangulation import TABLES, AdjustedRun, of_block, of_record, of_tables
from musatpy.compilation.verdicts import lost, slips, verdict_of, warnings_of
from musatpy.errors import CompilationError, DeckError, Problem, ProblemsError
from musatpy.figures import FORM, ImageForm
from musatpy.files import together, write_files
from musatpy.formats.compilation_checks import READINGS
from musatpy.formats.compilation_deck import place_of, read_compilation, with_columns
from musatpy.formats.musat import check_deck
from musatpy.interchange.geojson import write_each
from musatpy.interchange.layers import Lines, Points
from musatpy.model import Solution, Verdict
from musatpy.model.compilation import AGAIN
from musatpy.reports import compilation
from musatpy.reports.compilation_bottom import contours_csv, grid_csv
from musatpy.reports.compilation_points import CompilationReport, profiles_csv
from musatpy.reports.pages import csv_files
from musatpy.reports.record import dumps, held_tables
from musatpy.runs import ExitStatus, output_paths
from musatpy.statistics import Statistics

if TYPE_CHECKING:
    from musatpy.adjustment.wavy_water import Sea

_NAMED = 10  # readings without a position that are told at their cards


@dataclass(frozen=True, kw_only=True, eq=False)
class CompileResult:
    """A compilation deck after its compilation: what came of it, None where nothing did, and the files written."""

    status: ExitStatus
    problems: tuple[Problem, ...]
    compiled: Compiled | None
    verdict: Verdict | None = None  # on what was compiled
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
    form: ImageForm = FORM,
    gis: bool = False,
    las: bool = False,
    crs: str = "",
    strict: bool = False,
    date: datetime.date | None = None,
) -> CompileResult:
    """Compile a deck in stereomodels of the record of a run, and write `NAME.lst` and `NAME.json`.

    With profiles also `NAME.profiles.csv`, with contours `NAME.contours.csv` and `NAME.heights.csv`, with grids of
    posts `NAME.GRID.csv`; with `plots` the pictures of the record and of contours, `NAME.contours.png`, in `form`;
    with `gis` `NAME.gpkg`, `NAME.dxf` and `NAME.GRID.tif`, with `las` `NAME.las`, all of them in the system `crs`
    where it is given; with `csv` the tables of the listing, in `NAME_tables`; `anyway` also on a run that has not
    converged. `strict` makes the status of a doubtful compilation that of a rejected one. Where run or deck cannot
    be used nothing is written, and every reason is in `problems`. Raises `OSError` where files cannot be read or
    written.
    """
    problems: list[Problem] = []
    try:
        result, problems = compiled_deck(run, deck, anyway)
        if not len(result.rows):
            raise CompilationError.of("the deck has no readings (no STG or MPT card)", file=deck)
        with _at(deck):
            done = _reported(result, bottoms_of(result))
    except ProblemsError as error:
        return _unusable([*problems, *error.problems])
    sections, values = compilation.sections_of(done), compilation.DOCUMENT.record(done)
    listing, record = output_paths(deck, out_dir)[:2]
    text = compilation.listing_of(done, sections, carriage_control=carriage_control, date=date)
    files = {listing: text.encode(), record: dumps(values).encode()}
    if csv:
        files |= csv_files(sections, listing)
    files |= {listing.with_suffix(f".{name}"): data for name, data in _extracts(done)}
    if plots:
        files |= {listing.with_suffix(f".{name}"): data for name, data in _pictures(done, values, form)}
    layers: dict[str, Points | Lines] = {}
    if gis or las:
        from musatpy.compilation.gis_layers import layers_of  # few users need these packages

        layers = layers_of(result, done.bottoms, crs)
    with together():
        write_files(files)
        written = [*files, *(_for_gis(done, layers, listing) if gis else ())]
        written += _point_cloud(layers, listing) if las else ()
        of_globe, refused = write_each(layers, listing.with_suffix("")) if gis and crs else ([], [])
    assert done.verdict is not None
    return CompileResult(
        status=ExitStatus.of(done.verdict.grade, strict=strict),
        problems=tuple(problems),
        compiled=result,
        verdict=done.verdict,
        warnings=(*done.warnings, *refused),
        files=(*written, *of_globe),
    )


def _unusable(problems: Sequence[Problem]) -> CompileResult:
    """Return that nothing came of a deck."""
    return CompileResult(status=ExitStatus.UNUSABLE, problems=tuple(problems), compiled=None)


def _beside_run(result: Compiled) -> CompilationReport:
    """Return the points of a deck beside those of the run, with what is odd about both."""
    against = [against_run(model, result.deck.stages.kind[model.rows] == AGAIN) for model in result.models]
    of_points = (text for part in against for text in part.warnings())
    return CompilationReport(compiled=result, against=against, warnings=(*of_points, *warnings_of(result)))


def _reported(result: Compiled, bottoms: Sequence[Bottom]) -> CompilationReport:
    """Return what is reported of a deck; raises `ProblemsError` where its profiles cannot be used."""
    done, profiles = _beside_run(result), profiles_of(result)
    drawn = (text for bottom in bottoms for text in bottom.warnings(result.deck.grids.ids.tolist()))
    return replace(
        done,
        warnings=(*done.warnings, *oddities(profiles), *drawn),
        verdict=verdict_of(result, done.against),
        profiles=profiles,
        scans=scans_of(result, profiles),
        bottoms=bottoms,
    )


def _extracts(done: CompilationReport) -> Iterator[tuple[str, bytes]]:
    """Yield the names and contents of the files that a deck asks for: profiles, contours, grids of posts."""
    places, datum = places_of(done.compiled), done.compiled.datum
    if done.profiles:
        yield "profiles.csv", profiles_csv(done.profiles, places, datum).encode()
    for bottom in done.bottoms:
        if bottom.sheets:
            yield f"{bottom.of.layer}.csv", contours_csv(bottom, places, datum).encode()
        for grid in bottom.grids:
            yield f"{grid.name}.csv", grid_csv(grid, places, datum).encode()


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
    try:
        result, problems = compiled_deck(run, deck, anyway)
    except ProblemsError as error:
        return _unusable(error.problems)
    kind = result.deck.stages.kind
    done = replace(_beside_run(result), set_up=[model_set_up(model, kind[model.rows]) for model in result.models])
    listing, record = setup_paths(deck, out_dir)
    sections = compilation.set_up_sections(done)
    text = compilation.listing_of(done, sections, carriage_control=carriage_control, date=date)
    write_files({listing: text.encode(), record: dumps(compilation.SET_UP.record(done)).encode()})
    return CompileResult(
        status=ExitStatus.DONE,
        problems=tuple(problems),
        compiled=result,
        warnings=tuple(done.warnings),
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
    done = _beside_run(result)
    count = sum(len(part.rows) for part in done.against)
    if not count:
        raise CompilationError.of("no point of it has a position in the run too", file=deck)
    values = dumps(compilation.AGAINST_RUN.record(done))
    write_files({listing: compilation.point_listing(done).encode(), record: values.encode()})
    return count, compilation.vectors(done), problems


def setup_paths(deck: Path, out_dir: Path | None) -> tuple[Path, Path]:
    """Return where the listing and the record of models set up go."""
    stem = (deck.parent if out_dir is None else out_dir) / f"{deck.stem}.setup"
    return stem.with_name(f"{stem.name}.lst"), stem.with_name(f"{stem.name}.json")


def run_of(path: Path, anyway: bool = False) -> AdjustedRun:
    """Return the triangulation of the record of a run, or of a punched deck; `anyway` also of one not adjusted.

    Raises `CompilationError` or `DeckError` where it cannot be compiled from, and `OSError`.
    """
    with path.open("rb") as file:
        is_record = path.suffix.lower() == ".json" or file.read(64).lstrip().startswith(b"{")
    if is_record:
        return of_record(path, anyway)
    block, problems = check_deck(path, for_run=False)
    if block is None:
        other = _other_than_run(path)
        raise DeckError([Problem(file=str(path), message=other)] if other else problems)
    with _at(path):
        run = of_block(block)
        if not anyway and (fault := unadjusted(run)):
            raise CompilationError.of(fault)
    return run


def of_solution(solution: Solution, sea: Sea | None = None) -> AdjustedRun:
    """Return the triangulation of a solution, with the waves that were given beside its block, if any.

    Raises `CompilationError` where it cannot be compiled from.
    """
    return of_tables(held_tables(Statistics(solution), TABLES), sea=sea)


def _other_than_run(path: Path) -> str:
    """Return what a file is that has no exposure stations; empty where it has some, or nothing at all."""
    with path.open("rb") as file:
        names = {line[:3] for line in file if line.strip()}
    if not names or names & {b"STA", b"STX"}:
        return ""
    content = "a compilation deck (MDL cards)" if b"MDL" in names else "no deck with exposure stations (STA cards)"
    return f"it is {content}; expected the record of a run, NAME.json, or the deck that it punched, NAME.pun"


def compiled_deck(run: Path, deck: Path, anyway: bool = False) -> tuple[Compiled, list[Problem]]:
    """Return what came of a deck on a run, and warnings.

    Raises `ProblemsError` with every problem of both where they cannot be used, and `OSError`. `anyway` takes a run
    that has not converged, and readings most of which make no points.
    """
    problems: list[Problem] = []
    triangulation = contents = None
    try:
        triangulation = run_of(run, anyway)
    except ProblemsError as error:
        problems += error.problems
    try:
        known = (triangulation.block, partial(faults_of_pair, triangulation)) if triangulation else ()
        contents, of_cards = read_compilation(deck, *known)
        problems += of_cards
    except ProblemsError as error:
        problems += error.problems
    if triangulation is None or contents is None:
        raise ProblemsError(problems)
    try:
        with _at(deck):
            result = compiled(triangulation, contents)
    except ProblemsError as error:
        raise ProblemsError([*problems, *error.problems]) from error
    slipped = list(_slips(deck, result))
    if slipped and not anyway:
        raise ProblemsError([*problems, *slipped])
    return result, [*problems, *_lost(deck, result)]


def _slips(deck: Path, result: Compiled) -> Iterator[Problem]:
    """Yield at their cards the models most of whose readings make no points."""
    assert result.deck.lines is not None  # it was read
    for row, message in slips(result):
        place = place_of(str(deck), int(result.deck.lines.models[row]), "MDL")
        yield Problem(**place, message=f"{message} (--anyway compiles it)")


def _lost(deck: Path, result: Compiled) -> Iterator[Problem]:
    """Yield at their cards the readings that give no position, the first of many."""
    assert result.deck.lines is not None
    as_points, without = result.deck.stages.as_points, list(lost(result))
    for row, message in without[:_NAMED]:
        place = place_of(str(deck), int(result.deck.lines.stages[row]), READINGS[int(as_points[row])])
        yield Problem(**place, message=message, severity="warning")
    if len(without) > _NAMED:
        message = f"and {len(without) - _NAMED} more readings without a position; see the listing"
        yield Problem(file=str(deck), message=message, severity="warning")


def _for_gis(done: CompilationReport, layers: dict[str, Points | Lines], listing: Path) -> Iterator[Path]:
    """Write layers and grids for GIS and CAD, and yield where they are."""
    from musatpy.compilation.gis_layers import raster_of
    from musatpy.interchange import dxf, geopackage, geotiff

    for suffix, write in ((".gpkg", geopackage.write), (".dxf", dxf.write)):
        path = listing.with_suffix(suffix)
        write(path, layers)
        yield path
    for grid in (grid for bottom in done.bottoms for grid in bottom.grids):
        path = listing.with_suffix(f".{grid.name}.tif")
        geotiff.write(path, raster_of(grid, done.compiled.datum))
        yield path


def _point_cloud(layers: dict[str, Points | Lines], listing: Path) -> Iterator[Path]:
    """Write the points with their columns of numbers as a LAS file, and yield where it is."""
    from musatpy.interchange import las

    points, path = layers["points"], listing.with_suffix(".las")
    assert isinstance(points, Points)
    columns = {name: column for name, column in points.columns.items() if not column.is_text}
    las.write(path, replace(points, columns=columns))
    yield path


def _pictures(done: CompilationReport, record: dict[str, Any], form: ImageForm) -> Iterator[tuple[str, bytes]]:
    """Yield the names and contents of the pictures of a record, and of the contours as a PNG and a page of PDF."""
    from musatpy.compilation.pictures import contour_pictures  # few users draw
    from musatpy.plots.gallery import COMPILED, rendered

    for picture in COMPILED:
        if image := rendered(picture, record, form=form):
            yield f"{picture.name}.{image[0]}", image[1]
    for bottom in done.bottoms:
        for kind, data in contour_pictures(done.compiled, bottom, form).items():
            yield f"{bottom.of.layer}.{kind}", data


@contextmanager
def _at(path: Path) -> Iterator[None]:
    """Let what is wrong be told of a file, at its columns."""
    try:
        yield
    except ProblemsError as error:
        raise CompilationError([with_columns(problem, str(path)) for problem in error.problems]) from error
