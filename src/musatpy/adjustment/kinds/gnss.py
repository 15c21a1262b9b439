"""Antenna positions of a satellite receiver, and what is unknown of them: lever arms, shifts and drifts of lines.

    observed + v = C + M' a + s + d (t - mean t of the line)

with the projection centre C, M from the ground to the photo, the lever arm a of the camera along the axes of the
photo, shift s and drift d of the line along east, north, up at the observed place. Covariances are whitened: the
components that stand in the normal equations are those along their principal axes, each named as the direction that
it is nearest to.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from musatpy.adjustment.iteration import State
from musatpy.adjustment.kinds.parameter import ParameterUnknown
from musatpy.adjustment.kinds.photo_vectors import Deviations, PhotoVector
from musatpy.adjustment.network import NOTHING, MeasuredTies, Network
from musatpy.adjustment.parameters import Effect, Parameters
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.geometry.similarity import Similarity
from musatpy.model import Block, Initial, ObservationKind
from musatpy.model.gnss import AXES, DIRECTIONS

_REST = 1e-4  # m at an antenna
_NAMES = ("east", "north", "up")
_UNKNOWN = (ObservationKind.LEVER_ARM, ObservationKind.ANTENNA_SHIFT, ObservationKind.ANTENNA_DRIFT)


@dataclass(frozen=True, kw_only=True, eq=False)
class AntennaTies(MeasuredTies):
    """Antenna positions, in the system of the job, that take part; numbers of parameters are -1 for none."""

    principal: FloatArray  # (d, 3, 3) from east, north, up to the components
    arm: FloatArray  # (d, 3) m, lever arm as given
    numbers: IntArray  # (d, 9) of the lever arm, the shift and the drift
    since: FloatArray  # (d,) s since the mean time of the line

    def to_components(self, network: Network) -> FloatArray:
        """Return (d, 3, 3) from working axes to the components."""
        return self.principal @ np.asarray(network.frame.axes(network.frame.working(self.value)))


def flight_lines(block: Block) -> tuple[IntArray, FloatArray]:
    """Return the row (a,) in the table of lines of each antenna position, -1 for none, and its time (a,) in s.

    Times count from the mean of the line, 0 where a line has none; NaN where the photo has none.
    """
    positions, lines = block.antenna_positions, block.antenna_lines
    time = np.full(block.photos.count, np.nan)
    time[block.exposure_times.photo] = block.exposure_times.time
    since, row = time[positions.photo], np.full(positions.count, -1)
    for name in np.unique(positions.line).tolist():
        member = positions.line == name
        if np.isfinite(since[member]).any():
            since[member] -= np.nanmean(since[member])
        if name and (known := np.flatnonzero(lines.line == name)).size:
            row[member] = known[0]
    return row, since


def principal_axes(block: Block) -> tuple[FloatArray, FloatArray]:
    """Return the axes (a, 3, 3) along which errors of the antenna positions are independent, and sigmas (a, 3)."""
    positions, order = block.antenna_positions, np.array(list(permutations(range(3))))
    axes, sigma = np.tile(np.eye(3), (positions.count, 1, 1)), positions.sigma.copy()
    for row in np.flatnonzero(positions.correlated).tolist():
        variances, vectors = np.linalg.eigh(positions.covariance[row])
        near = order[np.abs(vectors[np.arange(3), order]).sum(axis=1).argmax()]  # the vector of each direction
        signed = vectors[:, near] * np.sign(vectors[np.arange(3), near])
        axes[row], sigma[row] = signed.T, np.sqrt(np.maximum(variances[near], 0.0))
    return axes, sigma


def unknown_arms(block: Block) -> BoolArray:
    """Return which components (l, 3) of lever arms are unknowns: of cameras with antenna positions."""
    seen = block.photos.camera[block.antenna_positions.photo]
    return block.lever_arms.unknown & np.isin(block.lever_arms.camera, seen)[:, None]


def unknown_shifts(block: Block) -> BoolArray:
    """Return which components (g, 3) of shifts are unknowns: of lines with antenna positions."""
    lines = block.antenna_lines
    return lines.shifted & np.isin(lines.line, block.antenna_positions.line)[:, None]


def unknown_drifts(block: Block) -> tuple[BoolArray, FloatArray]:
    """Return which components (g, 3) of drifts are unknowns, and the longest time (g,) s from the mean."""
    (row, since), span = flight_lines(block), np.zeros(block.antenna_lines.count)
    timed = (row >= 0) & np.isfinite(since)
    np.maximum.at(span, row[timed], np.abs(since[timed]))
    return block.antenna_lines.drifting & (span > 0.0)[:, None], span


class Antenna(PhotoVector):
    """Antenna positions."""

    observed = ObservationKind.ANTENNA

    def with_starts(self, block: Block) -> Block:
        """Return the block with antenna positions as approximate stations, where stations are computed."""
        photos, table = block.photos, block.antenna_positions
        nowhere, position = np.isnan(photos.position[table.photo]).any(axis=1), photos.position.copy()
        position[table.photo[nowhere]] = table.position[nowhere]
        is_start = block.options.initial is Initial.COMPUTE and nowhere.any()
        return replace(block, photos=replace(photos, position=position)) if is_start else block

    def measured(self, block: Block, enters: BoolArray) -> MeasuredTies:
        """Return the antenna positions that take part: all, in IIIA."""
        if not self.applies(block):
            return NOTHING
        table, (axes, sigma) = block.antenna_positions, principal_axes(block)
        line, since = flight_lines(block)
        camera = block.photos.camera[table.photo]
        arm, arms = np.zeros((block.cameras.count, 3)), np.full(block.cameras.count, -1)
        arm[block.lever_arms.camera] = block.lever_arms.offset
        arms[block.lever_arms.camera] = np.arange(block.lever_arms.count)
        numbers = [
            _numbers(unknown_arms(block), arms[camera]),
            _numbers(unknown_shifts(block), line),
            _numbers(unknown_drifts(block)[0], line),
        ]
        return AntennaTies(
            row=np.arange(table.count),
            photo=table.photo[:, None],
            point=np.zeros((table.count, 0), dtype=np.int64),
            value=table.position,
            weight=1.0 / np.square(sigma),
            principal=axes,
            arm=arm[camera],
            numbers=np.concatenate(numbers, axis=1),
            since=np.nan_to_num(since),
        )

    def deviations(self, network: Network, state: State) -> Deviations:
        """Return adjusted minus observed, along the principal axes of each."""
        of = _ties(network)
        photo, numbers = of.photo[:, 0], np.split(of.numbers, 3, axis=1)
        observed, to_components = network.frame.working(of.value), of.to_components(network)
        arm, shift, drift = np.split(_values(of, state), 3, axis=1)
        M, axes = state.M[photo], network.axes[photo]
        from_centre = np.einsum("dji,dj->di", M, arm)
        off = np.einsum("dij,dj->di", to_components, state.position[photo] + from_centre - observed)
        by_attitude = to_components @ np.einsum("daji,dj->dia", state.dM[photo], arm)
        by_shift = of.principal
        parts = [to_components @ np.swapaxes(M, 1, 2), by_shift, by_shift * of.since[:, None, None]]
        used = (of.numbers >= 0).any(axis=0)  # the border has no columns at all where nothing is unknown
        return Deviations(
            residual=off + np.einsum("dij,dj->di", of.principal, shift + drift * of.since[:, None]),
            by_station=np.concatenate([to_components @ np.swapaxes(axes, 1, 2), by_attitude], axis=2),
            column=np.concatenate(list(map(self.columns, [network] * 3, _UNKNOWN, numbers)), axis=1)[:, used],
            by_parameters=(np.concatenate(parts, axis=2) * (of.numbers >= 0)[:, None])[..., used],
        )

    def values(self, block: Block, network: Network, state: State) -> FloatArray:
        """Return adjusted minus observed (rows, 3) m, along east, north, up; NaN for what takes no part."""
        of, out = network.measured[self.observed], np.full((block.antenna_positions.count, 3), np.nan)
        if isinstance(of, AntennaTies):
            residual = self.deviations(network, state).residual
            out[of.row] = np.einsum("dji,dj->di", of.principal, residual)
        return out

    def misfit(self, block: Block, network: Network, row: int, component: int, size: float) -> str:
        """Return in words that a component is off by `size` m."""
        photo = block.photos.ids[block.antenna_positions.photo[row]]
        return f"the antenna position of photo {photo} is {size:.2f} m off in {_NAMES[component]}"


class AntennaParameter(ParameterUnknown):
    """What is unknown of antenna positions; motions of a block move it along where it is free."""

    def put_motions(self, network: Network, state: State, centre: FloatArray, motions: FloatArray) -> None:
        """Put what keeps the antennas as they are observed, where free parameters can, into `motions` (u, 7)."""
        if network.border.count(self.observed):
            of = _ties(network)
            photo, axes = of.photo[:, 0], network.frame.axes(centre)
            arm = state.position[photo] - centre
            turned = np.cross(axes[None], (arm + _from_centre(of, state))[:, None])
            shifts = np.broadcast_to(axes, turned.shape)
            moved = np.concatenate([shifts, turned, arm[:, None]], axis=1)
            self.part_of(network, motions)[:] = _following(network, state, np.swapaxes(moved, 1, 2))[self.observed]

    def transformed(self, network: Network, state: State, centre: FloatArray, move: Similarity) -> State:
        """Return the state with free parameters that keep the antennas as they are observed, as far as they can."""
        if not network.border.count(self.observed):
            return state
        of, axes = _ties(network), network.frame.axes(centre)
        place, arm = (state.position[of.photo[:, 0]] - centre) @ axes.T, _from_centre(of, state) @ axes.T
        moved = (move.apply(place) - place + arm @ move.rotation.T - arm) @ axes
        change = _following(network, state, moved[:, :, None])[self.observed][:, 0]
        after = state.parameters[self.observed] + change
        return replace(state, parameters={**state.parameters, self.observed: after})


class LeverArm(AntennaParameter):
    """Components of lever arms."""

    observed = ObservationKind.LEVER_ARM

    def parameters(self, block: Block) -> Parameters | None:
        """Return the unknown components of LVR cards, of cameras with antenna positions."""
        arms = block.lever_arms
        ids, unknown = block.cameras.ids[arms.camera], unknown_arms(block)
        return _parameters("camera", ids, "ARM", AXES, "m", unknown, arms.offset, arms.sigma)


class AntennaShift(AntennaParameter):
    """Components of the shifts of lines."""

    observed = ObservationKind.ANTENNA_SHIFT

    def parameters(self, block: Block) -> Parameters | None:
        """Return the unknown components of GNL cards, of lines with antenna positions."""
        lines, unknown = block.antenna_lines, unknown_shifts(block)
        zero = np.zeros(unknown.shape)
        return _parameters("line", lines.line, "SHIFT", DIRECTIONS, "m", unknown, zero, lines.shift_sigma)


class AntennaDrift(AntennaParameter):
    """Components of the drifts of lines."""

    observed = ObservationKind.ANTENNA_DRIFT

    def parameters(self, block: Block) -> Parameters | None:
        """Return the unknown components of GNL cards, of lines with times."""
        lines, (unknown, span) = block.antenna_lines, unknown_drifts(block)
        zero = np.zeros(unknown.shape)
        sigma, effect = lines.drift_sigma, span[:, None]
        return _parameters("line", lines.line, "DRIFT", DIRECTIONS, "m/s", unknown, zero, sigma, effect)


def _parameters(
    noun: str, owners: TextArray, what: str, names: tuple[str, ...], unit: str, unknown: BoolArray,
    given: FloatArray, sigma: FloatArray, effect: FloatArray | float = 1.0,
) -> Parameters | None:  # fmt: skip
    """Return the unknown ones of components (k, 3), None without any."""
    named, of = [f"{what} {name}" for name in names], {"effect_in": Effect.PLACE, "rest": _REST}
    every = Parameters.of_components(noun, owners, named, (unit,) * 3, unknown, given, sigma, effect, **of)
    return every if unknown.any() else None


def _numbers(unknown: BoolArray, row: IntArray) -> IntArray:
    """Return the numbers (d, 3) of components, of the rows (d,) of a table (k, 3) or -1, among the unknown ones."""
    number = np.where(unknown, np.cumsum(unknown.reshape(-1)).reshape(unknown.shape) - 1, -1)
    return np.concatenate([number, np.full((1, 3), -1)])[row]


def _ties(network: Network) -> AntennaTies:
    ties = network.measured[ObservationKind.ANTENNA]
    assert isinstance(ties, AntennaTies)
    return ties


def _values(of: AntennaTies, state: State) -> FloatArray:
    """Return lever arm, shift and drift (d, 9) of antenna positions at `state`."""
    out = np.concatenate([of.arm, np.zeros((len(of.row), 6))], axis=1)
    for number, kind in enumerate(_UNKNOWN):
        part = slice(3 * number, 3 * number + 3)
        known, values = of.numbers[:, part] >= 0, state.parameters.get(kind)
        if values is not None:
            out[:, part][known] = values[of.numbers[:, part][known]]
    return out


def _from_centre(of: AntennaTies, state: State) -> FloatArray:
    """Return the lever arms (d, 3) in working axes."""
    return np.einsum("dji,dj->di", state.M[of.photo[:, 0]], _values(of, state)[:, :3])


def _following(network: Network, state: State, moved: FloatArray) -> dict[ObservationKind, FloatArray]:
    """Return the changes (x, m) of the parameters of each kind that make up best for moved antennas (d, 3, m).

    Only free ones change: others are held by what is known of them.
    """
    of = _ties(network)
    change = of.to_components(network) @ moved
    part = ANTENNA.deviations(network, state)
    g, d = network.border.first_kept, len(change)
    J = np.zeros((d, 3, g))
    np.add.at(J, (np.arange(d)[:, None, None], np.arange(3)[:, None], part.column[:, None]), part.by_parameters)
    free = np.zeros(g, dtype=bool)
    for kind in _UNKNOWN:
        if kind in network.parameters:
            free[network.border.at(kind)] = network.parameters[kind].weight == 0.0
    root = np.sqrt(of.weight).reshape(-1, 1)
    out = np.zeros((g, moved.shape[2]))
    left = root * J.reshape(3 * d, g)[:, free]
    out[free] = -np.linalg.lstsq(left, root * change.reshape(3 * d, -1), rcond=None)[0]
    return {kind: out[network.border.at(kind)] for kind in _UNKNOWN}


ANTENNA = Antenna()
KINDS = (ANTENNA, LeverArm(), AntennaShift(), AntennaDrift())
