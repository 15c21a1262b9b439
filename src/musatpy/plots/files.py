"""The files of pictures, of a record, beside it or in a folder; lines and soundings given for a profile."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyproj

from musatpy.arrays import FloatArray
from musatpy.errors import MusatError, ProblemsError, SoundingError
from musatpy.figures import FORM, ImageForm
from musatpy.files import real_path, write_files
from musatpy.geometry.projected import crs_of
from musatpy.interchange.any_file import TEXTS, read_layers
from musatpy.interchange.layers import Lines, Points
from musatpy.plots.depth_profile import DepthProfile, ProfileLine, SoundedPlaces, profile_picture
from musatpy.plots.gallery import KINDS, read_tables, rendered
from musatpy.plots.picture import Picture
from musatpy.plots.plane import MapPlane
from musatpy.pointfiles.columns import LON_LAT, MAP_PLACES, PLAN, Wanted
from musatpy.pointfiles.point_tables import read_table
from musatpy.records.tables import Tables
from musatpy.soundings.sounding_files import job_places, read_soundings
from musatpy.units import DEGREE


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawn:
    """The pictures of a record: their files with a sentence each, and why others were not drawn, by their names."""

    files: tuple[Path, ...]
    sentences: tuple[str, ...]
    reasons: Mapping[str, str]


def check_names(names: Sequence[str]) -> None:
    """Raise `MusatError` for a name that no picture has."""
    there = list(dict.fromkeys(picture.name for kind in KINDS.values() for picture in kind.pictures))
    unknown = [name for name in names if name not in there]
    if unknown:
        raise MusatError(f"no picture '{unknown[0]}'; there are {', '.join(there)}")


def stem_of(record: Path, out_dir: Path | None = None) -> Path:
    """Return what the names of the pictures of a record begin with."""
    return (record.parent if out_dir is None else out_dir) / record.stem


def check_stems(records: Sequence[Path], out_dir: Path | None = None) -> None:
    """Raise `MusatError` where the pictures of two records would have the same names."""
    taken: dict[Path, Path] = {}
    for record in records:
        stem = real_path(stem_of(record, out_dir))
        if stem in taken:
            raise MusatError(
                f"the pictures of {taken[stem]} and {record} would both go to {stem_of(record, out_dir)}.*"
            )
        taken[stem] = record


def profile_of(
    line: Path | None, soundings: Path | None, crs: str = "", datum: float = 0.0, within: float | None = None
) -> Picture[DepthProfile]:
    """Return the picture of the profile along the line of a file, with soundings of another, `within` metres of it.

    Raises `ProblemsError` where a file cannot be used, and `OSError`.
    """
    return profile_picture(
        None if line is None else given_line(line, crs),
        None if soundings is None else partial(_soundings_on, soundings, crs, datum),
        within,
    )


def draw(tables: Tables, pictures: Sequence[Picture[Any]], stem: Path, form: ImageForm = FORM) -> Drawn:
    """Write the files of pictures in a form, named after `stem`.

    Raises `OSError`, and `MusatError` without matplotlib or where what is given for a profile is not on its plane.
    """
    files, sentences, reasons = {}, [], {}
    for picture in pictures:
        image = rendered(picture, tables, stem.name, form)
        if image is None:
            reasons[picture.name] = picture.sentence(tables)
            continue
        suffix, data, sentence = image
        files[stem.with_name(f"{stem.name}.{picture.name}.{suffix}")] = data
        sentences.append(sentence)
    if files:
        write_files(files)
    return Drawn(files=tuple(files), sentences=tuple(sentences), reasons=reasons)


def drawn(
    record: Path,
    out_dir: Path | None = None,
    names: Sequence[str] = (),
    profile: Picture[DepthProfile] | None = None,
    form: ImageForm = FORM,
) -> Drawn:
    """Draw the pictures of a record, or those that are named, beside it or in a folder.

    `profile` stands in for that of the gallery. Raises `RecordError` where the record cannot be used, `MusatError`
    without matplotlib, and `OSError`.
    """
    kind, tables = read_tables(record)
    wanted = [picture for picture in kind.pictures if not names or picture.name in names]
    if profile is not None:
        own = profile.numbers
        wanted = [replace(one, numbers=own) if one.name == profile.name else one for one in wanted]
    pictures = draw(tables, wanted, stem_of(record, out_dir), form)
    lacking = {name: f"is no picture of a {kind.what}" for name in names if name not in {p.name for p in wanted}}
    return replace(pictures, reasons={**pictures.reasons, **lacking})


# --- what is given for a profile ---


def given_line(path: Path, crs: str = "") -> Callable[[MapPlane], ProfileLine]:
    """Return the line of a file, on any plane: the points of a CSV file, or the first line of another format.

    `crs` is the system of x and y that a file does not say. Raises `ProblemsError` for a file that cannot be used,
    and the line does on a plane that it cannot be brought to; `OSError`.
    """
    stated = crs_of(crs) if crs else None
    if path.suffix.lower() in TEXTS:
        return partial(_line_on, path, *_of_csv(path), stated)
    layers = list(read_layers(path, stated).values())
    vertices = [layer.paths()[0] for layer in layers if isinstance(layer, Lines)]
    vertices += [layer.xyz for layer in layers if isinstance(layer, Points)]
    if not vertices:
        raise ProblemsError.of("has no line and no points", file=path)
    return partial(_line_on, path, vertices[0][:, :2], False, layers[0].crs or stated)


def _line_on(path: Path, xy: FloatArray, angular: bool, crs: pyproj.CRS | None, plane: MapPlane) -> ProfileLine:
    places = _on_plane(path, xy, angular, crs, plane)
    apart = np.append(True, np.linalg.norm(np.diff(places, axis=0), axis=1) > 0.0)
    if apart.sum() < 2:
        raise ProblemsError.of("a line needs two points in different places", file=path)
    return ProfileLine(name=path.name, vertices=places[apart])


def _soundings_on(path: Path, crs: str, datum: float, plane: MapPlane) -> SoundedPlaces:
    """Return the soundings of a file on a plane; `datum` is the height (m) from which depths count."""
    soundings = read_soundings(path, plane.system.ellipsoid, crs="" if plane.own and not crs else crs)
    places = _on_plane(path, soundings.place, soundings.angular, None, plane)
    return SoundedPlaces(places=places, height=datum - soundings.depth, sigma=soundings.sigma)


def _on_plane(path: Path, xy: FloatArray, angular: bool, crs: pyproj.CRS | None, plane: MapPlane) -> FloatArray:
    """Return places (n, 2) m of latitude and longitude (rad), or x and y of a system. Raises `SoundingError`."""
    ellipsoid = plane.system.ellipsoid
    if angular and ellipsoid is None:
        raise SoundingError.of("latitudes and longitudes, and the job is a local one", file=path)
    if not angular:
        if plane.own and crs is None:
            return xy
        xy = job_places(path, xy, crs, ellipsoid)
    return plane.places_of_level(np.column_stack([xy, np.zeros(len(xy))]))[:, :2]


def _of_csv(path: Path) -> tuple[FloatArray, bool]:
    """Return the points (v, 2) of a table, rad or m, and whether they are latitude and longitude."""
    table = read_table(path, Wanted(columns=MAP_PLACES, forms=(LON_LAT, PLAN)))
    table.require(ProblemsError)
    if table.has("lat"):
        return table.numbers("lat", "lon") * DEGREE, True
    return table.numbers(*PLAN), False
