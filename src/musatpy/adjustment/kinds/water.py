"""What is unknown of the water, and observed beforehand: tides, tilt, refractive index, parameters of waves.

Motions of a block as a whole move the plane of its water, z = level + slopes . (east, north), the slopes in the
level axes, the level at the working origin, about which the plane tilts. With the point P of the plane over the
origin and its downhill covector n = (-slopes, 1), a velocity v of space lifts the level by n . v(P), and changes
each slope by n times the change of v along the tangent of the plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from musatpy.adjustment.iteration import LEVEL, State, WaterKnowledge, level_corrections
from musatpy.adjustment.kinds.kind import OfWater, Rows, of_unknowns
from musatpy.adjustment.network import Network, PointGroup
from musatpy.adjustment.wavy_water import AZIMUTH, CREST, HEIGHT, LENGTH, Sea, wave_names
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.similarity import Similarity
from musatpy.model import Block, ObservationKind
from musatpy.units import ARC_SECOND, DEGREE


class LevelCorrection(OfWater):
    """The corrections stand in the border, or, where each photo has its own, with the unknowns of the photos."""

    observed = ObservationKind.WATER_LEVEL
    change = "a level still changes by {} m"

    def names(self, block: Block, water: WaterKnowledge, sea: Sea | None) -> Sequence[str]:
        """Return the names of the corrections in the border."""
        ids = [] if water.per_photo else water.ids.tolist()
        return [f"water level{f' of {name}' if name else ''}" for name in ids]

    def rows(self, network: Network, state: State) -> Rows:
        """Return the corrections as observed."""
        corrections, row = level_corrections(network, state), np.arange(len(network.water.ids))
        index = self._index(network)
        return of_unknowns(corrections, network.water.level_weight, index, row, np.zeros_like(row))

    def weights(self, network: Network, block: Block) -> FloatArray:
        """Return the weights (c, 1)."""
        return network.water.level_weight[:, None]

    def weighted(self, network: Network, block: Block, factor: FloatArray) -> Network:
        """Return the network with the weights times `factor` (c, 1)."""
        weight = network.water.level_weight * factor[:, 0]
        return replace(network, water=replace(network.water, level_weight=weight))

    def misfit(self, block: Block, network: Network, row: int, component: int, size: float) -> str:
        """Return in words that a correction is `size` m."""
        name = network.water.ids[row]
        return f"the water level{f' {name}' if name else ''} is {size:.2f} m off its tide"

    def state_after(self, network: Network, step: FloatArray, state: State) -> State:
        """Return the state with the tides after a step (u,)."""
        water = network.water
        if not len(water.ids):
            return state
        if water.per_photo:
            return replace(state, tide=state.tide + step[self._index(network)])
        correction = step[self._index(network)][np.maximum(water.group, 0)]
        return replace(state, tide=state.tide + np.where(water.group >= 0, correction, 0.0))

    def transformed(self, network: Network, state: State, centre: FloatArray, move: Similarity) -> State:
        """Return the state with the planes of unknown tides moved."""
        tide = moved_levels(network, centre, state.tilt, state.tide, move)
        return replace(state, tide=np.where(network.water.group >= 0, tide, state.tide))

    def put_motions(self, network: Network, state: State, centre: FloatArray, motions: FloatArray) -> None:
        """Put what the motions do to the levels into `motions` (u, 7)."""
        water = network.water
        level, belongs = np.zeros(len(water.ids)), water.group >= 0
        level[water.group[belongs]] = state.tide[belongs]
        known = belongs if water.per_photo else np.ones(len(water.ids), dtype=bool)
        moves = level_motions(network, centre, state.tilt, np.nan_to_num(level))
        motions[self._index(network)] = np.where(known[:, None], moves, 0.0)

    def of_wet_images(
        self, network: Network, group: PointGroup, by_water: FloatArray
    ) -> tuple[IntArray, FloatArray]:
        """Return columns (k, m) and partials (k, m, 2, m): each image sees the water of its photo."""
        k, m = group.rays.shape
        if not network.border.count(self.observed):
            return self.everywhere(network, k), np.zeros((k, m, 2, 0))
        columns, belongs = self._at_photos(network, group)
        images = np.zeros((k, m, 2, m))
        ray = np.arange(m)
        images[:, ray, :, ray] = np.moveaxis(by_water[..., 0] * belongs[..., None], 1, 0)
        return columns, images

    def of_surface(self, network: Network, state: State, group: PointGroup) -> tuple[IntArray, FloatArray]:
        """Return columns (k, m) and partials (k, m): the mean over the photos."""
        if not network.border.count(self.observed):
            return super().of_surface(network, state, group)
        columns, belongs = self._at_photos(network, group)
        return columns, belongs / belongs.shape[1]

    def _at_photos(self, network: Network, group: PointGroup) -> tuple[IntArray, BoolArray]:
        """Return the columns (k, m) of the corrections at the photos of points, and which of these have one."""
        water = network.water.group[network.photo[group.rays]]
        return network.border.at(self.observed).start + np.maximum(water, 0), water >= 0

    def weight(self, network: Network) -> FloatArray:
        """Return the weights (c,)."""
        return network.water.level_weight

    def part_of(self, network: Network, values: FloatArray) -> FloatArray:
        """Return the part (c, ...) of values (u, ...) of all unknowns that belongs to the corrections."""
        return values[self._index(network)]

    def _index(self, network: Network) -> IntArray:
        """Return the numbers (c,) of the corrections among all unknowns."""
        if network.water.per_photo:
            return np.arange(network.photos) * network.pattern.size + LEVEL
        return network.pattern.order + network.border.numbers(self.observed)


class WaterParameter(OfWater):
    """Parameters of the water on which all refracted images depend alike."""

    searched = False  # no card of one photo or point is to blame
    part: slice  # of the partials by the water
    attribute: str  # of states, and of what is known of the water

    def values(self, network: Network, state: State) -> tuple[FloatArray, FloatArray]:
        """Return the unknown parameters (X,) at `state`, and as they were given."""
        return np.atleast_1d(getattr(state, self.attribute)), np.atleast_1d(getattr(network.water, self.attribute))

    def weight(self, network: Network) -> FloatArray:
        """Return the weights (X,) of what is known of them beforehand, 0 where nothing is."""
        return np.full(network.border.count(self.observed), getattr(network.water, f"{self.attribute}_weight"))

    def with_values(self, network: Network, state: State, values: FloatArray) -> State:
        """Return the state with other unknown parameters (X,)."""
        raise NotImplementedError

    def rows(self, network: Network, state: State) -> Rows:
        """Return the parameters as observed, components of one row."""
        (values, given), index = self.values(network, state), self.numbers(network)
        row, component = np.zeros_like(index), np.arange(len(index))
        return of_unknowns(values - given, self.weight(network), index, row, component)

    def state_after(self, network: Network, step: FloatArray, state: State) -> State:
        """Return the state with the parameters after a step (u,)."""
        part = self.part_of(network, step)
        return self.with_values(network, state, self.values(network, state)[0] + part) if len(part) else state

    def of_wet_images(
        self, network: Network, group: PointGroup, by_water: FloatArray
    ) -> tuple[IntArray, FloatArray]:
        """Return columns (k, X) and partials (k, m, 2, X)."""
        index = self.everywhere(network, len(by_water))
        return index, by_water[..., self.part][..., : index.shape[1]]


class WaterTilt(WaterParameter):
    """The two slopes, in rad."""

    observed = ObservationKind.WATER_TILT
    part, attribute = slice(1, 3), "tilt"
    change, unit, digits = "the water still tilts by {} arc seconds", ARC_SECOND, 3

    def names(self, block: Block, water: WaterKnowledge, sea: Sea | None) -> Sequence[str]:
        """Return the names of the slopes."""
        return ("tilt of the water east", "tilt of the water north") if water.tilt_unknown else ()

    def with_values(self, network: Network, state: State, values: FloatArray) -> State:
        """Return the state with other slopes."""
        return replace(state, tilt=values)

    def transformed(self, network: Network, state: State, centre: FloatArray, move: Similarity) -> State:
        """Return the state with unknown slopes turned."""
        known = not network.border.count(self.observed)
        return state if known else replace(state, tilt=turned_slopes(state.tilt, move.rotation))

    def put_motions(self, network: Network, state: State, centre: FloatArray, motions: FloatArray) -> None:
        """Put what the motions do to the slopes into `motions` (u, 7)."""
        if network.border.count(self.observed):
            self.part_of(network, motions)[:] = slope_motions(state.tilt)

    def of_surface(self, network: Network, state: State, group: PointGroup) -> tuple[IntArray, FloatArray]:
        """Return columns (k, 2) and partials (k, 2): the surface turns about the middle of the stations."""
        index = self.everywhere(network, len(group.point))
        return index, (state.ground[group.point] @ network.tilt_axes.T)[:, : index.shape[1]]

    def limit(self, rotation: float, translation: float) -> float:
        """Return the limit of a change."""
        return rotation


_LIMIT = 1e-6  # of steps: a hundredth of what its sigma can be


class WaterIndex(WaterParameter):
    """The index, relative to air."""

    observed = ObservationKind.WATER_INDEX
    part, attribute = slice(3, 4), "index"
    change, digits = "the refractive index still changes by {}", 6

    def names(self, block: Block, water: WaterKnowledge, sea: Sea | None) -> Sequence[str]:
        """Return its name where it is unknown."""
        return ("refractive index",) if water.index_unknown else ()

    def with_values(self, network: Network, state: State, values: FloatArray) -> State:
        """Return the state with another index."""
        return replace(state, index=float(values[0]))

    def limit(self, rotation: float, translation: float) -> float:
        """Return the limit of a change."""
        return _LIMIT


_ARM = 100.0  # m, of the turn of a wave: about a length


class Wave(WaterParameter):
    """Height, length, azimuth, crest of each wave: those that are unknown, (w,) of (k, 4)."""

    observed = ObservationKind.WAVE
    part = slice(4, None)
    change = "{} still changes by {}"

    def names(self, block: Block, water: WaterKnowledge, sea: Sea | None) -> Sequence[str]:
        """Return the names of the unknown parameters."""
        return () if sea is None else wave_names(sea)

    def rows(self, network: Network, state: State) -> Rows:
        """Return the parameters as observed."""
        wave, parameter = np.nonzero(_unknown(network))
        return replace(super().rows(network, state), row=wave, component=parameter)

    def values(self, network: Network, state: State) -> tuple[FloatArray, FloatArray]:
        """Return the unknown parameters at `state`, and as given."""
        given = state.waves if network.sea is None else network.sea.waves
        return state.waves[_unknown(network)], given[_unknown(network)]

    def weight(self, network: Network) -> FloatArray:
        """Return the weights of what is known beforehand of the unknown parameters."""
        unknown = _unknown(network)
        if network.sea is None or network.sea.sea.sigma is None or not len(unknown):
            return np.zeros(0)
        if not network.sea.sea.observed:
            return np.zeros(np.count_nonzero(unknown))
        return 1.0 / np.square(network.sea.sea.sigma[unknown])

    def with_values(self, network: Network, state: State, values: FloatArray) -> State:
        """Return the state with other parameters."""
        waves = state.waves.copy()
        waves[_unknown(network)] = values
        return replace(state, waves=waves)

    def put_motions(self, network: Network, state: State, centre: FloatArray, motions: FloatArray) -> None:
        """Put into `motions` (u, 7): crests go along, azimuths turn, all grows.

        About the origin of the waves, which is taken for the centre: the block need not be named more exactly.
        """
        unknown = _unknown(network)
        if not unknown.any():
            return
        trough_to_crest, length, azimuth, crest = state.waves.T
        of_waves = np.zeros((len(state.waves), 4, motions.shape[1]))
        of_waves[:, CREST, 0], of_waves[:, CREST, 1] = np.sin(azimuth), np.cos(azimuth)
        of_waves[:, AZIMUTH, 5] = -1.0  # clockwise
        of_waves[:, HEIGHT, 6], of_waves[:, LENGTH, 6], of_waves[:, CREST, 6] = trough_to_crest, length, crest
        self.part_of(network, motions)[:] = of_waves[unknown]

    def movement(self, network: Network, step: FloatArray) -> tuple[float, str]:
        """Return the largest change in m, that of an azimuth by how far it moves a crest line `_ARM` off."""
        size = np.abs(self.part_of(network, step))
        turns = np.nonzero(_unknown(network))[1] == AZIMUTH
        size = np.where(turns, _ARM * size, size)
        if not size.any():
            return 0.0, ""
        row = int(size.argmax())
        change = f"{size[row] / _ARM / DEGREE:.2g} degrees" if turns[row] else f"{size[row]:.2g} m"
        return float(size[row]), self.change.format(network.border.columns[self.observed][row], change)


def _unknown(network: Network) -> BoolArray:
    """Return (k, 4) which parameters stand in the border; (0, 4) where all are known."""
    if network.sea is None or not network.border.count(ObservationKind.WAVE):
        return np.zeros((0, 4), dtype=bool)
    return network.sea.sea.unknown


def slope_motions(slopes: FloatArray) -> FloatArray:
    """Return what the seven similarity motions do to slopes (2,): (2, 7)."""
    tangents = np.column_stack([np.eye(2), slopes])
    motions = np.zeros((2, 7))
    motions[:, 3:6] = _turned(tangents) @ _covector(slopes)
    return motions


def level_motions(network: Network, centre: FloatArray, slopes: FloatArray, level: FloatArray) -> FloatArray:
    """Return what the seven similarity motions about `centre` (3,) do to levels (c,) of the water: (c, 7)."""
    arm, n = _over_origin(network, centre, level), _covector(slopes)
    shifts = np.broadcast_to(n, (len(level), 3))
    return np.concatenate([shifts, _turned(arm) @ n, (arm @ n)[:, None]], axis=1)


def turned_slopes(slopes: FloatArray, rotation: FloatArray) -> FloatArray:
    """Return slopes (2,) after a finite rotation of the level axes (3, 3)."""
    normal = rotation @ _covector(slopes)
    return -normal[:2] / normal[2]


def moved_levels(
    network: Network, centre: FloatArray, slopes: FloatArray, level: FloatArray, move: Similarity
) -> FloatArray:
    """Return levels (c,) of the water after a finite similarity in the level axes at `centre` (3,)."""
    arm = _over_origin(network, centre, level)
    lift = move.apply(arm) - arm
    return level + lift @ _covector(turned_slopes(slopes, move.rotation))


def _over_origin(network: Network, centre: FloatArray, level: FloatArray) -> FloatArray:
    """Return points (c, 3) of planes with levels (c,), over the working origin, in the level axes at `centre`."""
    east, north, _ = network.frame.axes(centre) @ -centre
    height = level - float(network.frame.height(centre))
    return np.stack([np.full_like(height, east), np.full_like(height, north), height], axis=1)


def _turned(arm: FloatArray) -> FloatArray:
    """Return the velocities (k, 3 axes, 3) of places (k, 3) under unit turns about east, north and up."""
    return np.cross(np.eye(3), arm[:, None])


def _covector(slopes: FloatArray) -> FloatArray:
    """Return (3,) what the height over the plane gains along east, north and up."""
    return np.array([*-slopes, 1.0])


KINDS = (LevelCorrection(), WaterTilt(), WaterIndex(), Wave())
