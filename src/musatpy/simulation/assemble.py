"""Assembly of the block: the tables of the model, in the order of a deck."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from musatpy.errors import Problem, SpecError
from musatpy.model import (
    AirBases,
    Block,
    Cameras,
    Control,
    CoordinateSystem,
    Distortion,
    EqualElevations,
    FiducialMeasurements,
    Fiducials,
    Options,
    Photos,
    PlateMeasurements,
    Points,
    Refraction,
    Water,
    Weights,
)
from musatpy.simulation.draws import Draws
from musatpy.simulation.flight import TrueFlight
from musatpy.simulation.ground import Ground
from musatpy.simulation.images import Images
from musatpy.simulation.measure import GivenControl, GivenStations, MeasuredPlates
from musatpy.simulation.spec import SimulationSpec
from musatpy.simulation.world import METRE_DECIMALS, World
from musatpy.units import ARC_SECOND, MICROMETRE

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Order:
    """Order of the points in the deck, which is that of their first plate cards."""

    rows: IntArray  # (p,) row of the ground of each point of the block
    links: IntArray  # row of the block of each point of the ground, -1 where it is not measured


def order_of_appearance(images: Images, ground: Ground) -> Order:
    """Return the order of the measured points."""
    found, first = np.unique(images.point, return_index=True)
    rows = found[np.argsort(first)]
    links = np.full(len(ground.ids), -1)
    links[rows] = np.arange(len(rows))
    return Order(rows=rows, links=links)


def assemble(
    spec: SimulationSpec,
    world: World,
    flight: TrueFlight,
    ground: Ground,
    images: Images,
    control: GivenControl,
    plates: MeasuredPlates,
    stations: GivenStations,
    order: Order,
    bases: AirBases,
) -> Block:
    """Return the block. Raises `SpecError` where a shore point is not measured twice."""
    no_links, no_text, no_xy = np.empty(0, dtype=np.int64), np.empty(0, dtype=str), np.empty((0, 2))
    return Block(
        titles=spec.title,
        options=_options(spec),
        ellipsoid=world.ellipsoid,
        water=Water(index=spec.water.index, sigma=spec.water.index_sigma) if spec.water else None,
        cameras=_cameras(spec),
        distortion=Distortion(camera=no_links, kind=no_text, values=np.empty((0, 3))),
        fiducials=Fiducials(camera=no_links, ids=no_text, xy=no_xy, sigma=no_xy),
        photos=_photos(spec, flight, stations),
        fiducial_measurements=FiducialMeasurements(photo=no_links, ids=no_text, xy=no_xy, sigma=no_xy),
        points=Points(ids=np.array(control.names)[order.rows], bathymetric=ground.bathymetric[order.rows]),
        plates=_plates(images, plates, order),
        control=_control(control, order),
        equal_elevations=_equal_elevations(spec, ground, order),
        air_bases=bases,
    )


def _options(spec: SimulationSpec) -> Options:
    """Return the option card's values; the program's own defaults where the spec has none."""
    keys = spec.options
    units = {"rotation_limit": ARC_SECOND}
    given = {
        name: getattr(keys, name) * units.get(name, 1)
        for name in ("max_iterations", "max_passes", "rotation_limit", "translation_limit", "water_limit")
        if getattr(keys, name) is not None
    }
    return Options(
        system=CoordinateSystem(spec.job.system),
        refraction=Refraction(keys.refraction),
        weights=Weights(keys.weights),
        plate_sigma=spec.measurement.sigma * MICROMETRE,
        **given,
    )


def _cameras(spec: SimulationSpec) -> Cameras:
    camera = spec.camera
    return Cameras(
        ids=np.array([camera.id]),
        focal_length=np.array([camera.focal_length]),
        principal_point=np.array([camera.principal_point]),
        format_size=np.array([camera.format]),
    )


def _photos(spec: SimulationSpec, flight: TrueFlight, stations: GivenStations) -> Photos:
    n = len(flight.ids)
    tide_sigma = spec.water.tide_sigma if spec.water else None
    return Photos(
        ids=np.array(flight.ids),
        camera=np.zeros(n, dtype=int),
        position=stations.position,
        position_sigma=stations.position_sigma,
        attitude=stations.attitude,
        attitude_sigma=stations.attitude_sigma,
        tide=flight.tide,
        tide_sigma=np.full(n, np.nan if tide_sigma is None else tide_sigma),
    )


def _plates(images: Images, plates: MeasuredPlates, order: Order) -> PlateMeasurements:
    return PlateMeasurements(
        photo=images.photo,
        point=order.links[images.point],
        xy=plates.xy,
        sigma=plates.sigma,
        triangulated=plates.triangulated,
    )


def _control(control: GivenControl, order: Order) -> Control:
    return Control(
        point=order.links[control.point],
        kind=control.kind,
        fixed=control.fixed,
        position=control.position,
        sigma=control.sigma,
    )


def _equal_elevations(spec: SimulationSpec, ground: Ground, order: Order) -> EqualElevations:
    """Return the groups of shore points. Raises `SpecError` where a member is not measured twice."""
    members = np.flatnonzero(ground.shore >= 0)
    members = members[np.argsort(ground.shore[members], kind="stable")]
    points = order.links[members]
    if np.any(points < 0):
        lost = ", ".join(ground.ids[row] for row in members[points < 0])
        raise SpecError([Problem(field="equal_elevation", message=f"not measured on two photos: {lost}")])
    return EqualElevations(
        ids=np.array([shore.id for shore in spec.equal_elevation], dtype=str),
        sigma=np.array([shore.sigma for shore in spec.equal_elevation]),
        group=ground.shore[members],
        point=points,
    )


def air_bases(spec: SimulationSpec, flight: TrueFlight, draws: Draws) -> tuple[AirBases, FloatArray]:
    """Return the given air bases and the true lengths (b,). Raises `SpecError` where a photo is unknown."""
    rows = {name: row for row, name in enumerate(flight.ids)}
    unknown = [name for base in spec.air_base for name in base.photos if name not in rows]
    if unknown:
        raise SpecError([Problem(field="air_base", message=f"unknown photos: {', '.join(unknown)}")])
    photo = np.array([[rows[name] for name in base.photos] for base in spec.air_base], dtype=int).reshape(-1, 2)
    ends = flight.stations.xyz[photo]
    true = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    error = draws.normal("air bases", len(photo)) * np.array([base.error for base in spec.air_base])
    bases = AirBases(
        photo=photo,
        length=np.round(true + error, METRE_DECIMALS),
        sigma=np.array([base.sigma for base in spec.air_base]),
    )
    return bases, true
