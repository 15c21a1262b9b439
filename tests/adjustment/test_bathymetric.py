"""Submerged points by straight rays of the adjusted stations, at n times their depth, and as adjusted."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from altered import altered, put, with_options
from blocks import simulation
from musatpy import listing
from musatpy.adjustment import adjust
from musatpy.adjustment.network import job_frame
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.model import Block, ControlKind, PointStatus, Program, Refraction, Solution, Treatment
from musatpy.refraction.apparent import Stations, apparent_points
from musatpy.refraction.flat import air_tangent
from musatpy.simulation import Simulation
from musatpy.statistics import Statistics

INDEX = 1.34
MODES: dict[str, dict[str, Any]] = {
    "rigorous": {"program": Program.IIA, "refraction": Refraction.RIGOROUS},
    "watpt": {"program": Program.IIA, "refraction": Refraction.WATPT},
    "simultaneous": {"program": Program.IIIA, "refraction": Refraction.RIGOROUS},
}


@cache
def soundings_as_control(system: str = "LOCL", noise: float = 0.0, **water: float) -> Simulation:
    """A strip over a shoal with soundings as control: without refraction they bend its stations."""
    return simulation(
        5,
        job={"system": system, "centre": [0.0, 0.0] if system == "LOCL" else [18.0, -65.0]},
        terrain={"level": 12.0, "relief": 5.0},
        flight={"photos": 4, "height": 800.0},
        water={"index": INDEX, "level": 0.4, "tide_scatter": 0.1, **water},
        shoal=[{"share": 0.6, "depth": [1.0, 12.0]}],
        points={"extra": [{"number": 12}]},
        measurement={"noise": noise, "sigma": 3.0},
        control=[
            {"kind": "full", "number": 4, "sigma": 0.02},
            {"kind": "vertical", "number": 8, "sigma": 0.02, "bathymetric": True},
        ],
        stations={"position_error": 5.0, "attitude_error": 0.1},
        options={"refraction": "RIGOROUS"},
    )


def as_traced(made: Simulation, block: Block) -> tuple[np.ndarray, np.ndarray]:
    """Return apparent depths (s,) and mean incidences (s,) by the true stations, in the plane of each point."""
    truth, depths, angles = made.truth, [], []
    looks = np.einsum("nij,ni->nj", truth.stations.vertical, -attitude_matrix(truth.attitude)[:, 2])
    for point in np.flatnonzero(block.points.bathymetric):
        photo = np.unique(block.plates.photo[block.plates.point == point])
        camera = (truth.stations.xyz[photo] - truth.points.xyz[point]) @ truth.points.vertical[point].T
        level = truth.tide[photo] - truth.points.natural[point, 2]
        gap = np.hypot(camera[:, 0], camera[:, 1])
        angles.append(np.arctan(air_tangent(camera[:, 2] - level, level, gap, INDEX)).mean())
        stations = Stations(position=camera, level=level, axis=looks[photo] @ truth.points.vertical[point].T)
        depths.append(level.mean() - apparent_points(np.zeros((1, 3)), stations, INDEX)[0][0, 2])
    return np.array(depths), np.array(angles)


def determined(solution: Solution) -> np.ndarray:
    return solution.points.status[solution.bathymetric.point] != PointStatus.NOT_DETERMINED


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("system", ["LOCL", "GEOG", "GEOC"])
def test_straight_rays_meet_where_traced_ones_do(system: str, mode: str) -> None:
    made = soundings_as_control(system)
    solution = adjust(with_options(made.block, **MODES[mode]))
    depth, incidence = as_traced(made, made.block)
    sea = solution.bathymetric
    assert len(sea.point) > 10 and determined(solution).all()
    np.testing.assert_allclose(sea.apparent_depth, depth, atol=1e-3)
    np.testing.assert_allclose(sea.incidence, incidence, atol=1e-4)
    np.testing.assert_allclose(sea.predicted_depth, INDEX * sea.apparent_depth, rtol=1e-9)
    frame = job_frame(made.block)
    for position, below in ((sea.apparent, sea.apparent_depth), (sea.predicted, sea.predicted_depth)):
        level = frame.level(frame.working(position))
        np.testing.assert_allclose(sea.water_level - level[:, 2], below, atol=1e-6)
        np.testing.assert_allclose(level[:, :2], frame.level(frame.working(sea.apparent))[:, :2], rtol=1e-12)


def test_straight_rays_know_nothing_of_control() -> None:
    """Points held at their soundings by NONE are not: the stations alone are bent by these."""
    block = with_options(soundings_as_control().block, program=Program.IIA, refraction=Refraction.NONE)
    solution = adjust(block)
    sea, status = solution.bathymetric, solution.points.status
    held = np.isin(sea.point, block.control.point)
    assert (status[sea.point] == PointStatus.TRIANGULATED).all()
    np.testing.assert_allclose(sea.apparent_depth[~held], sea.depth[~held], atol=1e-5)
    assert np.abs(sea.apparent_depth - sea.depth)[held].max() > 0.05


def test_an_unknown_index_predicts_as_adjusted() -> None:
    made = soundings_as_control()
    block = made.block
    block = altered(block, water={"index": 1.36, "sigma": 0.05})
    solution = adjust(with_options(block, program=Program.IIIA, water_index=Treatment.ADJUST))
    sea = solution.bathymetric
    assert solution.water is not None and solution.water.index == pytest.approx(INDEX, abs=1e-3)
    np.testing.assert_allclose(sea.predicted_depth, solution.water.index * sea.apparent_depth)
    np.testing.assert_allclose(sea.apparent_depth, as_traced(made, block)[0], atol=3e-3)


def test_tilted_water_stands_at_the_point_and_turns_the_normal() -> None:
    block = soundings_as_control().block
    east = 1e-3
    leaning = altered(block, water={"tilt_east": east})
    level, tilted = (adjust(with_options(one, **MODES["simultaneous"])) for one in (block, leaning))
    frame = job_frame(block)
    ground = frame.working(tilted.points.position[tilted.bathymetric.point])
    seems = frame.working(tilted.bathymetric.apparent)
    rise = tilted.bathymetric.water_level - level.bathymetric.water_level
    np.testing.assert_allclose(rise, east * ground[:, 0], atol=1e-9)
    assert np.abs(rise).max() > 0.3
    # water that rises eastwards turns its normal westwards: rays from cameras in the west are steeper to it
    rays = block.plates.point == tilted.bathymetric.point[0]
    camera = frame.working(tilted.stations.position[block.plates.photo[rays]]) - seems[0]
    down = camera / np.linalg.norm(camera, axis=1)[:, None]
    here, there = (np.arccos(down @ [slope, 0.0, 1.0]).mean() for slope in (-east, east))
    assert abs(here - there) > 5e-4
    assert tilted.bathymetric.incidence[0] == pytest.approx(here, abs=1e-4)


def test_a_point_with_one_ray_has_no_apparent_depth_and_the_listing_says_so() -> None:
    block = soundings_as_control().block
    vertical = block.control.kind == ControlKind.VERTICAL
    point = int(block.control.point[vertical & block.points.bathymetric[block.control.point]][0])
    rays = np.flatnonzero(block.plates.point == point)
    block = altered(block, plates={"triangulated": put(np.s_[rays[1:]], False)})
    solution = adjust(with_options(block, **MODES["simultaneous"]))
    sea, row = solution.bathymetric, list(solution.bathymetric.point).index(point)
    assert solution.points.rays[point] == 1
    for name in ("apparent_depth", "predicted_depth"):
        assert np.isnan(getattr(sea, name)).nonzero()[0].tolist() == [row]
    assert np.isnan(sea.apparent[row]).all() and np.isnan(sea.predicted[row]).all()
    assert sea.incidence[row] > 0.0 and np.isfinite(sea.depth[row])
    text = listing(solution)
    name = block.points.ids[point]
    assert f"No refr. is blank where straight rays do not meet, or there is only one: {name}" in text


def test_depths_of_soundings_stand_beside_those_given() -> None:
    block = soundings_as_control(noise=3.0).block
    solution = adjust(with_options(block, **MODES["rigorous"]))
    given = Statistics(solution)
    rows = np.isin(solution.bathymetric.point, block.control.point)
    assert (given.sounding_kinds[rows] == ControlKind.VERTICAL).sum() == 8
    assert np.isnan(given.sounding_residuals[~rows]).all()
    by_point = dict(zip(block.control.point.tolist(), given.control_difference[:, 2], strict=True))
    expected = [-by_point[point] for point in solution.bathymetric.point[rows].tolist()]
    np.testing.assert_allclose(given.sounding_residuals[rows], expected, atol=1e-9)
    assert np.abs(expected).max() > 0.005
