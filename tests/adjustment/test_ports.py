"""Cameras behind flat ports, under or over water: partials, recovery, errors against sigmas, what is held."""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

import musatpy
from altered import altered, with_options
from blocks import converged, simulation
from musatpy.adjustment import sightings
from musatpy.adjustment.iteration import State
from musatpy.adjustment.job import prepared
from musatpy.adjustment.network import Network
from musatpy.errors import AdjustmentError
from musatpy.model import (
    PORT_PARAMETERS,
    Block,
    CauseSearch,
    Grade,
    Initial,
    LensUnknowns,
    ObservationKind,
    Ports,
    Program,
)
from musatpy.model.tables import empty, stacked
from musatpy.probability import chi_square_limit
from musatpy.simulation import Simulation

PORT, LENS = ObservationKind.PORT, ObservationKind.LENS
TRUE = (35.0, 10.0, 1.492, 1.335, 0.5, -0.8)  # mm, 1, degrees


def tank(seed: int, *unknown: dict[str, Any], noise: float = 1.5, **tables: Any) -> Simulation:
    """Eight convergent photos of a tank, 1.5 m from its bottom, of a 35 mm camera; errors by the noise in um."""
    wrong = noise / 1.5
    spec: dict[str, Any] = {
        "job": {"system": "LOCL", "centre": [0.0, 0.0]},
        "camera": {"id": "T35", "focal_length": 28.0, "format": [36.0, 24.0], "margin": 0.5},
        "port": {
            **dict(zip(("distance", "thickness", "glass", "water"), TRUE, strict=False)),
            "tilt": list(TRUE[4:]),
            "unknown": list(unknown),
        },
        "flight": {
            "strips": 2,
            "photos": 4,
            "height": 1.5,
            "forward_overlap": 0.8,
            "side_overlap": 0.7,
            "reverse_alternate": True,
            "attitude_scatter": [5.0, 5.0, 30.0],
            "station_scatter": [0.06, 0.06, 0.15],
        },
        "terrain": {"level": 0.0, "relief": 0.25, "wavelength": 1.3},
        "points": {"per_site": 2, "extra": [{"number": 70}]},
        "measurement": {"noise": noise, "sigma": 1.5},
        "control": [{"kind": "full", "number": 6, "sigma": 0.0005, "error": 0.0005 * wrong}],
        "stations": {"position_error": 0.02, "attitude_error": 0.5},
        "options": {"program": "IIIA", "translation_limit": 0.00001, "rotation_limit": 0.1},
    }
    return simulation(seed, **(spec | tables))


OPTIONS = {"program": "IIIA", "translation_limit": 0.00001, "rotation_limit": 0.1}


def window(seed: int, *unknown: dict[str, Any], noise: float = 1.5, **tables: Any) -> Simulation:
    """Eight photos from 3 m over a shore, through 25 mm of glass with air on both sides; half of the points wet."""
    glass = {"distance": 35.0, "thickness": 25.0, "glass": 1.52, "water": 1.0, "unknown": list(unknown)}
    spec: dict[str, Any] = {
        "port": {**glass, "tilt": list(tables.pop("tilt", (4.0, -6.0)))},
        "flight": {
            "strips": 2,
            "photos": 4,
            "height": 3.0,
            "forward_overlap": 0.8,
            "side_overlap": 0.6,
            "attitude_scatter": [5.0, 5.0, 30.0],
        },
        "terrain": {"level": 0.3, "relief": 0.3, "wavelength": 2.0},
        "water": {"level": 0.0, "index": 1.34},
        "shoal": [{"share": 0.5, "depth": [0.3, 1.5]}],
        "points": {"extra": [{"number": 20}]},
    }
    return tank(seed, noise=noise, **(spec | tables))


@lru_cache
def first(seed: int) -> Block:
    return tank(seed, *({"name": name, "sigma": 1.0, "error": 0.0} for name in PORT_PARAMETERS)).block


def with_lens(block: Block, *names: str, value: float = np.nan, sigma: float = np.nan) -> Block:
    """The block with parameters of its lens unknown."""
    count = len(names)
    table = LensUnknowns(
        camera=np.zeros(count, dtype=int),
        parameter=np.array(names),
        value=np.full(count, value),
        sigma=np.full(count, sigma),
    )
    return replace(block, lens_unknowns=stacked([table, block.lens_unknowns]))


