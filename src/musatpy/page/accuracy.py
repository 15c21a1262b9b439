"""Accuracy of a run from its record: samples of control, check points and depths, S-44, what refraction changed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.plots.tables import Tables, flags, numbers, part, rows_of, texts
from musatpy.soundings.s44 import orders_met, survey_orders
from musatpy.statistics.differences import DifferenceStatistics, difference_statistics

AXES = {"LOCL": ("X", "Y", "Z")}
_EAST_NORTH_UP = ("East", "North", "Up")
_CHECK = "check"


@dataclass(frozen=True, kw_only=True, eq=False)
class Sample:
    """Differences of one component in numbers: adjusted minus given, in metres."""

    what: str  # control or check points
    component: str
    statistics: DifferenceStatistics


@dataclass(frozen=True, kw_only=True, eq=False)
class Depths:
    """Submerged points that have a depth: adjusted, and where straight rays meet; metres."""

    ids: TextArray  # (k,)
    depth: FloatArray  # (k,)
    sigma: FloatArray  # (k,) NaN where it is not known
    straight: FloatArray  # (k,) NaN where straight rays do not meet
    moved: FloatArray  # (k,) in plan, by refraction; NaN likewise
    covariance: FloatArray  # (k, 3, 3) m2 of east, north, up

    @property
    def deeper(self) -> FloatArray:
        """(k,) m, by which refraction put the points deeper."""
        return self.depth - self.straight

    @cached_property
    def ranked(self) -> BoolArray:
        """(k,) True where sigmas say which order of S-44 a point meets."""
        return np.asarray(np.isfinite(self.covariance).all(axis=(1, 2)) & np.isfinite(self.depth))

    def shares(self) -> list[tuple[str, int]]:
        """Return the orders of S-44, the strictest first, each with the points that meet it."""
        met = orders_met(self.depth[self.ranked], self.covariance[self.ranked])
        return [(order.name, int((met <= number).sum())) for number, order in enumerate(survey_orders())]


def axes_of(tables: Tables) -> tuple[str, ...]:
    """Return the names of the metric components of a job."""
    return AXES.get(str(part(tables, "options").get("system")), _EAST_NORTH_UP)


def samples(tables: Tables) -> list[Sample]:
    """Return the samples of control residuals and of check points, by component, and of given depths."""
    control = part(tables, "control")
    kinds, names = texts(control, "kind"), texts(control, "point")
    difference, used = numbers(control, "difference", 3), flags(control, "used", 3)
    fixed = flags(control, "fixed", 1)[:, 0]
    checks = kinds == _CHECK
    every = []
    for what, rows, counts in (
        ("Control", ~checks & ~fixed, used),
        ("Check points", checks, np.ones_like(used)),
    ):
        for axis, component in enumerate(axes_of(tables)):
            values = np.where(rows & counts[:, axis], difference[:, axis], np.nan)
            every.append(_sample(what, component, values, names))
        every.append(_sample(what, "Depth", *_given_depths(tables, of_checks=what != "Control")))
    return [sample for sample in every if sample.statistics.size]


def _sample(what: str, component: str, values: FloatArray, names: TextArray) -> Sample:
    return Sample(what=what, component=component, statistics=difference_statistics(values, names))


def _given_depths(tables: Tables, *, of_checks: bool) -> tuple[FloatArray, TextArray]:
    """Return adjusted minus given depths (k,) of submerged control or check points, and their ids."""
    points = part(tables, "bathymetric_points")
    if "control" not in points:
        return np.zeros(0), np.array([], dtype=np.str_)
    is_check = texts(points, "control") == _CHECK
    return np.where(is_check == of_checks, numbers(points, "residual"), np.nan), texts(points, "point")


def root_mean_squares(every: Sequence[Sample], what: str) -> dict[str, DifferenceStatistics]:
    """Return the samples of control or check points by their component."""
    return {sample.component: sample.statistics for sample in every if sample.what == what}


def depths_of(tables: Tables) -> Depths:
    """Return the depths of a run."""
    table, points = part(tables, "bathymetric_points"), part(tables, "points")
    ids = texts(table, "point")
    depth, straight = numbers(table, "depth"), numbers(table, "depth_no_refraction")
    if not len(depth):
        depth, straight = np.full(len(ids), np.nan), np.full(len(ids), np.nan)
    moved = np.linalg.norm(numbers(table, "refraction", 3) - numbers(table, "no_refraction", 3), axis=1)
    deeper = depth - straight
    row = rows_of(texts(points, "point"), ids)
    return Depths(
        ids=ids,
        depth=depth,
        sigma=numbers(table, "depth_sigma"),
        straight=straight,
        moved=np.sqrt(np.maximum(moved**2 - deeper**2, 0.0)),
        covariance=numbers(points, "covariance", 3, 3)[row],
    )


def refraction_sentences(tables: Tables, depths: Depths) -> Iterator[str]:
    """Yield what refraction changed: of depths, of places in plan, and of images."""
    known = np.isfinite(depths.deeper)
    if part(tables, "options").get("refraction") == "NONE":
        yield "The run knew nothing of the water: depths are those where straight rays meet."
    elif known.any():
        deeper, ratio = depths.deeper[known], depths.depth[known] / depths.straight[known]
        largest = int(np.abs(deeper).argmax())
        yield (
            f"Refraction put {known.sum():,} submerged points deeper by {deeper.mean():.2f} m in the mean, by "
            f"{deeper[largest]:.2f} m at most (point {depths.ids[known][largest]}), and moved them in plan by "
            f"{depths.moved[known].mean():.2f} m in the mean. Adjusted depths are {np.median(ratio):.2f} times "
            "(median) those where straight rays meet."
        )
    shift = np.linalg.norm(numbers(part(tables, "plates"), "refraction", 2), axis=1)
    wet = shift[np.isfinite(shift) & (shift > 0.0)]
    if len(wet):
        yield (
            f"In the photos it moves the images of submerged points by {1000.0 * np.sqrt((wet**2).mean()):.0f} µm "
            f"(RMS), {1000.0 * wet.max():.0f} µm at most."
        )
