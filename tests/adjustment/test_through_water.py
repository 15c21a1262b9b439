"""Initial values of a photo over a tank: control under water, with which straight rays agree nowhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import musatpy
from musatpy.adjustment.initial import THROUGH_WATER, initial_photos
from musatpy.errors import AdjustmentError
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import Block, CoordinateSystem, EllipsoidSpec, Initial, Refraction, Treatment, WaterLevel
from musatpy.orientation.twomedia.oriented import Oriented, orient
from musatpy.orientation.twomedia.sights import Plane
from musatpy.orientation.twomedia.single import SINGLE_RAY
from orientation.twomedia.geometries import (
    ANGLES,
    Kind,
    level_of,
    points_of,
    scene,
    sights_of,
    stations_of,
    truth_of,
)
from orientation.twomedia.referee import block_of

TANK = Kind(H=200.0, B=100.0, least=50.0, largest=120.0, width=100.0, c=0.15)
SLOPES, CONTROL_SIGMA = (0.03, 0.02), 0.01
TOLD = "photo 0: straight rays agree with no station; its initial values are those of its control through the water"


def tank(tide: float = 5.0, wrong: float = 0.0) -> tuple[Oriented, Block]:
    """The photo oriented from nothing, and its block without a station.

    `tide` is by how much the given one is off, `wrong` the shift of control point 3 (in the block alone).
    """
    true = scene(TANK, points_of(TANK, 11), stations_of(TANK, 1), ANGLES[:1])
    sights = sights_of(true, 20, control_sigma=CONTROL_SIGMA)
    rng = np.random.default_rng(0)
    sights = replace(
        sights,
        image=sights.image + rng.normal(size=sights.image.shape) * sights.image_sigma,
        control=sights.control + rng.normal(size=sights.control.shape) * CONTROL_SIGMA,
    )
    block = block_of(true, sights, truth_of(true)[0])
    unknown = np.full((1, 3), np.nan)
    position = block.control.position.copy()
    position[3] += wrong
    return orient(sights, SINGLE_RAY, Plane()), replace(
        block,
        options=replace(block.options, initial=Initial.COMPUTE),
        photos=replace(block.photos, position=unknown, attitude=unknown, tide=block.photos.tide + tide),
        control=replace(block.control, position=position),
    )


@pytest.mark.parametrize("tide", [5.0, 120.0])
def test_program_iiia_starts_from_nothing(tide: float) -> None:
    """And ends where the orientation does, to 1e-6 of its sigmas; a tide may be a guess."""
    oriented, block = tank(tide)
    solution = musatpy.adjust(block)
    assert solution.converged, solution.reason
    assert solution.warnings[0] == f"{TOLD} (SINGLE-RAY)"
    pose = np.concatenate([solution.stations.attitude[0], solution.stations.position[0]])
    assert np.abs((pose - oriented.at.vector[0:6]) / oriented.sigma[:6]).max() < 1e-6
    assert solution.sum_of_squares == pytest.approx(oriented.adjusted.squares[0], rel=1e-9)
    assert solution.degrees_of_freedom == oriented.redundancy


@pytest.mark.slow
def test_a_wrong_control_point_is_named_and_does_not_lead_astray() -> None:
    oriented, block = tank(wrong=8.0)
    values = initial_photos(block)
    assert values.found.tolist() == [THROUGH_WATER]
    assert values.notes == (f"{TOLD} (SINGLE-RAY, without control 3)",)
    off = (values.photos.position[0] - oriented.at.station[0]) / oriented.sigma[3:6]
    assert np.abs(off).max() < 3.0  # of 20 points one less
    given = replace(block.options, initial=Initial.GIVEN)
    assert musatpy.adjust(replace(block, photos=values.photos, options=given)).converged


def test_a_geocentric_job_starts_in_its_level_axes() -> None:
    """200 m of the ellipsoid are level to 1 mm, a tenth of the sigma of the control."""
    oriented, block = tank()
    ellipsoid = EllipsoidSpec(name="WGS84")
    at = np.array([0.6, -1.1, 0.0])  # latitude and longitude, rad
    origin, axes = Ellipsoid.of(ellipsoid).geocentric(at), Ellipsoid.of(ellipsoid).frame(at)
    solution = musatpy.adjust(
        replace(
            block,
            ellipsoid=ellipsoid,
            options=replace(
                block.options, system=CoordinateSystem.GEOCENTRIC, rotation_limit=1e-9, translation_limit=1e-6
            ),
            control=replace(block.control, position=origin + block.control.position @ axes),
        )
    )
    assert solution.converged, solution.reason
    assert solution.warnings[0] == f"{TOLD} (SINGLE-RAY)"
    station = (solution.stations.position[0] - origin) @ axes.T
    assert np.abs((station - oriented.at.station[0]) / oriented.sigma[3:6]).max() < 1.0


@pytest.mark.parametrize(
    ("level", "tilt"), [(WaterLevel.KNOWN, Treatment.KNOWN), (WaterLevel.ONE, Treatment.KNOWN)]
)
def test_what_the_deck_knows_of_the_plane_is_held(level: WaterLevel, tilt: Treatment) -> None:
    _, block = tank(tide=0.0)
    assert block.water is not None
    water = replace(block.water, tilt_east=SLOPES[0], tilt_north=SLOPES[1])
    # the tide holds at the middle of the stations, which stand over 0, 0
    photos = replace(block.photos, tide=np.array([level_of(TANK)]))
    options = replace(block.options, water_level=level, water_tilt=tilt)
    solution = musatpy.adjust(replace(block, water=water, photos=photos, options=options))
    assert solution.converged, solution.reason
    assert solution.warnings[0].startswith(TOLD)
    assert solution.sigma0 == pytest.approx(1.0, abs=0.4)  # three standard errors of 33 degrees of freedom
    sigma = np.sqrt(np.diagonal(solution.stations.covariance[0])[:3])
    assert np.abs(solution.stations.position[0] / sigma).max() < 4.0


@pytest.mark.slow
def test_control_that_contradicts_says_so_of_both_ways() -> None:
    _, block = tank()
    mixed = replace(block, control=replace(block.control, position=block.control.position[::-1]))
    with pytest.raises(AdjustmentError, match=r"agree with no station.*; through the water, SINGLE-RAY: "):
        musatpy.adjust(mixed)


def test_without_refraction_there_is_no_water() -> None:
    _, block = tank()
    dry = replace(block, options=replace(block.options, refraction=Refraction.NONE))
    assert initial_photos(dry).found.tolist() == [""]
