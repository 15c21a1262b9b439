"""Submerged points of a run or a compilation: where straight rays meet, and what refraction moved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray, at_rows, rows_of
from musatpy.figures import LIGHT, add_bar, shades
from musatpy.plots.maps import add_arrows, dot_size, name_places, new_maps, view_of
from musatpy.plots.picture import NothingToShowError, Picture, counted, measure
from musatpy.plots.plane import MapPlane, is_compilation, plane_of
from musatpy.records.tables import Tables, flags, numbers, part, texts


@dataclass(frozen=True, kw_only=True, eq=False)
class PlottedPoints:
    """n points on a plane, m; NaN where one has no place, or is not submerged."""

    plane: MapPlane
    ids: TextArray
    submerged: BoolArray  # (n,)
    places: FloatArray  # (n, 3) corrected
    apparent: FloatArray  # (n, 3) where straight rays meet
    sigma: FloatArray  # (n,) of the height
    water: FloatArray  # (n,) mean height of the water, over the photos that give the point
    depth: FloatArray  # (n,) below that
    depth_sigma: FloatArray  # (n,)

    @property
    def shift(self) -> FloatArray:
        """(n, 3) corrected minus apparent."""
        return self.places - self.apparent

    @property
    def factor(self) -> FloatArray:
        """(n,) corrected over apparent depth, NaN where the latter is none."""
        apparent = self.depth + self.shift[:, 2]
        return self.depth / np.where(apparent > 0.0, apparent, np.nan)


def bottom_points(tables: Tables) -> PlottedPoints:
    """Return the points of a record with what is known of those below the water.

    Raises `NothingToShowError` where the system of the job is not known.
    """
    plane, points = plane_of(tables), part(tables, "points")
    ids, position = texts(points, "point"), numbers(points, "position", 3)
    if is_compilation(tables):
        wet, row = points, np.arange(len(ids))
        apparent = plane.places(numbers(points, "apparent", 3))
    else:
        wet = part(tables, "bathymetric_points")
        row = rows_of(texts(wet, "point"), ids)
        apparent = plane.places_of_xyz(numbers(wet, "no_refraction", 3))
    water, depth, depth_sigma = (
        at_rows(numbers(wet, name), row) for name in ("water_level", "depth", "depth_sigma")
    )
    return PlottedPoints(
        plane=plane,
        ids=ids,
        submerged=flags(points, "submerged" if wet is points else "bathymetric"),
        places=plane.places(position),
        apparent=at_rows(apparent, row),
        sigma=numbers(points, "sigma", 3)[:, 2],
        water=plane.heights(position, water),
        depth=depth,
        depth_sigma=depth_sigma,
    )


def submerged_points(tables: Tables) -> PlottedPoints:
    """Return `bottom_points`. Raises `NothingToShowError` too where none is submerged and has an apparent place."""
    data = bottom_points(tables)
    if not data.submerged.any():
        raise NothingToShowError("no point is submerged")
    if not np.isfinite(data.shift[data.submerged]).all(axis=1).any():
        raise NothingToShowError("no submerged point has an apparent place")
    return data


# --- the map ---


_NAMED = 25  # points whose corrections are written


def sentence(data: PlottedPoints) -> str:
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


def figure(data: PlottedPoints) -> Any:
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
    "corrections",
    "Correction of refraction",
    ("options", "stations", "points", "bathymetric_points"),
    submerged_points,
    figure,
    sentence,
)
