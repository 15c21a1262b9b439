"""Which images of a point are the wrong ones, all choices compared; and whether its flag is wrong instead.

Three images in a strip check each other's x once only: any of them explains a wrong one. Taking out the wrong one
of them would move the point and tell nobody. So for a point with images that do not fit, every choice of images to
take out is tried, the smallest first: all images of the choices that leave a point that fits, about equally well,
go out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, count
from math import comb

import numpy as np

from musatpy.adjustment import ground as ground_points
from musatpy.adjustment.ground import point_squares
from musatpy.adjustment.iteration import State, heights_and_water
from musatpy.adjustment.kernels import loops_of
from musatpy.adjustment.network import Network, PointGroup, parts_of
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.blunders.scene import PENALTY, StagedBlock
from musatpy.probability import chi_square_limit

_MEET = 4.0  # times the limit of a point that fits: the stations may be bent by its images
_MOST = 1000  # choices that are tried of one point
_PART = 2**14  # rays that are tried at a time


def wrong_images(network: Network, state: State, out: BoolArray, sigma0: float) -> tuple[BoolArray, State]:
    """Return which images (m,) are out when those of points with images in `out` (m,) are chosen anew.

    And the state with these points where the images that are left see them; the stations stay as they are.
    `network` has the full weights of the images.
    """
    wrong, ground, asked = np.zeros_like(out), state.ground.copy(), np.zeros(network.points, dtype=bool)
    asked[network.point[out]] = True
    left = _groups(network, asked)
    for group in left:
        wrong[group.rays] = True  # until a choice fits
    for number in count():
        tried = []
        for group in left:
            m = group.rays.shape[1]
            if sum(comb(m, less) for less in range(number + 1)) > _MOST:
                wrong[group.rays] = out[group.rays]
            elif number < m - 1:
                tried.append(group)
        if not tried:
            break
        left = _choose(network, state, tried, number, sigma0, wrong, ground)
    return wrong, replace(state, ground=ground)


def misfit(network: Network, state: State, point: IntArray) -> FloatArray:
    """Return the root of the squares (k,) of points with all their images, NaN for those that take no part."""
    asked = np.zeros(network.points, dtype=bool)
    asked[point] = True
    return np.sqrt(_squares_of(network, state, asked)[point])


def exchanged_images(network: Network, state: State, point: int) -> list[tuple[int, int]]:
    """Return the pairs of photos of a point whose images fit when each has the other one's plate coordinates."""
    pairs = []
    for group in network.groups:
        part = group.part(group.point == point)
        if not len(part.point) or part.rays.shape[1] < 2:
            continue
        m = part.rays.shape[1]
        exchanged = np.array(list(combinations(range(m), 2)))
        order = np.tile(np.arange(m), (len(exchanged), 1))
        np.put_along_axis(order, exchanged, exchanged[:, ::-1], axis=1)
        tries = part.part(np.zeros(len(exchanged), dtype=int))
        squares, _ = _intersected(network, state, [tries], network.xy[part.rays[0][order].reshape(-1)])
        fits = squares < _MEET * _limit(part, m)
        pairs += [tuple(photos) for photos in network.photo[part.rays[0]][exchanged[fits]].tolist()]
    return pairs


def wrong_flags(scene: StagedBlock, state: State, sigma0: float) -> dict[int, float]:
    """Return the points whose images want the other flag, submerged or dry, and the test values of that.

    All images of a point are taken as they are, once refracted and once straight: the test value is the root of the
    difference of the squares. Only points below the water at all their photos can have either, but for those that
    are dry for certain. Where one wrong image would explain the misfit better, the flag is not blamed.
    """
    network, variance = scene.network, sigma0**2
    height, water = heights_and_water(network, state)
    asked, limit = ~scene.block.points.dry, np.zeros(network.points)
    asked[network.point[~(height < water)]] = False
    for group in network.groups:
        m = group.rays.shape[1]
        asked[group.point] &= m > 1
        limit[group.point] = _limit(group, m)
    flagged = _squares_of(network, state, asked)
    asked &= ~(flagged <= PENALTY * variance)  # the other flag gains no more than these squares
    other = replace(network, refracted=np.where(asked[network.point], ~network.refracted, network.refracted))
    flipped = _squares_of(other, state, asked)
    with np.errstate(invalid="ignore"):  # of points that neither way stand before their cameras
        gain = (flagged - flipped) / variance
        wrong = (gain > PENALTY) & (flipped < variance * limit)
    groups = _groups(network, wrong)
    for group, (_, squares, _) in zip(groups, _without(network, state, groups, 1), strict=True):
        wrong[group.point] = squares.min(axis=1) > flipped[group.point]
    return {point: float(np.sqrt(gain[point])) for point in np.flatnonzero(wrong).tolist()}


