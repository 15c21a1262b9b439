"""Soundings or contours of a file held against a bottom: that of a deck, or a raster.

`musat as11 compare-soundings` and `compare-contours`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from musatpy.as11_runs import compiled_deck, run_of
from musatpy.compilation.bottom import bottom_of
from musatpy.compilation.compiled import Compiled
from musatpy.compilation.joined_surfaces import JoinedSurface, surfaces_of
from musatpy.compilation.other_bottoms import Contoured, Matching, Sounded, contoured, nowhere, sounded
from musatpy.compilation.rasters import RasterBottom, read_raster_bottom
from musatpy.compilation.verdicts import far_datum
from musatpy.errors import CompilationError, SoundingError
from musatpy.figures import FORM, ImageForm, file_of
from musatpy.files import write_files
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.reports import compilation_bottom
from musatpy.reports import soundings as report
from musatpy.reports.record import dumps
from musatpy.soundings.contours import read_contours
from musatpy.soundings.differences import likeness_warning
from musatpy.soundings.pictures import difference_figure
from musatpy.soundings.sounding_files import Soundings, read_soundings

_RASTERS = (".tif", ".tiff")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Bottom:
    """What soundings are held against: a bottom, and how it came about; not compiled where it is a raster."""

    surfaces: Sequence[JoinedSurface | RasterBottom]
    ellipsoid: Ellipsoid | None
    compiled: Compiled | None
    title: str
    caution: str

    @property
    def levels(self) -> list[float]:
        """Depths whose contours the deck asks for."""
        bottom = None if self.compiled is None else bottom_of(self.compiled)
        return sorted({line.level for sheet in bottom.sheets for line in sheet.contours.lines} if bottom else ())


def compare_soundings(
    run: Path,
    bottom: Path,
    source: Path,
    outputs: tuple[Path, Path],
    how: Matching,
    *,
    picture: Path | None = None,
    form: ImageForm = FORM,
    crs: str = "",
    anyway: bool = False,
) -> tuple[Sounded, list[str]]:
    """Hold the soundings of a file against the bottom of a deck or of a raster; write listing, record and picture.

    The suffix of `picture` is that of its form.

    Returns the comparison and warnings. Raises `ProblemsError` where a file cannot be used and where no sounding
    meets the bottom, and `OSError`; then nothing is written.
    """
    if np.isfinite(how.radius) and bottom.suffix.lower() in _RASTERS:
        raise CompilationError.of("--radius goes with points, and this is a raster", file=bottom)
    of = _bottom(run, bottom, anyway)
    read = read_soundings(source, of.ellipsoid, crs=crs, dated=how.not_before is not None)
    compared = sounded(of.surfaces, read, how)
    if not len(compared.rows):
        raise nowhere(of.surfaces, read, compared)
    text = report.listing_of(compared, of.compiled, of.title, of.caution)
    values = dumps(report.DOCUMENT.record(compared, point_orders=of.compiled))
    files = dict(zip(outputs, (text.encode(), values.encode()), strict=True))
    if picture is not None:
        title = f"{source.name} and the bottom of {bottom.name}"
        figure = difference_figure(compared.differences, compared.xy, title)
        suffix, image = file_of(figure, form)
        files[picture.with_suffix(f".{suffix}")] = image
    write_files(files)
    far = far_datum(of.compiled, how.datum) if of.compiled and (how.datum or of.compiled.deck.datum) else ()
    return compared, [*far, *_warnings(compared, read)]


def compare_contours(
    run: Path,
    bottom: Path,
    source: Path,
    outputs: tuple[Path, Path],
    *,
    datum: float = 0.0,
    farthest: float = np.inf,
    crs: str = "",
    layer: str = "",
    depths: bool = False,
    anyway: bool = False,
) -> Contoured:
    """Hold contours of the bottom of a deck, or of a raster, against the lines of a file; write listing and record.

    Raises `ProblemsError` where a file cannot be used and where no contour has a partner, and `OSError`; then
    nothing is written.
    """
    of = _bottom(run, bottom, anyway)
    other = read_contours(source, of.ellipsoid, crs=crs, layer=layer, depths=depths)
    compared = contoured(of.surfaces, other, datum, of.levels, farthest)
    if not compared.distances:
        why = next((row.reason for row in compared.areas), "there is no bottom")
        raise SoundingError.of(f"no contour has a partner: {why}", file=source)
    text = compilation_bottom.contour_listing(compared, of.title, of.caution)
    values = dumps(compilation_bottom.COMPARED_CONTOURS.record(compared))
    write_files(dict(zip(outputs, (text.encode(), values.encode()), strict=True)))
    return compared


def _bottom(run: Path, bottom: Path, anyway: bool) -> _Bottom:
    """Return the bottom of a deck compiled on a run, or of a raster in a system of its job."""
    if bottom.suffix.lower() not in _RASTERS:
        compiled, _ = compiled_deck(run, bottom, anyway)
        titles = compiled.deck.titles
        return _Bottom(
            surfaces=surfaces_of(compiled)[0],
            ellipsoid=compiled.run.ellipsoid,
            compiled=compiled,
            title=titles[0] if titles else "",
            caution=compiled.run.caution,
        )
    triangulation = run_of(run, anyway)
    return _Bottom(
        surfaces=[read_raster_bottom(bottom, triangulation.ellipsoid)],
        ellipsoid=triangulation.ellipsoid,
        compiled=None,
        title=bottom.name.upper(),
        caution=triangulation.caution,
    )


def _warnings(compared: Sounded, soundings: Soundings) -> Iterator[str]:
    """Yield what is odd about soundings: a scale, and those that are there twice."""
    if warning := likeness_warning(compared.differences):
        yield warning
    rows = np.column_stack([soundings.place, soundings.depth])
    _, first, count = np.unique(rows, axis=0, return_index=True, return_counts=True)
    twice = len(rows) - len(first)
    if twice:
        name = soundings.names[first[count > 1].min()]
        yield f"{twice} soundings are given twice, {name} first: each counts as often as it is given"
