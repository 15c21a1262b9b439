"""The water of a simulation: its true surface with its waves, and what the deck says of it.

What stands on the cards of waves is what images are made through, but for the errors that the spec puts there. The
formulas are those of the adjustment's surfaces in other words, and share no code with them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.draws import Draws
from musatpy.errors import Problem, SpecError
from musatpy.model import Water, WaveOrigin, Waves, WaveShape
from musatpy.model.tables import empty
from musatpy.model.water import WAVE_SIGMAS
from musatpy.simulation.scene_keys import SurfaceKeys, WaveTrain, index_of
from musatpy.simulation.simulation_spec import SimulationSpec
from musatpy.simulation.world import METRE_DECIMALS, TruePlaces, World
from musatpy.units import ARC_SECOND, DEGREE

_INDEX_DECIMALS, _TILT_DECIMALS = 6, 3  # of the water card, the tilt in arc seconds
_DECIMALS = {"period": 3, "depth": 2, "length": 3, "speed": 3, "height": 3, "azimuth": 3, "crest": 3}  # of the card
_WRONG = ("height", "length", "azimuth", "crest")  # may be wrong there


@dataclass(frozen=True, kw_only=True)
class TrueWater:
    """The true surface: the level one at the tide of a photo, raised by slope . (place - middle)."""

    slope: FloatArray  # (3,) in the axes of the job, horizontal at `middle`
    middle: FloatArray  # (3,) m, geocentric or local: the mean of the true stations, to the metre

    def levels(self, places: TruePlaces, tide: FloatArray) -> FloatArray:
        """Return the heights (k,) m of the surface over places, row by row at the tides (k,) m.

        The point of the surface over a place lies d up its vertical U: d = (tide - height + s . (place - middle)) /
        (1 - s . U).
        """
        if not self.slope.any():
            return tide
        height = places.natural[:, 2]
        above = tide - height + (places.xyz - self.middle) @ self.slope
        return height + above / (1.0 - places.vertical[:, 2] @ self.slope)


@dataclass(frozen=True, kw_only=True)
class GivenWater:
    """What the deck says of the water."""

    card: Water | None
    tide: FloatArray  # (n,) m, NaN without water
    sigma: FloatArray  # (n,) m, of the tides, NaN where none is given
    error: FloatArray  # (n,) m, of the tides, given minus true; zero without water
    group: TextArray  # (n,)
    day: TextArray  # (n,)


def true_water(spec: SimulationSpec, stations: TruePlaces, world: World) -> TrueWater:
    """Return the true surface under the true stations."""
    middle = np.rint(stations.xyz.mean(axis=0))
    tilt = np.array(spec.water.tilt if spec.water else (0.0, 0.0)) * ARC_SECOND
    return TrueWater(slope=tilt @ world.axes(middle)[:2], middle=middle)


def state_water(spec: SimulationSpec, tide: FloatArray, draws: Draws) -> GivenWater:
    """Return what the deck says of the water at true tides (n,)."""
    n, keys = len(tide), spec.water
    none, unknown = np.full(n, ""), np.full(n, np.nan)
    if keys is None:
        return GivenWater(card=None, tide=tide, sigma=unknown, error=np.zeros(n), group=none, day=none)
    photo_error = keys.photo_level_error * draws.normal("photo levels", n)
    given = np.round(tide + (keys.level_error + photo_error), METRE_DECIMALS)
    return GivenWater(
        card=_card(keys),
        tide=given,
        sigma=unknown if keys.tide_sigma is None else np.full(n, keys.tide_sigma),
        error=np.round(given - tide, METRE_DECIMALS) + 0.0,
        group=_numbered("G", keys.group_size, n),
        day=_numbered("D", keys.day_size, n),
    )


def _numbered(letter: str, size: int, n: int) -> TextArray:
    """Return the names (n,) of groups of so many photos, empty without groups."""
    return np.array([f"{letter}{row // size + 1}" if size else "" for row in range(n)], dtype=np.str_)


def _card(keys: SurfaceKeys) -> Water:
    card = [None, None] if keys.tilt_on_card is None else np.round(keys.tilt_on_card, _TILT_DECIMALS).tolist()
    east, north = (None if slope is None else slope * ARC_SECOND for slope in card)
    index = keys.index if not keys.index_error else round(keys.index + keys.index_error, _INDEX_DECIMALS)
    conditions = keys.conditions.on_card if keys.conditions else None
    return Water(
        index=index if conditions is None else index_of(conditions),
        sigma=keys.index_sigma,
        liquid=keys.liquid,
        tilt_east=east,
        tilt_north=north,
        tilt_sigma=None if keys.tilt_sigma is None else keys.tilt_sigma * ARC_SECOND,
        conditions=conditions,
    )


# --- waves ---


@dataclass(frozen=True, kw_only=True)
class TrueWaves:
    """The sum of amplitude cos(vector . (place - origin) - frequency time - phase), up the vertical."""

    amplitude: FloatArray  # (c,) m
    vector: FloatArray  # (c, 3) rad/m in the axes of the job, horizontal at the origin
    frequency: FloatArray  # (c,) rad/s
    phase: FloatArray  # (c,) rad
    origin: FloatArray  # (3,) m, geocentric or local

    def rise(self, xyz: FloatArray, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the height (k,) m over the level water at places (k, 3) of it and times (k,) s, and its gradient.

        The gradient (k, 3) stands in the axes of the job.
        """
        angle = (xyz - self.origin) @ self.vector.T - time[:, None] * self.frequency - self.phase
        height = np.cos(angle) @ self.amplitude
        return height, -(np.sin(angle) * self.amplitude) @ self.vector


