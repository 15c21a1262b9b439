"""Labels that two photos, or two control points, have exchanged: each stands where the other one should.

The places of photos are those that their images say, compared with all given stations; those of control points
likewise.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray, finite_rows
from musatpy.blunders.factors import taking_part
from musatpy.blunders.hypotheses import Hypothesis
from musatpy.blunders.revisions import CARDS, PLATES
from musatpy.blunders.scene import Scene
from musatpy.blunders.snooping import Snooped
from musatpy.model import Block, CauseKind, ObservationKind

FAR = 0.1  # of the flying height: a station farther than this from its card is not where it should be
_NEARER = 0.3  # times as far the place of the other one must be


def flying_height(scene: Scene, state: State) -> float:
    """Return the median distance, m, of points from the stations that see them."""
    network = scene.network
    rays = np.flatnonzero(taking_part(network))
    v = state.ground.take(network.point[rays], axis=0) - state.position.take(network.photo[rays], axis=0)
    return float(np.nanmedian(np.sqrt(np.einsum("ri,ri->r", v, v))))


def exchanged_photos(block: Block, scene: Scene, state: State) -> list[tuple[int, int]]:
    """Return the pairs of photos that stand where the cards of the other one say."""
    given = np.full_like(state.position, np.nan)
    stated_on_card = finite_rows(block.photos.position)
    given[stated_on_card] = scene.network.frame.working(block.photos.position[stated_on_card])
    return _pairs(state.position, given, FAR * flying_height(scene, state))


def exchanged_control(last: Snooped) -> list[tuple[int, int]]:
    """Return the pairs of points with control that lie where the cards of the other one say."""
    network, out = last.scene.network, last.out()[ObservationKind.CONTROL]
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


def exchanges(block: Block, last: Snooped) -> Iterator[Hypothesis]:
    """Yield the exchanges of labels that the places say."""
    for pair in exchanged_photos(block, last.scene, last.state):
        for member in (PLATES, CARDS):
            yield Hypothesis(kind=CauseKind.LABELS, photo=pair, member=member)
    for pair in exchanged_control(last):
        yield Hypothesis(kind=CauseKind.EXCHANGED_CONTROL, point=pair)
