"""Images that lie where another point should be: names exchanged, mistaken, or mistyped.

An image that does not fit its point is compared with the predicted images of all points near its photo. It gets the
name of one of them only where that is certain: one point alone is there, its name is free on the photo, and so few
points lie about that it is there by chance in less than one case of a thousand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.network import Network
from musatpy.adjustment.sightings import image_coordinates, images
from musatpy.adjustment.unknowns import State
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.blunders.factors import taking_part
from musatpy.blunders.scene import Scene
from musatpy.geometry import collinearity

_RIM = 10.0  # mm around the images of a photo, where other points may be looked for
_NEAR = 6.0  # sigmas of an image: from image to predicted image, both with errors
_APART = 5.0  # times as far must the second nearest point be
_CHANCE = 1e-3  # expected number of points that lie so near by chance
_FEW = 5  # points near a photo, for there to be a density
_TOGETHER = 32  # photos whose points are looked at together: some megabytes
_DETERMINED = 2  # good images of a point that can be predicted


@dataclass(frozen=True, kw_only=True, eq=False)
class Lookalikes:
    """Images (c,) that lie on other points than those whose names they bear."""

    row: IntArray  # (c,) plate measurement
    point: IntArray  # (c,) whose image it is
    distance: FloatArray  # (c,) mm off its predicted image, NaN where only the other one of a pair has one
    certain: BoolArray  # (c,) it is this point, and its name is free on the photo


def lookalikes(
    scene: Scene, state: State, out: BoolArray, suspect: IntArray, covariance: FloatArray, sigma0: float
) -> Lookalikes:
    """Return which of the images `suspect` lie on other points; images in `out` (m,) determine no point.

    `covariance` (p, 3, 3) m2 is that of the points along east, north, up.
    """
    network = scene.network
    good = taking_part(network) & ~out
    determined = np.bincount(network.point[good], minlength=network.points) >= _DETERMINED
    determined &= np.isfinite(covariance).all(axis=(1, 2))
    rows: list[int] = []
    points: list[int] = []
    distances: list[float] = []
    alone: list[bool] = []
    suspect = suspect[np.argsort(network.photo[suspect], kind="stable")]
    photos = np.unique(network.photo[suspect])
    around, rims = _near(network, photos), _rims(network, photos)
    for first in range(0, len(photos), _TOGETHER):
        part = slice(first, first + _TOGETHER)
        of_part = suspect[np.isin(network.photo[suspect], photos[part])]
        seen = _imagined(scene, state, photos[part], around[part], rims, determined, covariance)
        found = _nearest(network, of_part, seen, sigma0)
        near = found.off < _NEAR
        rows += found.row[near].tolist()
        points += found.point[near].tolist()
        distances += found.distance[near].tolist()
        alone += ((found.second > _APART * _NEAR) & (found.chance < _CHANCE))[near].tolist()
    for partner, name in _exchanged(network, rows, points, alone, out, determined):
        rows.append(partner)
        points.append(name)
        distances.append(np.nan)
        alone.append(True)
    row, point = np.array(rows, dtype=int), np.array(points, dtype=int)
    certain = _free_names(network, row, point, np.array(alone, dtype=bool))
    return Lookalikes(row=row, point=point, distance=np.array(distances), certain=certain)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Nearest:
    """Images (c,) and the points that photos would show nearest to them, those of their names left out."""

    row: IntArray  # (c,) plate measurement
    point: IntArray  # (c,)
    distance: FloatArray  # (c,) mm
    off: FloatArray  # (c,) sigmas
    second: FloatArray  # (c,) sigmas, of the next point
    chance: FloatArray  # (c,) expected number of points so near by chance, were they spread evenly


def _nearest(network: Network, rows: IntArray, seen: _Imagined, sigma0: float) -> _Nearest:
    """Return the nearest points of the images `rows`, photo by photo, where photos would show a few."""
    number = np.searchsorted(seen.photos, network.photo[rows])
    few = np.diff(seen.start)[number] < _FEW
    rows, number = rows[~few], number[~few]
    count = np.diff(seen.start)[number]
    begin = np.cumsum(count) - count
    image = np.repeat(np.arange(len(rows)), count)
    of = np.arange(len(image)) + (seen.start[number] - begin)[image]  # the pairs of an image stand together
    if not len(image):
        nothing = np.zeros(0)
        return _Nearest(row=rows, point=rows, distance=nothing, off=nothing, second=nothing, chance=nothing)
    measured = (sigma0**2 / network.weight[rows])[image]
    xx, yy = (seen.covariance[of, axis, axis] + measured[:, axis] for axis in range(2))
    xy = seen.covariance[of, 0, 1]
    dx, dy = (network.xy[rows[image], axis] - seen.xy[of, axis] for axis in range(2))
    determinant = xx * yy - np.square(xy)
    off = np.sqrt((yy * np.square(dx) - 2.0 * xy * dx * dy + xx * np.square(dy)) / determinant)
    off[np.isnan(off) | (seen.point[of] == network.point[rows[image]])] = np.inf
    least = np.minimum.reduceat(off, begin)
    at = np.flatnonzero(off == least[image])
    best = at[np.searchsorted(image[at], np.arange(len(rows)))]
    off[best] = np.inf
    extent = np.prod(seen.extent()[number], axis=1)
    return _Nearest(
        row=rows,
        point=seen.point[of[best]],
        distance=np.hypot(dx[best], dy[best]),
        off=least,
        second=np.minimum.reduceat(off, begin),
        chance=np.pi * _NEAR**2 * np.add.reduceat(np.sqrt(determinant), begin) / extent,
    )


def _exchanged(
    network: Network, rows: list[int], points: list[int], alone: list[bool], out: BoolArray, determined: BoolArray
) -> list[tuple[int, int]]:
    """Return images, and the points that they get, that must have exchanged their names with another image.

    The other one is found on their point, and the point of its name can be seen nowhere: nothing else tells.
    """
    pairs = []
    for row, point, sure in zip(rows, points, alone, strict=True):
        name = int(network.point[row])
        if not sure or determined[name]:
            continue
        partner = np.flatnonzero((network.photo == network.photo[row]) & (network.point == point))
        if len(partner) == 1 and out[partner[0]] and partner[0] not in rows:
            pairs.append((int(partner[0]), name))
    return pairs


def _free_names(network: Network, row: IntArray, point: IntArray, certain: BoolArray) -> BoolArray:
    """Return which images can get their new names: no other image on the photo has it, or keeps it."""
    old = network.photo * network.points + network.point
    new = network.photo[row] * network.points + point
    bearers = np.flatnonzero(np.isin(old, new))
    while certain.any():
        kept = old[np.setdiff1d(bearers, row[certain])]
        names, count = np.unique(new[certain], return_counts=True)
        keep = np.isin(new, names[count == 1]) & ~np.isin(new, kept)
        if (keep | ~certain).all():
            break
        certain = certain & keep
    return certain


def _near(network: Network, photos: IntArray) -> list[IntArray]:
    """Return the points on the photos that have points in common with each of some photos (c,)."""
    if not len(photos):
        return []
    from scipy.sparse import csr_array  # most jobs do without

    seen = np.ones(len(network.photo), dtype=np.int32)
    shows = csr_array((seen, (network.photo, network.point)), shape=(network.photos, network.points))
    near = (shows[photos] @ shows.T) @ shows
    return np.split(near.indices.astype(np.int64), near.indptr[1:-1])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Imagined:
    """The points that photos would show, one photo after the other, where, and how sure that is."""

    photos: IntArray  # (c,)
    start: IntArray  # (c + 1,) the points of each
    point: IntArray  # (k,)
    xy: FloatArray  # (k, 2) mm
    covariance: FloatArray  # (k, 2, 2) mm2, the stations without error

    def extent(self) -> FloatArray:
        """Return how far (c, 2) mm the points of each photo lie apart, 0 of those without any."""
        out = np.zeros((len(self.photos), 2))
        some = np.flatnonzero(np.diff(self.start))
        start = self.start[some]
        out[some] = np.maximum.reduceat(self.xy, start) - np.minimum.reduceat(self.xy, start)
        return out


def _rims(network: Network, photos: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the least and the largest coordinates (n, 2) mm of the plates of some photos (c,) and their rims."""
    low, high = np.full((network.photos, 2), np.inf), np.full((network.photos, 2), -np.inf)
    rows = np.flatnonzero(np.isin(network.photo, photos))
    np.minimum.at(low, network.photo[rows], network.xy[rows])
    np.maximum.at(high, network.photo[rows], network.xy[rows])
    return low - _RIM, high + _RIM


