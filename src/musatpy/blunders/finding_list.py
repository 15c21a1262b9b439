"""The list of what the search found, with test values, estimated sizes and actions."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.adjustment.kinds import MEASURED
from musatpy.adjustment.waterline import heights_and_water
from musatpy.arrays import FloatArray, IntArray
from musatpy.blunders.alternatives import misfit
from musatpy.blunders.edits import control_out, wrong_tides
from musatpy.blunders.scene import LIMIT, sees_water
from musatpy.blunders.search import Search, plate_errors
from musatpy.model import Action, Block, CauseKind, Finding, ObservationKind
from musatpy.model.ranking import falling
from musatpy.units import MICROMETRE

_DECIMALS = 1  # of the test values of the list
_K = ObservationKind
_SIMPLE = {
    _K.STATION_POSITION: CauseKind.POSITION,
    _K.STATION_ATTITUDE: CauseKind.ATTITUDE,
    _K.EQUAL_ELEVATION: CauseKind.ELEVATION,
    **{kind.observed: kind.cause for kind in MEASURED},
}
_ORDER = (
    CauseKind.NAME,
    CauseKind.IMAGE,
    CauseKind.HORIZONTAL,
    CauseKind.VERTICAL,
    *_SIMPLE.values(),
    CauseKind.TIDE,
    CauseKind.DRY_FLAG,
    CauseKind.WET_FLAG,
)


def findings(search: Search) -> tuple[Finding, ...]:
    """Return everything that was found, by kind and falling test value."""
    listed = [
        *_renamed(search),
        *_images(search),
        *_rows(search),
        *_tides(search),
        *_flags(search),
    ]
    return _in_order(listed)


def flag_findings(search: Search) -> tuple[Finding, ...]:
    """Return those of `findings` that are wrong flags."""
    return _in_order(list(_flags(search)))


def _in_order(listed: list[Finding]) -> tuple[Finding, ...]:
    ranked = [listed[row] for row in falling([finding.test for finding in listed], _DECIMALS).tolist()]
    return tuple(sorted(ranked, key=lambda finding: _ORDER.index(finding.kind)))


def _renamed(search: Search) -> Iterator[Finding]:
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


def _images(search: Search) -> Iterator[Finding]:
    block, last = search.block, search.last
    plates = search.revised.plates
    rows = np.flatnonzero(last.rows_out(_K.PLATE))
    test, error = (values[rows] for values in plate_errors(last))
    nothing = np.isnan(test)
    untested, error[nothing] = rows[nothing], np.nan
    test[nothing] = misfit(last.scene.network, last.state, plates.point[untested]) / last.judgement.sigma0
    alike = {one.row: one.point for one in search.alike}
    doubtful = dict(zip(untested.tolist(), _not_told_apart(search.revised, untested), strict=True))
    photos, points = block.photos.ids[plates.photo[rows]].tolist(), block.points.ids[plates.point[rows]].tolist()
    sizes = (error / MICROMETRE).tolist()
    for row, photo, point, size, value in zip(rows.tolist(), photos, points, sizes, test.tolist(), strict=True):
        notes = [f"it lies on point {block.points.ids[alike[row]]}"] if row in alike else []
        notes += [doubtful[row]] if doubtful.get(row) else []
        yield Finding(
            kind=CauseKind.IMAGE,
            photo=photo,
            point=point,
            test=value,
            size=tuple(size),
            action=CauseKind.IMAGE.action,
            note="; ".join(notes),
        )


def _not_told_apart(block: Block, images: IntArray) -> Iterator[str]:
    """Yield what is said of each of some images that nothing tests: the photos of the others of its point."""
    point = block.plates.point[images].tolist()
    photos: dict[int, list[str]] = {}
    for of, photo in zip(point, block.photos.ids[block.plates.photo[images]].tolist(), strict=True):
        photos.setdefault(of, []).append(photo)
    place = dict.fromkeys(photos, 0)
    for of in point:
        others = photos[of][: place[of]] + photos[of][place[of] + 1 :]
        place[of] += 1
        which = "cannot be told from photo" if len(others) == 1 else "nor from photos"
        yield f"{which} {', '.join(others)}" if others else ""


def _tested(
    search: Search, kind: ObservationKind, row: int, components: IntArray
) -> tuple[float, tuple[float, ...]]:
    """Return the largest test value of some components of an observation, and the errors of all of them."""
    units, judgement = search.last.units, search.last.judgement
    rows = np.flatnonzero((units.kind == kind) & (units.row == row) & np.isin(units.component, components))
    tests = np.abs(judgement.test[rows])
    largest = float(np.nanmax(tests)) if np.isfinite(tests).any() else np.nan
    return largest, tuple(judgement.error[rows].tolist())


def _rows(search: Search) -> Iterator[Finding]:
    """Yield wrong control, stations, equal elevations, and what was measured between points and stations."""
    horizontal, vertical = control_out(search)
    kinds = [
        (CauseKind.HORIZONTAL, _K.CONTROL, horizontal, np.arange(2)),
        (CauseKind.VERTICAL, _K.CONTROL, vertical, np.array([2])),
        *((kind, observed, search.last.rows_out(observed), np.arange(3)) for observed, kind in _SIMPLE.items()),
    ]
    for kind, observed, out, components in kinds:
        for row in np.flatnonzero(out).tolist():
            test, size = _tested(search, observed, row, components)
            photos, points = observed.links(search.block, row)
            yield Finding(
                kind=kind,
                photo="-".join(photos),
                point="-".join(points),
                test=test,
                size=tuple(value / kind.scale for value in size),
                action=kind.action,
                note="its images do not fix it without" if observed is _K.CONTROL and np.isnan(test) else "",
            )


def _tides(search: Search) -> Iterator[Finding]:
    """Yield wrong tides: common ones first."""
    block, last = search.block, search.last
    common = np.zeros(len(block.photos.ids), dtype=bool)
    for tide in last.tides:
        common[list(tide.photo)] = True
    for tide in (*last.tides, *(one for one in search.common if one.kind is CauseKind.TIDES)):
        yield Finding(
            kind=CauseKind.TIDE,
            photo=tide.name or "all",
            test=abs(float(tide.error[0])) / (float(tide.sigma[0]) * last.judgement.sigma0),
            size=(float(tide.error[0]),),
            action=Action.NONE,
            note=f"common to the tides of {len(tide.photo)} photos; no image can be blamed",
        )
    mask = last.rows_out(_K.WATER_LEVEL)
    if len(mask) != len(common):
        return
    kept_out = wrong_tides(search)
    for row in np.flatnonzero(mask & ~common).tolist():
        test, size = _tested(search, _K.WATER_LEVEL, row, np.arange(1))
        yield Finding(
            kind=CauseKind.TIDE,
            photo=str(block.photos.ids[row]),
            test=test,
            size=size,
            action=CauseKind.TIDE.action if kept_out[row] else Action.NONE,
            note="all its submerged images" if kept_out[row] else "too few images on land to do without",
        )


def _flags(search: Search) -> Iterator[Finding]:
    """Yield the points whose flags their images, or their heights, do not agree with."""
    if not sees_water(search.block):
        return
    block, revised = search.block, search.revised
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
            note="treated as dry" if wet[point] else "treated as dry: its images do not say",
        )


def _depths(search: Search) -> tuple[FloatArray, FloatArray]:
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
