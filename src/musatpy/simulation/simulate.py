"""From a spec to a block and its truth."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from musatpy.errors import Problem, SpecError
from musatpy.model import Block
from musatpy.simulation.assemble import air_bases, assemble, order_of_appearance
from musatpy.simulation.draws import Draws
from musatpy.simulation.flight import fly, plan_flight
from musatpy.simulation.ground import lay_ground
from musatpy.simulation.images import take_images
from musatpy.simulation.measure import Blunder, choose_control, measure_plates, state_stations
from musatpy.simulation.spec import SimulationSpec, load_spec
from musatpy.simulation.world import Places, World, world_of

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What a block does not say. Rows are those of the block's photos, points, plates, control."""

    spec: SimulationSpec
    stations: Places  # n
    attitude: FloatArray  # (n, 3) rad, in the local vertical frame of the true station
    tide: FloatArray  # (n,) m, NaN without water
    points: Places  # p
    images: FloatArray  # (m, 2) mm, without error
    refracted: BoolArray  # (m,) the image was seen through the water surface
    control_error: FloatArray  # (k, 3) m east north up, given minus true
    blunders: tuple[Blunder, ...]
    levels: FloatArray  # (g,) m, of the equal elevation groups
    base_lengths: FloatArray  # (b,) m


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """A simulated block, and the truth behind it."""

    block: Block
    truth: Truth


def simulate(spec: SimulationSpec | str | Path, seed: int | None = None) -> Simulation:
    """Return the block that a spec (or the TOML file of one) describes, and its truth.

    `seed` takes the place of the spec's own. The same spec and seed give the same block everywhere. Raises
    `SpecError` where the spec cannot be read or asks for something impossible.
    """
    if not isinstance(spec, SimulationSpec):
        spec = load_spec(spec)
    if seed is not None and seed < 0:
        raise SpecError([Problem(field="seed", message=f"{seed} is below 0")])
    if seed is not None:
        spec = dataclasses.replace(spec, seed=seed)
    draws, world, plan = Draws(spec.seed), _world(spec), plan_flight(spec)
    flight = fly(spec, plan, world, draws)
    ground = lay_ground(spec, plan, flight, world, draws)
    images = take_images(spec, plan, flight, ground, world)
    control = choose_control(spec, ground, images, world, draws)
    plates = measure_plates(spec, flight, ground, control, images, draws)
    stations = state_stations(spec, flight, world, draws)
    order = order_of_appearance(images, ground)
    bases, base_lengths = air_bases(spec, flight, draws)
    block = assemble(spec, world, flight, ground, images, control, plates, stations, order, bases)
    truth = Truth(
        spec=spec,
        stations=flight.stations,
        attitude=flight.attitude,
        tide=flight.tide,
        points=ground.places[order.rows],
        images=images.xy,
        refracted=images.refracted,
        control_error=control.error,
        blunders=plates.blunders,
        levels=ground.levels,
        base_lengths=base_lengths,
    )
    return Simulation(block=block, truth=truth)


def _world(spec: SimulationSpec) -> World:
    """Return the world of the spec's job; an unknown ellipsoid is a `SpecError`."""
    try:
        return world_of(spec.job)
    except ValueError as error:
        raise SpecError([Problem(field="job.ellipsoid", message=str(error))]) from error
