"""Control points and their images: a gcp_list.txt of OpenDroneMap, the markers of Metashape, or a table.

gcp_list.txt   a system, then x y z px py photo [name ...] or, without images, name x y z; the middle of the
               first pixel is (0, 0), as OpenSfM reads it
cameras.xml    markers with references and pinned projections, pixels from the corner; disabled ones are checks
a table        id; x, y, z or lon, lat, z; sigma, or sigma_x, sigma_y, sigma_z; check; photo, px, py from the
               corner; a point may stand in a row for itself or in those of its images
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.errors import Problem, count_of
from musatpy.pointfiles.columns import LON_LAT, MAP_PLACES, PLAN, FileColumn, Wanted, number
from musatpy.pointfiles.point_tables import read_table
from musatpy.sfm.metashape import chunk_of, stated_system
from musatpy.sfm.model import Model, ModelError, refused
from musatpy.sfm.times import matched

_UTM = re.compile(r"WGS ?84 UTM ?(\d{1,2}) ?([NS])", re.IGNORECASE)
_SYSTEM = re.compile(r"'?(EPSG:|\+?proj=|\+init=|\w+\[|WGS ?84)", re.IGNORECASE)
_ROW = "x y z px py photo [name], between tabs or blanks"
_IMAGES = ("photo", "px", "py")
_PLACES = ((*PLAN, "z"), (*LON_LAT, "z"))
_SIGMAS = ("sigma_x", "sigma_y", "sigma_z")
_NO = ("", "0", "no", "false", "n")
_NAMED = 5  # photos that are lacking
_WANTED = Wanted(
    columns=(
        FileColumn(name="id", kind="text", expected="a name"),
        *(
            FileColumn(name=c.name, unit=c.unit, least=c.least, most=c.most, expected=c.expected, blank=True)
            for c in MAP_PLACES
        ),
        FileColumn(name="z", unit="m", blank=True),
        FileColumn(name="photo", aliases=("image", "image_name", "filename"), kind="text", blank=True),
        *(FileColumn(name=name, aliases=(), blank=True) for name in _IMAGES[1:]),
        *(
            FileColumn(name=name, unit="m", required=False, blank=True, least=0.0, expected="0 or more")
            for name in ("sigma", *_SIGMAS)
        ),
        FileColumn(name="check", kind="text", required=False, blank=True),
    ),
    forms=(*((*place, *_IMAGES) for place in _PLACES), *_PLACES, _IMAGES),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class ImagedControl:
    """k points and c images of them on photos of a model."""

    source: str
    ids: TextArray  # (k,)
    position: FloatArray  # (k, 3) x, y, z in `system`, longitude and latitude in degrees; NaN: not stated
    sigma: FloatArray  # (k, 3) m; NaN: not stated
    check: BoolArray  # (k,) it is compared only
    photo: IntArray  # (c,)
    point: IntArray  # (c,)
    pixel: FloatArray  # (c, 2) from the corner
    system: str  # as it is stated, `local`; empty: not stated
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class _Stated:
    """What one line or element states of a point."""

    id: str
    line: int | None = None
    position: tuple[float, ...] = ()
    sigma: tuple[float, ...] = ()
    check: bool = False
    photo: str = ""
    pixel: tuple[float, ...] = ()


def read_control(path: Path, model: Model) -> ImagedControl:
    """Return the control points of a file, their images on photos of a model by whole names, else by unique tails.

    Images on photos that the model does not have are left out, and said. Raises `ModelError` with file and line or
    item, and `OSError`.
    """
    if path.suffix.lower() == ".xml":
        system, rows = _of_metashape(path)
    elif _is_list(path):
        system, rows = _of_list(path)
    else:
        system, rows = _of_table(path)
    return _assembled(str(path), system, rows, model)


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines that are neither blank nor comments, with their numbers."""
    with path.open(encoding="utf-8", errors="surrogateescape") as file:
        for line, text in enumerate(file, 1):
            if text.strip() and not text.lstrip().startswith("#"):
                yield line, text.strip().removeprefix("\ufeff")


def _words(text: str) -> list[str]:
    """Return the values of a row between tabs, or between blanks where only these part its five numbers."""
    values, tabbed = text.split(), [word.strip() for word in text.split("\t")]
    five = (
        len(row) > 5 and bool(np.isfinite([number(word) for word in row[:5]]).all()) for row in (values, tabbed)
    )
    return tabbed if "\t" in text and [*five] != [True, False] else values


