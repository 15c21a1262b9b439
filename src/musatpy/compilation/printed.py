"""True coordinates as ETL-0306 prints them, section 5, with its misprints put right: (5.1) to (5.26).

The rays are cut with the water, refracted and intersected by least squares in the model, unweighted. By default
every photo has its own ray and its own tide, and every point its own vertical; the program of 1983 has one model
point for both rays, one vertical for the model, and one mean tide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.stereomodels import Stereomodel

_STEPS = 6  # of the vertical of a point, which turns by a microradian in some metres
_STILL = 1e-7  # m


@dataclass(frozen=True, kw_only=True)
class Shortcuts:
    """What is taken as in 1983: one model point for both rays, the vertical of the model, the mean tide."""

    shared_point: bool = False
    model_vertical: bool = False
    mean_tide: bool = False


AS_1983 = Shortcuts(shared_point=True, model_vertical=True, mean_tide=True)


def printed_points(model: Stereomodel, xy: FloatArray, mode: Shortcuts) -> FloatArray:
    """Return the true points (k, 3) in the model of submerged images (k, 2, 2) mm on its plates.

    The water is level; where the rays of a point meet above it, the formulas go on all the same.
    """
    rays, apparent = model.rays(xy), model.half_way(xy)
    if mode.shared_point:
        gap = apparent[:, None] - model.stations
        rays = gap / np.linalg.norm(gap, axis=-1, keepdims=True)
    tides = np.full(2, model.tides.mean()) if mode.mean_tide else model.tides
    if mode.model_vertical:
        water = tides - model.run.frame.height(model.origin)
        return true_coordinates(
            np.broadcast_to(model.stations, rays.shape), _at_heights(model.stations, rays, apparent[:, 2]),
            np.broadcast_to(water, (len(xy), 2)), model.index,
        )  # fmt: skip
    X = apparent
    for _ in range(_STEPS):
        before, X = X, _by_own_vertical(model, rays, tides, X)
        if not np.nanmax(np.abs(X - before), initial=0.0) > _STILL:
            break
    return X


def _by_own_vertical(model: Stereomodel, rays: FloatArray, tides: FloatArray, X: FloatArray) -> FloatArray:
    """Return the points (k, 3) with the verticals of points X (k, 3), at which the heights hold."""
    frame = model.run.frame
    place = model.working(X)
    axes = frame.axes(place) @ model.axes.T  # (k, 3, 3) east, north, up in the model
    height = frame.height(place)
    stations = np.einsum("kij,kmj->kmi", axes, model.stations - X[:, None])
    stations[..., 2] += height[:, None]
    turned = np.einsum("kij,kmj->kmi", axes, rays)
    apparent = _at_heights(stations, turned, height)
    local = true_coordinates(stations, apparent, np.broadcast_to(tides, (*height.shape, 2)), model.index)
    local[:, 2] -= height
    return np.asarray(X + np.einsum("kij,ki->kj", axes, local))


def _at_heights(stations: FloatArray, rays: FloatArray, height: FloatArray) -> FloatArray:
    """Return the points (k, 2, 3) of rays from stations (..., 2, 3) at heights (k,)."""
    reach = (height[:, None] - stations[..., 2]) / rays[..., 2]
    return np.asarray(stations + rays * reach[..., None])


def true_coordinates(stations: FloatArray, points: FloatArray, water: FloatArray, index: float) -> FloatArray:
    """Return the true coordinates (k, 3) of bathymetric points, ETL-0306 (5.1) to (5.26), corrected.

    stations B (k, 2, 3); points (k, 2, 3), the measured one, on the ray of each photo; heights Zw of the water
    (k, 2); all in axes whose Z is vertical.
    """
    B, P = stations, points
    H = B[..., 2] - water
    W = B[..., :2] + (H / (B[..., 2] - P[..., 2]))[..., None] * (P[..., :2] - B[..., :2])  # (5.1) to (5.4)
    D = np.linalg.norm(B[..., :2] - W, axis=-1)  # (5.5), (5.6)
    sine = np.sin(np.arctan2(D, H)) / index  # (5.7) to (5.10)
    tangent = sine / np.sqrt(1.0 - np.square(sine))
    off = np.where(D > 0.0, D, 1.0)
    r = -(tangent / off)[..., None] * (W - B[..., :2])  # (5.17a) to (5.17d): r13, r23 of each photo
    a = W - r * water[..., None]
    c13_23, c1_2 = -r.sum(axis=1), a.sum(axis=1)  # (5.18), (5.19), (5.21), (5.22)
    c33, c3 = np.sum(np.square(r), axis=(1, 2)), -np.sum(r * a, axis=(1, 2))  # (5.20), (5.23)
    Z = (c3 - 0.5 * np.sum(c13_23 * c1_2, axis=1)) / (c33 - 0.5 * np.sum(np.square(c13_23), axis=1))  # (5.24)
    return np.concatenate([0.5 * (c1_2 - c13_23 * Z[:, None]), Z[:, None]], axis=1)  # (5.25), (5.26)
