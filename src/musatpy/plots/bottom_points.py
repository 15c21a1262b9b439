"""Submerged points of a run or a compilation: where straight rays meet, and where they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.plots.picture import NothingToShowError
from musatpy.plots.plane import Plane, plane_of
from musatpy.records.tables import Tables, flags, numbers, part, rows_of, texts

_ABOUT = {"name": "GRS80", "semi_major_axis": None, "inverse_flattening": None}  # of plans of older compilations


@dataclass(frozen=True, kw_only=True, eq=False)
class BottomPoints:
    """n points on a plane, m; NaN where one has no place, or is not submerged."""

    plane: Plane
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


def bottom_points(tables: Tables) -> BottomPoints:
    """Return the points of a record with what is known of those below the water.

    Raises `NothingToShowError` where the system of the job is not known.
    """
    return _of_compilation(tables) if is_compilation(tables) else _of_run(tables)


def is_compilation(tables: Tables) -> bool:
    """Tell whether tables are of the record of a compilation, and not of a run."""
    return "job" in tables


def submerged_points(tables: Tables) -> BottomPoints:
    """Return `bottom_points`. Raises `NothingToShowError` too where none is submerged and has an apparent place."""
    data = bottom_points(tables)
    if not data.submerged.any():
        raise NothingToShowError("no point is submerged")
    if not np.isfinite(data.shift[data.submerged]).all(axis=1).any():
        raise NothingToShowError("no submerged point has an apparent place")
    return data


def _of_run(tables: Tables) -> BottomPoints:
    plane, points, wet = plane_of(tables), part(tables, "points"), part(tables, "bathymetric_points")
    ids, position = texts(points, "point"), numbers(points, "position", 3)
    row = rows_of(ids, texts(wet, "point"))

    def spread(values: FloatArray) -> FloatArray:
        out = np.full((len(ids), *values.shape[1:]), np.nan)
        out[row[row >= 0]] = values[row >= 0]
        return out

    apparent = plane.places_of_xyz(numbers(wet, "no_refraction", 3))
    return BottomPoints(
        plane=plane,
        ids=ids,
        submerged=flags(points, "bathymetric"),
        places=plane.places(position),
        apparent=spread(apparent),
        sigma=numbers(points, "sigma", 3)[:, 2],
        water=plane.heights(position, spread(numbers(wet, "water_level"))),
        depth=spread(numbers(wet, "depth")),
        depth_sigma=spread(numbers(wet, "depth_sigma")),
    )


def _of_compilation(tables: Tables) -> BottomPoints:
    points = part(tables, "points")
    plane, position = plane_of(as_run(tables)), numbers(points, "position", 3)
    return BottomPoints(
        plane=plane,
        ids=texts(points, "point"),
        submerged=flags(points, "submerged"),
        places=plane.places(position),
        apparent=plane.places(numbers(points, "apparent", 3)),
        sigma=numbers(points, "sigma", 3)[:, 2],
        water=plane.heights(position, numbers(points, "water_level")),
        depth=numbers(points, "depth"),
        depth_sigma=numbers(points, "depth_sigma"),
    )


def as_run(tables: Tables) -> dict[str, Any]:
    """Return what a compilation says of its system as the record of a run does, about its points.

    Raises `NothingToShowError` for a geocentric job whose ellipsoid the record does not say.
    """
    job = part(tables, "job")
    system, ellipsoid = job.get("system"), job.get("ellipsoid")
    if system == "GEOC" and ellipsoid is None:
        raise NothingToShowError("the record of a geocentric job does not say its ellipsoid")
    return {
        "options": {"system": system},
        "ellipsoid": None if system == "LOCL" else ellipsoid or _ABOUT,
        "stations": {"position": part(tables, "points").get("position", ())},
    }