def _is_list(path: Path) -> bool:
    """Tell whether a file begins as a gcp_list.txt: with a system, or with two numbers or a name before photos."""
    text = next((text for _, text in _lines(path)), "")
    words = _words(text)
    pixels = len(words) in (3, 6, 7) and "," not in text and bool(np.isfinite([number(w) for w in words[:2]]).all())
    return bool(_SYSTEM.match(text)) or pixels


def _of_list(path: Path) -> tuple[str, list[_Stated]]:
    """Return the system and the rows of a gcp_list.txt; points without names are told apart by their places."""
    lines = list(_lines(path))
    if not _SYSTEM.match(lines[0][1]):
        line, text = lines[0]
        expected = "a system: EPSG:32616, WGS84 UTM 16N, +proj=..."
        if len(_words(text)) == 3:
            expected += "; images without coordinates or names belong to no point"
        raise ModelError([Problem(file=str(path), line=line, found=text[:60], expected=expected)])
    rows, problems, names = list[_Stated](), list[Problem](), dict[tuple[float, ...], str]()
    for line, text in lines[1:]:
        words = _words(text)
        with_image = len(words) >= 6
        values = tuple(number(word) for word in (words[:5] if with_image else words[1:4]))
        if len(values) != (5 if with_image else 3) or not np.isfinite(values).all():
            problems.append(Problem(file=str(path), line=line, found=text[:60], expected=_ROW))
        elif with_image:
            place = values[:3]
            name = words[6] if words[6:] and words[6] else names.setdefault(place, f"gcp{len(names) + 1}")
            pixel = (values[3] + 0.5, values[4] + 0.5)
            rows.append(_Stated(id=name, line=line, position=place, photo=words[5], pixel=pixel))
        else:
            rows.append(_Stated(id=words[0], line=line, position=values))
    refused(problems)
    system = lines[0][1].strip("'").replace("+north", "")  # which says nothing that PROJ does not take for granted
    if utm := _UTM.fullmatch(system):
        system = f"EPSG:{32600 + int(utm[1]) + 100 * (utm[2].upper() == 'S')}"
    return "EPSG:4326" if system.upper() == "WGS84" else system, rows


def _of_table(path: Path) -> tuple[str, list[_Stated]]:
    """Return the rows of a table; places by latitude and longitude are of WGS 84."""
    table = read_table(path, _WANTED)
    table.require(ModelError, "it has no control point")
    lonlat, imaged = table.has("lon"), table.has("photo")
    position = table.numbers(*_PLACES[lonlat])
    sigma = table.numbers(*_SIGMAS)
    sigma = np.where(np.isnan(sigma), table.numbers("sigma")[:, None], sigma)
    pixel = table.numbers("px", "py")
    photos = table.texts("photo") if imaged else [""] * len(position)
    checks = table.texts("check") if table.has("check") else [""] * len(position)
    for row, (at, photo) in enumerate(zip(pixel, photos, strict=True)):
        if np.isnan(at).any() == bool(photo):
            table.refuse("photo, px and py go together", row, "photo")
        if np.isnan(position[row]).any() and not np.isnan(position[row]).all():
            table.refuse("a point has three coordinates or none", row, "id")
    table.require(ModelError)
    rows = [
        _Stated(
            id=name,
            line=table.lines[row],
            position=() if np.isnan(position[row]).any() else tuple(position[row].tolist()),
            sigma=tuple(sigma[row].tolist()),
            check=checks[row].lower() not in _NO,
            photo=photos[row],
            pixel=tuple(pixel[row].tolist()),
        )
        for row, name in enumerate(table.texts("id"))
    ]
    return "EPSG:4326" if lonlat else "", rows


def _of_metashape(path: Path) -> tuple[str, list[_Stated]]:
    """Return the system and the markers of a file: a row for each, and one for each of its pinned projections."""
    chunk = chunk_of(path)
    labels = {camera.get("id"): camera.get("label", "") for camera in chunk.iterfind("./cameras//camera")}
    usual = chunk.find("./settings/property[@name='accuracy_markers']")
    default = number("" if usual is None else usual.get("value", ""))
    markers = {marker.get("id"): marker for marker in chunk.iterfind("./markers//marker")}
    names = {id: marker.get("label") or f"marker {id}" for id, marker in markers.items()}
    rows = [_marker(names[id], marker.find("reference"), default) for id, marker in markers.items()]
    for marker in chunk.iterfind("./frames/frame/markers/marker"):
        for at in marker.iterfind("location"):
            if at.get("pinned") in ("true", "1") and marker.get("marker_id") in names:
                pixel = (number(at.get("x", "")), number(at.get("y", "")))
                photo = labels.get(at.get("camera_id"), "")
                rows.append(_Stated(id=names[marker.get("marker_id")], photo=photo, pixel=pixel))
    if not rows:
        raise ModelError.of("it has no markers", path)
    return stated_system(chunk.findtext("marker_reference") or chunk.findtext("reference")), rows


