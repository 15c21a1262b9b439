"""What refraction moved: from where straight rays meet to the true bottom."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.plots.mapping import (
    SHADES,
    dot_size,
    draw_arrows,
    draw_outlines,
    finish,
    new_map,
    shown_size,
    view_of,
)
from musatpy.plots.panels import MAPS_NEED, PointMap, point_map
from musatpy.plots.picture import Picture
from musatpy.plots.tables import NothingToShowError, Tables, numbers, part, rows_of, texts
from musatpy.plots.wording import counted, measure


@dataclass(frozen=True, kw_only=True, eq=False)
class Corrections:
    """Corrections of n submerged points on the plane, m: corrected minus apparent; NaN where one has no place."""

    block: PointMap
    ids: TextArray  # (n,)
    places: FloatArray  # (n, 2) corrected
    shift: FloatArray  # (n, 3) x, y, height
    depth: FloatArray  # (n,) below the water, corrected
    apparent: FloatArray  # (n,) the same where straight rays meet

    @property
    def factor(self) -> FloatArray:
        """(n,) corrected over apparent depth, NaN where that is none."""
        return self.depth / np.where(self.apparent > 0.0, self.apparent, np.nan)


def corrections(tables: Tables) -> Corrections:
    """Return the corrections. Raises `NothingToShowError` without submerged points."""
    wet = part(tables, "bathymetric_points")
    ids = texts(wet, "point")
    if not len(ids):
        raise NothingToShowError("no point is submerged")
    block, points = point_map(tables), part(tables, "points")
    row = rows_of(texts(points, "point"), ids)
    places = block.plane.places(numbers(points, "position", 3))[row]
    shift = places - block.plane.places_of_xyz(numbers(wet, "no_refraction", 3))
    if not np.isfinite(shift).any():
        raise NothingToShowError("no submerged point has an apparent place")
    return Corrections(
        block=block,
        ids=ids,
        places=places[:, :2],
        shift=shift,
        depth=numbers(wet, "depth"),
        apparent=numbers(wet, "depth_no_refraction"),
    )


def sentence(found: Corrections) -> str:
    """Return what the map says."""
    known = np.isfinite(found.shift).all(axis=1)
    fall, side = -found.shift[known, 2], np.linalg.norm(found.shift[known, :2], axis=1)
    worst = int(np.abs(fall).argmax())
    text = (
        f"Refraction lowers {counted(len(fall), 'submerged point')} by {measure(np.median(fall), 'm')} in the "
        f"median, by {measure(fall[worst], 'm')} at most (point {found.ids[known][worst]}), and moves them "
        f"sideways by {measure(side.max(), 'm')} at most"
    )
    factor = found.factor[np.isfinite(found.factor)]
    if len(factor):
        text += f"; corrected over apparent depths: {np.median(factor):.3f} in the median"
    return text + "."


def figure(found: Corrections) -> Any:
    """Return the figure of corrections. Raises `MusatError` where matplotlib is missing."""
    known = np.isfinite(found.shift).all(axis=1) & np.isfinite(found.places).all(axis=1)
    places = found.places[known]
    bounds, _ = view_of(places, places, keys=1)
    drawing, axes = new_map(bounds, found.block.plane, "Refraction: corrected minus apparent points")
    draw_outlines(axes, found.block.outlines)
    fall = -found.shift[known, 2]
    shade = axes.scatter(
        *places.T, c=fall, s=(1.5 * dot_size(bounds, len(places))) ** 2, cmap=SHADES, edgecolors="0.3",
        linewidths=0.4, label=counted(len(places), "submerged point"),
    )  # fmt: skip
    draw_arrows(axes, places, found.shift[known, :2], 2.0 * shown_size(bounds, len(places)), "moved sideways")
    _label_some(axes, places, fall)
    return finish(drawing, axes, shade=shade, label="lowered by, m")


def _label_some(axes: Any, places: FloatArray, fall: FloatArray) -> None:
    """Write the corrections of some points beside them: shades alone do not say a number."""
    step = max(len(fall) // 25, 1)
    for row in np.argsort(fall, kind="stable")[::step].tolist():
        axes.annotate(f"{fall[row]:.1f}", places[row], textcoords="offset points", xytext=(5, 4), fontsize=7)


CORRECTIONS = Picture(
    name="corrections",
    title="Correction of refraction",
    needs={
        **MAPS_NEED,
        "points": ("point", "position"),
        "bathymetric_points": ("point", "no_refraction", "depth", "depth_no_refraction"),
    },
    numbers=corrections,
    figure=figure,
    words=sentence,
)
