"""Factors on the weights of all observations, by kind: how the search takes one out without changing the block.

An observation that is taken out keeps a millionth of its weight. Its residual is then what the others predict, and
the inverse of the normal equations says how well they predict it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.adjustment import direct
from musatpy.adjustment.ground import prior_rows
from musatpy.adjustment.network import Network
from musatpy.adjustment.sightings import image_coordinates
from musatpy.adjustment.unknowns import State
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model import Block, ObservationKind

Factors = dict[ObservationKind, FloatArray]  # (rows, components), rows and components those of `Observations`

_K = ObservationKind


def weights(network: Network, block: Block) -> Factors:
    """Return the weights of the observations, 0 for those that take no part."""
    distance, rise = tied(network, block)
    length, difference = np.zeros(len(block.distances.length)), np.zeros(len(block.height_differences.difference))
    length[distance], difference[rise] = network.ties.length_weight, network.ties.difference_weight
    return {
        _K.PLATE: np.where(taking_part(network)[:, None], network.weight, 0.0),
        _K.CONTROL: network.priors.weight[block.control.point],
        _K.STATION_POSITION: network.position_weight,
        _K.STATION_ATTITUDE: network.attitude_weight,
        _K.EQUAL_ELEVATION: network.priors.group_weight[block.equal_elevations.point][:, None],
        _K.AIR_BASE: network.base_weight[:, None],
        _K.WATER_LEVEL: network.water.level_weight[:, None],
        _K.DISTANCE: length[:, None],
        _K.HEIGHT_DIFFERENCE: difference[:, None],
    }


def weighted(network: Network, block: Block, factors: Factors) -> Network:
    """Return the network with its weights times the factors."""
    priors = network.priors
    weight, group_weight = priors.weight.copy(), priors.group_weight.copy()
    weight[block.control.point] *= factors[_K.CONTROL]
    group_weight[block.equal_elevations.point] *= factors[_K.EQUAL_ELEVATION][:, 0]
    distance, rise = tied(network, block)
    return replace(
        network,
        weight=network.weight * factors[_K.PLATE],
        priors=replace(priors, weight=weight, group_weight=group_weight),
        position_weight=network.position_weight * factors[_K.STATION_POSITION],
        attitude_weight=network.attitude_weight * factors[_K.STATION_ATTITUDE],
        base_weight=network.base_weight * factors[_K.AIR_BASE][:, 0],
        water=replace(network.water, level_weight=network.water.level_weight * factors[_K.WATER_LEVEL][:, 0]),
        ties=replace(
            network.ties,
            length_weight=network.ties.length_weight * factors[_K.DISTANCE][distance, 0],
            difference_weight=network.ties.difference_weight * factors[_K.HEIGHT_DIFFERENCE][rise, 0],
        ),
    )


def deviations(network: Network, block: Block, state: State) -> Factors:
    """Return the residuals of the observations, adjusted minus observed, in their units."""
    used = np.flatnonzero(taking_part(network))
    plate = np.zeros((len(network.photo), 2))
    plate[used] = image_coordinates(network, state, used, state.ground[network.point[used]]) - network.xy[used]
    control, member = block.control.point, block.equal_elevations.point
    stations = direct.station_deviation(network, state)
    distance, rise = tied(network, block)
    length, difference = np.zeros(len(block.distances.length)), np.zeros(len(block.height_differences.difference))
    if len(network.border.kept):
        length[distance] = -direct.distances(network, state).deviation
        difference[rise] = -direct.height_differences(network, state).deviation
    return {
        _K.PLATE: plate,
        _K.CONTROL: -_prior_deviation(network, state, control)[:, :3],
        _K.STATION_POSITION: stations[:, :3],
        _K.STATION_ATTITUDE: stations[:, 3:],
        _K.EQUAL_ELEVATION: -_prior_deviation(network, state, member)[:, 3:],
        _K.AIR_BASE: (direct.air_bases(network, state)[0] - network.base_length)[:, None],
        _K.WATER_LEVEL: direct.level_corrections(network, state)[:, None],
        _K.DISTANCE: length[:, None],
        _K.HEIGHT_DIFFERENCE: difference[:, None],
    }


def tied(network: Network, block: Block) -> tuple[IntArray, IntArray]:
    """Return which distances and which height differences take part."""
    return (
        np.flatnonzero(np.isin(block.distances.point, network.border.kept).all(axis=1)),
        np.flatnonzero(np.isin(block.height_differences.point, network.border.kept).all(axis=1)),
    )


def taking_part(network: Network) -> BoolArray:
    """Return which measurements (m,) take part."""
    used = np.zeros(len(network.photo), dtype=bool)
    for group in network.groups:
        used[group.rays] = True
    return used


def _prior_deviation(network: Network, state: State, point: IntArray) -> FloatArray:
    """Return known minus current (k, 4) of points, zero for those that take no part."""
    deviation = np.zeros((len(point), 4))
    here = np.isfinite(state.ground[point]).all(axis=1)
    deviation[here] = prior_rows(network, state, point[here], state.ground[point[here]]).deviation
    return deviation
