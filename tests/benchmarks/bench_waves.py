"""Incidence points on waves: the search against a net over all that Snell's law allows, one ray at a time.

Regular rays, which need no search, are set against the flat surface. Run as a script it prints the times; run by
pytest it asserts that a searched ray costs 20 times less than its net, and a regular ray at most 100 flat ones.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from musatpy.refraction import fermat, flat
from musatpy.refraction.stationary import RayEnds, path, stationary
from musatpy.refraction.waves import sinusoidal

INDEX, SEARCHED, NETTED, REGULAR = 1.34, 200, 3, 50_000
CAMERA = np.array([300.0, 100.0, 1500.0])
SHORT = sinusoidal(amplitude=0.5, length=25.0, azimuth=0.5)  # of 4 s
LONG = sinusoidal(amplitude=0.5, length=92.0, azimuth=0.5)


def ground(count: int, depth: float) -> np.ndarray:
    rng = np.random.default_rng(3)
    return np.column_stack([rng.uniform(-600.0, 600.0, (count, 2)), np.full(count, -depth)])


def seconds(function: Callable[[], object]) -> float:
    """Return the processor time of the best of three."""
    best = np.inf
    for _ in range(3):
        start = time.process_time()
        function()
        best = min(best, time.process_time() - start)
    return best


def by_net(place: np.ndarray) -> None:
    """Look for the refraction points of one ray in every twelfth of a wave, all over its reach."""
    ray = RayEnds.of(CAMERA, place, INDEX, 0.0)
    reach = float(ray.reach(SHORT).radius[0])
    nodes = np.linspace(-reach, reach, int(2.0 * reach / SHORT.limits.length * 12.0) + 2)
    net = place[:2] + np.stack(np.meshgrid(nodes, nodes, indexing="ij"), axis=-1)
    many = ray[np.zeros(net.size // 2, dtype=int)]
    slope = path(SHORT, many, net.reshape(-1, 2)).gradient.reshape(net.shape)
    corners = np.stack([slope[:-1, :-1], slope[1:, :-1], slope[:-1, 1:], slope[1:, 1:]])
    hit = ((corners.min(axis=0) <= 0.0) & (corners.max(axis=0) >= 0.0)).all(axis=-1)
    start = net[:-1, :-1][hit]
    stationary(SHORT, ray[np.zeros(len(start), dtype=int)], start)


def times() -> tuple[float, float, float, float]:
    """Return seconds per ray: searched, by the net, regular, and flat."""
    deep, shallow = ground(SEARCHED, 200.0), ground(REGULAR, 20.0)
    up, depth = np.broadcast_to(np.array([0.0, 0.0, 1.0]), shallow.shape), np.full(REGULAR, 20.0)
    cameras = np.broadcast_to(CAMERA, shallow.shape)
    return (
        seconds(lambda: fermat.incidence(SHORT, CAMERA, deep, INDEX)) / SEARCHED,
        seconds(lambda: [by_net(place) for place in deep[:NETTED]]) / NETTED,
        seconds(lambda: fermat.incidence(LONG, CAMERA, shallow, INDEX)) / REGULAR,
        seconds(lambda: flat.incidence(cameras, shallow, up, depth, INDEX)) / REGULAR,
    )


def test_the_search_is_20_times_the_net() -> None:
    searched, netted, regular, level = times()
    assert 20.0 * searched <= netted
    assert regular <= 100.0 * level


def main() -> None:
    searched, netted, regular, level = (1e3 * one for one in times())
    print(f"searched: {searched:.3f} ms a ray; by a net: {netted:.3f} ms; ratio {netted / searched:.0f}")
    print(f"regular: {regular:.4f} ms a ray; flat: {level:.4f} ms; ratio {regular / level:.0f}")


if __name__ == "__main__":
    main()
