"""From a spec to a block and its truth."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.draws import Draws
from musatpy.errors import Problem, SpecError
from musatpy.model import Block
from musatpy.simulation.assemble import Given, Order, assemble, order_of_appearance
from musatpy.simulation.compiled_models import CompiledTruth, compile_models
from musatpy.simulation.flight import TrueFlight, fly, plan_flight
from musatpy.simulation.measure import Blunder, choose_control, measure_plates, state_stations
from musatpy.simulation.measured_ties import air_bases, distances, height_differences
from musatpy.simulation.mistakes import flags_on_cards, mixed_names
from musatpy.simulation.simulation_spec import SimulationSpec, load_spec
from musatpy.simulation.terrain import Ground, lay_ground
from musatpy.simulation.true_images import Images, take_images
from musatpy.simulation.true_water import state_water
from musatpy.simulation.world import Places, World, world_of
from musatpy.units import ARC_SECOND


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What a block does not say. Rows are those of the block's photos, points, plates, control."""

    spec: SimulationSpec
    stations: Places  # n
    gross_stations: FloatArray  # (n, 6) gross errors of the cards: east, north, up m, of the angles rad
    attitude: FloatArray  # (n, 3) rad, in the local vertical frame of the true station
    tide: FloatArray  # (n,) m, in the middle of the stations; NaN without water
    tide_error: FloatArray  # (n,) m, of the tide cards, given minus true; 0 without water
    gross_tide: FloatArray  # (n,) m, the gross errors in it
    index: float | None  # refractive index; None without water
    tilt: FloatArray  # (2,) rad, slopes of the water towards east and north
    middle: FloatArray  # (3,) m, geocentric or local, about which it is tilted
    points: Places  # p
    bathymetric: BoolArray  # (p,) whatever the flags in the deck say
    images: FloatArray  # (m, 2) mm, without error
    seen: IntArray  # (m,) point of the block whose image it is, whatever its name in the deck
    refracted: BoolArray  # (m,) the image was seen through the water surface
    swapped: IntArray  # (s, 2) plate measurements that have each other's names
    misnamed: IntArray  # (w,) plate measurements that have the name of a point which their photo lacks
    control_error: FloatArray  # (k, 3) m east north up, given minus true
    gross_control: FloatArray  # (k, 3) m, the gross errors in it
    blunders: tuple[Blunder, ...]
    levels: FloatArray  # (g,) m, of the equal elevation groups
    off_level: FloatArray  # (p,) m, gross errors of their points
    base_lengths: FloatArray  # (b,) m
    gross_bases: FloatArray  # (b,) m, the gross errors of those in the deck
    distances: FloatArray  # (d,) m
    gross_distances: FloatArray  # (d,) m, the gross errors of those in the deck
    height_differences: FloatArray  # (h,) m
    gross_height_differences: FloatArray  # (h,) m


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """A simulated block, the truth behind it, and what is compiled in its models, None where nothing is."""

    block: Block
    truth: Truth
    compiled: CompiledTruth | None = None


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
    try:
        world = world_of(spec.job)
    except ValueError as error:
        raise SpecError([Problem(field="job.ellipsoid", message=str(error))]) from error
    draws, plan = Draws(spec.seed), plan_flight(spec)
    flight = fly(spec, plan, world, draws)
    with np.errstate(over="ignore", invalid="ignore"):  # places beyond all numbers are refused below
        ground = lay_ground(spec, plan, flight, world, draws)
    images = take_images(spec, plan, flight, ground, world)
    given, base_lengths = _stated(spec, flight, ground, images, world, draws)
    order = order_of_appearance(given.names.point, len(ground.ids))
    block = assemble(spec, world, flight, ground, given, order)
    return Simulation(
        block=block,
        truth=_truth(spec, flight, ground, given, order, base_lengths),
        compiled=compile_models(spec, plan, flight, ground, world, draws),
    )


def _stated(
    spec: SimulationSpec, flight: TrueFlight, ground: Ground, images: Images, world: World, draws: Draws
) -> tuple[Given, FloatArray]:
    """Return what the deck says of the truth, and the true lengths (b,) m of the air bases."""
    control = choose_control(spec, ground, images, world, draws)
    plates = measure_plates(spec, flight, ground, control, images, draws)
    sound = plates.triangulated.copy()
    sound[plates.hit] = False
    rays = np.bincount(images.point[plates.triangulated], minlength=len(ground.ids))
    usable = np.flatnonzero(rays >= 2)
    bases, base_lengths = air_bases(spec, flight, draws)
    given = Given(
        water=state_water(spec, flight.ids, flight.tide, draws),
        stations=state_stations(spec, flight, world, draws),
        images=images,
        plates=plates,
        names=mixed_names(spec, images, sound, draws),
        flags=flags_on_cards(spec, ground, images, draws),
        control=control,
        bases=bases,
        distances=distances(spec, ground, control.names, usable, draws),
        height_differences=height_differences(spec, ground, control.names, usable, draws),
    )
    return given, base_lengths


def _truth(
    spec: SimulationSpec, flight: TrueFlight, ground: Ground, given: Given, order: Order, base_lengths: FloatArray
) -> Truth:
    water, names = spec.water, given.names
    return Truth(
        spec=spec,
        stations=flight.stations,
        gross_stations=given.stations.gross,
        attitude=flight.attitude,
        tide=flight.tide,
        tide_error=given.water.error,
        gross_tide=given.water.gross,
        index=water.index if water else None,
        tilt=np.array(water.tilt if water else (0.0, 0.0)) * ARC_SECOND,
        middle=flight.water.middle,
        points=ground.places[order.rows],
        bathymetric=ground.bathymetric[order.rows],
        images=given.images.xy,
        seen=order.links[given.images.point],
        refracted=given.images.refracted,
        swapped=names.swapped,
        misnamed=names.misnamed,
        control_error=given.control.error,
        gross_control=given.control.gross,
        blunders=given.plates.blunders,
        levels=ground.levels,
        off_level=ground.off_level[order.rows],
        base_lengths=base_lengths,
        gross_bases=np.array([base.blunder for base in spec.air_base]),
        distances=given.distances.true,
        gross_distances=given.distances.gross,
        height_differences=given.height_differences.true,
        gross_height_differences=given.height_differences.gross,
    )
