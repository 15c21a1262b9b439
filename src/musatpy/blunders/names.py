"""Images that lie where another point should be: names exchanged, mistaken, or mistyped.

An image that does not fit its point is compared with the predicted images of all points near its photo. It gets the
name of one of them only where that is certain: one point alone is there, its name is free on the photo, and so few
points lie about that it is there by chance in less than one case of a thousand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.network import Network
from musatpy.adjustment.sightings import image_coordinates
from musatpy.adjustment.unknowns import State
from musatpy.blunders.factors import taking_part
from musatpy.blunders.scene import Scene
from musatpy.geometry import collinearity
from musatpy.model.arrays import BoolArray, FloatArray, IntArray

_RIM = 10.0  # mm around the images of a photo, where other points may be looked for
_NEAR = 6.0  # sigmas of an image: from image to predicted image, both with errors
_APART = 5.0  # times as far must the second nearest point be
_CHANCE = 1e-3  # expected number of points that lie so near by chance
_FEW = 5  # points near a photo, for there to be a density
_DETERMINED = 2  # good images of a point that can be predicted


@dataclass(frozen=True, kw_only=True, eq=False)
class Lookalikes:
    """Images (c,) that lie on other points than those whose names they bear."""

    row: IntArray  # (c,) plate measurement
    point: IntArray  # (c,) whose image it is
    distance: FloatArray  # (c,) mm off its predicted image, NaN where only the other one of a pair has one
    certain: BoolArray  # (c,) it is this point, and its name is free on the photo


def lookalikes(scene: Scene, state: State, out: BoolArray, suspect: IntArray, sigma0: float) -> Lookalikes:
    """Return which of the images `suspect` lie on other points; images in `out` (m,) determine no point."""
    network = scene.network
    good = taking_part(network) & ~out
    determined = np.bincount(network.point[good], minlength=network.points) >= _DETERMINED
    rows, points, distances, alone = [], [], [], []
    for photo in np.unique(network.photo[suspect]).tolist():
        mine = suspect[network.photo[suspect] == photo]
        near, images = _imagined(scene, state, photo, _near(network, photo, determined))
        tolerance = _NEAR * sigma0 / np.sqrt(network.weight[mine].min(axis=1))
        distance = np.linalg.norm(network.xy[mine][:, None] - images[None], axis=2)
        distance[near[None] == network.point[mine][:, None]] = np.inf
        if len(near) < _FEW:
            continue
        first, second = np.partition(distance, 1, axis=1)[:, :2].T
        found = first < tolerance
        chance = len(near) * np.pi * tolerance**2 / np.prod(np.ptp(images, axis=0))  # of an even spread
        rows += mine[found].tolist()
        points += near[distance.argmin(axis=1)][found].tolist()
        distances += first[found].tolist()
        alone += ((second > _APART * tolerance) & (chance < _CHANCE))[found].tolist()
    for partner, own in _exchanged(network, rows, points, alone, out, determined):
        rows.append(partner)
        points.append(own)
        distances.append(np.nan)
        alone.append(True)
    row, point = np.array(rows, dtype=int), np.array(points, dtype=int)
    certain = _free_names(network, row, point, np.array(alone, dtype=bool))
    return Lookalikes(row=row, point=point, distance=np.array(distances), certain=certain)


def _exchanged(
    network: Network, rows: list[int], points: list[int], alone: list[bool], out: BoolArray, determined: BoolArray
) -> list[tuple[int, int]]:
    """Return images, and the points that they get, that must have exchanged their names with another image.

    The other one is found on their point, and the point of its name can be seen nowhere: nothing else tells.
    """
    found = []
    for row, point, sure in zip(rows, points, alone, strict=True):
        own = int(network.point[row])
        partner = np.flatnonzero((network.photo == network.photo[row]) & (network.point == point))
        if sure and not determined[own] and len(partner) == 1 and out[partner[0]] and partner[0] not in rows:
            found.append((int(partner[0]), own))
    return found


def _free_names(network: Network, row: IntArray, point: IntArray, certain: BoolArray) -> BoolArray:
    """Return which images can get their new names: no other image on the photo has it, or keeps it."""
    photo = network.photo[row]
    while certain.any():
        renamed = np.zeros(len(network.photo), dtype=bool)
        renamed[row[certain]] = True
        keep = np.array([
            not (~renamed & (network.photo == a) & (network.point == q)).any()
            and np.count_nonzero(certain & (photo == a) & (point == q)) == 1
            for a, q in zip(photo.tolist(), point.tolist(), strict=True)
        ])  # fmt: skip
        if (keep | ~certain).all():
            break
        certain = certain & keep
    return certain


def _near(network: Network, photo: int, determined: BoolArray) -> IntArray:
    """Return the determined points on the photos that have points in common with a photo."""
    own = np.unique(network.point[network.photo == photo])
    photos = np.unique(network.photo[np.isin(network.point, own)])
    points = np.unique(network.point[np.isin(network.photo, photos)])
    return points[determined[points]]


def _imagined(scene: Scene, state: State, photo: int, points: IntArray) -> tuple[IntArray, FloatArray]:
    """Return the points (k,) that a photo would show, and their images (k, 2) mm."""
    network = scene.network
    k = len(points)
    imagined = replace(
        network,
        photo=np.full(k, photo),
        point=points,
        refracted=np.asarray(scene.block.points.bathymetric[points]),
    )
    ground = state.ground[points]
    images = image_coordinates(imagined, state, np.arange(k), ground)
    own = network.xy[network.photo == photo]
    seen = collinearity.in_front(ground - state.position[photo], state.M[np.full(k, photo)])
    seen &= ((images > own.min(axis=0) - _RIM) & (images < own.max(axis=0) + _RIM)).all(axis=1)
    return points[seen], images[seen]