@pytest.mark.parametrize("tilted", [False, True])
@pytest.mark.parametrize("lens", [(), ("F", "K1")])
def test_partials_are_those_of_differences(tilted: bool, lens: tuple[str, ...]) -> None:
    """Central differences of images by port, point and station: 1e-6 of the largest; with a lens, too."""
    job, state = prepared(with_lens(first(1), *lens), None)
    network, values = job.network, np.array([*TRUE[:4], *(TRUE[4:] if tilted else (0.0, 0.0))])
    state = replace(state, parameters={**state.parameters, PORT: values})
    if lens:
        state = replace(state, parameters={**state.parameters, LENS: np.array([28.1, 2e-5])})
    rays = np.arange(0, len(network.photo), 3)
    ground = state.ground[network.point[rays]]
    check_partials(network, state, rays, ground)


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (4.0, -6.0)])
def test_partials_through_port_and_water_are_those_of_differences(tilt: tuple[float, float]) -> None:
    """The same of a window in air, wet and dry points, and by level, tilt and index of the water."""
    water = {"water_level": "ONE", "water_tilt": "ADJUST", "water_index": "ADJUST"}
    block = window(1, {"name": "PT", "error": 0.0}, tilt=tilt, options=OPTIONS | water).block
    job, state = prepared(block, None)
    network = job.network.with_plates(job.network.xy, block.points.bathymetric[job.network.point])
    rays = np.arange(0, len(network.photo), 3)
    assert 0 < network.refracted[rays].sum() < len(rays)
    check_partials(network, state, rays, state.ground[network.point[rays]])


def check_partials(network: Network, state: State, rays: np.ndarray, ground: np.ndarray) -> None:
    """Check them by ports, points, stations and water. One port is unknown in all that it has, or only in PT."""
    images = sightings.images(network, state, rays, ground)
    np.testing.assert_allclose(images.xy, sightings.image_coordinates(network, state, rays, ground), atol=1e-12)
    half = sightings.images(network, state, rays, ground, stations=False)
    np.testing.assert_allclose(half.by_ground, images.by_ground, atol=1e-12)
    assert images.by_port is not None and network.ports is not None

    def agrees(partials: np.ndarray, size: float, *ends: tuple[Network, State, np.ndarray]) -> None:
        plus, minus = (sightings.image_coordinates(n, s, rays, g) for n, s, g in ends)
        expected = (plus - minus) / (2.0 * size)
        np.testing.assert_allclose(partials, expected, atol=1e-6 * np.abs(expected).max() + 1e-12)

    def at(size: float, name: str, by: np.ndarray) -> list[Any]:
        return [(network, replace(state, **{name: getattr(state, name) + s * size * by}), ground) for s in (1, -1)]

    held, nothing = network.ports.table(state.parameters[PORT]), np.zeros((1, 6), dtype=bool)
    for column, size in enumerate((1e-2, 1e-2, 1e-5, 1e-5, 1e-3, 1e-3)):
        glass = [replace(network.ports, held=held + s * size * np.eye(6)[column], unknown=nothing) for s in (1, -1)]
        known = replace(state, parameters={**state.parameters, PORT: np.zeros(0)})
        agrees(
            images.by_port[..., column], size, *((network.with_parameters({PORT: g}), known, ground) for g in glass)
        )
    for axis, step in enumerate(np.eye(3)):
        agrees(images.by_ground[..., axis], 1e-5, *((network, state, ground + s * 1e-5 * step) for s in (1, -1)))
        agrees(images.by_station[..., axis], 1e-5, *at(1e-5, "position", network.axes[:, axis]))
        agrees(images.by_station[..., 3 + axis], 1e-5, *at(1e-5, "attitude", step))
    if images.by_water is not None:
        agrees(images.by_water[..., 0], 1e-4, *at(1e-4, "tide", np.ones(network.photos)))
        agrees(images.by_water[..., 1], 1e-5, *at(1e-5, "tilt", np.eye(2)[0]))
        agrees(images.by_water[..., 2], 1e-5, *at(1e-5, "tilt", np.eye(2)[1]))
        agrees(images.by_water[..., 3], 1e-5, *at(1e-5, "index", np.ones(())))


