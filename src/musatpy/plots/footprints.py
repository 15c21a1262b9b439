"""What photos show of the ground: their formats, brought down to a height."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.plots.enlarged import turned
from musatpy.plots.plane import Plane
from musatpy.plots.tables import Tables, numbers, part, rows_of, texts

_CORNERS = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
_LOWEST = -0.1  # cosine from straight up of a ray that still goes down
_BORDER = 1.05  # of what was measured, where a camera has no format


def footprints(
    station: FloatArray, attitude: FloatArray, corners: FloatArray, focal_length: FloatArray, ground: float
) -> FloatArray:
    """Return corners (n, 4, 2) m east and north of stations (n, 3) where their rays (n, 4, 2) mm meet a height.

    `attitude` (n, 3) rad, `focal_length` (n,) mm; rays through image points from the principal point. NaN where one
    of the rays of a photo does not go down, or the station is not above the ground.
    """
    M = attitude_matrix(attitude)
    image = np.concatenate([corners, np.broadcast_to(-focal_length[:, None, None], (*corners.shape[:2], 1))], 2)
    ray = np.einsum("nji,ncj->nci", M, image)
    ray /= np.linalg.norm(ray, axis=2, keepdims=True)
    reach = (ground - station[:, 2])[:, None] / ray[..., 2]
    down = (ray[..., 2] < _LOWEST).all(axis=1) & (station[:, 2] > ground)
    return np.where(down[:, None, None], ray[..., :2] * reach[..., None], np.nan)


def frames(tables: Tables) -> tuple[FloatArray, FloatArray]:
    """Return the corners (n, 4, 2) mm of the photos from the principal point, and focal lengths (n,) mm.

    Of a camera without a format these are the corners of what was measured on its photos.
    """
    cameras, stations, plates = part(tables, "cameras"), part(tables, "stations"), part(tables, "plates")
    of = rows_of(texts(cameras, "camera"), texts(stations, "camera"))
    size, centre = numbers(cameras, "format_size", 2), numbers(cameras, "principal_point", 2)
    unknown = np.flatnonzero(~np.isfinite(size).all(axis=1)).tolist()
    camera = of[rows_of(texts(stations, "photo"), texts(plates, "photo"))] if unknown else of
    for row in unknown:
        mine = numbers(plates, "xy", 2)[camera == row]
        if len(mine):
            size[row] = 2.0 * _BORDER * np.abs(mine).max(axis=0)
    corners = _CORNERS * size[of, None, :] - centre[of, None, :]
    return corners, numbers(cameras, "focal_length")[of]


def ground_of(places: FloatArray) -> float:
    """Return the median height of places (n, 3), 0 where none is known."""
    heights = places[np.isfinite(places).all(axis=1), 2]
    return float(np.median(heights)) if len(heights) else 0.0


def outlines(tables: Tables, plane: Plane, ground: float) -> FloatArray:
    """Return the corners (n, 4, 2) m on the plane of what each photo shows at a height; NaN where it has none."""
    stations = part(tables, "stations")
    position = numbers(stations, "position", 3)
    places = plane.places(position)
    corners, focal_length = frames(tables)
    flat = footprints(places, numbers(stations, "attitude", 3), corners, focal_length, ground)
    turns = np.repeat(plane.turns(position), 4)
    return places[:, None, :2] + turned(flat.reshape(-1, 2), turns).reshape(-1, 4, 2)
