"""The list of what the search found, with test values, estimated sizes and actions; and the block without that."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from musatpy.adjustment.iteration import heights_and_water
from musatpy.adjustment.kinds import MEASURED
from musatpy.arrays import BoolArray, FloatArray
from musatpy.blunders.alternatives import misfit
from musatpy.blunders.hypotheses import CAUSES
from musatpy.blunders.linear_model import as_on_cards
from musatpy.blunders.scene import LIMIT, sees_water, sizes
from musatpy.blunders.search import BlunderSearch
from musatpy.model import (
    Action,
    BathymetricPoints,
    Block,
    CauseKind,
    ControlKind,
    Editing,
    Finding,
    ObservationKind,
    PointStatus,
    Solution,
)
from musatpy.model.block import in_order
from musatpy.model.tables import columns, falling
from musatpy.units import MICROMETRE

_DECIMALS = 1  # of the test values of the list
_SEEN = 2  # images that give a point its position
_FIFTH = 0.2  # of the observations of a kind: where more would go, they are not what is wrong
_SEVERAL = 3  # of a kind, at least: one of four control points is one wrong card
ENOUGH = 6  # images on land that a photo must keep for its submerged ones to be kept out
_K = ObservationKind
_NOUNS = {_K.PLATE: "images", _K.CONTROL: "control points"}
_ORDER = (
    CauseKind.NAME,
    CauseKind.IMAGE,
    CauseKind.HORIZONTAL,
    CauseKind.VERTICAL,
    *CAUSES.values(),
    CauseKind.DRY_FLAG,
    CauseKind.WET_FLAG,
)


def findings(search: BlunderSearch) -> tuple[Finding, ...]:
    """Return everything that was found, by kind and falling test value."""
    listed = [
        *_renamed(search),
        *_images(search),
        *_rows(search),
        *_common_tides(search),
        *_flags(search),
    ]
    ranked = [listed[row] for row in falling([finding.test for finding in listed], _DECIMALS).tolist()]
    return tuple(sorted(ranked, key=lambda finding: _ORDER.index(finding.kind)))


def _renamed(search: BlunderSearch) -> Iterator[Finding]:
    block = search.block
    photos, points = block.photos.ids, block.points.ids
    for renaming in search.renamings:
        old, new = (str(points[number]) for number in (block.plates.point[renaming.row], renaming.point))
        off = renaming.distance / MICROMETRE
        where = f"{off:.0f} um from its image" if np.isfinite(off) else "exchanged with the other one"
        yield Finding(
            kind=CauseKind.NAME,
            photo=str(photos[block.plates.photo[renaming.row]]),
            point=old,
            test=renaming.test,
            size=tuple(value / MICROMETRE for value in renaming.error),
            action=CauseKind.NAME.action,
            note=f"it is point {new}, {where}",
        )


def _images(search: BlunderSearch) -> Iterator[Finding]:
    block, last, judgement = search.block, search.last, search.last.judgement
    plates = search.case.block.plates
    rows = np.flatnonzero(last.rows_out(_K.PLATE))
    test = np.abs(judgement.table(_K.PLATE, judgement.test)[rows]).max(axis=1)
    error = judgement.table(_K.PLATE, judgement.error)[rows] / MICROMETRE
    nothing = np.isnan(test)
    untested, error[nothing] = rows[nothing], np.nan
    test[nothing] = misfit(last.scene.network, last.state, plates.point[untested]) / judgement.sigma0
    alike = {one.row: one.point for one in search.lookalikes}
    photos, points = block.photos.ids[plates.photo].tolist(), block.points.ids[plates.point].tolist()
    told_apart_by_none: dict[str, list[int]] = {}
    for row in untested.tolist():
        told_apart_by_none.setdefault(points[row], []).append(row)
    for row, value, size in zip(rows.tolist(), test.tolist(), error.tolist(), strict=True):
        notes = [f"it lies on point {block.points.ids[alike[row]]}"] if row in alike else []
        together = told_apart_by_none.get(points[row], [])
        if row in together:
            others = [photos[other] for other in together if other != row]
            which = "cannot be told from photo" if len(others) == 1 else "nor from photos"
            notes += [f"{which} {', '.join(others)}"] if others else []
        yield Finding(
            kind=CauseKind.IMAGE,
            photo=photos[row],
            point=points[row],
            test=value,
            size=tuple(size),
            action=CauseKind.IMAGE.action,
            note="; ".join(notes),
        )


def _tested(
    search: BlunderSearch, kind: ObservationKind, row: int, components: slice
) -> tuple[float, tuple[float, ...]]:
    """Return the largest test value of some components of an observation, and the errors of all of them."""
    judgement = search.last.judgement
    known = search.last.scene.weight[kind][row, components] > 0.0
    test, error = (judgement.table(kind, values)[row] for values in (judgement.test, judgement.error))
    if kind is _K.CONTROL:
        point, out = int(search.block.control.point[row]), np.flatnonzero(search.last.out[kind][row])
        error[out] = as_on_cards(search.last.scene.network, point, out, error[out])
    elif kind in search.last.scene.network.measured:
        error = search.last.scene.network.measured[kind].on_card(row, error)
    largest = np.fmax.reduce(np.abs(test[components][known]), initial=np.nan)
    return float(largest), tuple(error[components][known].tolist())


def _rows(search: BlunderSearch) -> Iterator[Finding]:
    """Yield wrong control, stations, equal elevations, tides, and what was measured between points and stations."""
    block, tides = search.block, own_tides(search)
    (horizontal, vertical), kept_out = control_out(search), wrong_tides(search)
    kinds = [
        (CauseKind.HORIZONTAL, _K.CONTROL, horizontal, slice(0, 2)),
        (CauseKind.VERTICAL, _K.CONTROL, vertical, slice(2, 3)),
        *((kind, observed, search.last.rows_out(observed), slice(None)) for observed, kind in CAUSES.items()),
    ]
    for kind, observed, out, components in kinds:
        for row in np.flatnonzero(tides if kind is CauseKind.TIDE else out).tolist():
            test, size = _tested(search, observed, row, components)
            action, note = kind.action, ""
            if kind is CauseKind.TIDE:
                photos, points = [str(block.photos.ids[row])], list[str]()
                action = action if kept_out[row] else Action.NONE
                note = "all its submerged images" if kept_out[row] else "too few images on land to do without"
            else:
                photos, points = observed.links(block, row)
                if observed is _K.CONTROL and np.isnan(test):
                    note = "its images do not fix it without"
            size = tuple(value / kind.scale for value in size)
            yield Finding(
                kind=kind,
                photo="-".join(photos),
                point="-".join(points),
                test=test,
                size=size,
                action=action,
                note=note,
            )


def _common_tides(search: BlunderSearch) -> Iterator[Finding]:
    for tide in (*search.last.tides, *(one for one in search.case.taken if one.kind is CauseKind.TIDES)):
        yield Finding(
            kind=CauseKind.TIDE,
            photo=tide.name or "all",
            test=abs(float(tide.error[0])) / (float(tide.sigma[0]) * search.last.judgement.sigma0),
            size=(float(tide.error[0]),),
            action=Action.NONE,
            note=f"common to the tides of {len(tide.photo)} photos; no image can be blamed",
        )


def _flags(search: BlunderSearch) -> Iterator[Finding]:
    """Yield the points whose flags their images, or their heights, do not agree with."""
    if not sees_water(search.block):
        return
    block, revised = search.block, search.case.block
    depth, sigma = _depths(search)
    points = block.points
    for point, test in search.flags.items():
        set_ = bool(revised.points.bathymetric[point])
        kind = CauseKind.DRY_FLAG if set_ else CauseKind.WET_FLAG
        yield Finding(
            kind=kind,
            point=str(points.ids[point]),
            test=test,
            size=(float(depth[point] if set_ else -depth[point]),),
            action=kind.action,
            note="its images are refracted" if set_ else "its images are not refracted",
        )
    wet = points.bathymetric
    with np.errstate(invalid="ignore"):
        beyond = np.where(wet, -depth, depth) / sigma
        strange = np.flatnonzero((beyond > LIMIT) & (wet == revised.points.bathymetric))
    for point in strange.tolist():
        yield Finding(
            kind=CauseKind.WET_FLAG if wet[point] else CauseKind.DRY_FLAG,
            point=str(points.ids[point]),
            test=float(beyond[point]),
            size=(abs(float(depth[point])),),
            action=Action.NONE,
            note="treated as dry" if wet[point] else "treated as dry, because its images do not tell",
        )


def _depths(search: BlunderSearch) -> tuple[FloatArray, FloatArray]:
    """Return depths (p,) m below the water at all photos, negative above it at all, NaN in between; and sigmas."""
    last = search.last
    height, water = heights_and_water(last.scene.network, last.state)
    point, p = last.scene.network.point, last.scene.network.points
    shallow, deep = np.full(p, np.inf), np.full(p, -np.inf)
    with np.errstate(invalid="ignore"):
        np.minimum.at(shallow, point, water - height)
        np.maximum.at(deep, point, water - height)
    depth = np.where(shallow > 0.0, shallow, np.where(deep < 0.0, deep, np.nan))
    return np.where(np.isfinite(depth), depth, np.nan), np.sqrt(last.judgement.covariance[:, 2, 2])


def edited(search: BlunderSearch) -> Block:
    """Return the block with everything edited that the search found, and with no more editing asked for."""
    block, out = search.case.block, search.last.rows_out
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


def lost_points(search: BlunderSearch, deck: Block) -> frozenset[str]:
    """Return the ids of points that have lost images, and too many of them, to the search."""
    used = search.case.block.plates.triangulated
    wrong = search.case.block.plates.point[used & search.last.rows_out(_K.PLATE)]
    ids = search.case.block.points.ids[np.unique(wrong)]
    point, kept = deck.plates.point, deck.plates.triangulated
    left = np.bincount(point[kept], minlength=len(deck.points.ids))
    return frozenset(ids[np.isin(ids, deck.points.ids[left < _SEEN])].tolist())


def unedited(search: BlunderSearch) -> str:
    """Return why nothing is to be edited: one cause of all, or more than a fifth of a kind; empty where all may."""
    commons = {cause.kind for cause in search.case.taken}
    named = ", ".join(kind for kind in CauseKind if kind in commons)
    if commons - {CauseKind.TIDES} or _explains_most(search):
        return f"one cause explains what does not fit: {named}"
    units = search.last.judgement.units
    for kind, rows in units.of_kinds.items():
        wrong = search.last.rows_out(kind)
        if kind is _K.WATER_LEVEL:  # what common errors explain is not edited anyway
            wrong = wrong_tides(search)
        count, total = np.count_nonzero(wrong), np.count_nonzero(np.diff(units.row[rows], prepend=-1))
        if count >= _SEVERAL and count > _FIFTH * total:
            return (
                f"{count} of {total} would go of one kind, {_NOUNS.get(kind, kind.noun)}: look for one cause of all"
            )
    return ""


def _explains_most(search: BlunderSearch) -> bool:
    """Return whether what is revised explains more than all that is out."""
    common = sum(cause.squares for cause in search.case.taken if np.isfinite(cause.squares))
    if not common > 0.0:
        return False
    size, out = sizes(search.last.scene, search.last.state), search.last.out
    return common > sum(float(np.square(size[kind][out[kind] > 0.0]).sum()) for kind in out)


def own_tides(search: BlunderSearch) -> BoolArray:
    """Return the photos (n,) whose tides are out, each by itself: not as part of a common error."""
    tides, mask = np.zeros(len(search.block.photos.ids), dtype=bool), search.last.rows_out(_K.WATER_LEVEL)
    if len(mask) == len(tides):
        tides[mask] = True
    for common in search.last.tides:
        tides[list(common.photo)] = False
    return tides


def wrong_tides(search: BlunderSearch) -> BoolArray:
    """Return the photos (n,) whose own tides are wrong, and whose submerged images can be done without."""
    block, tides = search.case.block, own_tides(search)
    dry = ~block.points.bathymetric[block.plates.point] & block.plates.triangulated
    kept = block.plates.photo[dry & ~search.last.rows_out(_K.PLATE)]
    return np.asarray(tides & (np.bincount(kept, minlength=len(tides)) >= ENOUGH))


def control_out(search: BlunderSearch) -> tuple[BoolArray, BoolArray]:
    """Return which control points (k,) are wrong in plan, and which in height."""
    out = search.last.out[_K.CONTROL] > 0.0
    return np.asarray(out[:, :2].any(axis=1)), np.asarray(out[:, 2])


def without_positions(solution: Solution, ids: frozenset[str]) -> Solution:
    """Return the solution with no position of points that only images which were taken out would intersect."""
    points, plates, wet = solution.points, solution.plates, solution.bathymetric
    lost = points.status == PointStatus.INTERSECTED
    lost[lost] = np.isin(solution.block.points.ids[lost], list(ids))
    if not lost.any():
        return solution
    reasons = dict.fromkeys(np.flatnonzero(lost).tolist(), "all its images are wrong, and kept out")
    points = replace(
        _blank(points, lost, ("position", "covariance")),
        status=np.where(lost, PointStatus.NOT_DETERMINED, points.status),
        rays=np.where(lost, 0, points.rays),
        reasons={**points.reasons, **reasons},
    )
    return replace(
        solution,
        points=points,
        plates=_blank(plates, lost[solution.block.plates.point], ("residual",)),
        bathymetric=_blank(wet, lost[wet.point], [name for name in columns(BathymetricPoints) if name != "point"]),
    )


def _blank(table: Any, rows: BoolArray, names: Sequence[str]) -> Any:
    """Return a table with nothing (NaN) in some columns of some rows (n,)."""
    values = {name: getattr(table, name).copy() for name in names}
    for value in values.values():
        value[rows] = np.nan
    return replace(table, **values)
