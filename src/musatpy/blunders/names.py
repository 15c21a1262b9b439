"""Images that lie where another point should be: names exchanged, mistaken, or mistyped.

An image that does not fit its point is compared with the predicted images of all points near its photo. It gets the
name of one of them only where that is certain: one point alone is there, its name is free on the photo, and so few
points lie about that it is there by chance in less than one case of a thousand. Labels that two photos, or two
control points, have exchanged are told by their places: each stands where the other one should.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from musatpy.adjustment.iteration import State
from musatpy.adjustment.network import Network
from musatpy.adjustment.precision import reach_of
from musatpy.adjustment.sightings import image_coordinates, images
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.blunders.hypotheses import CARDS, PLATES, Hypothesis, of_kinds
from musatpy.blunders.scene import StagedBlock, taking_part
from musatpy.blunders.snooping import SnoopingResult
from musatpy.geometry import collinearity
from musatpy.model import Block, CauseKind, ObservationKind
from musatpy.model.tables import finite_rows

_RIM = 10.0  # mm around the images of a photo, where other points may be looked for
_NEAR = 6.0  # sigmas of an image: from image to predicted image, both with errors
_APART = 5.0  # times as far must the second nearest point be
_CHANCE = 1e-3  # expected number of points that lie so near by chance
_FEW = 5  # points near a photo, for there to be a density
_DETERMINED = 2  # good images of a point that can be predicted


class Lookalike(NamedTuple):
    """An image that lies on another point than that whose name it bears."""

    row: int  # plate measurement
    point: int  # whose image it is
    distance: float  # mm off its predicted image, NaN where only the other one of a pair has one
    certain: bool  # it is this point, and its name is free on the photo
    test: float = np.nan  # under the old name, NaN where that could not be tested
    error: tuple[float, float] = (np.nan, np.nan)  # mm, likewise


def lookalikes(last: SnoopingResult) -> list[Lookalike]:
    """Return the images out, or of no point that takes part, that lie on other points."""
    scene, network, covariance = last.scene, last.scene.network, last.judgement.covariance
    out, used = last.rows_out(ObservationKind.PLATE), taking_part(network)
    determined = np.bincount(network.point[used & ~out], minlength=network.points) >= _DETERMINED
    determined &= np.isfinite(covariance).all(axis=(1, 2))
    suspect = np.flatnonzero(out | (scene.block.plates.triangulated & ~used))
    if not len(suspect):
        return []
    photos = np.unique(network.photo[suspect])
    found: list[Lookalike] = []
    for photo, near in zip(photos.tolist(), _near(network, photos), strict=True):
        points, xy, spread = _imagined(scene, last.state, photo, near[determined[near]], covariance)
        if len(points) >= _FEW:
            rows = suspect[network.photo[suspect] == photo]
            found += _nearest(network, rows, points, xy, spread, last.judgement.sigma0)
    found += list(_exchanged(network, found, out, determined))
    certain = _free_names(network, found)
    return [one._replace(certain=name_is_free) for one, name_is_free in zip(found, certain.tolist(), strict=True)]


def _nearest(
    network: Network, rows: IntArray, point: IntArray, xy: FloatArray, covariance: FloatArray, sigma0: float
) -> Iterator[Lookalike]:
    """Yield the images `rows` of a photo that lie on others of the points (k,) that it would show.

    They are certain where the next point is far, and where in less than one case of a thousand any lies so near by
    chance, were they spread evenly. `covariance` (k, 2, 2) is that of their predicted images xy (k, 2).
    """
    measured = sigma0**2 / network.weight[rows][:, None, :, None] * np.eye(2)
    d, C = network.xy[rows][:, None] - xy, covariance + measured
    off = np.sqrt(np.einsum("rki,rki->rk", d, np.linalg.solve(C, d[..., None])[..., 0]))
    off[np.isnan(off) | (point == network.point[rows][:, None])] = np.inf
    chance = np.pi * _NEAR**2 * np.sqrt(np.linalg.det(C)).sum(axis=1) / np.prod(np.ptp(xy, axis=0))
    for image, best in enumerate(off.argmin(axis=1).tolist()):
        if off[image, best] < _NEAR:
            alone = np.partition(off[image], 1)[1] > _APART * _NEAR and chance[image] < _CHANCE
            distance = float(np.hypot(*d[image, best]))
            yield Lookalike(int(rows[image]), int(point[best]), distance, bool(alone))


def _exchanged(
    network: Network, found: list[Lookalike], out: BoolArray, determined: BoolArray
) -> Iterator[Lookalike]:
    """Yield images, and the points that they get, that must have exchanged their names with another image.

    The other one is found on their point, and the point of its name can be seen nowhere: nothing else tells.
    """
    rows = {one.row for one in found}
    for one in found:
        name = int(network.point[one.row])
        if not one.certain or determined[name]:
            continue
        partner = np.flatnonzero((network.photo == network.photo[one.row]) & (network.point == one.point))
        if len(partner) == 1 and out[partner[0]] and partner[0] not in rows:
            yield Lookalike(int(partner[0]), name, np.nan, True)


def _free_names(network: Network, found: list[Lookalike]) -> BoolArray:
    """Return which certain images can get their new names: no other image on the photo has it, or keeps it."""
    row, point = (np.array([one[column] for one in found], dtype=int) for column in range(2))
    certain = np.array([one.certain for one in found], dtype=bool)
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
    from scipy.sparse import csr_array  # most jobs do without

    seen = np.ones(len(network.photo), dtype=np.int32)
    shows = csr_array((seen, (network.photo, network.point)), shape=(network.photos, network.points))
    near = (shows[photos] @ shows.T) @ shows
    return np.split(near.indices.astype(np.int64), near.indptr[1:-1])


def _imagined(
    scene: StagedBlock, state: State, photo: int, points: IntArray, covariance: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return which of some points a photo would show, their images (k, 2) mm, and their covariances (k, 2, 2) mm2.

    `covariance` (p, 3, 3) m2 is that of the points along east, north, up.
    """
    network, ground = scene.network, state.ground[points]
    shown = network.xy[network.photo == photo]
    imagined = replace(
        network,
        photo=np.full(len(points), photo),
        point=points,
        refracted=np.asarray(scene.block.points.bathymetric[points]),
    )
    xy = image_coordinates(imagined, state, np.arange(len(points)), ground)
    inside = ((xy > shown.min(axis=0) - _RIM) & (xy < shown.max(axis=0) + _RIM)).all(axis=1)
    rows = np.flatnonzero(inside & collinearity.in_front(ground - state.position[photo], state.M[photo]))
    predicted = images(imagined, state, rows, ground[rows], stations=False)
    B = predicted.by_ground @ np.swapaxes(network.frame.axes(ground[rows]), 1, 2)
    return points[rows], predicted.xy, B @ covariance[points[rows]] @ np.swapaxes(B, 1, 2)


