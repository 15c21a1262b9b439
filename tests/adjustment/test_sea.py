"""Blocks photographed through waves: both programs find the truth where they know the waves."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

import musatpy
from altered import altered, with_options
from musatpy.adjustment.job import prepared
from musatpy.adjustment.sightings import condition_rays, images
from musatpy.adjustment.wavy_water import Sea, WorkingSea
from musatpy.errors import AdjustmentError
from musatpy.model import Block, CoordinateSystem, Program, Refraction, Treatment
from musatpy.refraction.waves import sinusoidal
from reference import compare, waves
from reference.networks import Plan

WAVES = sinusoidal(
    amplitude=[0.5, 0.15], length=[92.0, 25.0], azimuth=[0.5, 1.3], speed=[9.2, 6.2], crest=[7.0, 2.0]
)
PLANS = {
    system.value: Plan(
        system=system, submerged=True, sea_control=True, photos_per_strip=3, height=1500.0, base=650.0, noise=0.0,
        start_error=(2.0, 1e-3), control_errors=False, seed=3,
    )
    for system in CoordinateSystem
}  # fmt: skip
INTERVAL = 7.0  # s


@lru_cache
def photographed(system: str) -> tuple[Block, Sea, np.ndarray]:
    """Return a block with images through waves, without noise, its sea, and its true points."""
    block, time, origin, truth = waves.photographed(PLANS[system], WAVES, INTERVAL)
    return block, Sea(surface=WAVES, time=time, origin=origin), truth


def solved(system: str, program: Program, sea: bool = True) -> np.ndarray:
    """Return the differences (p, 3) m from the truth of the points found."""
    block, known, truth = photographed(system)
    block = with_options(block, program=program, refraction=Refraction.RIGOROUS)
    solution = musatpy.adjust(block, sea=known if sea else None)
    assert solution.converged, solution.reason
    found = np.isfinite(solution.points.position).all(axis=1)
    return compare.enu_difference(block, solution.points.position[found], truth[found])


@pytest.mark.slow  # `test_wave_decks` has the same of waves on cards
@pytest.mark.parametrize("program", list(Program))
@pytest.mark.parametrize("system", list(PLANS))
def test_the_truth_is_found_through_known_waves(system: str, program: Program) -> None:
    # rounding; on the ellipsoid the axes of the waves turn with the vertical, which the images do not know: 1e-5 m
    tolerance = 1e-9 if system == "LOCL" else 1e-4
    assert np.abs(solved(system, program)).max() < tolerance
    assert np.abs(solved(system, program, sea=False)).max() > 0.1  # what taking the water for level costs


@pytest.mark.parametrize("system", list(PLANS))
def test_partials_of_images_and_rays_are_those_of_their_functions(system: str) -> None:
    """By station and ground point; central differences of 1 mm leave 2e-6 of the largest element."""
    block, sea, _ = photographed(system)
    job, state = prepared(with_options(block, program=Program.IIIA, refraction=Refraction.RIGOROUS), None, sea)
    rays = np.flatnonzero(block.points.bathymetric[job.network.point])
    network = job.network.with_plates(job.network.xy, block.points.bathymetric[job.network.point])
    ground = state.ground[network.point[rays]]
    at = images(network, state, rays, ground)
    bent = condition_rays(network, state, rays, network.xy[rays], ground)
    scale, ray_scale = np.abs(at.by_ground).max(), np.abs(bent.by_station[:, :, :3]).max()
    for axis in range(3):
        step = 1e-3 * np.eye(3)[axis]
        fore, aft = (images(network, state, rays, ground + sign * step).xy for sign in (1.0, -1.0))
        np.testing.assert_allclose(at.by_ground[..., axis], (fore - aft) / 2e-3, atol=2e-6 * scale)
        shift = 1e-3 * network.axes[:, axis]
        moved = [replace(state, position=state.position + sign * shift) for sign in (1.0, -1.0)]
        fore, aft = (images(network, one, rays, ground).xy for one in moved)
        np.testing.assert_allclose(at.by_station[..., axis], (fore - aft) / 2e-3, atol=2e-6 * scale)
        rows = [condition_rays(network, one, rays, network.xy[rays], ground) for one in moved]
        fore, aft = (np.concatenate([one.origin, one.direction], axis=-1) for one in rows)
        np.testing.assert_allclose(bent.by_station[..., axis], (fore - aft) / 2e-3, atol=2e-6 * ray_scale)


@pytest.mark.slow
def test_a_calm_sea_is_level_water() -> None:
    block, sea, _ = photographed("GEOG")
    calm = replace(sea, surface=sinusoidal(amplitude=0.0, length=50.0, azimuth=0.0))
    block = altered(block, options={"program": Program.IIIA})
    with_sea, without = musatpy.adjust(block, sea=calm), musatpy.adjust(block)
    moved = compare.enu_difference(block, with_sea.points.position[:20], without.points.position[:20])
    assert np.nanmax(np.abs(moved)) < 1e-6  # where the iteration stops
    assert with_sea.sigma0 == pytest.approx(without.sigma0, rel=1e-6)


def test_axes_turn_with_the_vertical_and_not_about_it() -> None:
    block, sea, _ = photographed("GEOG")
    job, state = prepared(altered(block, options={"program": Program.IIIA}), None, sea)
    working = WorkingSea.of(sea, job.network.frame)
    ground = state.ground[np.isfinite(state.ground).all(axis=1)]
    R, height = working._local(ground)
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-14)
    np.testing.assert_allclose(height, job.network.frame.height(ground))
    turn = R @ working.axes.T  # from the axes at the origin
    # a turn about a horizontal axis has a symmetric horizontal part
    np.testing.assert_allclose(turn[:, 0, 1], turn[:, 1, 0], atol=1e-14)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"refraction": Refraction.WATPT}, "waves need the refraction RIGOROUS, or the program IIIA"),
        ({"program": Program.IIIA, "water_tilt": Treatment.ADJUST}, "exclude each other"),
    ],
)
def test_what_waves_cannot_be_joined_with_is_said(changes, message: str) -> None:
    block, sea, _ = photographed("LOCL")
    with pytest.raises(AdjustmentError, match=message):
        musatpy.adjust(replace(block, options=replace(block.options, **changes)), sea=sea)


def test_every_exposure_has_its_time() -> None:
    block, sea, _ = photographed("LOCL")
    block = altered(block, options={"program": Program.IIIA})
    for time in (np.zeros(2), np.array([0.0, np.nan, 9.0])):
        with pytest.raises(AdjustmentError, match="the time of every exposure"):
            musatpy.adjust(block, sea=replace(sea, time=time))
