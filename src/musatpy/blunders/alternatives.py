"""Which images of a point are the wrong ones, all choices compared; and whether its flag is wrong instead.

Three images in a strip check each other's x once only: any of them explains a wrong one. Taking out the wrong one
of them would move the point and tell nobody. So for a point with images that do not fit, every choice of images to
take out is tried, the smallest first: all images of the choices that leave a point that fits, about equally well,
go out.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from musatpy.adjustment import ground as ground_points
from musatpy.adjustment.ground import point_squares
from musatpy.adjustment.network import Network, PointGroup, parts_of
from musatpy.adjustment.robust import chi_square_limit
from musatpy.adjustment.unknowns import State
from musatpy.adjustment.waterline import heights_and_water
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.blunders.scene import Scene

_AS_GOOD = 16.0  # of squares over sigma0 squared: a choice that is worse by less explains the point too
_MEET = 4.0  # times the limit of a point that fits: the stations may be bent by its images
_MOST = 1000  # choices that are tried of one point
_PART = 2**14  # rays that are tried at a time


def wrong_images(network: Network, state: State, out: BoolArray, sigma0: float) -> tuple[BoolArray, State]:
    """Return which images (m,) are out when those of points with images in `out` (m,) are chosen anew.

    And the state with these points where the images that are left see them; the stations stay as they are.
    `network` has the full weights of the images.
    """
    wrong, ground = np.zeros_like(out), state.ground.copy()
    for group in network.groups:
        part = group.part(np.asarray(out[group.rays].any(axis=1)))
        if len(part.point):
            wrong[part.rays], ground[part.point] = _chosen(network, state, part, out[part.rays], sigma0)
    return wrong, replace(state, ground=ground)


def misfit(network: Network, state: State, point: IntArray) -> FloatArray:
    """Return the root of the squares (k,) of points with all their images, NaN for those that take no part."""
    roots = np.full(network.points, np.nan)
    for group in network.groups:
        part = group.part(np.isin(group.point, point))
        if len(part.point):
            roots[part.point] = np.sqrt(_squares(network, state, part, np.arange(part.rays.shape[1]))[0])
    return roots[point]


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
        squares, _ = _intersected(network, state, tries, network.xy[part.rays[0][order]])
        fits = squares < _MEET * chi_square_limit(_redundancy(part, m))
        pairs += [tuple(photos) for photos in network.photo[part.rays[0]][exchanged[fits]].tolist()]
    return pairs


def wrong_flags(scene: Scene, state: State, sigma0: float) -> tuple[IntArray, FloatArray]:
    """Return the points whose images want the other flag, submerged or dry, and the test values of that.

    All images of a point are taken as they are, once refracted and once straight: the test value is the root of the
    difference of the squares. Only points below the water at all their photos can have either. Where one wrong
    image would explain the misfit better, the flag is not blamed.
    """
    network = scene.network
    height, water = heights_and_water(network, state)
    below = np.ones(network.points, dtype=bool)
    np.logical_and.at(below, network.point, height < water)
    other = replace(network, refracted=np.where(below[network.point], ~network.refracted, network.refracted))
    points, tests = [np.zeros(0, dtype=int)], [np.zeros(0)]
    for group in network.groups:
        part = group.part(below[group.point])
        if not len(part.point) or part.rays.shape[1] == 1:
            continue
        m = part.rays.shape[1]
        every = np.arange(m)
        flagged = _squares(network, state, part, every)[0]
        misfits = ~(flagged <= _AS_GOOD * sigma0**2)  # the other flag gains no more than these squares
        if not misfits.any():
            continue
        part, flagged = part.part(misfits), flagged[misfits]
        flipped = _squares(other, state, part, every)[0]
        with np.errstate(invalid="ignore"):  # of points that neither way stand before their cameras
            gain = (flagged - flipped) / sigma0**2
        wrong = (gain > _AS_GOOD) & (flipped < sigma0**2 * chi_square_limit(_redundancy(part, m)))
        doubtful = part.part(wrong)
        if wrong.any():
            one_less = [_squares(network, state, doubtful, np.delete(every, image))[0] for image in every]
            wrong[wrong] = np.min(one_less, axis=0) > flipped[wrong]
        points.append(part.point[wrong])
        tests.append(np.sqrt(gain[wrong]))
    return np.concatenate(points), np.concatenate(tests)


def _chosen(
    network: Network, state: State, group: PointGroup, out: BoolArray, sigma0: float
) -> tuple[BoolArray, FloatArray]:
    """Return which images (k, m) of the points of a group are out, and the positions (k, 3) by the others.

    Where too many choices would have to be tried, `out` and the positions are kept.
    """
    k, m = group.rays.shape
    ground = state.ground[group.point]
    wrong, open_ = np.ones((k, m), dtype=bool), np.ones(k, dtype=bool)
    tried = 0
    for number in range(m - 1):
        choices = [np.array(kept) for kept in combinations(range(m), m - number)]
        tried += len(choices)
        rows = np.flatnonzero(open_)
        if not len(rows):
            break
        if tried > _MOST:
            wrong[rows] = out[rows]
            break
        squares, positions = _of_choices(network, state, group.part(open_), np.stack(choices))
        squares /= sigma0**2
        positions = positions[np.arange(len(rows)), squares.argmin(axis=1)]
        best = squares.min(axis=1)
        fits = best < chi_square_limit(_redundancy(group, m - number))
        taken = np.stack([~np.isin(np.arange(m), kept) for kept in choices])  # (c, m)
        good = squares <= best[:, None] + _AS_GOOD
        wrong[rows[fits]] = (good[fits, :, None] & taken[None]).any(axis=1)
        ground[rows[fits]] = positions[fits]
        open_[rows[fits]] = False
    return wrong, ground


def _redundancy(group: PointGroup, images: int) -> int:
    """Return the redundancy of a point with so many images; one of which something is known counts as all known."""
    return 2 * images if group.known else 2 * images - 3


def _squares(network: Network, state: State, group: PointGroup, kept: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the weighted squares (k,) of points with only the images `kept` of theirs, and their positions."""
    return _intersected(network, state, replace(group, rays=group.rays[:, kept]))


def _of_choices(
    network: Network, state: State, group: PointGroup, choices: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return the squares (k, c) and positions (k, c, 3) of points with `choices` (c, r) of their images only."""
    (k, _), (c, r) = group.rays.shape, choices.shape
    tries = replace(group, point=np.repeat(group.point, c), rays=group.rays[:, choices].reshape(-1, r))
    parts = [_intersected(network, state, part) for part in parts_of([tries], _PART)]
    squares, ground = (np.concatenate(values) for values in zip(*parts, strict=True))
    return squares.reshape(k, c), ground.reshape(k, c, 3)


def _intersected(
    network: Network, state: State, group: PointGroup, xy: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the weighted squares (k,) and the positions (k, 3) of points of a group by its rays and what is known.

    A point may be in it more than once, with other rays, or other images xy (k, m, 2). The stations stay.
    """
    rays = group.rays
    tried, every = network.apart(group, network.xy[rays] if xy is None else xy, network.refracted[rays])
    first = ground_points.start_ground(tried, replace(state, ground=state.ground[group.point])).ground
    met = replace(state, ground=first, squares=np.zeros(len(first)))
    ground = ground_points.settle(tried, met).ground
    # the squares that come with it hold near the optimum only, where wrong images may not have let it come
    return point_squares(tried, state, every, ground), ground
