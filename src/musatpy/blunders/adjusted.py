"""Cofactors of points and adjusted observations: what the tests of a scene take of the inverse of its normals."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment import reliability
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import Cofactors
from musatpy.adjustment.propagation import pieces, point_covariances
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray
from musatpy.blunders.factors import Factors
from musatpy.blunders.scene import Scene
from musatpy.model import ObservationKind

_K = ObservationKind


@dataclass(frozen=True, kw_only=True, eq=False)
class Adjusted:
    """Cofactors of points (p, 3, 3) m2 along working axes, NaN where not determined, and of observations."""

    points: FloatArray
    observations: Factors


def adjusted_cofactors(scene: Scene, network: Network, state: State, cofactors: Cofactors) -> Adjusted:
    """Return the cofactors that those of the unknowns give at a state; `network` has the weights of the scene now.

    As `precision.spread_to_observations`, without what else that tells of them.
    """
    points = np.full((network.points, 3, 3), np.nan)
    tables = {kind: np.zeros(weight.shape) for kind, weight in scene.weight.items()}
    parts = list(reliability.direct(network, state, cofactors))
    not_asked_for = network.xy  # residuals
    for group in network.groups:
        for rows, piece in pieces(network, state, group, cofactors):
            working = replace(piece, axes=np.swapaxes(piece.E.normals.axes, 1, 2))
            points[group.point[rows]] = point_covariances(network, working, cofactors, None)
            parts += [reliability.images(network, piece, not_asked_for), *reliability.priors(piece, scene.block)]
    for part in parts:
        # the priors of tilt and index hold the water of the whole job: no card of one photo or point is to blame
        if part.kind in tables:
            observed = part.weight > 0.0
            tables[part.kind][part.row[observed], part.component[observed]] = part.cofactor[observed]
    return Adjusted(points=points, observations=tables)
