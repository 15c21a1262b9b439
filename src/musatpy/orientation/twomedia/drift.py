"""How errors of images and control spread along a strip, exact to first order, at a cost that grows as it does.

The similarity of a triplet to the ground changes with the chain of triplets before it, and with the absolute
orientation, which is a function of all images that see control and of those that carry it there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.geometry.similarity import Similarity
from musatpy.orientation.twomedia.strip_chain import MOVE, STATE, Chain
from musatpy.orientation.twomedia.strip_ground import Known, Placed
from musatpy.orientation.twomedia.triplet_models import PLANE, TripletModel


@dataclass(frozen=True, kw_only=True, eq=False)
class Drift:
    """Changes (N, 7) of the similarities `moves` of N triplets to the ground, for unit weight of the images.

    by_first (7, 7) is what the control asks for by a change of the first of them, 1 but where the plane is held.
    covariance (N, 7, 7); `nearby` has for each triplet the partials (7, 2 n) of that change by errors of its own
    images.
    """

    models: list[TripletModel]
    moves: list[Similarity]
    by_first: FloatArray
    covariance: FloatArray
    nearby: list[FloatArray]

    def precision(self, number: int, rows: IntArray) -> FloatArray:
        """Return the covariances (r, 3, 3) of quantities `rows` (r,) of a triplet, on the ground."""
        model = self.models[number]
        there = model.on_ground(self.moves[number], rows)
        local = there.by_old @ model.influence(rows)
        with_move = (self.nearby[number] * model.variance) @ np.swapaxes(local, 1, 2)  # (r, 7, 3)
        G = there.by_change
        mixed = G @ with_move
        moving = G @ self.covariance[number] @ np.swapaxes(G, 1, 2)
        return moving + mixed + np.swapaxes(mixed, 1, 2) + (local * model.variance) @ np.swapaxes(local, 1, 2)


def drift_of(chain: Chain, variance: FloatArray, ground: tuple[Known, Placed] | None) -> Drift:
    """Return the drift of a strip with coordinates of images of `variance` (2 n,), put to the ground or free."""
    models = chain.models
    states, nearby = chain.covariance[:, :MOVE, :MOVE], [part[:MOVE] for part in chain.nearby]
    if ground is None:
        return Drift(models=models, moves=chain.moves, by_first=np.eye(MOVE), covariance=states, nearby=nearby)
    known, placed = ground
    by_image, by_first = _of_ground(known, placed, chain, len(variance))
    back = np.linalg.inv(by_first)
    by_image = back @ by_image
    weighted = by_image * variance
    of_ground = weighted @ by_image.T + back @ _of_control(known, placed) @ back.T
    along, first, covariance = np.zeros((STATE, MOVE)), _whole(chain), []
    for number, (link, model) in enumerate(zip(chain.links, models, strict=True)):
        along = link.transition @ along + link.by_image @ weighted[:, link.columns].T
        first = link.transition @ first if number else first
        of_first = first[:MOVE]
        mixed = along[:MOVE] @ of_first.T
        covariance.append(states[number] + mixed + mixed.T + of_first @ of_ground @ of_first.T)
        nearby[number] = nearby[number] + of_first @ by_image[:, model.columns]
    return Drift(
        models=models, moves=chain.moves, by_first=by_first, covariance=np.array(covariance), nearby=nearby
    )


def _of_ground(known: Known, placed: Placed, chain: Chain, size: int) -> tuple[FloatArray, FloatArray]:
    """Return the partials (7, 2 n) of what the control asks of the strip by errors of the images.

    And those (7, 7) of what it asks by a change of the first triplet, which all others follow.
    """
    by_image, by_state = np.zeros((MOVE, size)), np.zeros((len(chain.moves), MOVE, STATE))
    for number in np.unique(known.model):
        here = known.model == number
        model, gain = chain.models[number], placed.gain[here]
        there = model.on_ground(chain.moves[number], known.row[here])
        by_image[:, model.columns] -= np.einsum(
            "oxi,oic->xc", gain, there.by_old @ model.influence(known.row[here])
        )
        by_state[number, :, :MOVE] = -np.einsum("oxi,oiy->xy", gain, there.by_change)
    later = np.zeros((MOVE, STATE))
    for number in range(len(chain.moves) - 1, -1, -1):
        link = chain.links[number]
        later = by_state[number] + later
        by_image[:, link.columns] += later @ link.by_image
        later = later @ link.transition if number else later
    return by_image, -later @ _whole(chain)


def _whole(chain: Chain) -> FloatArray:
    """Return the partials (10, 7) of the first state by a change of the whole strip, with its plane."""
    plane = chain.models[0].moved(chain.moves[0], np.array([PLANE]))
    return np.concatenate([np.eye(MOVE), plane.by_change[0]])


def _of_control(known: Known, placed: Placed) -> FloatArray:
    """Return the covariance (7, 7) of the absolute orientation by errors of what is known of the ground."""
    given = np.isfinite(known.target)
    variance = np.where(given, known.variance, 0.0)
    planes = placed.gain[known.plane].sum(axis=0)
    shared = (planes * np.where(given[known.plane].any(axis=0), known.shared, 0.0)) @ planes.T
    return np.einsum("oxi,oi,oyi->xy", placed.gain, variance, placed.gain) + shared
