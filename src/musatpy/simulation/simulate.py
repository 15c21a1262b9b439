"""From a spec to a block, its tables in the order of a deck, and its truth."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from musatpy import model
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.draws import Draws
from musatpy.errors import Problem, SpecError
from musatpy.model.tables import empty
from musatpy.simulation.compiled_models import CompiledTruth, compile_models
from musatpy.simulation.flight import TrueFlight, fly, plan_flight
from musatpy.simulation.measure import (
    Blunder,
    GivenControl,
    GivenStations,
    MeasuredPlates,
    Ties,
    air_bases,
    choose_control,
    distances,
    height_differences,
    measure_plates,
    state_stations,
)
from musatpy.simulation.mistakes import Names, mixed_names
from musatpy.simulation.simulation_spec import OptionKeys, SimulationSpec, load_spec
from musatpy.simulation.terrain import TrueGround, lay_ground
from musatpy.simulation.true_images import TrueImages, take_images
from musatpy.simulation.true_water import GivenWater, state_water
from musatpy.simulation.world import TruePlaces, World, world_of
from musatpy.specs import echoed, keys
from musatpy.units import ARC_SECOND, MICROMETRE


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What a block does not say. Rows are those of the block's photos, points, plates, control."""

    spec: SimulationSpec
    stations: TruePlaces  # n
    attitude: FloatArray  # (n, 3) rad, in the local vertical frame of the true station
    tide: FloatArray  # (n,) m, in the middle of the stations; NaN without water
    tide_error: FloatArray  # (n,) m, of the tide cards, given minus true; 0 without water
    index: float | None  # refractive index; None without water
    tilt: FloatArray  # (2,) rad, slopes of the water towards east and north
    middle: FloatArray  # (3,) m, geocentric or local, about which it is tilted
    points: TruePlaces  # p
    bathymetric: BoolArray  # (p,)
    images: FloatArray  # (m, 2) mm, without error
    seen: IntArray  # (m,) point of the block whose image it is, whatever its name in the deck
    refracted: BoolArray  # (m,) the image was seen through the water surface
    swapped: IntArray  # (s, 2) plate measurements that have each other's names
    misnamed: IntArray  # (w,) plate measurements that have the name of a point which their photo lacks
    control_error: FloatArray  # (k, 3) m east north up, given minus true
    gross_control: FloatArray  # (k, 3) m, the gross errors in it
    blunders: tuple[Blunder, ...]
    levels: FloatArray  # (g,) m, of the equal elevation groups
    base_lengths: FloatArray  # (b,) m
    distances: FloatArray  # (d,) m
    height_differences: FloatArray  # (h,) m


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """A simulated block, the truth behind it, and what is compiled in its models, None where nothing is."""

    block: model.Block
    truth: Truth
    compiled: CompiledTruth | None = None


@dataclass(frozen=True, kw_only=True)
class PointOrder:
    """Order of the points in the deck, which is that of their first plate cards."""

    rows: IntArray  # (p,) row of the ground of each point of the block
    links: IntArray  # row of the block of each point of the ground, -1 where it is not measured


def order_of_appearance(named: IntArray, points: int) -> PointOrder:
    """Return the order in which plate cards, whose points are `named` (m,), first name each of so many points."""
    measured, first = np.unique(named, return_index=True)
    rows = measured[np.argsort(first)]
    links = np.full(points, -1)
    links[rows] = np.arange(len(rows))
    return PointOrder(rows=rows, links=links)


@dataclass(frozen=True, kw_only=True)
class Given:
    """All that the deck says, with its errors."""

    water: GivenWater
    stations: GivenStations
    images: TrueImages
    plates: MeasuredPlates
    names: Names
    control: GivenControl
    bases: Ties
    distances: Ties
    height_differences: Ties


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
    given = _stated(spec, flight, ground, images, world, draws)
    order = order_of_appearance(given.names.point, len(ground.ids))
    block = assemble(spec, world, flight, ground, given, order)
    return Simulation(
        block=block,
        truth=_truth(spec, flight, ground, given, order),
        compiled=compile_models(spec, plan, flight, ground, world, draws),
    )


def _stated(
    spec: SimulationSpec, flight: TrueFlight, ground: TrueGround, images: TrueImages, world: World, draws: Draws
) -> Given:
    """Return what the deck says of the truth."""
    control = choose_control(spec, ground, images, world, draws)
    plates = measure_plates(spec, flight, ground, control, images, draws)
    sound = plates.triangulated.copy()
    sound[plates.hit] = False
    rays = np.bincount(images.point[plates.triangulated], minlength=len(ground.ids))
    usable = np.flatnonzero(rays >= 2)
    return Given(
        water=state_water(spec, flight.tide, draws),
        stations=state_stations(spec, flight, world, draws),
        images=images,
        plates=plates,
        names=mixed_names(spec, images, sound, draws),
        control=control,
        bases=air_bases(spec, flight, draws),
        distances=distances(spec, ground, control.names, usable, draws),
        height_differences=height_differences(spec, ground, control.names, usable, draws),
    )


