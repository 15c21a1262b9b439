"""A file of apparent points, lines or heights, written again with the true ones (`musat correct`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, tee
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pyproj

from musatpy.arrays import FloatArray, IntArray
from musatpy.correction.layers import BARE, correct_layers, kind_of
from musatpy.correction.methods import APPARENT, TRUE, Method, Tally
from musatpy.correction.rasters import band_of, correct_raster, only_band
from musatpy.depth.correction import Progress, in_order
from musatpy.errors import DepthError, Problem
from musatpy.files import whole_file
from musatpy.geometry.crs import LongitudeLatitude
from musatpy.geometry.projected import crs_of
from musatpy.interchange import geotiff
from musatpy.interchange.any_file import RASTERS, read_layers, write_layers
from musatpy.interchange.layers import LOCAL, Grid, placed
from musatpy.pointfiles.columns import AXES, Wanted, place_columns
from musatpy.pointfiles.las_files import SUFFIXES, chunks, classes, coordinates, opened, rewritten
from musatpy.pointfiles.point_tables import ENCODING, Layout, quoted, read_chunks
from musatpy.records.json_files import read_record
from musatpy.records.run_tables import SYSTEM, level_positions
from musatpy.records.tables import flags, numbers
from musatpy.sea.stereo.point_records import ID, SIGMA, SIGMA_COLUMNS, is_wanted

Chosen = TypeVar("Chosen", bound=Method)
# Rows of a table, their points (n, 3) and covariances (n, 3, 3), and the bytes of the file that they are
_Task = tuple[Layout, Sequence[str], FloatArray, FloatArray, int]


def correct_file(
    source: Path,
    target: Path,
    method: Chosen,
    *,
    crs: str | None = None,
    geoid: str | None = None,
    columns: Sequence[str] = AXES,
    only: Sequence[str] = (),
    layer: str = "",
    band: str = "",
    surface: bool = False,
    jobs: int = 1,
    progress: Progress | None = None,
) -> tuple[Chosen, Tally]:
    """Correct the apparent points of a file, and write the true ones in the format that the target's suffix says.

    Returns the method, in the system that the points were taken in, and what came of them.

    `crs`, `geoid`: system of the points; `columns`: names of coordinates in a table; `only`: patterns of the ids of
    a table or a record; `layer`: that of a GeoPackage of several, `band`: that of the heights of a raster;
    `surface`: of a raster the true heights at its posts; `jobs`: processes; `progress` is told of bytes of a table,
    points of a cloud, posts of a raster. Tables, clouds and rasters that keep their kind may be of any size; the
    record of a run is written as a table. Raises the error of the method, `InterchangeError` and `SystemsError` for
    what cannot be used, and `OSError`; then nothing is written.
    """
    kind = kind_of(source, target)
    if surface and kind != RASTERS:
        raise DepthError([Problem(message="a surface is that of a raster, in another raster")])
    unstated = LOCAL if method.system.ellipsoid is None else crs
    stand_in = crs_of(unstated) if unstated else None
    work = partial(method.placed_in, source, crs=crs, geoid=geoid)
    if source.suffix.lower() == ".json" and method.of_records:
        tally = correct_record(source, target, method, only)
    elif kind == RASTERS:
        with geotiff.opened(source, stand_in) as raster:
            method = work(placed(raster.posts.crs))
            raster = replace(raster, posts=replace(raster.posts, crs=placed(stand_in) or raster.posts.crs))
            wanted = band_of(source, raster.names, band)
            tally = correct_raster(raster, target, wanted, method, surface=surface, jobs=jobs, progress=progress)
    elif kind == SUFFIXES:
        method = work(None)
        tally = correct_cloud(source, target, method, crs=placed(stand_in), jobs=jobs, progress=progress)
    elif kind:
        method = work(None)
        tally = correct_table(source, target, method, columns, only=only, jobs=jobs, progress=progress)
    else:
        layers = read_layers(source, stand_in, layer, columns)
        layers = {
            name: only_band(source, part, band) if isinstance(part, Grid) else part for name, part in layers.items()
        }
        stated = placed(next((part.crs for part in layers.values() if part.crs is not None), None))
        method = work(stated)
        written, system = placed(stand_in) or stated, method.system
        if written is None and isinstance(
            system, LongitudeLatitude
        ):  # on the ellipsoid of a run; no datum is known
            written = pyproj.CRS.from_user_input(f"+proj=longlat {system.ellipsoid.definition} +type=crs")
        layers = {name: replace(part, crs=written) for name, part in layers.items()}
        numbered = target.suffix.lower() in (*SUFFIXES, *BARE)
        of_cloud = None
        if source.suffix.lower() in SUFFIXES:
            with opened(source) as cloud:
                of_cloud = np.concatenate([classes(points) for points in chunks(cloud, source)])
        true, tally = correct_layers(layers, method, source, classes=of_cloud, numbered=numbered, jobs=jobs)
        write_layers(target, true)
    return method, tally


def correct_table(
    source: Path,
    target: Path,
    method: Method,
    columns: Sequence[str] = AXES,
    *,
    only: Sequence[str] = (),
    jobs: int = 1,
    progress: Progress | None = None,
) -> Tally:
    """Correct the points of a table with these columns; `progress` is told of bytes. Raises as `correct_file`."""
    places = place_columns(columns, method.system.units, blank=method.blank)
    added, sigmas = (*TRUE, *method.in_table), bool(method.inputs)
    wanted = Wanted(
        columns=(*(ID,) * bool(only), *places, *SIGMA_COLUMNS * sigmas),
        together=(SIGMA,) * sigmas,
        bare=tuple(columns),
        added=added,
    )
    tables = read_chunks(source, wanted, method.error)
    first, tally, names = next(tables), Tally(), [place.name for place in places]

    def tasks() -> Iterator[_Task]:
        for table in chain([first], tables):
            kept = [row for row, name in enumerate(table.texts("id") if only else ()) if is_wanted(name, only)]
            rows: Any = kept if only else slice(None)
            covariance = np.square(table.numbers(*SIGMA)[rows])[:, :, None] * np.eye(3)
            texts = [table.rows[row] for row in kept] if only else table.rows
            yield table.layout, texts, table.numbers(*names)[rows], covariance, table.size

    with whole_file(target) as out:
        out.write(first.layout.header_with(added).encode(**ENCODING))
        for done in in_order(partial(_corrected_rows, method), tasks(), jobs):
            if isinstance(done, Problem):
                raise method.error([done])
            text, part, size = done
            out.write(text.encode(**ENCODING))
            tally = tally + part
            if progress:
                progress(size)
        method.require_use(source, tally, first.numbers(*names))
    return tally


def _corrected_rows(method: Method, task: _Task) -> tuple[str, Tally, int] | Problem:
    """Return rows with what comes of them; a function of the module, because other processes call it."""
    layout, rows, apparent, covariance, size = task
    if not rows:
        return "", Tally(), size
    points = method(layout.source, apparent, covariance)
    if isinstance(points, Problem):
        return points
    return layout.rows_with(rows, method.texts(points)), Tally.of(points, method.reasons), size


def correct_cloud(
    source: Path,
    target: Path,
    method: Method,
    *,
    crs: pyproj.CRS | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
) -> Tally:
    """Correct the points of a LAS or LAZ file; `progress` is told of points. Raises as `correct_file`.

    The result states the `crs` that was named, else what the file does.
    A point that is not corrected keeps its coordinates, and has the number of the reason (`Fault`).
    """
    added = dict.fromkeys(APPARENT, ("f8", "before the correction"))
    added |= {name: (column.kind, column.meaning) for name, column in method.columns.items()}
    tally, some = Tally(), np.empty((0, 3))
    with rewritten(source, target, added, crs) as (parts, write):
        given, waiting = tee(parts)  # these stay in this process
        tasks = ((coordinates(points), classes(points)) for points in waiting)
        work = in_order(partial(_corrected_values, method, str(source)), tasks, jobs)
        for points, done in zip(given, work, strict=True):
            if isinstance(done, Problem):
                raise method.error([done])
            values, part = done
            some = coordinates(points) if not tally.seen else some
            write(points, {apparent: points[axis] for apparent, axis in zip(APPARENT, AXES, strict=True)} | values)
            tally = tally + part
            if progress:
                progress(len(points))
        method.require_use(source, tally, some)
    return tally


def _corrected_values(
    method: Method, source: str, given: tuple[FloatArray, IntArray]
) -> tuple[dict[str, Any], Tally] | Problem:
    """Return coordinates and dimensions of some points; a function of the module: other processes call it."""
    apparent, of_cloud = given
    points = method(source, apparent, classes=of_cloud)
    if isinstance(points, Problem):
        return points
    values = {  # zero of what integers have none
        name: np.nan_to_num(points.values[name]) if column.kind[0] == "u" else points.values[name]
        for name, column in method.columns.items()
    }
    return {**dict(zip(AXES, points.kept(apparent).T, strict=True)), **values}, Tally.of(points, method.reasons)


def correct_record(source: Path, target: Path, method: Method, only: Sequence[str] = ()) -> Tally:
    """Write a table of the points of a record; where only heights are corrected, of those under water."""
    system, record = method.system, read_record(source, (*SYSTEM, "points"))
    table = record["points"]
    kept = [row for row, name in enumerate(table["point"]) if is_wanted(name, only)]
    position, covariance = numbers(table, "position", 3)[kept], numbers(table, "covariance", 3, 3)[kept]
    known = np.isfinite(position).all(axis=1)
    position[known] = system.coordinates(level_positions(record, position[known]))
    wet = flags(table, "bathymetric")[kept] | bool(method.inputs)
    why = {
        row: f"not determined: {table['reason'][kept[row]] or 'no position'}"
        for row in np.flatnonzero(~known).tolist()
    }
    why |= dict.fromkeys(np.flatnonzero(known & ~wet).tolist(), "not under water")
    usable = known & wet
    points = method(str(source), position[usable], covariance[usable])
    if isinstance(points, Problem):
        raise method.error([points])
    tally = Tally.of(points, method.reasons)
    tally.counts.update(why.values())
    method.require_use(source, tally, position)
    columns = (*TRUE, *method.in_table)
    lines, texts = [",".join(["id", *AXES, *columns])], method.texts(points)
    for row, place in enumerate(position.tolist()):
        given = ["" if np.isnan(v) else f"{v:.{d}f}" for v, d in zip(place, system.decimals, strict=True)]
        lost = ["" if name != "reason" else quoted(why.get(row, "")) for name in columns]
        lines.append(",".join([quoted(table["point"][kept[row]]), *given, *(lost if row in why else next(texts))]))
    with whole_file(target) as out:
        out.write("".join(f"{line}\n" for line in lines).encode(**ENCODING))
    return tally
