"""DXF, the drawings of CAD: lines as 3-D polylines, points with their depths as text.

Written as Release 12, which has no dates, handles or marks of the writer, and which every reader takes. A drawing
has no coordinate system: comments at its beginning say it, and what heights are above. GDAL reads drawings of which
it changes nothing, fifteen times as fast as ezdxf, which reads all others. Needs the packages ezdxf, pyogrio and
shapely, the extra `gis`.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
import pyproj

from musatpy.arrays import FloatArray
from musatpy.errors import InterchangeError, Problem
from musatpy.files import write_file
from musatpy.interchange import layers as gis

_USE = "DXF files need"
_DEPTH = "depth"  # column by which lines go to layers, and whose numbers stand at points
_DECIMALS = 4  # 0.1 mm
_LONGEST = 31  # characters of the name of a layer in Release 12
_COMMENT, _SHOWN = "999", 200  # group of comments, and characters of one
_CRS, _HEIGHTS = "CRS ", "HEIGHTS "  # what comments begin with
_CLOSED, _FITTED, _IN_SPACE, _DASHED = 1, 6, 8, 128  # flags of polylines; fitted ones are curves
_READ = "points, lines and polylines"
_NOTES = {"TEXT", "MTEXT", "ATTDEF", "DIMENSION", "LEADER", "MULTILEADER", "TOLERANCE", "VIEWPORT"}  # passed over
_DRAWN, _PARTS = {b"POINT", b"LINE", b"POLYLINE", b"LWPOLYLINE"}, {b"VERTEX", b"SEQEND"}
_PLAIN_NOTES = {b"TEXT", b"MTEXT", b"VIEWPORT"}  # of which GDAL makes points with a text, or nothing
_COORDINATES = {b"10", b"11", b"20", b"21", b"30", b"31", b"38"}  # their groups
_PLAIN = {b"42": 0.0, b"210": 0.0, b"220": 0.0, b"230": 1.0}  # bulge; direction upwards


@dataclass(frozen=True, kw_only=True, eq=False)
class Entity:
    """A point or a line of a drawing: its kind and layer, vertices (k, 3), and whether the last joins the first."""

    kind: str
    layer: str
    xyz: FloatArray
    closed: bool = False


def write(path: Path, layers: Mapping[str, gis.Points | gis.Lines], text_height: float = 2.0) -> None:
    """Write layers by their names: lines on one for each depth (`CONTOURS_2_5`), depths of points as text.

    Depths are the column `depth`; `text_height` (m). The same layers give the same bytes. Raises `InterchangeError`
    without ezdxf, for layers in different systems and for names that are too long; `OSError`.
    """
    writer = gis.package("ezdxf.addons.r12writer", _USE).r12writer
    if len({(layer.crs and layer.crs.to_wkt(), layer.heights) for layer in layers.values()}) > 1:
        raise gis.refuse(path, "", "layers of different coordinate systems or heights", "one of a drawing")
    out = StringIO()
    out.write("".join(_comments(layer) for layer in list(layers.values())[:1]))
    with writer(out) as drawing:
        for name, layer in layers.items():
            if isinstance(layer, gis.Points):
                _draw_points(drawing, _layer_name(path, name), layer, text_height)
            else:
                _draw_lines(drawing, path, name, layer)
    write_file(path, out.getvalue().encode("cp1252", "replace"))


def read(path: Path, crs: pyproj.CRS | None = None, heights: str = "") -> tuple[gis.Points, gis.Lines]:
    """Read the points and the lines of a drawing, the names of their layers as a column; notes are passed over.

    `crs` and `heights` stand in for what no comment says. Raises `InterchangeError` with all that is wrong: curves
    and other entities that are neither, polylines without heights; `OSError`.
    """
    gis.package("ezdxf", _USE)
    gis.require_content(path)
    with gis.upsets(path, "is no DXF file"):
        entities = _drawn(path)
        stated, words = _stated(path)
    if not entities:
        raise gis.refuse(path, "", "the drawing has none", _READ)
    problems = [
        gis.fault(path, f"layer {entity.layer}", "a coordinate is no number", "x, y and z")
        for entity in entities
        if not np.isfinite(entity.xyz).all()
    ]
    if problems := [*problems, *_without_heights(path, entities)]:
        raise InterchangeError(problems)
    place: dict[str, Any] = {"crs": gis.placed(stated or crs), "heights": words or heights}
    dots = [entity for entity in entities if entity.kind == "POINT"]
    lines = [entity for entity in entities if entity.kind != "POINT"]
    xyz = np.concatenate([np.empty((0, 3)), *(dot.xyz for dot in dots)])
    paths = [np.concatenate([line.xyz, line.xyz[:1]]) if line.closed else line.xyz for line in lines]
    points = gis.Points(xyz=xyz, columns=_layers(dots), **place)
    return points, gis.Lines.of_paths(paths, columns=_layers(lines), **place)


def _drawn(path: Path) -> list[Entity]:
    """Return the points and lines of a drawing. Raises `InterchangeError` with all that is neither."""
    kinds = _plain_kinds(path)
    if kinds and (plain := _by_gdal(path, kinds)) is not None:
        return plain
    drawing = gis.package("ezdxf", _USE).readfile(path)
    entities = [entity for entity in drawing.modelspace() if entity.dxftype() not in _NOTES]
    strange = Counter((entity.dxf.layer, why) for entity in entities if (why := _reason(entity)))
    if strange:
        found = ((layer, f"{count} of the kind {kind}") for (layer, kind), count in strange.items())
        raise InterchangeError([gis.fault(path, f"layer {layer}", words, _READ) for layer, words in found])
    return [
        Entity(
            kind=entity.dxftype(),
            layer=entity.dxf.layer,
            xyz=_vertices(entity),
            closed=entity.dxftype() not in ("POINT", "LINE") and bool(entity.is_closed),
        )
        for entity in entities
    ]


def _plain_kinds(path: Path) -> list[str]:
    """Return the kinds of points and lines in their order, none of a drawing that GDAL changes without a word.

    It makes lines of curves, takes what is no number for 0, a file that breaks off for a whole one, and drops the
    elevation of old 2-D polylines. Raises `OSError`.
    """
    kinds: list[str] = []
    kind, in_space = b"", True
    with path.open("rb") as file:
        tags = ((group.strip(), text.strip()) for group, text in zip(file, file, strict=False))
        if (b"2", b"ENTITIES") not in tags:  # which leaves the tags behind it
            return []
        for group, text in takewhile(lambda tag: tag != (b"0", b"ENDSEC"), tags):
            if group == b"0":
                if not in_space or text not in _DRAWN | _PARTS | _PLAIN_NOTES:
                    return []
                kind, in_space = text, text != b"POLYLINE"
                kinds += [kind.decode()] * (kind in _DRAWN)
            elif kind not in _PLAIN_NOTES and not _is_plain(kind, group, text):
                return []
            in_space |= kind == b"POLYLINE" and group == b"70"
        return kinds if (b"0", b"EOF") in tags else []


def _is_plain(kind: bytes, group: bytes, text: bytes) -> bool:
    """Tell whether a tag of an entity is one that GDAL takes as it is."""
    try:
        if group in _COORDINATES:
            return math.isfinite(float(text))
        if group in _PLAIN:
            return float(text) == _PLAIN[group]
        if group == b"70" and kind == b"POLYLINE":
            return int(text) & ~(_CLOSED | _DASHED) == _IN_SPACE
    except ValueError:
        return False
    return True


def _by_gdal(path: Path, kinds: list[str]) -> list[Entity] | None:
    """Return the points and lines of a plain drawing, of known kinds; None where GDAL has others."""
    raw, shapely = gis.package("pyogrio.raw", _USE), gis.package("shapely", _USE)
    encoding = gis.package("ezdxf.filemanagement", _USE).dxf_file_info(path).encoding
    with gis.gdal_options(_USE, {"DXF_ENCODING": encoding}):
        meta, _, encoded, values = raw.read(path, layer="entities", columns=["Layer", "PaperSpace", "Text"])
    fields = dict(zip(meta["fields"], values, strict=True))
    xyz, index = shapely.get_coordinates(shapely.from_wkb(encoded), include_z=True, return_index=True)
    xyz = np.nan_to_num(xyz)  # the height of what says none
    parts = np.split(xyz, np.searchsorted(index, np.arange(1, len(encoded))))
    rows = [row for row, text in enumerate(fields["Text"]) if text is None]
    if [kind == "POINT" for kind in kinds] != [len(parts[row]) == 1 for row in rows]:
        return None
    return [
        Entity(kind=kind, layer=fields["Layer"][row], xyz=parts[row])
        for kind, row in zip(kinds, rows, strict=True)
        if fields["PaperSpace"][row] != 1
    ]


def _comments(layer: gis.Points | gis.Lines) -> str:
    """Return the comments that say the system of a layer, and what its heights are above."""
    texts = {_CRS: layer.crs.to_string() if layer.crs is not None else "", _HEIGHTS: layer.heights}
    return "".join(
        f"{_COMMENT}\n{begin}{text[start : start + _SHOWN]}\n"
        for begin, text in texts.items()
        for start in range(0, len(text), _SHOWN)
    )


def _stated(path: Path) -> tuple[pyproj.CRS | None, str]:
    """Return the system and the words for heights that the comments of a drawing say."""
    with path.open(encoding="cp1252", errors="replace") as file:
        tags = takewhile(lambda tag: tag[0].strip() == _COMMENT, zip(file, file, strict=False))
        comments = [text.rstrip("\r\n") for _, text in tags]
    definition, words = (
        "".join(comment.removeprefix(begin) for comment in comments if comment.startswith(begin))
        for begin in (_CRS, _HEIGHTS)
    )
    return (pyproj.CRS.from_user_input(definition) if definition else None), words


def _draw_points(drawing: Any, name: str, points: gis.Points, text_height: float) -> None:
    for place, text in zip(_rounded(points.xyz), _depth_texts(points, len(points.xyz), ".1f"), strict=True):
        drawing.add_point(place, layer=name)
        if text:
            drawing.add_text(text, insert=place, height=text_height, layer=name)


def _draw_lines(drawing: Any, path: Path, name: str, lines: gis.Lines) -> None:
    depths = _depth_texts(lines, len(lines.vertices), "g")
    names = [f"{name}_{depth}" if depth else name for depth in depths]
    known = {text: _layer_name(path, text) for text in dict.fromkeys(names)}
    for vertices, is_ring, text in zip(lines.vertices, lines.closed.tolist(), names, strict=True):
        drawing.add_polyline(_rounded(vertices), closed=is_ring, layer=known[text])


def _depth_texts(layer: gis.Points | gis.Lines, count: int, form: str) -> list[str]:
    """Return the depths of a layer as text, empty where it has none."""
    column = layer.columns.get(_DEPTH)
    depths = [math.nan] * count if column is None else column.values.astype(float).tolist()
    return [f"{depth:z{form}}" if math.isfinite(depth) else "" for depth in depths]  # no zero has a sign


def _rounded(xyz: FloatArray) -> list[list[float]]:
    return (np.round(xyz, _DECIMALS) + 0.0).tolist()  # no zero has a sign


def _layer_name(path: Path, text: str) -> str:
    """Return a name as Release 12 has them: capitals, digits, `-` and `_`. Raises `InterchangeError`."""
    name = re.sub(r"[^A-Z0-9_-]", "_", text.upper())
    if len(name) > _LONGEST:
        raise gis.refuse(path, f"layer {text}", f"a name of {len(name)} characters", f"{_LONGEST} at most")
    return name


def _reason(entity: Any) -> str:
    """Return what an entity is that is neither point nor line of two vertices or more, else nothing."""
    kind = str(entity.dxftype())
    if kind in ("POINT", "LINE"):
        return ""
    if kind not in ("LWPOLYLINE", "POLYLINE"):
        return kind
    if kind == "POLYLINE" and (entity.is_poly_face_mesh or entity.is_polygon_mesh):
        return "mesh"
    if entity.has_arc or (kind == "POLYLINE" and entity.dxf.flags & _FITTED):
        return f"{kind} with curves"
    return "" if len(entity) > 1 else f"{kind} of one vertex"


def _vertices(entity: Any) -> FloatArray:
    """Return the vertices (k, 3) of a point, line or polyline."""
    kind = entity.dxftype()
    if kind == "POINT":
        return np.array([tuple(entity.dxf.location)])
    if kind == "LINE":
        return np.array([tuple(entity.dxf.start), tuple(entity.dxf.end)])
    places = entity.vertices_in_wcs() if kind == "LWPOLYLINE" else entity.points_in_wcs()
    return np.array([tuple(place) for place in places])


def _without_heights(path: Path, entities: Sequence[Entity]) -> Iterator[Problem]:
    """Yield a problem where all lines are at the height 0: that of 2-D drawings, in which none is given."""
    lines = [entity for entity in entities if entity.kind != "POINT"]
    if lines and not any(line.xyz[:, 2].any() for line in lines):
        kinds = ", ".join(sorted({line.kind for line in lines}))
        expected = "3-D polylines, or polylines with an elevation"
        yield gis.fault(path, "", f"no line has a height (2-D): {kinds}", expected)


def _layers(entities: Sequence[Entity]) -> dict[str, gis.LayerColumn]:
    return {"layer": gis.LayerColumn.of(np.array([entity.layer for entity in entities], dtype=np.str_))}
