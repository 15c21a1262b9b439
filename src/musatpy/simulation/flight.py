"""The flight: true exposure stations, attitudes and tides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.draws import Draws
from musatpy.geometry.collinearity import wrapped
from musatpy.simulation.simulation_spec import SimulationSpec
from musatpy.simulation.true_water import GivenWaves, TrueWater, state_waves, true_water
from musatpy.simulation.world import ATTITUDE_DECIMALS, METRE_DECIMALS, TruePlaces, World, on_grid
from musatpy.units import DEGREE

TIME_DECIMALS = 3  # of a second, on the tide cards


@dataclass(frozen=True, kw_only=True)
class FlightPlan:
    """Where the photos should be, in plan coordinates (m east and north of the centre), strip by strip."""

    nadirs: FloatArray  # (strips, photos, 2) in the order of exposure
    heading: FloatArray  # (strips,) rad, X-axis of the plate from east to north
    base: float  # m, between photos of a strip
    spacing: float  # m, between strips
    along: FloatArray  # (2,) unit, flight direction of the first strip
    right: FloatArray  # (2,) unit, to its right
    height: float  # m, ellipsoidal height (Z) of the stations
    reach: float  # m, radius on the ground that holds every image, tilts of the plan aside


@dataclass(frozen=True, kw_only=True)
class TrueFlight:
    """n true exposures, on the grid of the cards."""

    ids: tuple[str, ...]
    stations: TruePlaces
    attitude: FloatArray  # (n, 3) rad, in the local vertical frame of the station
    tide: FloatArray  # (n,) m, in the middle of the stations; NaN without water
    time: FloatArray  # (n,) s; NaN without waves
    water: TrueWater
    waves: GivenWaves


def plan_flight(spec: SimulationSpec) -> FlightPlan:
    """Return the plan of the flight of a spec."""
    flight, camera = spec.flight, spec.camera
    azimuth = flight.azimuth * DEGREE
    along, right = np.array([np.sin(azimuth), np.cos(azimuth)]), np.array([np.cos(azimuth), -np.sin(azimuth)])
    scale = flight.height / camera.focal_length
    base = camera.format[0] * scale * (1.0 - flight.forward_overlap)
    spacing = camera.format[1] * scale * (1.0 - flight.side_overlap)
    u = (np.arange(flight.photos) - (flight.photos - 1) / 2.0) * base
    v = (np.arange(flight.strips) - (flight.strips - 1) / 2.0) * spacing
    nadirs = u[None, :, None] * along + v[:, None, None] * right
    heading = np.full(flight.strips, np.pi / 2.0 - azimuth)
    if flight.reverse_alternate:
        nadirs[1::2] = nadirs[1::2, ::-1]
        heading[1::2] += np.pi
    return FlightPlan(
        nadirs=nadirs,
        heading=heading,
        base=base,
        spacing=spacing,
        along=along,
        right=right,
        height=(spec.water or spec.terrain).level + flight.height,
        reach=float(np.hypot(*camera.format)) / 2.0 * scale,
    )


def fly(spec: SimulationSpec, plan: FlightPlan, world: World, draws: Draws) -> TrueFlight:
    """Return the true exposures: the plan, scattered, on the grid of the cards."""
    flight = spec.flight
    n = flight.strips * flight.photos
    numbers = flight.first_photo + np.add.outer(
        np.arange(flight.strips) * flight.strip_step, np.arange(flight.photos)
    )
    scatter = draws.normal("station scatter", n, 3) * flight.station_scatter
    stations = world.at_plan(plan.nadirs.reshape(n, 2) + scatter[:, :2], plan.height + scatter[:, 2])
    attitude = draws.normal("attitude scatter", n, 3) * flight.attitude_scatter * DEGREE
    attitude[:, 2] += np.repeat(plan.heading, flight.photos)
    attitude[:, 2] = wrapped(attitude[:, 2])
    return TrueFlight(
        ids=tuple(str(number) for number in numbers.ravel()),
        stations=stations,
        attitude=on_grid(attitude, ATTITUDE_DECIMALS),
        tide=_tides(spec, n, draws),
        time=np.round(flight.interval * np.arange(n), TIME_DECIMALS) if spec.wave else np.full(n, np.nan),
        water=true_water(spec, stations, world),
        waves=state_waves(spec, world),
    )


def _tides(spec: SimulationSpec, n: int, draws: Draws) -> FloatArray:
    """Return the height of the water surface at each photo (n,) m."""
    water = spec.water
    if water is None:
        return np.full(n, np.nan)
    if water.tides:
        return np.round(water.tides, METRE_DECIMALS)
    trend = water.tide_trend * (np.arange(n) - (n - 1) / 2.0)
    return np.round(water.level + trend + water.tide_scatter * draws.normal("tides", n), METRE_DECIMALS)
