"""Pictures of a compilation alone, depths where they were read and y-parallaxes; and of a sounded bottom."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.figures import GREY, add_bar, shades
from musatpy.plots import depth_profile, point_quality, submerged_points
from musatpy.plots.maps import PointMap, dot_size, name_places, new_maps, point_map
from musatpy.plots.picture import NothingToShowError, Picture, counted, measure
from musatpy.plots.plate_residuals import LEAST_RESIDUALS, Residuals, normalised_figure, normalised_sentence
from musatpy.records.tables import Tables, numbers, part, texts
from musatpy.soundings.differences import DepthDifferences, median_and_spread, order_shares
from musatpy.soundings.pictures import difference_figure

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
    if len(test) < LEAST_RESIDUALS:
        raise NothingToShowError("fewer than three y-parallaxes are tested")
    return [Residuals(kind="y-parallax", values=test)]


DEPTHS = Picture("depths", "Compiled depths", _POINTS_NEED, compiled_depths, _depth_figure, _depth_sentence)
SIGMAS = replace(point_quality.SIGMAS, needs=_POINTS_NEED)
PROFILE = replace(depth_profile.PROFILE, needs=_POINTS_NEED)
CORRECTIONS = replace(submerged_points.CORRECTIONS, needs=_POINTS_NEED)


PARALLAXES = Picture("parallaxes", "Y-parallaxes", ("points",), _parallaxes, normalised_figure, normalised_sentence)


# --- compiled and sounded depths ---


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


def _sounded_sentence(data: tuple[DepthDifferences, FloatArray]) -> str:
    differences, _ = data
    good = ~differences.blunders
    middle, spread = median_and_spread(differences.difference[good])
    shares = ", ".join(f"{order.share:.0%} {order.name}" for order in order_shares(differences))
    return (
        f"Compiled less sounded depths at {counted(len(differences.names), 'sounding')}, "
        f"{counted(int(np.count_nonzero(~good)), 'blunder')} among them: median {measure(middle, 'm')}, scaled "
        f"median deviation {measure(spread, 'm')}; within the orders of S-44: {shares}."
    )


SOUNDINGS = Picture(
    "soundings",
    "Compiled and sounded depths",
    ("differences",),
    lambda tables: (differences_of(tables), numbers(part(tables, "differences"), "place", 2)),
    lambda data: difference_figure(*data, "Compiled and sounded depths"),
    _sounded_sentence,
)
