"""Assembly of the block: the tables of the model, in the order of a deck."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from musatpy import model
from musatpy.arrays import BoolArray, IntArray
from musatpy.errors import Problem, SpecError
from musatpy.model.tables import empty
from musatpy.simulation.flight import TrueFlight
from musatpy.simulation.measure import GivenControl, GivenStations, MeasuredPlates
from musatpy.simulation.measured_ties import Tied
from musatpy.simulation.mistakes import Names
from musatpy.simulation.simulation_spec import SimulationSpec
from musatpy.simulation.terrain import Ground
from musatpy.simulation.true_images import Images
from musatpy.simulation.true_water import GivenWater
from musatpy.simulation.world import World
from musatpy.specs import echoed
from musatpy.units import ARC_SECOND, MICROMETRE

_NAMED: dict[str, Callable[[str], StrEnum]] = {  # what the texts of the options are
    "refraction": model.Refraction,
    "weights": model.Weights,
    "program": model.Program,
    "initial": model.Initial,
    "water_level": model.WaterLevel,
    "water_tilt": model.Treatment,
    "water_index": model.Treatment,
    "datum": model.Datum,
    "editing": model.Editing,
}


@dataclass(frozen=True, kw_only=True)
class Order:
    """Order of the points in the deck, which is that of their first plate cards."""

    rows: IntArray  # (p,) row of the ground of each point of the block
    links: IntArray  # row of the block of each point of the ground, -1 where it is not measured


def order_of_appearance(named: IntArray, points: int) -> Order:
    """Return the order in which plate cards, whose points are `named` (m,), first name each of so many points."""
    measured, first = np.unique(named, return_index=True)
    rows = measured[np.argsort(first)]
    links = np.full(points, -1)
    links[rows] = np.arange(len(rows))
    return Order(rows=rows, links=links)


@dataclass(frozen=True, kw_only=True)
class Given:
    """All that the deck says, with its errors."""

    water: GivenWater
    stations: GivenStations
    images: Images
    plates: MeasuredPlates
    names: Names
    flags: BoolArray  # (p,) of the ground: flagged as submerged
    control: GivenControl
    bases: model.AirBases
    distances: Tied
    height_differences: Tied


def assemble(
    spec: SimulationSpec, world: World, flight: TrueFlight, ground: Ground, given: Given, order: Order
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
        points=model.Points(ids=np.array(control.names)[order.rows], bathymetric=given.flags[order.rows]),
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
        air_bases=given.bases,
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
    given |= {name: kind(given[name]) for name, kind in _NAMED.items() if name in given}
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


def _equal_elevations(spec: SimulationSpec, ground: Ground, order: Order) -> model.EqualElevations:
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