FAR = 0.1  # of the flying height: a station farther than this from its card is not where it should be
_NEARER = 0.3  # times as far the place of the other one must be


def exchanged_photos(block: Block, scene: StagedBlock, state: State) -> list[tuple[int, int]]:
    """Return the pairs of photos that stand where the cards of the other one say."""
    given = scene.network.frame.working(block.photos.position)
    return _pairs(state.position, given, FAR * reach_of(scene.network, state, taking_part(scene.network)).height)


def exchanged_control(last: SnoopingResult) -> list[tuple[int, int]]:
    """Return the pairs of points with control that lie where the cards of the other one say."""
    network, out = last.scene.network, last.out[ObservationKind.CONTROL]
    points = np.unique(last.scene.block.control.point[out[:, :2].any(axis=1)])
    points = points[finite_rows(last.state.ground[points])]
    points = points[finite_rows(network.priors.given[points])]
    if len(points) < 2:
        return []
    given = np.asarray(network.frame.from_level(network.priors.given[points]))
    pairs = _pairs(last.state.ground[points], given, 0.0)
    return [(int(points[a]), int(points[b])) for a, b in pairs]


def _pairs(place: FloatArray, given: FloatArray, far: float) -> list[tuple[int, int]]:
    """Return the pairs of which each is `far` from what is given for it, and near what is given for the other."""
    off = np.linalg.norm(place - given, axis=1)
    away = np.flatnonzero(off > far)
    nearest = {}
    for a in away.tolist():
        distance = np.linalg.norm(place[a] - given, axis=1)
        b = int(np.nanargmin(distance))
        if distance[b] < _NEARER * off[a]:
            nearest[a] = b
    return [(a, b) for a, b in nearest.items() if a < b and nearest.get(b) == a]


def exchanges(block: Block, last: SnoopingResult) -> Iterator[Hypothesis]:
    """Yield the exchanges of labels that the places say."""
    for pair in exchanged_photos(block, last.scene, last.state):
        for member in (PLATES, CARDS):
            yield Hypothesis(kind=CauseKind.LABELS, photo=pair, member=member)
    for pair in exchanged_control(last):
        yield Hypothesis(kind=CauseKind.EXCHANGED_CONTROL, point=pair)
    for module in of_kinds(last.scene.block):
        for kind, member, photos, name in module.exchanges(last.scene.block, last.scene.network, last.state):
            yield Hypothesis(kind=kind, photo=photos, member=member, name=name)
