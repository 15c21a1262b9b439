"""What the decks of a merged job must agree in: options, ellipsoid, water, cameras, submerged points."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import Any

import numpy as np

from musatpy.errors import Problem
from musatpy.model import Block, CoordinateSystem, Options, WaveOrigin, Waves
from musatpy.model.block import linking, parts_of_block
from musatpy.model.tables import InCommon, columns, empty
from musatpy.units import ARC_SECOND

_SYSTEM = "system"  # the one option that no other deck may decide: the coordinates are in it


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """One of the blocks to be merged, and what its deck is called."""

    name: str
    block: Block


def same_system(parts: Sequence[Part]) -> Iterator[Problem]:
    """Yield the decks whose coordinates are not in the system, or not on the ellipsoid, of the first."""
    first = parts[0]
    for part in parts[1:]:
        system, other = first.block.options.system, part.block.options.system
        if system is not other:
            yield _differ(first, part, "system", str(system), str(other))
        elif system is not CoordinateSystem.LOCAL and _ellipsoid(first.block) != _ellipsoid(part.block):
            yield _differ(first, part, "ellipsoid", _ellipsoid(first.block), _ellipsoid(part.block))


def _ellipsoid(block: Block) -> str:
    """Return what says which ellipsoid a block has, whatever the case of its name."""
    spec = block.ellipsoid
    if spec is None:
        return "none"
    return spec.name.lower() or f"{spec.semi_major_axis!r} {spec.inverse_flattening!r}"


def same_options(parts: Sequence[Part], chosen: Part | None) -> Iterator[Problem]:
    """Yield the options in which decks differ from the first, unless one was `chosen` to say them."""
    if chosen is not None:
        return
    first = parts[0]
    for part in parts[1:]:
        for name, one, other in options_apart(first.block.options, part.block.options):
            if name != _SYSTEM:
                yield _differ(first, part, f"option {name}", one, other)


def options_apart(first: Options, second: Options) -> Iterator[tuple[str, str, str]]:
    """Yield name and both values, as texts, of each option that differs."""
    for option in fields(Options):
        a, b = getattr(first, option.name), getattr(second, option.name)
        if a != b:
            yield option.name, _shown(option.name, a), _shown(option.name, b)


def _shown(name: str, value: Any) -> str:
    if isinstance(value, StrEnum):
        return str(value)
    return f'{value / ARC_SECOND:g}"' if name == "rotation_limit" else f"{value:g}"


def card_of(name: str, parts: Sequence[Part], chosen: Part | None = None) -> tuple[Any, tuple[Problem, ...]]:
    """Return what one card says in the merged job, and what decks say against it: without the card, nothing."""
    if chosen is not None and (card := getattr(chosen.block, name)) is not None:
        return card, ()
    given = [(part, card) for part in parts if (card := getattr(part.block, name)) is not None]
    problems = [
        _differ(given[0][0], part, f"{name} {field.name}".replace("_", " "), str(value), str(other))
        for part, card in given[1:]
        for field in fields(card)
        if (other := getattr(card, field.name)) != (value := getattr(given[0][1], field.name))
    ]
    return given[0][1] if given else None, tuple(problems)


def waves_of(parts: Sequence[Part], chosen: Part | None) -> tuple[Waves, WaveOrigin | None, tuple[Problem, ...]]:
    """Return waves and their origin in the merged job, and what decks say against it: no waves say nothing."""
    given = [part for part in parts if len(part.block.waves.ids)]
    if not given:
        return empty(Waves), None, ()
    if chosen is not None and len(chosen.block.waves.ids):
        given = [chosen]
    first = given[0]
    problems = []
    for part in given[1:]:
        apart = ", ".join(_waves_apart(first.block, part.block))
        if apart:
            message = f"the waves of {first.name} are not those of {part.name}: they differ in {apart}"
            problems.append(Problem(message=message))
    return first.block.waves, first.block.wave_origin, tuple(problems)


def in_common() -> dict[str, Any]:
    """Return, by their names, the parts of a block that its observations of a kind have in common: None of each."""
    return dict.fromkeys(name for name, kind in parts_of_block().items() if issubclass(kind, InCommon))


def _waves_apart(one: Block, other: Block) -> Iterator[str]:
    """Yield in what the waves of two blocks differ: in their number alone where that does."""
    if len(one.waves.ids) != len(other.waves.ids):
        yield "number"
        return
    for name in (field.name for field in fields(Waves)):
        if not same(getattr(one.waves, name), getattr(other.waves, name)):
            yield name.replace("_", " ")
    if one.wave_origin != other.wave_origin:
        yield "origin"


def same_reduction(parts: Sequence[Part], chosen: Part | None) -> Iterator[Problem]:
    """Yield the decks whose plates are not raw, or not refined, as the first's; of raw ones what else differs.

    Comparators never may. Options of the reduction may where one deck was `chosen` to say them; but not the plate
    sigma and its submerged factor, which cannot be put on cards of readings.
    """
    first = parts[0]
    for part in parts[1:]:
        if first.block.raw is not part.block.raw:
            given = ["readings (RAW)" if job.block.raw else "refined" for job in (first, part)]
            yield _differ(first, part, "what plate cards give", *given)
        elif first.block.raw:
            yield from _same_readings(first, part, chosen)


def _same_readings(first: Part, part: Part, chosen: Part | None) -> Iterator[Problem]:
    one, other = first.block, part.block
    for what, same_one in (
        ("comparator", repr(one.comparator) == repr(other.comparator)),
        ("reduction", chosen is not None or repr(one.reduction) == repr(other.reduction)),
    ):
        if not same_one:
            yield Problem(message=f"the {what} of {first.name} is not that of {part.name}")
    for name, a, b in options_apart(one.options, other.options):
        if chosen is not None and name in ("plate_sigma", "submerged_factor"):
            yield _differ(first, part, f"option {name} of raw plates", a, b)


_CAMERA_NOUNS = {
    ("cameras", "focal_length"): "focal length",
    ("cameras", "principal_point"): "principal point",
    ("cameras", "format_size"): "format",
    ("distortion", "kind"): "kinds of distortion",
    ("distortion", "values"): "distortion",
    ("fiducials", "ids"): "fiducial marks",
    ("fiducials", "xy"): "fiducials",
    ("fiducials", "sigma"): "sigmas of fiducials",
    ("lenses", "centre"): "point of best symmetry",
    ("lenses", "k0"): "linear distortion",
    ("lenses", "zero_radius"): "radius of zero distortion",
    ("mark_distances", "marks"): "marks with distances",
    ("mark_distances", "axis"): "axes between marks",
    ("mark_distances", "distance"): "distances between marks",
    ("mark_distances", "sigma"): "sigmas of distances between marks",
    ("reseau", "ids"): "crosses of the reseau",
    ("reseau", "row"): "rows of the reseau",
    ("reseau", "column"): "columns of the reseau",
    ("reseau", "xy"): "reseau",
}  # what columns are called that say what a camera is


def same_cameras(parts: Sequence[Part]) -> Iterator[Problem]:
    """Yield the cameras that have one name and are not one camera."""
    owner: dict[str, tuple[Part, dict[str, Any]]] = {}
    for part in parts:
        for row, name in enumerate(part.block.cameras.ids.tolist()):
            camera = _camera(part.block, row)
            first, known = owner.setdefault(name, (part, camera))
            for what in known:
                if not same(known[what], camera[what]):
                    message = f"{_printed(known[what])} in {first.name}, {_printed(camera[what])} in {part.name}"
                    hint = "one camera has one name; rename one of them"
                    yield Problem(message=f"camera {name}: {what} {message}: {hint}")


def _camera(block: Block, row: int) -> dict[str, Any]:
    """Return all that a block says of a camera, by what it is."""
    known = {}
    tables = {"cameras": block.cameras, **linking(block, "cameras")}
    for name, table in tables.items():
        rows = np.arange(table.count) if name == "cameras" else table.links_to("cameras")["camera"]
        for own, about in columns(type(table)).items():
            if name != "photos" and not about.link and not about.identity:
                what = _CAMERA_NOUNS.get((name, own), f"{own} of {name}".replace("_", " "))
                values = getattr(table, own)[rows == row]
                known[what] = values[0] if name == "cameras" else values
    return known


def _printed(value: Any) -> str:
    return np.array2string(np.asarray(value), max_line_width=10**6, formatter={"str_kind": str}) or "none"


def same(first: Any, second: Any) -> bool:
    """Return whether two values or arrays are the same, no value (NaN) being the same as none."""
    a, b = np.asarray(first), np.asarray(second)
    return a.shape == b.shape and bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f" and b.dtype.kind == "f"))


def _differ(first: Part, second: Part, what: str, one: str, other: str) -> Problem:
    return Problem(message=f"{what} is {one} in {first.name}, {other} in {second.name}")