def test_images_through_port_and_water_are_those_of_the_simulation() -> None:
    """A block without errors, of wet and dry points, is found to the digits of its cards."""
    given = window(2, noise=0.0, job={"system": "GEOG", "centre": [18.0, -65.0]})
    assert 0 < given.truth.refracted.sum() < len(given.truth.refracted)
    solution = converged(given.block)
    np.testing.assert_allclose(solution.plates.residual, 0.0, atol=2e-6)
    np.testing.assert_allclose(solution.stations.position, given.truth.stations.job, atol=1e-6)
    np.testing.assert_allclose(solution.stations.attitude, given.truth.attitude, atol=1e-6)


def at_rest(block: Block, ground: np.ndarray) -> np.ndarray:
    """The images (m, 2) of points (p, 3) about the origin, from the stations of the cards, flagged ones wet."""
    job, state = prepared(block, None)
    network = job.network.with_plates(job.network.xy, block.points.bathymetric[job.network.point])
    shift = network.frame.working(np.zeros((1, 3)))
    rays = np.arange(len(network.photo))
    return sightings.image_coordinates(network, state, rays, (ground + shift)[network.point])


def test_limits_of_port_and_water() -> None:
    """Glass of air: the camera over the water without port. Water of air: the port alone, all points dry."""
    given = window(3)
    block, ground = given.block, given.truth.points.xyz
    through = at_rest(block, ground)
    air = replace(block, ports=replace(block.ports, glass_index=np.ones(1), thickness=np.zeros(1)))
    without = replace(block, ports=empty(Ports))
    np.testing.assert_allclose(at_rest(air, ground), at_rest(without, ground), atol=1e-9)
    assert block.water is not None
    of_air = replace(block, water=replace(block.water, index=1.0))
    dry = altered(block, points={"bathymetric": np.zeros(len(block.points.ids), dtype=bool)})
    np.testing.assert_allclose(at_rest(of_air, ground), at_rest(dry, ground), atol=1e-9)
    assert np.abs(through - at_rest(without, ground)).max() > 0.01


def test_a_window_that_looks_straight_down_by_scalars() -> None:
    """Air, glass, air and water, one below the other: the tangent in air by bisection, images to 1e-10 mm."""
    given = window(4, tilt=(0.0, 0.0))
    block, ground = given.block, given.truth.points.xyz
    attitude = np.zeros_like(block.photos.attitude)
    block = altered(block, photos={"attitude": attitude})
    away = ground[block.plates.point] - block.photos.position[block.plates.photo]
    wet = block.points.bathymetric[block.plates.point]
    level = np.where(wet, 0.0 - block.photos.position[block.plates.photo, 2], away[:, 2])
    layers = [(0.035, 1.0), (0.025, 1.52), (-level - 0.060, 1.0), (level - away[:, 2], 1.34)]
    low, high = np.zeros(len(away)), np.ones(len(away))  # sines in air
    for _ in range(60):
        middle = (low + high) / 2.0
        reached = sum(depth * middle / np.sqrt(n**2 - middle**2) for depth, n in layers)
        short = reached < np.linalg.norm(away[:, :2], axis=1)
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    radius = 28.0 * low / np.sqrt(1.0 - low**2)
    xy = radius[:, None] * away[:, :2] / np.linalg.norm(away[:, :2], axis=1)[:, None]
    np.testing.assert_allclose(at_rest(block, ground), xy, atol=1e-10)


def test_images_are_those_of_the_simulation_and_rays_go_through_their_points() -> None:
    """At the truth: images to their digits (1 nm), straight rays to 1 um of the points."""
    given = tank(2, noise=0.0)
    job, state = prepared(given.block, None)
    places, network = given.truth.points.xyz, job.network
    shift = np.asarray(network.frame.working(np.zeros((1, 3))))  # m, of the working frame
    at_truth = replace(state, position=given.truth.stations.xyz + shift, attitude=given.truth.attitude)
    rays = np.arange(len(network.photo))
    ground = places[network.point] + shift
    np.testing.assert_allclose(sightings.image_coordinates(network, at_truth, rays, ground), network.xy, atol=2e-6)
    origin, direction = sightings.straight_rays(network, at_truth, rays)
    np.testing.assert_allclose(np.cross(ground - origin, direction), 0.0, atol=1e-6)


