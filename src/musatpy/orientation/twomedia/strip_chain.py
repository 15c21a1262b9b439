"""The triplets of a strip one after the other: their similarities to the ground, the plane of all, their errors.

The state is the similarity of a triplet and the plane of the strip. A join changes the similarity by an error of
its own; where the plane is common, that of each new triplet then corrects both by their covariances (Kalman, J.
Basic Eng. 82 (1960) 35). All errors are linear functions of those of the images, of which triplets on end share
most: covariances are exact to first order, and cost the same for every triplet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.geometry.similarity import Similarity, small
from musatpy.orientation.twomedia.joins import Join
from musatpy.orientation.twomedia.triplet_models import PLANE, TripletModel, overlap

MOVE, STATE = 7, 10  # of the state: the change of the similarity, as in `geometry.similarity.small`, and the plane
_REACH = 3  # joins before a triplet with which it has images in common
_ROW = np.array([PLANE])
_STEPS = 10
_STILL = 1e-11  # of the size of the strip


@dataclass(frozen=True, kw_only=True, eq=False)
class Link:
    """Errors of a state by those of the one before, `transition` (10, 10), and of images from `column` on."""

    transition: FloatArray
    by_image: FloatArray
    column: int

    @property
    def columns(self) -> slice:
        """The coordinates of images."""
        return slice(self.column, self.column + self.by_image.shape[1])


@dataclass(frozen=True, kw_only=True, eq=False)
class Chain:
    """Similarities `moves` of N triplets to the ground, and the plane there (N, 3) as it was found up to each.

    models (N) are the triplets, over that plane where they hold it. links (N); covariance (N, 10, 10) of the states
    for unit weight of the images; nearby (N) of (10, 2 n), their partials by the images of their own triplets.
    """

    models: list[TripletModel]
    moves: list[Similarity]
    plane: FloatArray
    links: list[Link]
    covariance: FloatArray
    nearby: list[FloatArray]


def chain_of(
    triplets: list[TripletModel],
    joins: list[Join],
    start: Similarity,
    variance: FloatArray,
    *,
    common_plane: bool,
    held: FloatArray | None = None,
) -> Chain:
    """Return the chain of N triplets, with coordinates of images of `variance` (2 n,), the first moved by `start`.

    `held` is the plane on the ground that all of them hold, None where they do not.
    """
    first = triplets[0] if held is None else triplets[0].over(start, held)
    there = first.moved(start, _ROW)
    models, moves, planes = [first], [start], [there.value[0]]
    by_image = np.zeros((STATE, len(first.variance)))
    by_image[MOVE:] = there.by_old[0] @ first.influence(_ROW)[0]
    links = [Link(transition=np.zeros((STATE, STATE)), by_image=by_image, column=first.column)]
    covariance, nearby = [(by_image * first.variance) @ by_image.T], [by_image]
    for triplet, join in zip(triplets[1:], joins, strict=True):
        move, plane, model = moves[-1].after(join.move), planes[-1], triplet
        if held is not None:
            move, model = _followed(models[-1], triplet, join, moves[-1], held)
        link = _link(models[-1], model, join, moves[-1], move)
        P = _covariance(covariance[-1], [*links[-_REACH:], link], variance)
        if common_plane:
            move, plane, link, P = _corrected(model, move, plane, P, links, link)
        models.append(model)
        moves.append(move)
        planes.append(plane)
        links.append(link)
        covariance.append(P)
        nearby.append(_nearby(model, links))
    return Chain(
        models=models,
        moves=moves,
        plane=np.array(planes),
        links=links,
        covariance=np.array(covariance),
        nearby=nearby,
    )


def _followed(
    before: TripletModel, triplet: TripletModel, join: Join, first: Similarity, held: FloatArray
) -> tuple[Similarity, TripletModel]:
    """Return where a triplet over the held plane fits the one before it, and the triplet there."""
    move = first.after(join.move)
    target = before.moved(first, join.rows_before).value
    for _ in range(_STEPS):
        model = triplet.over(move, held)
        misfit = target - model.moved(move, join.rows_after).value
        _, by_move = _asked(before, model, join, first, move)
        change = np.asarray(np.linalg.solve(by_move, join.gain @ (misfit @ _back(first).T).ravel()))
        move = small(change).after(move)
        if np.abs(change).max() <= _STILL * max(1.0, float(np.abs(target).max())):
            break
    return move, triplet.over(move, held)


def _back(move: Similarity) -> FloatArray:
    """Return the matrix (3, 3) of differences on the ground to those in the axes of a triplet."""
    return move.rotation.T / move.scale


def _asked(
    before: TripletModel, model: TripletModel, join: Join, first: Similarity, move: Similarity
) -> tuple[FloatArray, FloatArray]:
    """Return how the misfits of a join, in its gain, change with the similarities (7, 7) before and after it."""
    here, there = (
        join.gain @ (_back(first) @ part.on_ground(at, rows).by_change).reshape(-1, MOVE)
        for part, at, rows in ((before, first, join.rows_before), (model, move, join.rows_after))
    )
    return here, there


def _link(before: TripletModel, model: TripletModel, join: Join, first: Similarity, second: Similarity) -> Link:
    """Return what a join does to the errors: on the ground the gain of its misfits stays zero."""
    transition, by_image = np.eye(STATE), np.zeros((STATE, join.by_image.shape[1]))
    here, there = _asked(before, model, join, first, second)
    transition[:MOVE, :MOVE] = np.linalg.solve(there, here)
    by_image[:MOVE] = np.linalg.solve(there, join.by_image)
    return Link(transition=transition, by_image=by_image, column=join.column)


def _covariance(before: FloatArray, links: list[Link], variance: FloatArray) -> FloatArray:
    """Return the covariance of the state after the last link, of that before it: both have images in common."""
    last = links[-1]
    weighted = last.by_image * variance[last.columns]
    shared, transition = np.zeros((STATE, STATE)), np.eye(STATE)
    for link in links[-2::-1]:
        own, common = overlap(link.columns, last.columns)
        shared += transition @ link.by_image[:, own] @ weighted[:, common].T
        transition = transition @ link.transition
    mixed = last.transition @ shared
    return last.transition @ before @ last.transition.T + mixed + mixed.T + weighted @ last.by_image.T


def _nearby(model: TripletModel, links: list[Link]) -> FloatArray:
    """Return the partials (10, 2 n) of the state after the last link by the images of its triplet."""
    total, transition = np.zeros((STATE, len(model.variance))), np.eye(STATE)
    for link in links[: -_REACH - 2 : -1]:
        own, common = overlap(link.columns, model.columns)
        total[:, common] += transition @ link.by_image[:, own]
        transition = transition @ link.transition
    return total


def _corrected(
    model: TripletModel, move: Similarity, plane: FloatArray, P: FloatArray, links: list[Link], link: Link
) -> tuple[Similarity, FloatArray, Link, FloatArray]:
    """Return similarity, plane, link and covariance once the plane of a triplet is compared with the strip's."""
    there = model.moved(move, _ROW)
    local = there.by_old[0] @ model.influence(_ROW)[0]
    M = np.concatenate([there.by_change[0], -np.eye(3)], axis=1)
    shared = (_nearby(model, [*links, link]) * model.variance) @ local.T
    across = P @ M.T + shared
    S = M @ across + shared.T @ M.T + (local * model.variance) @ local.T
    gain = np.linalg.solve(S, across.T).T
    change = -gain @ (there.value[0] - plane)
    kept = np.eye(STATE) - gain @ M
    by_image = kept @ link.by_image
    own, common = overlap(link.columns, model.columns)
    by_image[:, own] -= gain @ local[:, common]
    corrected = Link(transition=kept @ link.transition, by_image=by_image, column=link.column)
    return small(change[:MOVE]).after(move), plane + change[MOVE:], corrected, P - gain @ across.T
