"""How well points are known, in steps of S-44, and how well their images check each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray, rows_of
from musatpy.plots.maps import CONFIDENCE, ELLIPSE, MAPS_NEED, NORMAL, PointMap, class_maps, point_map
from musatpy.plots.picture import NothingToShowError, Picture, counted, measure
from musatpy.plots.submerged_points import bottom_points
from musatpy.records.tables import Tables, flags, numbers, part, texts
from musatpy.soundings.s44 import survey_orders
from musatpy.statistics.analyses import ellipses

_FINER, _COARSER = 0.5, 3.0  # of the strictest and the last order: photographs may be better or worse than they ask
_RAYS = (2, 3, 4, 6, 9)  # most of a class
_NUMBERS = (0.1, 0.2, 0.35, 0.5)  # limits of classes
_RAY_CLASSES = ("2 rays or less", "3 rays", "4 rays", "5 or 6 rays", "7 to 9 rays", "10 rays or more")
_NUMBER_CLASSES = ("r below 0.10", "r 0.10 to 0.20", "r 0.20 to 0.35", "r 0.35 to 0.50", "r 0.50 or more")
_WEAK = 0.1  # redundancy number below which an error hides


@dataclass(frozen=True, kw_only=True, eq=False)
class Uncertainty:
    """Uncertainties (n,) of points, m at 95 %, in classes: rows of `classes`, -1 where there is none."""

    what: str
    value: FloatArray
    grade: IntArray
    classes: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class SigmaMaps:
    """The uncertainties of the points of a block, on its map."""

    block: PointMap
    ids: TextArray  # (n,)
    maps: tuple[Uncertainty, ...]


def graded(value: FloatArray, limits: FloatArray) -> IntArray:
    """Return which of limits (k, n), growing, values (n,) keep first: k where they keep none, -1 for NaN."""
    return np.where(np.isfinite(value), (value > limits).sum(axis=0), -1)


def steps(limits: list[FloatArray]) -> FloatArray:
    """Return the limits (k, n) of classes: a half of the strictest order, all orders, the last enlarged."""
    return np.array([_FINER * limits[0], *limits, _COARSER * limits[-1]])


def class_names() -> tuple[str, ...]:
    """Return the names of the classes, the best first."""
    names = [order.name for order in survey_orders()]
    first, last = f"half of {names[0]}", f"{_COARSER:g} times {names[-1]}"
    return (first, *names, last, "beyond")


def sigma_maps(tables: Tables) -> SigmaMaps:
    """Return the uncertainties of points. Raises `NothingToShowError` where no point has a sigma."""
    block, bottom = point_map(tables), bottom_points(tables)
    covariance = numbers(part(tables, "points"), "covariance", 3, 3)
    depth = np.nan_to_num(bottom.depth)
    depth_sigma = np.where(bottom.submerged, bottom.depth_sigma, np.nan)
    up, plan = NORMAL * ellipses(covariance).vertical, ELLIPSE * ellipses(covariance).major
    vertical = steps([order.vertical(depth) for order in survey_orders()])
    horizontal, names = steps([order.horizontal(depth) for order in survey_orders()]), class_names()
    maps = [
        Uncertainty(what="heights", value=up, grade=graded(up, vertical), classes=names),
        Uncertainty(what="plan", value=plan, grade=graded(plan, horizontal), classes=names),
    ]
    if np.isfinite(depth_sigma).any():
        value = NORMAL * depth_sigma
        maps.append(Uncertainty(what="depths", value=value, grade=graded(value, vertical), classes=names))
    if not np.isfinite(up).any():
        raise NothingToShowError("no point has a sigma")
    return SigmaMaps(block=block, ids=bottom.ids, maps=tuple(maps))


def sentence(sigmas: SigmaMaps) -> str:
    """Return what the maps say."""
    parts = []
    for sigma in sigmas.maps:
        known = np.isfinite(sigma.value)
        worst = int(np.nanargmax(sigma.value))
        best = int(np.flatnonzero(np.cumsum(np.bincount(sigma.grade[known])) >= CONFIDENCE * known.sum())[0])
        parts.append(
            f"{sigma.what} of {counted(int(known.sum()), 'point')}: typical "
            f"{measure(np.nanmedian(sigma.value), 'm')}, largest {measure(sigma.value[worst], 'm')} (point "
            f"{sigmas.ids[worst]}), class of 95 % of them {sigma.classes[best]}"
        )
    return "Uncertainties at 95 % in steps of S-44; " + "; ".join(parts) + "."


def figure(sigmas: SigmaMaps) -> Any:
    """Return the figure of the maps. Raises `MusatError` where matplotlib is missing."""
    panels = [(f"{sigma.what}, 95 %", sigma.grade, sigma.classes) for sigma in sigmas.maps]
    return class_maps(sigmas.block, "Uncertainty of points in steps of S-44", panels, together=True)


SIGMAS = Picture(
    "sigmas", "Uncertainty of points", (*MAPS_NEED, "bathymetric_points"), sigma_maps, figure, sentence
)


# --- rays and redundancy ---


@dataclass(frozen=True, kw_only=True, eq=False)
class RedundancyMap:
    """Rays (n,) of points, and the mean redundancy number (n,) of their plate coordinates, NaN of none."""

    block: PointMap
    ids: TextArray  # (n,)
    submerged: BoolArray  # (n,)
    rays: IntArray
    redundancy: FloatArray
    plates: FloatArray  # (m,) redundancy numbers of all plate coordinates


def redundancy_map(tables: Tables) -> RedundancyMap:
    """Return rays and redundancy. Raises `NothingToShowError` where no image took part."""
    block, points, observed = point_map(tables), part(tables, "points"), part(tables, "observations")
    ids = texts(points, "point")
    plates = np.flatnonzero(texts(observed, "kind") == "plate")
    if not len(plates):
        raise NothingToShowError("the record has no observation of a plate")
    owners = list(observed["of"])
    row = rows_of(ids, np.array([owners[number][-1] for number in plates.tolist()]))
    plates, row = plates[row >= 0], row[row >= 0]
    if not len(plates):
        raise NothingToShowError("no observed point is in the record")
    numbers_of_plates, images = numbers(observed, "redundancy")[plates], np.bincount(row, minlength=len(ids))
    return RedundancyMap(
        block=block,
        ids=ids,
        submerged=flags(points, "bathymetric"),
        rays=np.nan_to_num(numbers(points, "rays")).astype(np.int64),
        redundancy=np.bincount(row, numbers_of_plates, len(ids)) / np.where(images, images, np.nan),
        plates=numbers_of_plates,
    )


def _words_of_redundancy(data: RedundancyMap) -> str:
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


def _figure_of_redundancy(data: RedundancyMap) -> Any:
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
    "redundancy",
    "Rays and redundancy",
    (*MAPS_NEED, "observations"),
    redundancy_map,
    _figure_of_redundancy,
    _words_of_redundancy,
)
