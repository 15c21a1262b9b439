"""The block without the blunders that were found: flags, names, kinds of control, sigmas, members of groups."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.adjustment.kinds import MEASURED
from musatpy.arrays import BoolArray
from musatpy.blunders.scene import sizes
from musatpy.blunders.search import Search
from musatpy.model import (
    BathymetricPoints,
    Block,
    CauseKind,
    ControlKind,
    Editing,
    ObservationKind,
    PointStatus,
    Solution,
)
from musatpy.model.block import in_order
from musatpy.model.tables import columns

_K = ObservationKind
_NOUNS = {_K.PLATE: "images", _K.CONTROL: "control points"}
_SEEN = 2  # images that give a point its position
_FIFTH = 0.2  # of the observations of a kind: where more would go, they are not what is wrong
_SEVERAL = 3  # of a kind, at least: one of four control points is one wrong card
ENOUGH = 6  # images on land that a photo must keep for its submerged ones to be kept out


def edited(search: Search) -> Block:
    """Return the block with everything edited that the search found, and with no more editing asked for."""
    block, out = search.revised, search.last.rows_out
    groups, stays = block.equal_elevations, ~out(_K.EQUAL_ELEVATION)
    plates, photos, control = block.plates, block.photos, block.control
    wrong = out(_K.PLATE) | (wrong_tides(search)[plates.photo] & block.points.bathymetric[plates.point])
    horizontal, vertical = control_out(search)
    plan, height = control.known[:, 0] & ~horizontal, control.known[:, 2] & ~vertical
    kinds = [ControlKind.FULL, ControlKind.HORIZONTAL, ControlKind.VERTICAL]
    block = replace(
        block,
        options=replace(block.options, editing=Editing.NONE),
        photos=replace(
            photos,
            position_sigma=np.where(out(_K.STATION_POSITION)[:, None], np.nan, photos.position_sigma),
            attitude_sigma=np.where(out(_K.STATION_ATTITUDE)[:, None], np.nan, photos.attitude_sigma),
        ),
        plates=replace(plates, triangulated=plates.triangulated & ~wrong),
        control=replace(control, kind=np.select([plan & height, plan, height], kinds, ControlKind.CHECK)),
        equal_elevations=replace(groups, group=groups.group[stays], point=groups.point[stays]),
    )
    for kind in MEASURED:
        if kind.applies(block):
            block = kind.without(block, out(kind.observed))
    return in_order(block)


def lost_points(search: Search, deck: Block) -> frozenset[str]:
    """Return the ids of points that have lost images, and too many of them, to the search."""
    used = search.revised.plates.triangulated
    wrong = search.revised.plates.point[used & search.last.rows_out(_K.PLATE)]
    ids = search.revised.points.ids[np.unique(wrong)]
    point, kept = deck.plates.point, deck.plates.triangulated
    left = np.bincount(point[kept], minlength=len(deck.points.ids))
    return frozenset(ids[np.isin(ids, deck.points.ids[left < _SEEN])].tolist())


def unedited(search: Search) -> str:
    """Return why nothing is to be edited: one cause of all, or more than a fifth of a kind; empty where all may."""
    commons = {cause.kind for cause in search.common}
    named = ", ".join(kind for kind in CauseKind if kind in commons)
    if commons - {CauseKind.TIDES} or _explains_most(search):
        return f"one cause explains what does not fit: {named}"
    block, units = search.last.scene.block, search.last.units
    for kind, rows in units.of_kinds.items():
        wrong = search.last.rows_out(kind)
        if kind is _K.WATER_LEVEL:  # what common errors explain is not edited anyway
            wrong = wrong & wrong_tides(search) if len(wrong) == len(block.photos.ids) else np.zeros_like(wrong)
        count, total = np.count_nonzero(wrong), np.count_nonzero(np.diff(units.row[rows], prepend=-1))
        if count >= _SEVERAL and count > _FIFTH * total:
            return (
                f"{count} of {total} would go of one kind, {_NOUNS.get(kind, kind.noun)}: look for one cause of all"
            )
    return ""


def _explains_most(search: Search) -> bool:
    """Return whether what is revised explains more than all that is out."""
    common = sum(cause.squares for cause in search.common if np.isfinite(cause.squares))
    if not common > 0.0:
        return False
    size, out = sizes(search.last.scene, search.last.state), search.last.out()
    return common > sum(float(np.square(size[kind][out[kind] > 0.0]).sum()) for kind in out)


def wrong_tides(search: Search) -> BoolArray:
    """Return the photos (n,) whose own tides are wrong, and whose submerged images can be done without."""
    block, tides = search.revised, np.zeros(len(search.revised.photos.ids), dtype=bool)
    mask, images = search.last.rows_out(_K.WATER_LEVEL), search.last.rows_out(_K.PLATE)
    if len(mask) != len(tides) or not mask.any():
        return tides
    tides[mask] = True
    for common in search.last.tides:
        tides[list(common.photo)] = False
    dry = ~block.points.bathymetric[block.plates.point] & ~images & block.plates.triangulated
    return tides & (np.bincount(block.plates.photo[dry], minlength=len(tides)) >= ENOUGH)


def control_out(search: Search) -> tuple[BoolArray, BoolArray]:
    """Return which control points (k,) are wrong in plan, and which in height."""
    out = search.last.out()[_K.CONTROL] > 0.0
    return np.asarray(out[:, :2].any(axis=1)), np.asarray(out[:, 2])


def without_positions(solution: Solution, ids: frozenset[str]) -> Solution:
    """Return the solution with no position of points that only images which were taken out would intersect."""
    points = solution.points
    lost = points.status == PointStatus.INTERSECTED
    lost[lost] = np.isin(solution.block.points.ids[lost], list(ids))
    if not lost.any():
        return solution
    nowhere = lost[:, None]
    reasons = dict.fromkeys(np.flatnonzero(lost).tolist(), "all its images are wrong, and kept out")
    plates, wet = solution.plates, solution.bathymetric
    residual = np.where(lost[solution.block.plates.point][:, None], np.nan, plates.residual)
    no_depth = lost[wet.point]
    return replace(
        solution,
        points=replace(
            points,
            position=np.where(nowhere, np.nan, points.position),
            covariance=np.where(nowhere[:, :, None], np.nan, points.covariance),
            status=np.where(lost, PointStatus.NOT_DETERMINED, points.status),
            rays=np.where(lost, 0, points.rays),
            reasons={**points.reasons, **reasons},
        ),
        plates=replace(plates, residual=residual),
        bathymetric=replace(
            wet,
            **{
                name: np.where(no_depth if value.ndim == 1 else no_depth[:, None], np.nan, value)
                for name in columns(BathymetricPoints)
                if name != "point"
                for value in (getattr(wet, name),)
            },
        ),
    )