def test_a_port_is_found_from_images_without_error() -> None:
    """Distance, thickness and tilts, free: to a hundredth of their sigmas; from wrong values."""
    names = ("PD", "PT", "PX", "PY")
    errors = {"PD": 2.0, "PT": 1.0, "PX": 0.5, "PY": 0.5}
    solution = converged(tank(3, *({"name": name, "error": errors[name]} for name in names), noise=0.0).block)
    table = solution.parameters
    assert table is not None and table.parameter.tolist() == list(names)
    true = [TRUE[PORT_PARAMETERS.index(name)] for name in names]
    np.testing.assert_array_less(np.abs(table.value - true), 0.01 * table.spread / solution.sigma0)


def test_indices_held_by_control_are_found() -> None:
    """Scale is that of control, and the index of the water outside is no longer one with it."""
    solution = converged(tank(4, {"name": "PW", "error": 0.01}, noise=0.0).block)
    assert solution.parameters is not None
    assert solution.parameters.value[0] == pytest.approx(1.335, abs=1e-5)


@pytest.mark.slow
def test_a_known_port_is_no_unknown() -> None:
    """Nothing is estimated of it; without glass and water it is no port at all."""
    block = tank(5).block
    solution = converged(block)
    assert solution.parameters is None and "parameters of ports" not in solution.unknowns
    nothing = {name: np.ones(1) for name in ("glass_index", "water_index")}
    dry = converged(replace(block, ports=replace(block.ports, **nothing)), max_iterations=60)
    none = converged(replace(block, ports=replace(block.ports, **{n: v[:0] for n, v in vars(block.ports).items()})))
    np.testing.assert_allclose(dry.stations.position, none.stations.position, atol=1e-9)
    np.testing.assert_allclose(dry.sum_of_squares, none.sum_of_squares, rtol=1e-9)
    assert solution.sigma0 < 1.3 and none.sigma0 > 3.0


@pytest.mark.slow
def test_stations_are_computed() -> None:
    """From images and control alone, the same solution."""
    block = tank(6, {"name": "PD", "error": 2.0}).block
    given, computed = converged(block), converged(block, initial=Initial.COMPUTE)
    np.testing.assert_allclose(computed.stations.position, given.stations.position, atol=1e-6)


@pytest.mark.slow
def test_an_error_of_what_is_held_moves_stations_as_it_is_said() -> None:
    """Index and distance of a port on a card that is wrong: the station that moves most, to 2 %."""
    block = tank(10).block
    solution = converged(block)
    held = solution.held
    assert held is not None
    for name, attribute, size in (
        ("water at port, T35", "water_index", 1e-4),
        ("distance of port, T35", "distance", 0.05),
    ):
        row = held.names.tolist().index(name)
        card = {attribute: getattr(block.ports, attribute) + size}
        moved = converged(replace(block, ports=replace(block.ports, **card)))
        shift = np.linalg.norm(moved.stations.position - solution.stations.position, axis=1)
        assert shift[held.moved[row, 0]] == pytest.approx(size * held.shift[row, 0], rel=0.02)


def test_what_nothing_determines_is_named() -> None:
    """A flat strip without tilts: focal length, distance and index are one with the heights of the stations."""
    tables = {"control": [{"kind": "full", "number": 4, "sigma": 0.0005}], "terrain": {"relief": 0.0}}
    flight = {"strips": 1, "photos": 3, "height": 1.5, "attitude_scatter": 0.0}
    block = with_lens(tank(7, {"name": "PD"}, {"name": "PW"}, flight=flight, **tables).block, "F")
    solution = musatpy.adjust(block, causes=CauseSearch.NONE)
    assert solution.parameters is not None and np.isnan(solution.parameters.sigma).all()
    verdict = musatpy.verdict(solution)
    assert verdict.grade is Grade.DOUBTFUL
    assert "PD of camera T35" in str(verdict) and "PW of camera T35 (correlation 0.99" in str(verdict)