def _imagined(
    scene: Scene,
    state: State,
    photos: IntArray,
    near: list[IntArray],
    rims: tuple[FloatArray, FloatArray],
    determined: BoolArray,
    covariance: FloatArray,
) -> _Imagined:
    """Return what some photos (c,) would show, within `rims`, of the points `near` them that are determined."""
    network, near = scene.network, [points[determined[points]] for points in near]
    number = np.repeat(np.arange(len(photos)), [len(points) for points in near])
    photo, points = photos[number], np.concatenate(near)
    imagined = replace(
        network,
        photo=photo,
        point=points,
        refracted=np.asarray(scene.block.points.bathymetric[points]),
    )
    ground = state.ground[points]
    xy = image_coordinates(imagined, state, np.arange(len(points)), ground)
    low, high = (rim[photo] for rim in rims)
    inside = (xy > low) & (xy < high)
    rows = np.flatnonzero(inside[:, 0] & inside[:, 1])
    seen = collinearity.in_front(ground[rows] - state.position[photo[rows]], state.M[photo[rows]])
    rows = rows[seen]
    predicted = images(imagined, state, rows, ground[rows], stations=False)
    B = predicted.by_ground @ np.swapaxes(network.frame.axes(ground[rows]), 1, 2)
    spread = B @ covariance[points[rows]] @ np.swapaxes(B, 1, 2)
    return _Imagined(
        photos=photos,
        start=np.searchsorted(number[rows], np.arange(len(photos) + 1)),
        point=points[rows],
        xy=predicted.xy,
        covariance=spread,
    )
