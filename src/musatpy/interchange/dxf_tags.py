"""Points and lines of plain drawings, read tag by tag: ten times as fast as the objects that ezdxf makes of them.

Plain are POINT, LINE, and polylines with straight sides in the plane of x and y or in space. Of a drawing with
anything else nothing is read here: ezdxf knows what it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import takewhile
from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray

_NOTES = {"TEXT", "MTEXT", "ATTDEF", "DIMENSION", "LEADER", "MULTILEADER", "TOLERANCE", "VIEWPORT"}
_CLOSED, _IN_SPACE = 1, 8  # flags of polylines
_PLAIN_LINES, _PLAIN_VERTICES = {0, 1, 8, 9, 128, 129, 136, 137}, {0, 32}  # flags without curves, meshes, controls
_PLAIN = {42: 0.0, 67: 0.0, 210: 0.0, 220: 0.0, 230: 1.0}  # bulge; paper space; direction upwards
_PAPER, _ELEVATION, _FLAGS, _LAYER, _COMMENT = 67, 38, 70, 8, 999
_LEVEL = [0.0]  # of what says no height


@dataclass(frozen=True, kw_only=True, eq=False)
class Entity:
    """A point or a line of a drawing: its kind and layer, vertices (k, 3), and whether the last joins the first."""

    kind: str
    layer: str
    xyz: FloatArray
    closed: bool = False


class _NotPlainError(Exception):
    """There is something that has to be looked at as a whole."""


@dataclass(kw_only=True)
class _Tags:
    """What is read of an entity: texts by their groups, coordinates in their order."""

    kind: str
    layer: str = "0"
    flags: int = 0
    elevation: float = 0.0
    numbers: dict[int, list[float]] = field(default_factory=dict)

    def place(self, group: int) -> list[float]:
        """Return the coordinates whose x has a group. Raises `_NotPlainError` where x or y is missing."""
        try:
            return [self.numbers[group][0], self.numbers[group + 10][0], self.numbers.get(group + 20, _LEVEL)[0]]
        except KeyError as error:
            raise _NotPlainError from error


def plain_entities(path: Path, encoding: str) -> list[Entity] | None:
    """Return the points and lines of a drawing, None where it is not plain. Raises `OSError`."""
    try:
        with path.open(encoding=encoding, errors="surrogateescape") as file:
            return list(_entities(_of_model(_tagged(file))))
    except (_NotPlainError, ValueError):
        return None


def first_comments(path: Path) -> list[str]:
    """Return the comments at the beginning of a drawing, none of a binary one. Raises `OSError`."""
    with path.open(encoding="cp1252", errors="replace") as file, suppress(ValueError):
        tags = takewhile(lambda tag: tag[0] == _COMMENT, _tagged(file))
        return [value for _, value in tags]
    return []


def is_note(kind: str) -> bool:
    """Tell whether an entity is a text or a sign, which is passed over."""
    return kind in _NOTES


def _tagged(lines: Iterable[str]) -> Iterator[tuple[int, str]]:
    """Yield groups and values. Raises `ValueError` for a group that is no number, and at an odd end."""
    rest = iter(lines)
    for text in rest:
        yield int(text), next(rest, "").rstrip("\r\n")


def _of_model(tags: Iterator[tuple[int, str]]) -> Iterator[tuple[int, str]]:
    """Yield the tags of the section of entities."""
    inside = opened = ended = False
    for group, value in tags:
        if group == _COMMENT:
            continue
        if group == 0 and value == "SECTION":
            opened = True
        elif opened:
            inside, opened = group == 2 and value == "ENTITIES", False
        elif group == 0 and value == "ENDSEC":
            inside = False
        elif inside:
            yield group, value
        ended = group == 0 and value == "EOF"
    if not ended:
        raise _NotPlainError


def _entities(tags: Iterator[tuple[int, str]]) -> Iterator[Entity]:
    polyline: _Tags | None = None
    vertices: list[float] = []
    for part in _grouped(tags):
        if polyline is not None:
            if part.kind == "VERTEX" and part.flags in _PLAIN_VERTICES:
                vertices += part.place(10)
                continue
            if part.kind != "SEQEND":
                raise _NotPlainError
            yield _polyline(polyline, np.array(vertices).reshape(-1, 3))
            polyline, vertices = None, []
        elif part.kind == "POLYLINE":
            polyline = part
        elif part.kind == "LWPOLYLINE":
            plan = np.array([part.numbers.get(group, []) for group in (10, 20)]).T
            yield _line(part, np.column_stack([plan, np.full(len(plan), part.elevation)]))
        elif part.kind in ("POINT", "LINE"):
            ends = (10,) if part.kind == "POINT" else (10, 11)
            yield Entity(kind=part.kind, layer=part.layer, xyz=np.array([part.place(group) for group in ends]))
        elif not is_note(part.kind):
            raise _NotPlainError
    if polyline is not None:
        raise _NotPlainError


def _polyline(part: _Tags, xyz: FloatArray) -> Entity:
    elevation = part.numbers.get(30, _LEVEL)[0]
    if elevation and not part.flags & _IN_SPACE:
        xyz[:, 2] = elevation
    return _line(part, xyz)


def _line(part: _Tags, xyz: FloatArray) -> Entity:
    if len(xyz) < 2 or part.flags not in _PLAIN_LINES:
        raise _NotPlainError
    return Entity(kind=part.kind, layer=part.layer, xyz=xyz, closed=bool(part.flags & _CLOSED))


def _grouped(tags: Iterator[tuple[int, str]]) -> Iterator[_Tags]:
    """Yield entities with what counts of them. Raises `_NotPlainError` for those that are not plain."""
    part: _Tags | None = None
    note = False
    for group, value in tags:
        if group == 0:
            if part is not None:
                yield part
            part, note = _Tags(kind=value.strip()), is_note(value.strip())
        elif part is None:
            raise _NotPlainError
        elif 10 <= group <= 31 and not note:
            part.numbers.setdefault(group, []).append(float(value))
        elif group == _LAYER:
            part.layer = value.strip()
        elif not note:
            _settle(part, group, value)
        elif group == _PAPER and int(value):
            raise _NotPlainError
    if part is not None:
        yield part


def _settle(part: _Tags, group: int, value: str) -> None:
    """Take a flag or an elevation; raises `_NotPlainError` for what bends, tilts or hides an entity."""
    if group == _FLAGS:
        part.flags = int(value)
    elif group == _ELEVATION:
        part.elevation = float(value)
    elif group in _PLAIN and float(value) != _PLAIN[group]:
        raise _NotPlainError
