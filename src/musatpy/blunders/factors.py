"""Factors on the weights of all observations, by kind: how the search takes one out without changing the block.

An observation that is taken out keeps a millionth of its weight. Its residual is then what the others predict, and
the inverse of the normal equations says how well they predict it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.adjustment.kinds import SEARCHED
from musatpy.adjustment.network import Network
from musatpy.adjustment.sightings import all_residuals
from musatpy.adjustment.unknowns import State
from musatpy.arrays import BoolArray, FloatArray
from musatpy.model import Block, ObservationKind

Factors = dict[ObservationKind, FloatArray]  # (rows, components), rows and components those of `Observations`

_K = ObservationKind


def weights(network: Network, block: Block) -> Factors:
    """Return the weights of the observations, 0 for those that take no part."""
    plate = np.where(taking_part(network)[:, None], network.weight, 0.0)
    return {_K.PLATE: plate, **{kind.observed: kind.weights(network, block) for kind in SEARCHED}}


def weighted(network: Network, block: Block, factors: Factors) -> Network:
    """Return the network with its weights times the factors."""
    network = replace(network, weight=network.weight * factors[_K.PLATE])
    for kind in SEARCHED:
        if (factors[kind.observed] != 1.0).any():  # else what is kept of it serves on
            network = kind.weighted(network, block, factors[kind.observed])
    return network


def deviations(network: Network, block: Block, state: State) -> Factors:
    """Return the residuals of the observations, adjusted minus observed, in their units."""
    used = taking_part(network)
    plate = all_residuals(network, state, used)
    plate[~used] = 0.0
    return {_K.PLATE: plate, **{kind.observed: kind.residuals(network, block, state) for kind in SEARCHED}}


def taking_part(network: Network) -> BoolArray:
    """Return which measurements (m,) take part."""
    used = np.zeros(len(network.photo), dtype=bool)
    for group in network.groups:
        used[group.rays] = True
    return used
