"""The picture of a comparison with soundings, from its record: differences have no places there."""

from __future__ import annotations

from typing import Any

import numpy as np

from musatpy.plots.picture import Picture
from musatpy.plots.tables import NothingToShowError, Tables, numbers, part, texts
from musatpy.plots.wording import counted, measure
from musatpy.soundings.differences import Differences, median_and_spread, order_shares
from musatpy.soundings.pictures import difference_figure


def differences_of(tables: Tables) -> Differences:
    """Return the differences of a comparison. Raises `NothingToShowError` where there are none."""
    table = part(tables, "differences")
    found = Differences(
        names=texts(table, "sounding"),
        compiled=numbers(table, "compiled"),
        sounded=numbers(table, "sounded"),
        sigma=numbers(table, "sigma"),
    )
    if not len(found.names):
        raise NothingToShowError("no sounding meets the bottom")
    return found


def sentence(found: Differences) -> str:
    """Return what the picture says."""
    good = ~found.blunders
    middle, spread = median_and_spread(found.difference[good])
    shares = ", ".join(f"{order.share:.0%} {order.name}" for order in order_shares(found))
    return (
        f"Compiled less sounded depths at {counted(len(found.names), 'sounding')}, "
        f"{counted(int(np.count_nonzero(~good)), 'blunder')} among them: median {measure(middle, 'm')}, scaled "
        f"median deviation {measure(spread, 'm')}; within the orders of S-44: {shares}."
    )


def figure(found: Differences) -> Any:
    """Return the figure of differences. Raises `MusatError` where matplotlib is missing."""
    return difference_figure(found, None, "Compiled and sounded depths")


SOUNDINGS = Picture(
    name="soundings",
    title="Compiled and sounded depths",
    needs={"differences": ("sounding", "compiled", "sounded", "sigma")},
    numbers=differences_of,
    figure=figure,
    words=sentence,
)
