"""OP2 COMPUTE of a single photo over a tank, whose straight rays agree with no station."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from altered import altered
from musatpy import model
from musatpy.adjustment import adjust
from musatpy.adjustment.initial import initial_photos
from musatpy.orientation.twomedia.rays import Orientation
from orienting.decks import deck_block


def tank(tide_off: float = 0.0, **options: object) -> tuple[model.Block, Orientation]:
    """Return a photo 200 over a tank, its 20 control points 50 to 120 deep, and the truth."""
    block, truth, _ = deck_block("lab", "SINGLE-RAY", 20)
    tide = np.array([float(truth.level[0]) + tide_off])
    unknown = {"water_level": model.WaterLevel.ONE, "water_tilt": model.Treatment.ADJUST}
    options = {"initial": model.Initial.COMPUTE, **unknown, **options}
    return altered(replace(block, orientation=None), photos={"tide": tide}, options=options), truth


@pytest.mark.parametrize("tide_off", [0.0, 20.0])
def test_the_photo_is_found_through_the_water(tide_off: float) -> None:
    block, truth = tank(tide_off)
    solution = adjust(block)
    assert solution.converged
    assert any("photo 0: straight rays agree with no station" in warning for warning in solution.warnings)
    sigma = np.sqrt(np.diagonal(solution.stations.covariance[0]))
    error = np.concatenate([solution.stations.position[0], solution.stations.attitude[0]])
    error -= np.concatenate([truth.station[0, 0], truth.attitude[0, 0]])
    assert np.abs(error / sigma).max() < 4.0


def test_known_water_is_taken_as_known() -> None:
    slopes = {"tilt_east": 0.03, "tilt_north": 0.02}
    block, truth = tank(water_level=model.WaterLevel.KNOWN, water_tilt=model.Treatment.KNOWN)
    found = initial_photos(altered(block, water=slopes))
    assert found.found.tolist() == ["water"]
    assert np.abs(found.photos.position[0] - truth.station[0, 0]).max() < 2.0  # the tilt turns about the control


def test_a_wrong_control_point_is_left_out_of_the_start() -> None:
    block, truth = tank()
    position = block.control.position.copy()
    position[7, 2] += 30.0
    found = initial_photos(altered(block, control={"position": position}))
    assert np.abs(found.photos.position[0] - truth.station[0, 0]).max() < 1.0
    assert adjust(altered(block, control={"position": position})).converged


def test_without_submerged_control_nothing_changes() -> None:
    block, _ = tank()
    dry = altered(block, points={"bathymetric": np.zeros(len(block.points.ids), dtype=bool)})
    assert initial_photos(dry).found.tolist() == [""]
