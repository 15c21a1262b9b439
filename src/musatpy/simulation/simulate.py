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
from musatpy.errors import SpecError
from musatpy.model.tables import stacked
from musatpy.simulation.compiled_models import CompiledTruth, compile_models
from musatpy.simulation.flight import fly, plan_flight
from musatpy.simulation.measure import (
    Blunder,
    GivenControl,
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
from musatpy.simulation.scene_keys import KindKeys, TrueParameter
from musatpy.simulation.simulation_spec import OptionKeys, SimulationSpec, load_spec
from musatpy.simulation.terrain import Scene, lay_ground
from musatpy.simulation.true_images import TrueImages, take_images
from musatpy.simulation.true_water import GivenWater, state_water
from musatpy.simulation.world import TruePlaces, World
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
    parameters: tuple[TrueParameter, ...]  # of what runs may adjust besides


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """A simulated block, the truth behind it, and what is compiled in its models, None where nothing is."""

    block: model.Block
    truth: Truth
    compiled: CompiledTruth | None = None


@dataclass(frozen=True, kw_only=True)
class Given:
    """All that the deck says, with its errors, of images of points of the ground.

    rows (p,): these points in the order of the deck, which is that of their first plate cards; links: row of the
    block of each point of the ground, -1 where it is not measured.
    """

    water: GivenWater
    stations: dict[str, FloatArray]  # columns of Photos
    plates: MeasuredPlates
    names: Names
    control: GivenControl
    bases: Ties
    distances: Ties
    height_differences: Ties
    parts: dict[str, Any]  # of the block, by its name, that kinds of observations and unknowns add
    parameters: tuple[TrueParameter, ...]
    rows: IntArray
    links: IntArray


def simulate(spec: SimulationSpec | str | Path, seed: int | None = None) -> Simulation:
    """Return the block that a spec (or the TOML file of one) describes, and its truth.

    `seed` takes the place of the spec's own. The same spec and seed give the same block everywhere. Raises
    `SpecError` where the spec cannot be read or asks for something impossible.
    """
    if not isinstance(spec, SimulationSpec):
        spec = load_spec(spec)
    if seed is not None and seed < 0:
        raise SpecError.of(f"{seed} is below 0", field="seed")
    if seed is not None:
        spec = dataclasses.replace(spec, seed=seed)
    try:
        world = World(spec.job)
    except ValueError as error:
        raise SpecError.of(error, field="job.ellipsoid") from error
    draws, plan = Draws(spec.seed), plan_flight(spec)
    flight = fly(spec, plan, world, draws)
    with np.errstate(over="ignore", invalid="ignore"):  # places beyond all numbers are refused below
        ground = lay_ground(spec, plan, flight, world, draws)
    scene = Scene(spec=spec, world=world, draws=draws, plan=plan, flight=flight, ground=ground)
    images = take_images(scene)
    given = _stated(scene, images)
    return Simulation(
        block=_block(scene, given), truth=_truth(scene, images, given), compiled=compile_models(scene)
    )


def _stated(scene: Scene, images: TrueImages) -> Given:
    """Return what the deck says of the truth."""
    count = len(scene.ground.ids)
    control = choose_control(scene, images)
    plates = measure_plates(scene, images, control)
    sound = plates.table.triangulated.copy()
    rays = np.bincount(images.point[sound], minlength=count)
    sound[plates.hit] = False
    names, usable = mixed_names(scene.spec, images, sound, scene.draws), np.flatnonzero(rays >= 2)
    measured, first = np.unique(names.point, return_index=True)
    rows, links = measured[np.argsort(first)], np.full(count, -1)
    links[rows] = np.arange(len(rows))
    parts, parameters = _of_kinds(scene)
    return Given(
        water=state_water(scene.spec, scene.flight.tide, scene.draws),
        stations=state_stations(scene),
        plates=plates,
        names=names,
        control=control,
        bases=air_bases(scene),
        distances=distances(scene, control.names, usable),
        height_differences=height_differences(scene, control.names, usable),
        parts=parts,
        parameters=parameters,
        rows=rows,
        links=links,
    )


def _of_kinds(scene: Scene) -> tuple[dict[str, Any], tuple[TrueParameter, ...]]:
    """Return the parts of the block that kinds of observations and unknowns add, and their truth, kind by kind."""
    parts: dict[str, Any] = {}
    parameters: list[TrueParameter] = []
    for of_kind in vars(scene.spec).values():
        if isinstance(of_kind, KindKeys):
            given, true = of_kind.stated(scene)
            parts |= {name: stacked([parts[name], part]) if name in parts else part for name, part in given.items()}
            parameters += true
    return parts, tuple(sorted(parameters, key=lambda parameter: parameter.kind))


def _truth(scene: Scene, images: TrueImages, given: Given) -> Truth:
    water, flight, ground = scene.spec.water, scene.flight, scene.ground
    return Truth(
        spec=scene.spec,
        stations=flight.stations,
        attitude=flight.attitude,
        tide=flight.tide,
        tide_error=given.water.error,
        index=water.index if water else None,
        tilt=np.array(water.tilt if water else (0.0, 0.0)) * ARC_SECOND,
        middle=flight.water.middle,
        points=ground.places[given.rows],
        bathymetric=ground.bathymetric[given.rows],
        images=images.xy,
        seen=given.links[images.point],
        refracted=images.refracted,
        swapped=given.names.swapped,
        misnamed=given.names.misnamed,
        control_error=given.control.error,
        gross_control=given.control.gross,
        blunders=given.plates.blunders,
        levels=ground.levels,
        base_lengths=given.bases.true,
        distances=given.distances.true,
        height_differences=given.height_differences.true,
        parameters=given.parameters,
    )


def _block(scene: Scene, given: Given) -> model.Block:
    """Return the block. Raises `SpecError` where a shore point is not measured twice."""
    camera, flight, rows, links = scene.spec.camera, scene.flight, given.rows, given.links
    bases, distances, heights = given.bases, given.distances, given.height_differences
    return model.Block(
        titles=scene.spec.title,
        options=_options(scene.spec),
        ellipsoid=scene.world.ellipsoid,
        water=given.water.card,
        cameras=model.Cameras(
            ids=np.array([camera.id]),
            focal_length=np.array([camera.focal_length]),
            principal_point=np.array([camera.principal_point]),
            format_size=np.array([camera.format]),
        ),
        photos=model.Photos(
            ids=np.array(flight.ids),
            camera=np.zeros(len(flight.ids), dtype=int),
            **given.stations,
            tide=given.water.tide,
            tide_sigma=given.water.sigma,
            tide_group=given.water.group,
            tide_day=given.water.day,
            time=np.where(np.isnan(given.water.tide), np.nan, flight.time),
        ),
        points=model.Points(ids=np.array(given.control.names)[rows], bathymetric=scene.ground.bathymetric[rows]),
        plates=dataclasses.replace(given.plates.table, point=links[given.names.point]),
        control=dataclasses.replace(given.control.table, point=links[given.control.table.point]),
        equal_elevations=_equal_elevations(scene, links),
        air_bases=model.AirBases(photo=bases.point, length=bases.given, sigma=bases.sigma),
        distances=model.Distances(point=links[distances.point], length=distances.given, sigma=distances.sigma),
        height_differences=model.HeightDifferences(
            point=links[heights.point], difference=heights.given, sigma=heights.sigma
        ),
        waves=flight.waves.cards,
        wave_origin=flight.waves.origin,
        **given.parts,
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


def _equal_elevations(scene: Scene, links: IntArray) -> model.EqualElevations:
    """Return the groups of shore points. Raises `SpecError` where a member is not measured twice."""
    tables, ground = scene.spec.equal_elevation, scene.ground
    members = np.flatnonzero(ground.shore >= 0)
    members = members[np.argsort(ground.shore[members], kind="stable")]
    points = links[members]
    if np.any(points < 0):
        lost = ", ".join(ground.ids[row] for row in members[points < 0])
        raise SpecError.of(f"not measured on two photos: {lost}", field="equal_elevation")
    return model.EqualElevations(
        ids=np.array([shore.id for shore in tables], dtype=str),
        sigma=np.array([shore.sigma for shore in tables]),
        group=ground.shore[members],
        point=points,
    )