def _marker(name: str, reference: Element | None, default: float) -> _Stated:
    """Return the row of a marker: its reference and its accuracies, else the usual one of markers."""
    of = {} if reference is None else reference.attrib
    position = tuple(number(of.get(axis, "")) for axis in "xyz")
    shared = (of.get("sxy", of.get("sxyz")), of.get("sxy", of.get("sxyz")), of.get("sxyz"))
    stated = [of.get(f"s{axis}") or usual for axis, usual in zip("xyz", shared, strict=True)]
    return _Stated(
        id=name,
        position=position if np.isfinite(position).all() else (),
        sigma=tuple(default if text is None else number(text) for text in stated),
        check=of.get("enabled") in ("false", "0"),
    )


def _assembled(source: str, system: str, rows: Sequence[_Stated], model: Model) -> ImagedControl:
    """Return the points of rows. Raises `ModelError` where they contradict each other or the model."""
    ids = list(dict.fromkeys(row.id for row in rows))
    position, sigma = np.full((2, len(ids), 3), np.nan)
    check, problems, seen, off = np.zeros(len(ids), dtype=bool), list[Problem](), set[tuple[int, int]](), set[str]()
    images = list[tuple[int, int, tuple[float, ...]]]()
    place = {name: k for k, name in enumerate(ids)}
    photos = model.photos.tolist()
    fits = dict(zip(names := sorted({row.photo for row in rows if row.photo}), matched(names, photos), strict=True))

    def refuse(row: _Stated, message: str) -> None:
        problems.append(Problem(message=f"control point {row.id}: {message}", file=source, line=row.line))

    for row in rows:
        k = place[row.id]
        if row.position and np.isfinite(position[k]).all() and tuple(position[k].tolist()) != row.position:
            refuse(row, "it has other coordinates than before")
        position[k] = row.position or position[k]
        sigma[k] = np.where(np.isnan(sigma[k]), row.sigma or np.nan, sigma[k])
        check[k] |= row.check
        fit = int(fits.get(row.photo, -1))
        if not row.photo or fit == -1:
            off |= {row.photo} - {""}
        elif fit < -1:
            refuse(row, f"several photos are called {row.photo}: their folders are needed")
        elif (k, fit) in seen:
            refuse(row, f"it has two images on photo {row.photo}")
        elif _is_beyond(model, fit, row.pixel):
            lens = model.lenses[model.camera[fit]]
            at = ", ".join(f"{value:.1f}" for value in row.pixel)
            refuse(row, f"pixel {at} is beyond photo {row.photo}, {lens.width} x {lens.height}")
        else:
            seen.add((k, fit))
            images.append((k, fit, row.pixel))
    refused(problems)
    notes = [f"{count_of(len(off), 'photo')} of control not in the model: {' '.join(sorted(off)[:_NAMED])}"] * bool(
        off
    )
    if off and not images:
        raise ModelError([Problem(message=f"{notes[0]}; expected: names as {photos[0]}", file=source)])
    return ImagedControl(
        source=source,
        ids=np.array(ids, dtype=np.str_),
        position=position,
        sigma=np.where(sigma > 0.0, sigma, np.nan),
        check=check,
        photo=np.array([fit for _, fit, _ in images], dtype=np.int64),
        point=np.array([k for k, _, _ in images], dtype=np.int64),
        pixel=np.array([pixel for *_, pixel in images], dtype=float).reshape(-1, 2),
        system=system,
        notes=tuple(notes),
    )


def _is_beyond(model: Model, photo: int, pixel: tuple[float, ...]) -> bool:
    lens = model.lenses[model.camera[photo]]
    return not (-1.0 <= pixel[0] <= lens.width + 1.0 and -1.0 <= pixel[1] <= lens.height + 1.0)