@pytest.mark.slow
def test_a_scale_bar_is_enough() -> None:
    """A free network with three distances: distance and index of the port are determined."""
    unknown = ({"name": "PD", "error": 2.0}, {"name": "PW", "error": 0.003})
    options = {"program": "IIIA", "datum": "FREE"}
    bars = [{"number": 3, "sigma": 0.0002, "error": 0.0002}]
    solution = converged(tank(7, *unknown, control=[], distance=bars, options=options).block)
    table = solution.parameters
    assert table is not None and all(verdict.startswith("determined") for verdict in table.verdicts.tolist())
    assert (np.abs(table.value - [35.0, 1.335]) < 3.0 * table.sigma).all()


def test_a_free_network_without_scale_is_refused() -> None:
    """The distance of the glass grows with the block."""
    options = {"program": "IIIA", "datum": "FREE"}
    with pytest.raises(AdjustmentError, match=r"free in one motion.*scale"):
        musatpy.adjust(tank(7, {"name": "PD"}, control=[], options=options).block, causes=CauseSearch.NONE)


def test_ports_are_printed_and_recorded() -> None:
    block = tank(8, {"name": "PD", "sigma": 0.5}).block
    solution = converged(block)
    text = musatpy.listing(solution)
    assert "Input: Flat port (PRT)" in text and "Adjusted Parameters" in text
    assert solution.observed is not None and (solution.observed.kind == PORT).sum() == 1


def test_iia_has_no_ports() -> None:
    with pytest.raises(AdjustmentError, match="camera T35 is behind a port"):
        musatpy.adjust(with_options(first(1), program=Program.IIA), causes=CauseSearch.NONE)


MONTE_CARLO = ({"name": "PD", "error": 3.0}, {"name": "PX", "error": 0.3}, {"name": "PY", "error": 0.3})


def draw(seed: int) -> tuple[np.ndarray, float]:
    """Errors over sigmas of one draw, and the share of sigma0 that is larger by chance.

    PD, PX, PY, free, F by a prior, means of squares of stations, attitudes, points.
    """
    given, focal = tank(seed, *MONTE_CARLO), np.random.default_rng(seed).normal(28.0, 0.05)
    block = with_lens(given.block, "F", value=focal, sigma=0.05)
    solution = musatpy.adjust(block, causes=CauseSearch.NONE)
    assert solution.converged and solution.parameters is not None, (seed, solution.reason)
    true = {"F": 28.0} | dict(zip(PORT_PARAMETERS, TRUE, strict=True))
    table, s0 = solution.parameters, solution.sigma0
    error = np.array([value - true[name] for name, value in zip(table.parameter, table.value, strict=True)])
    of_stations = np.sqrt(np.einsum("nii->ni", solution.stations.covariance))
    position = (solution.stations.position - given.truth.stations.job) / of_stations[:, :3]
    attitude = (solution.stations.attitude - given.truth.attitude) / of_stations[:, 3:6]
    points = (solution.points.position - given.truth.points.job) / np.sqrt(
        np.einsum("nii->ni", solution.points.covariance)
    )
    squares = [np.nanmean(np.square(of * s0)) for of in (position, attitude, points)]
    return np.array([*np.square(error / table.spread * s0), *squares]), solution.sum_of_squares / chi_square_limit(
        solution.degrees_of_freedom, 1.644853627
    )


@pytest.mark.slow
def test_errors_are_as_large_as_their_sigmas() -> None:
    """Fifty draws: RMS within three of its sigma (.1), of stations and points .05; sigma0 passes its test."""
    squares, share = zip(*(draw(seed) for seed in range(1000, 1050)), strict=True)
    rms = np.sqrt(np.mean(squares, axis=0))
    np.testing.assert_array_less(np.abs(rms[:4] - 1.0), 0.30)
    np.testing.assert_array_less(np.abs(rms[4:] - 1.0), 0.15)
    assert 0.86 < np.mean(np.array(share) < 1.0) < 0.99
