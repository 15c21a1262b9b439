"""The picture of a comparison with soundings, from its record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.plots.picture import NothingToShowError, Picture, counted, measure
from musatpy.records.tables import Tables, numbers, part, texts
from musatpy.soundings.differences import DepthDifferences, median_and_spread, order_shares
from musatpy.soundings.pictures import difference_figure


@dataclass(frozen=True, kw_only=True, eq=False)
class SoundedPlan:
    """Differences of k soundings, and where these are."""

    differences: DepthDifferences
    places: FloatArray  # (k, 2) m


def differences_of(tables: Tables) -> DepthDifferences:
    """Return the differences of a comparison. Raises `NothingToShowError` where there are none."""
    table = part(tables, "differences")
    data = DepthDifferences(
        names=texts(table, "sounding"),
        compiled=numbers(table, "compiled"),
        sounded=numbers(table, "sounded"),
        sigma=numbers(table, "sigma"),
    )
    if not len(data.names):
        raise NothingToShowError("no sounding meets the bottom")
    return data


def sounded_plan(tables: Tables) -> SoundedPlan:
    """Return the differences with their places. Raises `NothingToShowError` where there are none."""
    places = numbers(part(tables, "differences"), "place", 2)
    return SoundedPlan(differences=differences_of(tables), places=places)


def sentence(data: SoundedPlan) -> str:
    """Return what the picture says."""
    differences = data.differences
    good = ~differences.blunders
    middle, spread = median_and_spread(differences.difference[good])
    shares = ", ".join(f"{order.share:.0%} {order.name}" for order in order_shares(differences))
    return (
        f"Compiled less sounded depths at {counted(len(differences.names), 'sounding')}, "
        f"{counted(int(np.count_nonzero(~good)), 'blunder')} among them: median {measure(middle, 'm')}, scaled "
        f"median deviation {measure(spread, 'm')}; within the orders of S-44: {shares}."
    )


def figure(data: SoundedPlan) -> Any:
    """Return the figure of differences. Raises `MusatError` where matplotlib is missing."""
    return difference_figure(data.differences, data.places, "Compiled and sounded depths")


SOUNDINGS = Picture(
    name="soundings",
    title="Compiled and sounded depths",
    needs=("differences",),
    numbers=sounded_plan,
    figure=figure,
    words=sentence,
)
