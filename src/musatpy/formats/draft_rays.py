"""The rays of a draft: which measurements can help the solution, and which photos have points in common."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, IntArray
from musatpy.formats.draft import Draft
from musatpy.model import ControlKind

HORIZONTAL = (ControlKind.FULL, ControlKind.HORIZONTAL)
VERTICAL = (ControlKind.FULL, ControlKind.VERTICAL)


@dataclass(frozen=True, kw_only=True, eq=False)
class Rays:
    """The m plate measurements of a draft, and what is known of its p points."""

    sound: BoolArray  # (m,) photo, point and coordinates could be read
    usable: BoolArray  # (m,) triangulated, and the point has another triangulated ray, or a known component
    count: IntArray  # (p,) sound measurements, triangulated or not
    triangulated: IntArray  # (p,) sound measurements that are triangulated
    horizontal: BoolArray  # (p,) horizontally known by its control card
    vertical: BoolArray  # (p,) vertically known


def rays_of(draft: Draft) -> Rays:
    """Return the rays of a draft."""
    rows, points = draft.rows["plates"], len(draft.point_ids)
    point = draft.point["plates"]
    sound = (draft.photo["plates"] >= 0) & (point >= 0) & ~np.isnan(rows["plates.xy"]).any(axis=1)
    if draft.raw:
        sound &= _first_readings(draft)
    triangulated = sound & rows["plates.triangulated"]
    counts = np.bincount(point[triangulated], minlength=points)
    horizontal, vertical = _known(draft, HORIZONTAL), _known(draft, VERTICAL)
    helpful = np.append((counts > 1) | horizontal | vertical, False)  # the last: no point
    return Rays(
        sound=sound,
        usable=triangulated & helpful[point],
        count=np.bincount(point[sound], minlength=points),
        triangulated=counts,
        horizontal=horizontal,
        vertical=vertical,
    )


def _known(draft: Draft, kinds: tuple[ControlKind, ...]) -> BoolArray:
    links = draft.point["control"]
    known = np.zeros(len(draft.point_ids), dtype=bool)
    known[links[np.isin(draft.rows["control"]["control.kind"], kinds) & (links >= 0)]] = True
    return known


def _first_readings(draft: Draft) -> BoolArray:
    """Return (m,) True for the first reading of each point of a photo: all of them make one ray."""
    first = np.zeros(len(draft.rows["plates"]), dtype=bool)
    rays = np.stack([draft.photo["plates"], draft.point["plates"]])
    first[np.unique(rays, axis=1, return_index=True)[1]] = True
    return first


def common_rays(draft: Draft, wanted: BoolArray) -> tuple[IntArray, IntArray]:
    """Return rows (c,), (c,) of measurements of one point on two photos, consecutive ones of the `wanted` (m,)."""
    rows = np.flatnonzero(wanted)
    rows = rows[np.lexsort((draft.photo["plates"][rows], draft.point["plates"][rows]))]
    point = draft.point["plates"][rows]
    same = point[1:] == point[:-1]
    return rows[:-1][same], rows[1:][same]