def _choose(
    network: Network,
    state: State,
    groups: list[PointGroup],
    number: int,
    sigma0: float,
    wrong: BoolArray,
    ground: FloatArray,
) -> list[PointGroup]:
    """Set which images (m,) of points that fit without so many are wrong, and the positions (p, 3) by the others.

    Return the points that do not.
    """
    left = []
    for group, (kept, squares, positions) in zip(groups, _without(network, state, groups, number), strict=True):
        squares /= sigma0**2
        best = squares.min(axis=1)
        fits = best < _limit(group, kept.shape[1])
        taken = (kept[:, :, None] != np.arange(group.rays.shape[1])).all(axis=1)  # (c, m)
        good, fitting = squares[fits] <= best[fits, None] + PENALTY, group.part(fits)
        wrong[fitting.rays] = (good[:, :, None] & taken).any(axis=1)
        ground[fitting.point] = positions[fits, squares[fits].argmin(axis=1)]
        left += group.some(~fits)
    return left


def _limit(group: PointGroup, images: int) -> float:
    """Return the limit of the squares with which a point with so many images fits.

    One of which something is known counts as all known.
    """
    return chi_square_limit(2 * images if group.known else 2 * images - 3)


def _groups(network: Network, asked: BoolArray) -> list[PointGroup]:
    """Return the points that are `asked` (p,), of those that take part."""
    return [part for group in network.groups for part in group.some(asked[group.point])]


def _squares_of(network: Network, state: State, asked: BoolArray) -> FloatArray:
    """Return the squares (p,) of points that are `asked` (p,) with all their images, NaN for others."""
    out, groups = np.full(network.points, np.nan), _groups(network, asked)
    if groups:
        out[np.concatenate([group.point for group in groups])] = _squares(network, state, groups)[0]
    return out


def _without(
    network: Network, state: State, groups: Sequence[PointGroup], number: int
) -> Iterator[tuple[IntArray, FloatArray, FloatArray]]:
    """Yield all choices of all but so many of the images of points, group by group: those that are kept (c, r).

    With the squares (k, c) and the positions (k, c, 3) of the points with these images only.
    """
    if not groups:
        return
    kept = [np.array(list(combinations(range(m), m - number))) for m in (group.rays.shape[1] for group in groups)]
    tries = [
        replace(group, point=np.repeat(group.point, len(rows)), rays=group.rays[:, rows].reshape(-1, rows.shape[1]))
        for group, rows in zip(groups, kept, strict=True)
    ]
    ends = np.cumsum([len(group.point) for group in tries])[:-1]
    squares, ground = (np.split(values, ends) for values in _squares(network, state, tries))
    for rows, of_tries, X in zip(kept, squares, ground, strict=True):
        yield rows, of_tries.reshape(-1, len(rows)), X.reshape(-1, len(rows), 3)


def _squares(network: Network, state: State, groups: Sequence[PointGroup]) -> tuple[FloatArray, FloatArray]:
    """Return what `_intersected` does, of so many rays at a time as the memory is to hold."""
    parts = parts_of(groups, _PART)
    number = np.cumsum([part.rays.size for part in parts]) // _PART
    met = [
        _intersected(network, state, [parts[row] for row in np.flatnonzero(number == n).tolist()])
        for n in np.unique(number).tolist()
    ]
    squares, ground = zip(*met, strict=True)
    return np.concatenate(squares), np.concatenate(ground)


def _intersected(
    network: Network, state: State, groups: list[PointGroup], xy: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the weighted squares (k,) and the positions (k, 3) of points by their rays and what is known of them.

    A point may be in them more than once, with other rays, or other images xy (r, 2). The stations stay.
    """
    tried, every, met = ground_points.apart_at_their_best(network, state, groups, xy)
    # the squares that come with it hold near the optimum only, where wrong images may not have let it come
    squares = np.empty(tried.points)
    for group in loops_of(tried, every).set_squares(met, squares):
        squares[group.point] = point_squares(tried, met, group, met.ground[group.point])
    return squares, met.ground
