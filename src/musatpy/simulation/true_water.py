"""The water of a simulation: its true surface, and what the deck says of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.draws import Draws
from musatpy.errors import Problem, SpecError
from musatpy.model import Water
from musatpy.simulation.simulation_spec import SimulationSpec
from musatpy.simulation.water_keys import WaterKeys, index_of
from musatpy.simulation.world import METRE_DECIMALS, Places, World
from musatpy.units import ARC_SECOND

_INDEX_DECIMALS, _TILT_DECIMALS = 6, 3  # of the water card, the tilt in arc seconds


@dataclass(frozen=True, kw_only=True)
class TrueWater:
    """The true surface: the level one at the tide of a photo, raised by slope . (place - middle)."""

    slope: FloatArray  # (3,) in the axes of the job, horizontal at `middle`
    middle: FloatArray  # (3,) m, geocentric or local: the mean of the true stations, to the metre

    def levels(self, places: Places, tide: FloatArray) -> FloatArray:
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
    error: FloatArray  # (n,) m, of the tides, given minus true; zero without water
    gross: FloatArray  # (n,) m, the part of it that [[wrong_tide]] makes
    group: TextArray  # (n,)
    day: TextArray  # (n,)


def true_water(spec: SimulationSpec, stations: Places, world: World) -> TrueWater:
    """Return the true surface under the true stations."""
    middle = np.rint(stations.xyz.mean(axis=0))
    tilt = np.array(spec.water.tilt if spec.water else (0.0, 0.0)) * ARC_SECOND
    return TrueWater(slope=tilt @ world.axes(middle)[:2], middle=middle)


def state_water(spec: SimulationSpec, ids: tuple[str, ...], tide: FloatArray, draws: Draws) -> GivenWater:
    """Return what the deck says of the water at true tides (n,). Raises `SpecError` where a photo is unknown."""
    n, keys = len(ids), spec.water
    if keys is None:
        none = np.full(n, "")
        return GivenWater(card=None, tide=tide, error=np.zeros(n), gross=np.zeros(n), group=none, day=none)
    gross = _gross_errors(spec, ids)
    group, group_error = _shared(keys.group_size, keys.group_level_error, n, draws, "group levels")
    day, day_error = _shared(keys.day_size, keys.day_level_error, n, draws, "day levels")
    photo_error = keys.photo_level_error * draws.normal("photo levels", n)
    given = np.round(tide + (keys.level_error + group_error + day_error + photo_error + gross), METRE_DECIMALS)
    return GivenWater(
        card=_card(keys), tide=given, error=np.round(given - tide, METRE_DECIMALS) + 0.0, gross=gross,
        group=np.char.add("G", group) if keys.group_size else group,
        day=np.char.add("D", day) if keys.day_size else day,
    )  # fmt: skip


def _card(keys: WaterKeys) -> Water:
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


def _shared(size: int, sigma: float, n: int, draws: Draws, stream: str) -> tuple[TextArray, FloatArray]:
    """Return the numbers (n,) from 1 of groups of so many photos, empty without groups, and their errors (n,) m."""
    if not size:
        return np.full(n, ""), np.zeros(n)
    number = np.arange(n) // size
    return (number + 1).astype(np.str_), sigma * draws.normal(stream, int(number.max(initial=-1)) + 1)[number]


def _gross_errors(spec: SimulationSpec, ids: tuple[str, ...]) -> FloatArray:
    """Return the gross errors (n,) m of the tides. Raises `SpecError` where a photo is unknown."""
    gross, rows = np.zeros(len(ids)), {name: row for row, name in enumerate(ids)}
    for i, wrong in enumerate(spec.wrong_tide, start=1):
        unknown = [name for name in wrong.photos if name not in rows]
        if unknown:
            message = f"unknown photos: {', '.join(unknown)}"
            raise SpecError([Problem(field=f"wrong_tide[{i}].photos", message=message)])
        gross[[rows[name] for name in wrong.photos or ids]] += wrong.error
    return gross
