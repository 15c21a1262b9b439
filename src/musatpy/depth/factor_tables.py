"""Depth factors as tables of text, in the manner of Groeneveld Meijer (1964)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.depth.views import Factors, Normalised, SingleValue


def factor_table(places: Mapping[str, FloatArray], factors: Factors) -> list[str]:
    """Return a line for each place: where it is, and its factor for each apparent depth (Table 1)."""
    heads = [*places, *(f"F({depth:g})" for depth in factors.depths.tolist())]
    lines = ["".join(f"{head:>10}" for head in heads)]
    for row, factor in enumerate(factors.factor.tolist()):
        where = "".join(f"{values[row]:10.1f}" for values in places.values())
        lines.append(where + "".join(f"{value:10.4f}" if value == value else f"{'-':>10}" for value in factor))
    return lines + [f"-: {reason}" for reason in factors.reasons()]


def normalised_table(x: FloatArray, y: FloatArray, depths: FloatArray, normalised: Normalised) -> list[str]:
    """Return the largest departure of each apparent depth (Table 2), `-` where there is no factor."""
    heads = ("apparent", "at x", "at y", "F", "F used", "depth", "by F used", "error", "percent")
    lines = ["".join(f"{head:>10}" for head in heads)]
    off = normalised.departure
    for i, depth in enumerate(depths.tolist()):
        place = normalised.place[i]
        if np.isnan(normalised.factor[i]):
            lines.append(f"{depth:10.3f}" + f"{'-':>10}" * (len(heads) - 1))
            continue
        lines.append(
            f"{depth:10.3f}{x[place]:10.1f}{y[place]:10.1f}{normalised.factor[i]:10.4f}{normalised.normal[i]:10.4f}"
            f"{off.depth[i]:10.3f}{off.other_depth[i]:10.3f}{off.error[i]:10.3f}{100.0 * off.relative[i]:10.2f}"
        )
    return lines


def single_table(single: SingleValue) -> list[str]:
    """Return how far the right factors depart from one for the whole model, and how much of it is within each."""
    heads = ("F", "depth", "departure", "percent", "of model")
    lines = ["".join(f"{head:>10}" for head in heads)]
    off = single.departure
    for i, level in enumerate(single.levels.tolist()):
        lines.append(
            f"{level:10.4f}{off.other_depth[i]:10.3f}{off.error[i]:10.3f}{100.0 * off.relative[i]:10.2f}"
            f"{100.0 * single.within[i]:9.0f}%"
        )
    return lines
