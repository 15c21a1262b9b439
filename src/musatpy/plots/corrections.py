"""What refraction moved: from where straight rays meet to the true bottom."""

from __future__ import annotations

from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.plots.bottom_points import BottomPoints, submerged_points
from musatpy.plots.mapping import MOST_ARROWS, SHADES, dot_size, draw_arrows, finish, new_map, shown_size, view_of
from musatpy.plots.painted import add_names
from musatpy.plots.picture import Picture
from musatpy.plots.wording import counted, measure

_NAMED = 25  # points whose corrections are written


def sentence(data: BottomPoints) -> str:
    """Return what the map says."""
    known = data.submerged & np.isfinite(data.shift).all(axis=1)
    fall, side = -data.shift[known, 2], np.linalg.norm(data.shift[known, :2], axis=1)
    worst = int(np.abs(fall).argmax())
    text = (
        f"Refraction lowers {counted(len(fall), 'submerged point')} by {measure(float(np.median(fall)), 'm')} in "
        f"the median, by {measure(fall[worst], 'm')} at most (point {data.ids[known][worst]}), and moves them "
        f"sideways by {measure(side.max(), 'm')} at most"
    )
    factor = data.factor[known & np.isfinite(data.factor)]
    if len(factor):
        text += f"; corrected over apparent depths: {np.median(factor):.3f} in the median"
    return text + "."


def figure(data: BottomPoints) -> Any:
    """Return the figure of corrections. Raises `MusatError` where matplotlib is missing."""
    rows = data.submerged & np.isfinite(data.shift).all(axis=1)
    places, shift, number = data.places[rows, :2], data.shift[rows], int(rows.sum())
    bounds, _ = view_of(places, places, keys=1)
    drawing, axes = new_map(bounds, data.plane, "Refraction: corrected minus apparent points")
    dry = data.places[~data.submerged, :2]
    axes.plot(*dry[np.isfinite(dry).all(axis=1)].T, ".", color="0.6", markersize=2, label="other points")
    shade = axes.scatter(
        *places.T, c=-shift[:, 2], s=(1.5 * dot_size(bounds, number)) ** 2, cmap=SHADES, edgecolors="0.3",
        linewidths=0.4 if number <= MOST_ARROWS else 0.0, label=counted(number, "submerged point"),
    )  # fmt: skip
    drawn = 2.0 * shown_size(bounds, min(number, MOST_ARROWS))
    draw_arrows(axes, places, shift[:, :2], drawn, "moved sideways")
    _write_some(axes, places, -shift[:, 2])
    return finish(drawing, axes, shade=shade, label="lowered by, m")


def _write_some(axes: Any, places: FloatArray, fall: FloatArray) -> None:
    """Write the corrections of some points beside them: shades alone do not say a number."""
    step = -(-len(fall) // _NAMED)
    rows = np.argsort(fall, kind="stable")[::step]
    add_names(axes, places[rows], np.array([f"{value:z.1f}" for value in fall[rows].tolist()]))


CORRECTIONS = Picture(
    name="corrections",
    title="Correction of refraction",
    needs={
        "options": ("system",),
        "stations": ("position",),
        "points": ("point", "bathymetric", "position", "sigma"),
        "bathymetric_points": (
            "point", "no_refraction", "water_level", "depth", "depth_sigma",
        ),
    },
    numbers=submerged_points,
    figure=figure,
    words=sentence,
)  # fmt: skip
