"""Pictures of a compilation alone: depths where they were read, and y-parallaxes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.figures import GREY, add_bar, shades
from musatpy.plots import corrections, normalised, point_quality, profile
from musatpy.plots.maps import PointMap, dot_size, name_places, new_maps, point_map
from musatpy.plots.normalised import Residuals
from musatpy.plots.picture import NothingToShowError, Picture, counted, measure
from musatpy.records.tables import Tables, numbers, part, texts

_POINTS_NEED = ("job", "points")
_CLASSES = {"G": ("o", "points"), "P": ("s", "profiles"), "S": ("^", "shoreline"), "R": ("D", "points of the run")}
_NAMED = 40  # depths that are written


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledDepths:
    """Depths of n compiled points below the sounding datum, m, where they have a place."""

    block: PointMap
    ids: TextArray
    kind: TextArray  # (n,) class of the reading
    places: FloatArray  # (n, 2)
    depth: FloatArray  # (n,)
    datum: str


def compiled_depths(tables: Tables) -> CompiledDepths:
    """Return the depths of a compilation. Raises `NothingToShowError` where there are none."""
    block, points = point_map(tables), part(tables, "points")
    depth, kind = numbers(points, "datum_depth"), texts(points, "class")
    rows = np.isfinite(depth) & np.isfinite(block.places).all(axis=1)
    if not rows.any():
        raise NothingToShowError("no compiled point has a place and a depth")
    return CompiledDepths(
        block=block,
        ids=texts(points, "point")[rows],
        kind=np.where(np.isin(kind, list(_CLASSES)), kind, "G")[rows],
        places=block.places[rows],
        depth=depth[rows],
        datum=str(part(tables, "job").get("datum") or "the height 0 of the job"),
    )


def _depth_sentence(data: CompiledDepths) -> str:
    deepest, wet = int(data.depth.argmax()), data.depth > 0.0
    return (
        f"{counted(len(data.ids), 'compiled point')}, {counted(int(wet.sum()), 'of them', 'of them')} below "
        f"{data.datum}: the greatest depth is {measure(data.depth[deepest], 'm')} (point {data.ids[deepest]})."
    )


def _depth_figure(data: CompiledDepths) -> Any:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    figure, (axes,) = new_maps(data.block.bounds, data.block.plane, f"Compiled depths below {data.datum}")
    size, wet = dot_size(data.block.bounds, len(data.ids)) ** 2, data.depth > 0.0
    shade = ScalarMappable(Normalize(0.0, max(float(data.depth.max()), 0.1)), shades())
    for kind, (marker, label) in _CLASSES.items():
        for rows, where in ((wet & (data.kind == kind), ""), (~wet & (data.kind == kind), " on land")):
            if rows.any():
                colour = "none" if where else shade.to_rgba(data.depth[rows])
                axes.scatter(
                    *data.places[rows].T, marker=marker, s=size, facecolors=colour, edgecolors=GREY, linewidths=0.5,
                    label=f"{rows.sum():,} {label}{where}",
                )  # fmt: skip
    add_bar(axes, shade, "depth, m")
    name_places(axes, data.places, np.array([f"{depth:z.1f}" for depth in data.depth.tolist()]))
    return figure


def _parallaxes(tables: Tables) -> list[Residuals]:
    test = numbers(part(tables, "points"), "y_parallax_test")
    test = np.sort(test[np.isfinite(test)])
    if len(test) < normalised.LEAST:
        raise NothingToShowError("fewer than three y-parallaxes are tested")
    return [Residuals(kind="y-parallax", values=test)]


DEPTHS = Picture(
    name="depths",
    title="Compiled depths",
    needs=_POINTS_NEED,
    numbers=compiled_depths,
    figure=_depth_figure,
    words=_depth_sentence,
)
SIGMAS = replace(point_quality.SIGMAS, needs=_POINTS_NEED)
PROFILE = replace(profile.PROFILE, needs=_POINTS_NEED)
CORRECTIONS = replace(corrections.CORRECTIONS, needs=_POINTS_NEED)


PARALLAXES = Picture(
    name="parallaxes",
    title="Y-parallaxes",
    needs=("points",),
    numbers=_parallaxes,
    figure=normalised.figure,
    words=normalised.sentence,
)
