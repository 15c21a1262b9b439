"""The reference adjustment is itself held against identities and exact data before it judges.

And against printed answers, in `test_real_cases`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyproj
import pytest

from altered import altered
from musatpy.model import Control, ControlKind, CoordinateSystem
from musatpy.model.tables import empty
from musatpy.units import ARC_SECOND
from reference import dense_bundle, networks
from reference.earth import earth_of
from reference.rays import sighted

GEOGRAPHIC = networks.Plan(
    system=CoordinateSystem.GEOGRAPHIC,
    submerged=True,
    kinds=(ControlKind.VERTICAL, ControlKind.HORIZONTAL),
    fixed_every=4,
    station_sigma=2.0,
    attitude_sigma=60 * ARC_SECOND,
    equal_elevation=True,
    air_base=True,
)


def test_geodesy_agrees_with_proj() -> None:
    earth = earth_of(networks.simulate(GEOGRAPHIC).block)
    proj = pyproj.Transformer.from_pipeline("+proj=cart +ellps=clrk66")
    native = np.array([[0.3, -1.4, 3000.0], [-1.2, 2.9, -30.0], [0.0, 0.0, 0.0]])
    expected = np.stack(proj.transform(native[:, 1], native[:, 0], native[:, 2], radians=True), axis=-1)
    # 1e-8 m: coordinates of 6.4e6 m carry 1e-9 m of rounding in each library
    np.testing.assert_allclose(earth.cartesian(native) + earth.origin, expected, rtol=0, atol=1e-8)
    step = np.array([0.3, -0.2, 0.5])
    moved = earth.cartesian(earth.shift(native, step)) - earth.cartesian(native)
    enu = np.einsum("rij,rj->ri", earth.frame(native), moved)
    # second order in the step over the earth's radius: 1e-7 m
    np.testing.assert_allclose(enu, np.broadcast_to(step, (3, 3)), rtol=0, atol=2e-7)


@pytest.mark.parametrize("distance", [0.0, 1e-3, 10.0, 2000.0, 30000.0])
@pytest.mark.parametrize("depth", [1e-6, 0.5, 30.0, 500.0])
@pytest.mark.parametrize("index", [1.0, 1.34])
def test_water_point_obeys_snell(distance: float, depth: float, index: float) -> None:
    camera = np.array([[0.6 * distance, -0.8 * distance, 1000.0]])
    water = sighted(camera, np.array([depth]), index)[0]
    assert water[2] == depth
    air = camera[0] - water
    sines = [np.hypot(v[0], v[1]) / np.linalg.norm(v) for v in (air, water)]
    assert sines[0] == pytest.approx(index * sines[1], abs=1e-12)  # rounding of vectors of 1e3 to 3e4 m
    across = air[0] * water[1] - air[1] * water[0]  # one vertical plane holds both rays
    assert abs(across) <= 1e-12 * (distance + 1.0) * (depth + 1.0)


def test_point_above_the_water_is_seen_straight() -> None:
    assert not sighted(np.array([[700.0, 20.0, 900.0]]), np.array([-0.1]), 1.34).any()


def test_jacobian_against_central_differences() -> None:
    simulated = networks.simulate(GEOGRAPHIC)
    network = dense_bundle.Network(simulated.block, refraction=True)
    state = dense_bundle.starting_state(network, simulated.truth)
    jacobian = network.jacobian(state)
    for column in range(0, network.size, 5):
        step = np.zeros(network.size)
        turn = column < network.unknowns["station"] and column % 6 >= 3
        step[column] = 1e-5 if turn else 0.05
        up, down = (network.misclosures(network.moved(state, s)) for s in (step, -step))
        numeric = (up - down) / (2.0 * step[column])
        # the third derivatives of a projection from 3 km leave 1e-9 of it, rounding of the misclosures 1e-6
        np.testing.assert_allclose(jacobian[:, column], numeric, rtol=1e-6, atol=1e-6 * np.abs(numeric).max())


@pytest.mark.parametrize("system", list(CoordinateSystem))
@pytest.mark.parametrize("submerged", [False, True])
def test_exact_data_give_the_truth(system: CoordinateSystem, submerged: bool) -> None:
    plan = networks.Plan(
        system=system,
        submerged=submerged,
        kinds=(ControlKind.VERTICAL, ControlKind.HORIZONTAL, ControlKind.CHECK),
        fixed_every=3,
        equal_elevation=True,
        air_base=True,
        noise=0.0,
    )
    simulated = networks.simulate(plan)
    result = dense_bundle.solve(simulated.block, refraction=submerged)
    earth = earth_of(simulated.block)
    found, truth = (earth.cartesian(earth.native(x)) for x in (result.position, simulated.truth.position))
    np.testing.assert_allclose(found, truth, rtol=0, atol=1e-6)  # m: rounding of 1e-9 m in 6.4e6 m, amplified
    np.testing.assert_allclose(
        result.attitude_in_given_frame, simulated.truth.attitude, rtol=0, atol=1e-4 * ARC_SECOND
    )
    assert result.sum_of_squares < 1e-10


def test_systems_give_one_answer() -> None:
    """Geographic and geocentric decks of one job differ in their words only."""
    geographic = networks.simulate(replace(GEOGRAPHIC, kinds=(ControlKind.FULL,))).block
    earth = earth_of(geographic)
    photos, control = geographic.photos, geographic.control
    geocentric = altered(
        geographic,
        options={"system": CoordinateSystem.GEOCENTRIC},
        photos=replace(photos, position=earth.cartesian(photos.position) + earth.origin),
        control=replace(control, position=earth.cartesian(control.position) + earth.origin),
    )
    a, b = (dense_bundle.solve(block, refraction=True) for block in (geographic, geocentric))
    sigma = np.sqrt(np.diagonal(a.covariance, axis1=1, axis2=2))
    assert np.abs((a.attitude - b.attitude) / sigma[:, 3:]).max() < 1e-6
    np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-6, atol=0)


@pytest.mark.slow
def test_sigma0_is_one_on_the_average() -> None:
    """Noise of the stated sigmas gives sum of squares / dof = 1 within its chi-square spread."""
    totals, dofs = 0.0, 0
    for seed in range(6):
        result = dense_bundle.solve(networks.simulate(replace(GEOGRAPHIC, seed=seed)).block, refraction=True)
        totals, dofs = totals + result.sum_of_squares, dofs + result.degrees_of_freedom
    assert totals / dofs == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / dofs))


def test_free_block_is_refused() -> None:
    block = networks.simulate(networks.Plan(photos_per_strip=2)).block
    with pytest.raises(np.linalg.LinAlgError):
        dense_bundle.solve(replace(block, control=empty(Control)), refraction=False)