def _truth(spec: SimulationSpec, flight: TrueFlight, ground: TrueGround, given: Given, order: PointOrder) -> Truth:
    water, names = spec.water, given.names
    return Truth(
        spec=spec,
        stations=flight.stations,
        attitude=flight.attitude,
        tide=flight.tide,
        tide_error=given.water.error,
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
        base_lengths=given.bases.true,
        distances=given.distances.true,
        height_differences=given.height_differences.true,
    )


def assemble(
    spec: SimulationSpec, world: World, flight: TrueFlight, ground: TrueGround, given: Given, order: PointOrder
) -> model.Block:
    """Return the block. Raises `SpecError` where a shore point is not measured twice."""
    camera, plates, control = spec.camera, given.plates, given.control
    distances, heights = given.distances, given.height_differences
    return model.Block(
        titles=spec.title,
        options=_options(spec),
        ellipsoid=world.ellipsoid,
        water=given.water.card,
        cameras=model.Cameras(
            ids=np.array([camera.id]),
            focal_length=np.array([camera.focal_length]),
            principal_point=np.array([camera.principal_point]),
            format_size=np.array([camera.format]),
        ),
        distortion=empty(model.Distortion),
        fiducials=empty(model.Fiducials),
        photos=_photos(spec, flight, given),
        fiducial_measurements=empty(model.FiducialMeasurements),
        points=model.Points(ids=np.array(control.names)[order.rows], bathymetric=ground.bathymetric[order.rows]),
        plates=model.PlateMeasurements(
            photo=given.images.photo,
            point=order.links[given.names.point],
            xy=plates.xy,
            sigma=plates.sigma,
            triangulated=plates.triangulated,
        ),
        control=model.Control(
            point=order.links[control.point],
            kind=control.kind,
            fixed=control.fixed,
            position=control.position,
            sigma=control.sigma,
        ),
        equal_elevations=_equal_elevations(spec, ground, order),
        air_bases=model.AirBases(photo=given.bases.point, length=given.bases.given, sigma=given.bases.sigma),
        distances=model.Distances(
            point=order.links[distances.point], length=distances.given, sigma=distances.sigma
        ),
        height_differences=model.HeightDifferences(
            point=order.links[heights.point], difference=heights.given, sigma=heights.sigma
        ),
        waves=flight.waves.cards,
        wave_origin=flight.waves.origin,
    )


def _options(spec: SimulationSpec) -> model.Options:
    """Return the option card's values; the program's own defaults where the spec has none."""
    given: dict[str, Any] = echoed(spec.options)  # without what is absent
    for name, key in keys(OptionKeys).items():
        if name in given and key.metadata["choices"]:  # members of an enumeration
            given[name] = next(choice for choice in key.metadata["choices"] if choice == given[name])
    if "rotation_limit" in given:
        given["rotation_limit"] *= ARC_SECOND
    is_rigorous = given.get("program") is model.Program.IIIA or spec.wave
    given.setdefault("refraction", model.Refraction.RIGOROUS if is_rigorous else model.Refraction.WATPT)
    return model.Options(
        system=model.CoordinateSystem(spec.job.system),
        plate_sigma=spec.measurement.sigma * MICROMETRE,
        **given,
    )


def _photos(spec: SimulationSpec, flight: TrueFlight, given: Given) -> model.Photos:
    n, stations, water = len(flight.ids), given.stations, given.water
    tide_sigma = spec.water.tide_sigma if spec.water else None
    return model.Photos(
        ids=np.array(flight.ids),
        camera=np.zeros(n, dtype=int),
        position=stations.position,
        position_sigma=stations.position_sigma,
        attitude=stations.attitude,
        attitude_sigma=stations.attitude_sigma,
        tide=water.tide,
        tide_sigma=np.full(n, np.nan if tide_sigma is None else tide_sigma),
        tide_group=water.group,
        tide_day=water.day,
        time=np.where(np.isnan(water.tide), np.nan, flight.time),
    )


def _equal_elevations(spec: SimulationSpec, ground: TrueGround, order: PointOrder) -> model.EqualElevations:
    """Return the groups of shore points. Raises `SpecError` where a member is not measured twice."""
    members = np.flatnonzero(ground.shore >= 0)
    members = members[np.argsort(ground.shore[members], kind="stable")]
    points = order.links[members]
    if np.any(points < 0):
        lost = ", ".join(ground.ids[row] for row in members[points < 0])
        raise SpecError([Problem(field="equal_elevation", message=f"not measured on two photos: {lost}")])
    return model.EqualElevations(
        ids=np.array([shore.id for shore in spec.equal_elevation], dtype=str),
        sigma=np.array([shore.sigma for shore in spec.equal_elevation]),
        group=ground.shore[members],
        point=points,
    )
