"""How well points are known, in height, plan and depth, in steps of S-44."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, IntArray, TextArray
from musatpy.plots.bottom_points import bottom_points
from musatpy.plots.corrections import CORRECTIONS
from musatpy.plots.maps import CONFIDENCE, ELLIPSE, MAPS_NEED, NORMAL, PointMap, class_maps, point_map
from musatpy.plots.picture import Picture, counted, measure
from musatpy.plots.tables import NothingToShowError, Tables, numbers, part
from musatpy.soundings.s44 import survey_orders
from musatpy.statistics.analyses import ellipses

_FINER, _COARSER = 0.5, 3.0  # of the strictest and the last order: photographs may be better or worse than they ask


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
    first, last = f"{_FINER:g} x {names[0]}", f"{_COARSER:g} x {names[-1]}"
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
    name="sigmas",
    title="Uncertainty of points",
    needs={**CORRECTIONS.needs, **MAPS_NEED, "points": ("point", "bathymetric", "position", "sigma", "covariance")},
    numbers=sigma_maps,
    figure=figure,
    words=sentence,
)
