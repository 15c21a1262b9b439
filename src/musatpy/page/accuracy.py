"""Accuracy of a run from its record: samples of control, check points and depths, S-44, what refraction changed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray, rows_of
from musatpy.page.page_tables import cell_text, page_table, place_of
from musatpy.page.rendering import Fact, PageTable
from musatpy.plots.picture import counted
from musatpy.records.tables import Tables, numbers, part, texts
from musatpy.reports import analyses
from musatpy.reports.headline import CHECKS, CONTROL, differences
from musatpy.soundings.s44 import NO_ORDER, orders_met, source, survey_orders
from musatpy.statistics.analyses import DifferenceStatistics, difference_statistics

SAMPLES = "Control And Check Points: Adjusted Minus Given"
ORDERS = "Orders Of S-44 Met By The Depths"
_ANGLE = "rad"
_ENOUGH = 0.95  # share of the points that meet an order, from which on it is that of the run

Samples = dict[tuple[str, str], DifferenceStatistics]  # by control or check points, and component; metres


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthFigures:
    """Submerged points that have a depth: adjusted, and where straight rays meet; metres."""

    ids: TextArray  # (k,)
    depth: FloatArray  # (k,)
    sigma: FloatArray  # (k,) NaN where it is not known
    covariance: FloatArray  # (k, 3, 3) m2 of east, north, up

    @cached_property
    def ranked(self) -> BoolArray:
        """(k,) True where sigmas say which order of S-44 a point meets."""
        return np.asarray(np.isfinite(self.covariance).all(axis=(1, 2)) & np.isfinite(self.depth))

    def shares(self) -> list[tuple[str, int]]:
        """Return the orders of S-44, the strictest first, each with the points that meet it."""
        met = orders_met(self.depth[self.ranked], self.covariance[self.ranked])
        return [(order.name, int((met <= number).sum())) for number, order in enumerate(survey_orders())]


def samples(tables: Tables) -> Samples:
    """Return control residuals and check points, adjusted minus given, by component, and given depths."""
    wet = tables["bathymetric_points"]
    is_check, found = texts(wet, "control") == "check", Samples()
    for label, what in (("Control", CONTROL), ("Check points", CHECKS)):
        found |= {(label, axis): statistics for axis, statistics in differences(tables, what).items()}
        depths = np.where(is_check == (what == CHECKS), numbers(wet, "residual"), np.nan)
        found[label, "Depth"] = difference_statistics(depths, texts(wet, "point"))
    return {names: statistics for names, statistics in found.items() if statistics.size}


def sample_table(every: Samples) -> PageTable:
    """Return samples of control and check points in numbers, as the analyses of the listing define them."""
    points, components = zip(*every, strict=True)
    numbers = every.values()
    return page_table(
        SAMPLES,
        [
            ("Points", "A16", points),
            ("Component", "A8", components),
            ("Number", "I8", [f"{s.size:,}" for s in numbers]),
            ("Mean\nm", "F9.3", [s.mean for s in numbers]),
            ("RMS\nm", "F9.3", [s.rms for s in numbers]),
            ("Standard deviation\nm", "F9.3", [s.deviation for s in numbers]),
            ("Maximum\nm", "F9.3", [s.maximum for s in numbers]),
            ("At point", "A8", [s.maximum_id for s in numbers]),
        ],
        ids=2,
        note="Components of control are those that took part. Depths are positive downwards.",
    )


def analysis_table(rows: Sequence[Any], title: str, of_maximum: str, *, folded: bool = True) -> PageTable:
    """Return one of the standard analyses of a record, a row for each component."""
    units = [row.get("unit", "m") for row in rows]
    edits = [analyses.EDITS[unit] for unit in units]
    return page_table(
        title,
        [
            ("Component", "A10", [row["component"] for row in rows]),
            ("Unit", "A5", ["° ′ ″" if unit == _ANGLE else unit for unit in units]),
            ("Sample Size", "I8", [f"{row['size']:,}" for row in rows]),
            *(
                (label, "F16.2", [cell_text(edit, row[name]) for edit, row in zip(edits, rows, strict=True)])
                for label, name in analyses.ROWS
            ),
            (of_maximum, "A8", [row["maximum_id"] for row in rows]),
        ],
        folded=folded,
    )


def orders_table(depths: DepthFigures) -> Iterator[PageTable]:
    """Yield how many submerged points meet each order of S-44, where a depth has a covariance."""
    count = int(depths.ranked.sum())
    if not count:
        return
    orders, met = zip(*depths.shares(), strict=True)
    yield page_table(
        ORDERS,
        [
            ("Order", "A10", orders),
            ("Points that meet it", "I8", [f"{number:,}" for number in met]),
            ("Share %", "F6.1", [100.0 * number / count for number in met]),
        ],
        note=f"{source()}, by the sigmas of {counted(count, 'submerged point')}.",
    )


def order_facts(depths: DepthFigures, places: Mapping[str, str]) -> Iterator[Fact]:
    """Yield the order of S-44 that nearly all depths meet, with a link."""
    count, shares = int(depths.ranked.sum()), depths.shares()
    if count:
        yield Fact(
            "Order of S-44 that 95 % of the depths meet",
            next((order for order, met in shares if met >= _ENOUGH * count), NO_ORDER),
            detail=f"{shares[0][0]}: {shares[0][1]:,} of {count:,} points",
            link=place_of(places, ORDERS),
        )


def depths_of(tables: Tables) -> DepthFigures:
    """Return the depths of a run."""
    table, points = part(tables, "bathymetric_points"), part(tables, "points")
    ids = texts(table, "point")
    return DepthFigures(
        ids=ids,
        depth=numbers(table, "depth"),
        sigma=numbers(table, "depth_sigma"),
        covariance=numbers(points, "covariance", 3, 3)[rows_of(texts(points, "point"), ids)],
    )


def refraction_sentences(tables: Tables, depths: DepthFigures) -> Iterator[str]:
    """Yield what refraction changed: of depths, of places in plan, and of images."""
    table = part(tables, "bathymetric_points")
    straight = numbers(table, "depth_no_refraction")
    deeper = depths.depth - straight
    known = np.isfinite(deeper)
    if tables["options"]["refraction"] == "NONE":
        yield "The run knew nothing of the water: depths are those where straight rays meet."
    elif known.any():
        moved = np.linalg.norm(numbers(table, "refraction", 3) - numbers(table, "no_refraction", 3), axis=1)
        in_plan = np.sqrt(np.maximum(moved**2 - deeper**2, 0.0))[known]
        ratio, deeper = (depths.depth / straight)[known], deeper[known]
        largest = int(np.abs(deeper).argmax())
        yield (
            f"Refraction put {known.sum():,} submerged points deeper by {deeper.mean():z.2f} m in the mean, by "
            f"{deeper[largest]:z.2f} m at most (point {depths.ids[known][largest]}), and moved them in plan by "
            f"{in_plan.mean():.2f} m in the mean. Adjusted depths are {np.median(ratio):.2f} times "
            "(median) those where straight rays meet."
        )
    shift = np.linalg.norm(numbers(part(tables, "plates"), "refraction", 2), axis=1)
    wet = shift[np.isfinite(shift) & (shift > 0.0)]
    if len(wet):
        yield (
            f"In the photos it moves the images of submerged points by {1000.0 * np.sqrt((wet**2).mean()):.0f} µm "
            f"(RMS), {1000.0 * wet.max():.0f} µm at most."
        )
