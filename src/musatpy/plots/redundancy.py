"""How well measurements check each other: rays of points and redundancy numbers of their images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.plots.maps import MAPS_NEED, PointMap, class_maps, point_map
from musatpy.plots.picture import Picture, counted
from musatpy.plots.tables import NothingToShowError, Tables, flags, numbers, part, texts

_RAYS = (2, 3, 4, 6, 9)  # most of a class
_NUMBERS = (0.1, 0.2, 0.35, 0.5)  # limits of classes
_RAY_CLASSES = ("2 rays or less", "3 rays", "4 rays", "5 or 6 rays", "7 to 9 rays", "10 rays or more")
_NUMBER_CLASSES = ("r below 0.10", "r 0.10 to 0.20", "r 0.20 to 0.35", "r 0.35 to 0.50", "r 0.50 or more")
_WEAK = 0.1  # redundancy number below which an error hides


@dataclass(frozen=True, kw_only=True, eq=False)
class RedundancyMap:
    """Rays (n,) of points, and the mean redundancy number (n,) of their plate coordinates, NaN of none."""

    block: PointMap
    ids: TextArray  # (n,)
    submerged: BoolArray  # (n,)
    rays: IntArray
    redundancy: FloatArray
    plates: FloatArray  # (m,) redundancy numbers of all plate coordinates


def means_of(row: IntArray, values: FloatArray, number: int) -> FloatArray:
    """Return the means (number,) of values (m,) by their rows (m,), NaN of a row without any."""
    count = np.bincount(row, minlength=number)
    return np.bincount(row, values, number) / np.where(count, count, np.nan)


def redundancy_map(tables: Tables) -> RedundancyMap:
    """Return rays and redundancy. Raises `NothingToShowError` where no image took part."""
    block, points, observed = point_map(tables), part(tables, "points"), part(tables, "observations")
    ids = texts(points, "point")
    plates = np.flatnonzero(texts(observed, "kind") == "plate")
    if not len(plates):
        raise NothingToShowError("the record has no observation of a plate")
    owners = list(observed["of"])
    known = {name: number for number, name in enumerate(ids.tolist())}
    row = np.array([known.get(owners[number][-1], -1) for number in plates.tolist()], dtype=np.int64)
    plates, row = plates[row >= 0], row[row >= 0]
    if not len(plates):
        raise NothingToShowError("no observed point is in the record")
    numbers_of_plates = numbers(observed, "redundancy")[plates]
    return RedundancyMap(
        block=block,
        ids=ids,
        submerged=flags(points, "bathymetric"),
        rays=np.nan_to_num(numbers(points, "rays")).astype(np.int64),
        redundancy=means_of(row, numbers_of_plates, len(ids)),
        plates=numbers_of_plates,
    )


def sentence(data: RedundancyMap) -> str:
    """Return what the maps say."""
    known = data.rays > 0
    two = int((data.rays[known] <= 2).sum())
    weak = float(np.mean(data.plates < _WEAK))
    wet = data.submerged & known
    text = (
        f"{counted(int(known.sum()), 'point')} with {data.rays[known].mean():.1f} rays in the mean, {two:,} with "
        f"two only; mean redundancy number of plate coordinates {data.plates.mean():.2f}, {weak:.0%} of them "
        f"below {_WEAK:g}"
    )
    if wet.any():
        text += f"; submerged points have {data.rays[wet].mean():.1f} rays"
    return text + "."


def figure(data: RedundancyMap) -> Any:
    """Return the figure of the maps. Raises `MusatError` where matplotlib is missing."""
    rays = np.where(data.rays > 0, np.searchsorted(_RAYS, data.rays), -1)
    known = np.isfinite(data.redundancy)
    grade = np.where(known, np.searchsorted(_NUMBERS, np.nan_to_num(data.redundancy), side="right"), -1)
    panels = [
        ("rays of points", rays, _RAY_CLASSES),
        ("mean redundancy number r of their images", grade, _NUMBER_CLASSES),
    ]
    return class_maps(data.block, "How well images check each other", panels, together=False)


REDUNDANCY = Picture(
    name="redundancy",
    title="Rays and redundancy",
    needs={
        **MAPS_NEED,
        "points": ("point", "bathymetric", "rays", "position"),
        "observations": ("kind", "of", "redundancy"),
    },
    numbers=redundancy_map,
    figure=figure,
    words=sentence,
)
