"""What refraction moved: from where straight rays meet to the true bottom."""

from __future__ import annotations

from typing import Any

import numpy as np

from musatpy.figures import LIGHT, add_bar, shades
from musatpy.plots.bottom_points import BottomPoints, submerged_points
from musatpy.plots.maps import add_arrows, dot_size, name_places, new_maps, view_of
from musatpy.plots.picture import Picture, counted, measure

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
    bounds, _ = view_of(places, places, keys=True)
    figure, (axes,) = new_maps(bounds, data.plane, "Refraction: corrected minus apparent points")
    dry = data.places[~data.submerged, :2]
    dry = dry[((dry > bounds[0]) & (dry < bounds[1])).all(axis=1)]
    if len(dry):
        axes.plot(*dry.T, ".", color=LIGHT, label=counted(len(dry), "other point"))
    drawn = axes.scatter(
        *places.T,
        c=-shift[:, 2],
        s=dot_size(bounds, number) ** 2,
        cmap=shades(),
        label=counted(number, "submerged point"),
    )
    add_bar(axes, drawn, "lowered by, m")
    add_arrows(axes, places, shift[:, :2], "moved sideways", share=0.35)
    order = np.argsort(-shift[:, 2], kind="stable")  # those that are written have all sizes
    name_places(axes, places[order], np.array([f"{-value:z.1f}" for value in shift[order, 2].tolist()]), _NAMED)
    return figure


CORRECTIONS = Picture(
    name="corrections",
    title="Correction of refraction",
    needs=("options", "stations", "points", "bathymetric_points"),
    numbers=submerged_points,
    figure=figure,
    words=sentence,
)