@dataclass(frozen=True, kw_only=True)
class GivenWaves:
    """What the deck says of the waves, and what is true of them: None without."""

    cards: Waves
    origin: WaveOrigin | None
    true: TrueWaves | None


def state_waves(spec: SimulationSpec, world: World) -> GivenWaves:
    """Return the waves of a spec. Raises `SpecError` with every wave that cannot be."""
    if not spec.wave or spec.water is None:
        return GivenWaves(cards=empty(Waves), origin=None, true=None)
    from musatpy.sea.deck_waves import faults  # few specs have waves

    true = _true_words(spec.wave)
    for waves in (true, cards := _cards(spec.wave, true)):
        wrong = [
            Problem(field=f"wave[{row + 1}].{name}", message=message)
            for row, name, message, error in faults(waves)
            if error
        ]
        if wrong:
            raise SpecError(wrong)
    place = world.at_plan(np.array([spec.water.wave_origin]), np.array([spec.water.level]))
    x, y, z = place.job[0].tolist()
    return GivenWaves(
        cards=cards, origin=WaveOrigin(position=(x, y, z)), true=_true(true, place.xyz[0], place.vertical[0])
    )


def _true_words(trains: tuple[WaveTrain, ...]) -> Waves:
    """Return what cards without error say."""
    values = {
        name: [
            np.nan if getattr(train, name) is None else round(getattr(train, name), decimals) for train in trains
        ]
        for name, decimals in _DECIMALS.items()
    }
    return Waves(
        ids=np.array([train.id for train in trains]),
        shape=np.array([train.shape for train in trains]),
        **{name: np.array(column) * (DEGREE if name == "azimuth" else 1.0) for name, column in values.items()},
        **dict.fromkeys(WAVE_SIGMAS, np.full(len(trains), np.nan)),
    )


def _cards(trains: tuple[WaveTrain, ...], true: Waves) -> Waves:
    """Return the cards: the truth with the errors of the spec, and its sigmas."""
    from musatpy.sea.deck_waves import wave_trains

    wrong = {name: np.array([getattr(train, f"{name}_error") for train in trains]) for name in _WRONG}
    sigmas = {name: np.array([getattr(train, name) for train in trains], dtype=float) for name in WAVE_SIGMAS}
    length = np.where(wrong["length"] != 0.0, wave_trains(true).length, true.length)
    given = {**{name: getattr(true, name) for name in _WRONG}, "length": length}
    for name in _WRONG:
        unit = DEGREE if name == "azimuth" else 1.0
        given[name] = np.round(given[name] / unit + wrong[name], _DECIMALS[name]) * unit
    sigmas["azimuth_sigma"] = sigmas["azimuth_sigma"] * DEGREE
    return replace(true, **given, **sigmas)


def _true(cards: Waves, origin: FloatArray, axes: FloatArray) -> TrueWaves:
    from musatpy.sea.deck_waves import wave_trains

    trains = wave_trains(cards)
    k, a = trains.number, cards.height / 2.0
    direction = np.stack([np.sin(cards.azimuth), np.cos(cards.azimuth)], axis=1)
    coth = 1.0 / np.tanh(k * trains.depth)
    # the bound harmonic of a second-order Stokes wave: a^2 k / 4 coth kh (3 coth^2 kh - 1)
    bound = np.where(cards.shape == WaveShape.STOKES, a**2 * k / 4.0 * coth * (3.0 * coth**2 - 1.0), 0.0)
    order = np.repeat([1.0, 2.0], len(k))
    number = order * np.tile(k, 2)
    return TrueWaves(
        amplitude=np.concatenate([a, bound]),
        vector=number[:, None] * np.tile(direction @ axes[:2], (2, 1)),
        frequency=number * np.tile(trains.speed, 2),
        phase=number * np.tile(cards.crest, 2),
        origin=origin,
    )
