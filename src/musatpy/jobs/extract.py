"""Photos taken out of a job, with everything that is still of use to them, and nothing else."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from musatpy.arrays import BoolArray, IntArray, TextArray
from musatpy.errors import DeckError, Problem
from musatpy.geometry.areas import Area
from musatpy.jobs.plan_positions import images_on_ground, plan
from musatpy.model import Block
from musatpy.model.block import in_order, with_rows, without_unused_cameras

_NUMBERED = re.compile(r"(.*?)(\d+)", re.DOTALL)


@dataclass(frozen=True, kw_only=True)
class Extract:
    """The block of some photos of a job, and what the job has and it has not."""

    block: Block
    left_out: dict[str, tuple[str, ...]]  # kind of thing -> names
    single: tuple[str, ...]  # points with one ray and nothing known of them, that have more rays in the job
    dropped: tuple[str, ...]  # such points whose only ray was left out, as asked for
    notes: tuple[str, ...]


def photos_named(block: Block, wanted: Iterable[str]) -> BoolArray:
    """Return (n,) the photos that names and ranges ask for.

    A name of a photo is that photo; else FIRST-LAST are the photos whose names begin alike and end in a number from
    the first to the last, ends included. Raises `DeckError` with everything that asks for no photo.
    """
    rows = {name: row for row, name in enumerate(block.photos.ids.tolist())}
    numbered = [(*parts, row) for name, row in rows.items() if (parts := _parts(name))]
    chosen = np.zeros(len(rows), dtype=bool)
    problems = []
    for name in wanted:
        matches = [rows[name]] if name in rows else _range(numbered, name)
        if not matches:
            problems.append(Problem(message=f"no photo {name} in the deck"))
        chosen[matches] = True
    if problems:
        raise DeckError(problems)
    return chosen


def _parts(name: str) -> tuple[str, int] | None:
    """Return what a name begins with, and the number that it ends in, None where it does not."""
    match = _NUMBERED.fullmatch(name)
    return (match[1], int(match[2])) if match else None


def _range(numbered: list[tuple[str, int, int]], wanted: str) -> list[int]:
    """Return the rows of a range of `numbered` names, none where it is no range; any hyphen may part its ends."""
    for hyphen in (place for place, letter in enumerate(wanted) if letter == "-"):
        first, last = _parts(wanted[:hyphen]), _parts(wanted[hyphen + 1 :])
        if first and last and first[0] == last[0]:
            matches = [row for begin, n, row in numbered if begin == first[0] and first[1] <= n <= last[1]]
            if matches:
                return matches
    return []


def photos_above(block: Block, area: Area) -> BoolArray:
    """Return (n,) the photos whose stations, as given, are in an area."""
    return area.holds(plan(block, block.photos.position))


def photos_showing(block: Block, area: Area, height: float) -> BoolArray:
    """Return (n,) the photos with an image in an area: of control that is there, else put down at `height` (m)."""
    ground = plan(block, images_on_ground(block, height))
    known = np.full((len(block.points.ids), 2), np.nan)
    known[block.control.point] = plan(block, block.control.position)
    known = known[block.plates.point]
    there = area.holds(np.where(np.isfinite(known).all(axis=1, keepdims=True), known, ground))
    return np.bincount(block.plates.photo[there], minlength=len(block.photos.ids)) > 0


def extracted(block: Block, photos: BoolArray, *, drop_single: bool = False) -> Extract:
    """Return the job of some photos (n,): with the points on them, and what links to nothing else.

    Control, members of groups, distances and height differences stay where all their points are still measured,
    groups with two members at least, air bases with both photos. With `drop_single`, rays of points that have no
    other ray left, and of which nothing is known, are left out too. Raises `DeckError` where there is no photo.
    """
    if not photos.any():
        raise DeckError.of("no photo to extract")
    stays = photos[block.plates.photo]
    single = _single(block, stays)
    alone = single[block.plates.point] & stays
    if drop_single:
        stays = stays & ~alone
    measured = np.bincount(block.plates.point[stays], minlength=len(block.points.ids)) > 0
    part = _part(block, photos, measured)
    names = block.points.ids
    more = np.bincount(block.plates.point[block.plates.first_readings()], minlength=len(names)) > 1
    return Extract(
        block=part,
        left_out=_left_out(block, part, measured),
        single=() if drop_single else tuple(names[single & more].tolist()),
        dropped=tuple(names[single].tolist()) if drop_single else (),
        notes=_notes(block, part),
    )


def _single(block: Block, stays: BoolArray) -> BoolArray:
    """Return (p,) the points that one measurement is left of, without control and without a group."""
    known = np.zeros(len(block.points.ids), dtype=bool)
    known[block.control.point[block.control.known.any(axis=1)]] = True
    rays = np.bincount(block.plates.point[stays & block.plates.first_readings()], minlength=len(known))
    known[block.equal_elevations.point[_stay_members(block, rays > 0)]] = True
    return (rays == 1) & ~known


def _stay_members(block: Block, measured: BoolArray) -> BoolArray:
    """Return (e,) the members of groups that are measured, in groups with two of them at least."""
    groups = block.equal_elevations
    there = measured[groups.point]
    enough = np.bincount(groups.group[there], minlength=len(groups.ids)) >= 2
    return there & enough[groups.group]


def _part(block: Block, photos: BoolArray, measured: BoolArray) -> Block:
    """Return the block of some photos (n,), with the rows all of whose photos stay, and whose points (p,) do."""
    groups = block.equal_elevations.with_members(_stay_members(block, measured))
    part = with_rows(replace(block, equal_elevations=groups), {"photos": photos, "points": measured})
    return in_order(without_unused_cameras(part))


def _left_out(block: Block, part: Block, measured: BoolArray) -> dict[str, tuple[str, ...]]:
    """Return what a job has and a part of it has not, by kind."""

    def lost(before: TextArray, after: TextArray) -> tuple[str, ...]:
        return tuple(before[~np.isin(before, after)].tolist())

    groups = block.equal_elevations
    gone = ~np.isin(block.points.ids, part.points.ids)
    control = block.points.ids[block.control.point[~measured[block.control.point]]]
    kept_groups = np.isin(groups.ids, part.equal_elevations.ids)
    cut = ~measured[groups.point] & kept_groups[groups.group]
    left = {
        "photos": lost(block.photos.ids, part.photos.ids),
        "cameras": lost(block.cameras.ids, part.cameras.ids),
        "points": tuple(block.points.ids[gone].tolist()),
        "control points": tuple(control.tolist()),
        "equal elevation groups": tuple(groups.ids[~kept_groups].tolist()),
        "members of groups": tuple(block.points.ids[groups.point[cut]].tolist()),
        "air bases": _pairs(block.air_bases.photo, block.photos.ids, part.air_bases.photo, part.photos.ids),
        "distances": _pairs(block.distances.point, block.points.ids, part.distances.point, part.points.ids),
        "height differences": _pairs(
            block.height_differences.point, block.points.ids, part.height_differences.point, part.points.ids
        ),
    }
    return {kind: names for kind, names in left.items() if names}


def _pairs(ends: IntArray, ids: TextArray, left: IntArray, left_ids: TextArray) -> tuple[str, ...]:
    kept = {tuple(pair) for pair in left_ids[left].tolist()}
    return tuple(f"{a}-{b}" for a, b in ids[ends].tolist() if (a, b) not in kept)


def _notes(block: Block, part: Block) -> tuple[str, ...]:
    """Return what means something else in a part of a job than in the whole."""
    water, notes = block.water, []
    if water is not None and (water.tilt_east or water.tilt_north) and len(part.photos.ids) < len(block.photos.ids):
        notes.append("the tilted water turns about the middle of fewer stations now, where the tides hold")
    return tuple(notes)
