"""Observations that concern no image: stations, air bases, the water, distances and height differences."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import NormalEquations, upper
from musatpy.adjustment.sea import AZIMUTH
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray, IntArray
from musatpy.units import DEGREE

INDEX_LIMIT = 1e-6  # of steps of the refractive index: a hundredth of what its sigma can be
_ARM = 100.0  # m, of the turn of a wave: about a length


def moved(network: Network, state: State, step: FloatArray) -> State:
    """Return the state after a step of stations, levels and water; ground points stay where they are."""
    n, q = network.photos, network.pattern.size
    border = network.border
    stations, rest = step[: q * n].reshape(n, q), step[q * n :]
    tide = state.tide
    if network.water.per_photo:
        tide = tide + stations[:, 6]
    elif border.waters:
        group = network.water.group
        correction = rest[border.first_water + np.maximum(group, 0)]
        tide = tide + np.where(group >= 0, correction, 0.0)
    return replace(
        state,
        position=state.position + np.einsum("nji,nj->ni", network.axes, stations[:, :3]),
        attitude=state.attitude + stations[:, 3:6],
        levels=state.levels + rest[: border.levels],
        tide=tide,
        tilt=state.tilt + rest[border.first_tilt : border.index_column] if border.tilts else state.tilt,
        index=state.index + float(rest[border.index_column]) if border.indices else state.index,
        waves=_waves_moved(network, state, rest[border.first_wave : border.first_kept]),
    )


def _waves_moved(network: Network, state: State, step: FloatArray) -> FloatArray:
    """Return the parameters (k, 4) of the waves after a step (w,) of the unknown ones."""
    if network.sea is None or not len(step):
        return state.waves
    waves = state.waves.copy()
    waves[network.sea.sea.unknown] += step
    return waves


def wave_corrections(network: Network, state: State) -> FloatArray:
    """Return current minus given unknown parameters (w,) of the waves."""
    if network.sea is None or not network.border.waves:
        return np.zeros(0)
    return (state.waves - network.sea.waves)[network.sea.sea.unknown]


def wave_weights(network: Network) -> FloatArray:
    """Return the weights (w,) of what is known beforehand of the unknown parameters of the waves."""
    if network.sea is None or network.sea.sea.sigma is None:
        return np.zeros(0)
    if not network.sea.sea.observed:
        return np.zeros(np.count_nonzero(network.sea.sea.unknown))
    return 1.0 / np.square(network.sea.sea.sigma[network.sea.sea.unknown])


def largest_movements(step: FloatArray, network: Network) -> tuple[int, float, int, float]:
    """Return (photo, rad) of the largest differential rotation and (photo, m) of the largest translation."""
    n, q = network.photos, network.pattern.size
    stations = step[: q * n].reshape(n, q)
    rotation = np.abs(stations[:, 3:6]).max(axis=1)
    translation = np.linalg.norm(stations[:, :3], axis=1)
    turned, shifted = int(rotation.argmax()), int(translation.argmax())
    return turned, float(rotation[turned]), shifted, float(translation[shifted])


def other_movements(step: FloatArray, network: Network) -> tuple[float, float, float, float]:
    """Return the largest changes of levels (m), tilts (rad), index, and coordinates of kept points (m)."""
    border, count = network.border, network.photos * network.pattern.size
    rest, photos = step[count:], step[:count].reshape(network.photos, -1)
    parts = (
        np.concatenate([photos[:, 6:].reshape(-1), rest[: border.first_tilt]]),
        rest[border.first_tilt : border.index_column],
        rest[border.index_column : border.first_wave],
        rest[border.first_kept :],
    )
    level, tilt, index, kept = (float(np.abs(part).max(initial=0.0)) for part in parts)
    return level, tilt, index, kept


def wave_movements(step: FloatArray, network: Network) -> FloatArray:
    """Return the changes (w,) m of the wave parameters; turns by how far they move a crest line `_ARM` off."""
    if network.sea is None or not network.border.waves:
        return np.zeros(0)
    border, count = network.border, network.photos * network.pattern.size
    size = np.abs(step[count:][border.first_wave : border.first_kept])
    turns = np.nonzero(network.sea.sea.unknown)[1] == AZIMUTH
    return np.where(turns, _ARM * size, size)


def largest_wave_change(step: FloatArray, network: Network) -> tuple[float, str]:
    """Return the largest of `wave_movements` (m), and the parameter with its change in words; 0 without any."""
    moves = wave_movements(step, network)
    if not moves.any() or network.sea is None:
        return 0.0, ""
    row = int(moves.argmax())
    turn = np.nonzero(network.sea.sea.unknown)[1][row] == AZIMUTH
    size = f"{moves[row] / _ARM / DEGREE:.2g} degrees" if turn else f"{moves[row]:.2g} m"
    return float(moves[row]), f"{network.border.waves[row]} still changes by {size}"


def station_deviation(network: Network, state: State) -> FloatArray:
    """Return current minus given stations (n, 6): east, north, up in m and angles in rad, within half a turn."""
    shift = np.einsum("nij,nj->ni", network.axes, state.position - network.position)
    turn = state.attitude - network.attitude
    return np.concatenate([shift, turn - 2.0 * np.pi * np.rint(turn / (2.0 * np.pi))], axis=1)


def air_bases(network: Network, state: State) -> tuple[FloatArray, FloatArray]:
    """Return the lengths (b,) of the known bases and their unit vectors (b, 3), first to second station."""
    base = state.position[network.base_photo[:, 1]] - state.position[network.base_photo[:, 0]]
    length = np.linalg.norm(base, axis=1)
    return length, base / length[:, None]


def level_corrections(network: Network, state: State) -> FloatArray:
    """Return the corrections (c,) m that the tides of groups of photos have received."""
    water = network.water
    out = np.zeros(len(water.ids))
    belongs = water.group >= 0
    out[water.group[belongs]] = (state.tide - water.tide)[belongs]
    return out


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """r observations of a few global unknowns each: deviation known minus current, and partials by X of them."""

    deviation: FloatArray  # (r,)
    weight: FloatArray  # (r,)
    index: IntArray  # (r, X)
    partials: FloatArray  # (r, X)


def distances(network: Network, state: State) -> Rows:
    """Return the measured distances between kept points, in m."""
    ties = network.ties
    X, axes = _kept(network, state)
    between = X[ties.distance[:, 1]] - X[ties.distance[:, 0]]
    length = np.linalg.norm(between, axis=1)
    unit = between / length[:, None]
    ends = np.stack([-unit, unit], axis=1)
    return Rows(
        deviation=ties.length - length,
        weight=ties.length_weight,
        index=_columns(network, ties.distance),
        partials=np.einsum("reij,rej->rei", axes[ties.distance], ends).reshape(-1, 6),
    )


def height_differences(network: Network, state: State) -> Rows:
    """Return the measured height differences between kept points, second minus first, in m."""
    ties = network.ties
    X, _ = _kept(network, state)
    height = network.frame.height(X) if len(X) else np.zeros(0)
    partials = np.zeros((len(ties.rise), 6))
    partials[:, 2], partials[:, 5] = -1.0, 1.0
    return Rows(
        deviation=ties.difference - (height[ties.rise[:, 1]] - height[ties.rise[:, 0]]),
        weight=ties.difference_weight,
        index=_columns(network, ties.rise),
        partials=partials,
    )


def water_rows(network: Network, state: State) -> Rows:
    """Return the priors of those unknowns of the water that stand in the border: levels, tilts, index, waves."""
    water, border = network.water, network.border
    levels = -level_corrections(network, state) if border.waters else np.zeros(0)
    tilts = (water.tilt - state.tilt) if border.tilts else np.zeros(0)
    index = np.array([water.index - state.index] if border.indices else [])
    weights = (
        water.level_weight if border.waters else np.zeros(0),
        np.full(border.tilts, water.tilt_weight),
        np.full(border.indices, water.index_weight),
        wave_weights(network),
    )
    columns = np.arange(border.first_water, border.first_kept)
    return Rows(
        deviation=np.concatenate([levels, tilts, index, -wave_corrections(network, state)]),
        weight=np.concatenate(weights),
        index=columns[:, None],
        partials=np.ones((len(columns), 1)),
    )


def _columns(network: Network, ends: IntArray) -> IntArray:
    return network.border.kept_columns(ends).reshape(len(ends), 6)


def _kept(network: Network, state: State) -> tuple[FloatArray, FloatArray]:
    """Return the positions (c, 3) of the kept points and their axes (c, 3, 3)."""
    X = state.ground[network.border.kept]
    return X, kept_axes(network, X)


def kept_axes(network: Network, ground: FloatArray) -> FloatArray:
    """Return the axes (c, 3, 3) along which the coordinates of kept points are unknown."""
    return np.asarray(network.frame.axes(ground)) if len(ground) else np.zeros((0, 3, 3))


def border_rows(network: Network, state: State) -> tuple[Rows, ...]:
    """Return all observations of global unknowns alone."""
    rows = [water_rows(network, state)]
    if len(network.border.kept):
        rows += [distances(network, state), height_differences(network, state)]
    return tuple(rows)


def direct_squares(network: Network, state: State) -> float:
    """Return the weighted sum of squares of all observations that concern no image."""
    weight, deviation = _station_observations(network, state)
    total = float(np.sum(weight * np.square(deviation)))
    length, _ = air_bases(network, state)
    total += float(np.sum(network.base_weight * np.square(length - network.base_length)))
    return total + sum(
        float(np.sum(rows.weight * np.square(rows.deviation))) for rows in border_rows(network, state)
    )


def add_direct(network: Network, state: State, normals: NormalEquations) -> None:
    """Add all observations that concern no image."""
    weight, deviation = _station_observations(network, state)
    normals.add_diagonal(weight, -weight * deviation)
    if len(network.base_length):
        _add_bases(network, state, normals)
    for rows in border_rows(network, state):
        if len(rows.weight):
            weighted = rows.partials * rows.weight[:, None]
            corner = weighted[:, :, None] * rows.partials[:, None, :]
            normals.add_corner(rows.index, corner, weighted * rows.deviation[:, None])


def _station_observations(network: Network, state: State) -> tuple[FloatArray, FloatArray]:
    """Return weights and current minus given (n, q) of the station unknowns, the water at each photo included."""
    weight = [network.position_weight, network.attitude_weight]
    deviation = [station_deviation(network, state)]
    if network.water.per_photo:
        known = network.water.group >= 0
        weight.append((network.water.level_weight * known)[:, None])
        deviation.append(level_corrections(network, state)[:, None])
    return np.concatenate(weight, axis=1), np.concatenate(deviation, axis=1)


def _add_bases(network: Network, state: State, normals: NormalEquations) -> None:
    length, unit = air_bases(network, state)
    photo = network.base_photo
    axes = network.axes[photo]
    a = np.zeros((len(length), 2, network.pattern.size))
    a[:, 0, :3] = -np.einsum("bij,bj->bi", axes[:, 0], unit)
    a[:, 1, :3] = np.einsum("bij,bj->bi", axes[:, 1], unit)
    w = network.base_weight
    matrix = np.einsum("bmi,b,bnj->bminj", a, w, a)
    rhs = np.einsum("bmi,b,b->bmi", a, w, network.base_length - length)
    normals.add(photo, upper(matrix), rhs)
