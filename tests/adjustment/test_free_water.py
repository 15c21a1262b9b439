"""Water whose plane nothing holds, and starts of blocks in a tank from nothing."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import musatpy
from blocks import converged
from musatpy import model
from musatpy.adjustment.collinear import Simultaneous
from musatpy.adjustment.datum import freedom
from musatpy.adjustment.initial import THROUGH_WATER, initial_photos
from musatpy.adjustment.job import prepared
from musatpy.errors import AdjustmentError
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix
from musatpy.geometry.geodesy import Ellipsoid, middle_of
from musatpy.geometry.similarity import fit
from musatpy.orientation.twomedia.methods import SINGLE_RAY
from musatpy.orientation.twomedia.oriented import Oriented, orient
from musatpy.orientation.twomedia.sights import WaterPlane
from orientation.twomedia.geometries import (
    ANGLES,
    KINDS,
    METHODS,
    Kind,
    block_of,
    geometry,
    level_of,
    level_of_origin,
    points_of,
    scene,
    sights_of,
    stations_of,
    truth_of,
)
from reference.compare import beside, covariance_difference, free_cofactors
from reference.dense_bundle import Network, starting_state

LAB = KINDS["lab"]
CASES = [
    ("PAIR-INDEPENDENT", False),
    ("TRIPLET", False),
    pytest.param("TRIPLET", True, marks=pytest.mark.slow),
    pytest.param("PAIR-SUCCESSIVE", False, marks=pytest.mark.slow),
]


@cache
def model_and_block(method: str, index: bool = False) -> tuple[Oriented, model.Block]:
    """The orientation of noisy images of the laboratory, and the block of a free network that starts from it."""
    true = geometry("lab", method)
    sights = sights_of(true)
    noise = np.random.default_rng(1).normal(size=sights.image.shape)
    sights = replace(sights, image=sights.image + noise * sights.image_sigma)
    result = orient(sights, METHODS[method], WaterPlane(index_unknown=index), LAB.B)
    block = block_of(true, sights, result.at)
    treatment = model.Treatment.ADJUST if index else model.Treatment.KNOWN
    return result, replace(block, options=replace(block.options, datum=model.Datum.FREE, water_index=treatment))


@cache
def adjusted(method: str, index: bool = False) -> model.Solution:
    return converged(model_and_block(method, index)[1])


@pytest.mark.slow
@pytest.mark.parametrize(("method", "index"), CASES)
def test_relative_orientation_through_water_after_a_similarity(method: str, index: bool) -> None:
    """1e-6 sigma of what the datum of the points gives; 1e-9 of squares and redundancy: both at rest to 1e-12."""
    result, solution = model_and_block(method, index)[0], adjusted(method, index)
    assert solution.observations["inner constraints"] == 7
    assert solution.degrees_of_freedom == result.redundancy
    assert solution.warnings == ()
    assert solution.sum_of_squares == pytest.approx(result.adjusted.squares[0], rel=1e-9)
    images = solution.observed.kind == model.ObservationKind.PLATE
    np.testing.assert_allclose(
        solution.observed.redundancy[images].reshape(-1, 2), result.image_redundancy, atol=1e-9
    )
    points, stations, water = solution.points, solution.stations, solution.water
    assert water is not None
    move = fit(result.points, points.position, np.ones(len(result.points)))
    sigma = np.sqrt(np.einsum("kii->ki", points.covariance)) / solution.sigma0
    assert np.abs((move.apply(result.points) - points.position) / sigma).max() < 1e-6
    attitude = attitude_from_matrix(move.turn(attitude_matrix(result.at.attitude)))
    pose = np.concatenate([move.apply(result.at.station), attitude], axis=1)
    ours = np.concatenate([stations.position, stations.attitude], axis=1)
    sigma = np.sqrt(np.einsum("kii->ki", stations.covariance)) / solution.sigma0
    assert np.abs((pose - ours) / sigma).max() < 1e-6
    up = np.array([*-result.at.slope, 1.0]) @ move.rotation.T
    through = move.apply(np.array([0.0, 0.0, float(result.at.level)]))
    tilt = -up[:2] / up[2]
    at_zero = through[2] - tilt @ through[:2]
    # the sigmas are 9e-4 and more of the tilt, 0.014 m of the level, 0.004 of the index
    np.testing.assert_allclose(water.tilt, tilt, atol=1e-10)
    assert level_of_origin(solution) == pytest.approx(at_zero, abs=1e-8)
    assert water.index == pytest.approx(float(result.at.index), abs=1e-10)


@pytest.mark.slow
def test_covariances_are_those_of_a_dense_pseudo_inverse() -> None:
    solution = adjusted("TRIPLET")
    Q, part = dense_cofactors(solution)
    unit = solution.sigma0**2
    for ours, name, size in (
        (solution.stations.covariance, "stations", 6),
        (solution.points.covariance, "points", 3),
    ):
        count = len(ours)
        theirs = Q[part[name], part[name]].reshape(count, size, count, size)[np.arange(count), :, np.arange(count)]
        # the eigenvectors of the defect are good to 1e-6 of the motions
        assert np.abs(covariance_difference(ours / unit, theirs)).max() < 1e-5


def dense_cofactors(solution: model.Solution) -> tuple[np.ndarray, dict[str, slice]]:
    """The cofactors under inner constraints over the points, from the dense normals."""
    network, water = Network(solution.block, refraction=True), solution.water
    assert water is not None
    state = starting_state(network, beside(solution))
    tides = np.array([water.tide[0] - solution.block.photos.tide[0]])
    J = network.jacobian(replace(state, tides=tides, tilt=np.array(water.tilt)))
    return free_cofactors(J, network.part["points"], 7), network.part


@pytest.mark.parametrize(
    ("level", "tilt", "free"),
    [
        (model.WaterLevel.ONE, model.Treatment.ADJUST, 7),
        (model.WaterLevel.PHOTO, model.Treatment.ADJUST, 7),
        (model.WaterLevel.ONE, model.Treatment.KNOWN, 5),  # a plane of known slopes holds two turns
        (model.WaterLevel.KNOWN, model.Treatment.ADJUST, 6),  # and one that goes through a known place one motion
        (model.WaterLevel.KNOWN, model.Treatment.KNOWN, 4),
    ],
)
def test_what_the_plane_does_not_hold_is_free(level: model.WaterLevel, tilt: model.Treatment, free: int) -> None:
    """Slopes of 20 %, so that shifts and the turn about the normal carry the level along."""
    block = with_plane(model_and_block("TRIPLET")[1], (0.2, -0.1))
    block = replace(block, options=replace(block.options, water_level=level, water_tilt=tilt))
    job, state = prepared(block, None)
    network = job.network.with_plates(job.network.xy, block.points.bathymetric[block.plates.point])
    problem = Simultaneous(network=network, options=block.options, held=np.zeros(0, dtype=np.int64))
    unheld = freedom(network, state, problem.linearise(state).matrix)
    assert unheld.count == free
    assert unheld.weak == 0


def with_plane(block: model.Block, slopes: tuple[float, float]) -> model.Block:
    """The block with other slopes of the water."""
    assert block.water is not None
    return replace(block, water=model.Water(index=block.water.index, tilt_east=slopes[0], tilt_north=slopes[1]))


@pytest.mark.parametrize("method", ["PAIR-INDEPENDENT", "TRIPLET"])
def test_nothing_known_but_the_images(method: str) -> None:
    """No station, no control: the shape is that of the relative orientation."""
    result, block = model_and_block(method)
    unknown = np.full_like(block.photos.position, np.nan)
    photos = replace(block.photos, position=unknown, attitude=unknown, tide=np.zeros(len(unknown)))
    options = replace(
        block.options, initial=model.Initial.COMPUTE, translation_limit=1e-8
    )  # of photographs at 1:10,000
    solution = converged(replace(block, photos=photos, options=options))
    assert solution.observations["inner constraints"] == 7
    assert not any("control" in text for text in solution.warnings)
    assert solution.sum_of_squares == pytest.approx(result.adjusted.squares[0], rel=1e-6)
    move = fit(solution.points.position, result.points, np.ones(len(result.points)))
    np.testing.assert_allclose(move.apply(solution.points.position), result.points, atol=1e-6)  # limits of steps


def test_water_tilts_about_the_middle_of_a_small_scene() -> None:
    """To a hundredth of the extent of the stations at most; of a strip to a metre, as its restarts have it."""
    for extent, step in ((1.0, 1e-2), (0.5, 1e-3), (60.0, 0.1), (5000.0, 1.0)):
        stations = np.array([[0.0, 0.0, 2.0], [extent, 0.3 * extent, 2.1]])
        middle = middle_of(stations)
        np.testing.assert_allclose(middle, stations.mean(axis=0), atol=0.5000001 * step)  # half a step, rounding
        np.testing.assert_allclose(middle / step, np.rint(middle / step), atol=1e-9)


TANK = Kind(H=200.0, B=100.0, least=50.0, largest=120.0, width=100.0, c=0.15)
SLOPES, CONTROL_SIGMA = (0.03, 0.02), 0.01
TOLD = "photo 0: straight rays agree with no station; its initial values are those of its control through the water"


def tank(tide: float = 5.0, wrong: float = 0.0) -> tuple[Oriented, model.Block]:
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
    return orient(sights, SINGLE_RAY, WaterPlane()), replace(
        block,
        options=replace(block.options, initial=model.Initial.COMPUTE),
        photos=replace(block.photos, position=unknown, attitude=unknown, tide=block.photos.tide + tide),
        control=replace(block.control, position=position),
    )


@pytest.mark.parametrize("tide", [5.0, 120.0])
def test_program_iiia_starts_from_nothing(tide: float) -> None:
    """And ends where the orientation does, to 1e-6 of its sigmas; a tide may be a guess."""
    oriented, block = tank(tide)
    solution = converged(block)
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
    given = replace(block.options, initial=model.Initial.GIVEN)
    assert musatpy.adjust(replace(block, photos=values.photos, options=given)).converged


def test_a_geocentric_job_starts_in_its_level_axes() -> None:
    """200 m of the ellipsoid are level to 1 mm, a tenth of the sigma of the control."""
    oriented, block = tank()
    ellipsoid = model.EllipsoidSpec(name="WGS84")
    at = np.array([0.6, -1.1, 0.0])  # latitude and longitude, rad
    origin, axes = Ellipsoid.of(ellipsoid).geocentric(at), Ellipsoid.of(ellipsoid).frame(at)
    solution = converged(
        replace(
            block,
            ellipsoid=ellipsoid,
            options=replace(
                block.options, system=model.CoordinateSystem.GEOCENTRIC, rotation_limit=1e-9, translation_limit=1e-6
            ),
            control=replace(block.control, position=origin + block.control.position @ axes),
        )
    )
    assert solution.warnings[0] == f"{TOLD} (SINGLE-RAY)"
    station = (solution.stations.position[0] - origin) @ axes.T
    assert np.abs((station - oriented.at.station[0]) / oriented.sigma[3:6]).max() < 1.0


@pytest.mark.parametrize(
    ("level", "tilt"),
    [(model.WaterLevel.KNOWN, model.Treatment.KNOWN), (model.WaterLevel.ONE, model.Treatment.KNOWN)],
)
def test_what_the_deck_knows_of_the_plane_is_held(level: model.WaterLevel, tilt: model.Treatment) -> None:
    _, block = tank(tide=0.0)
    assert block.water is not None
    water = replace(block.water, tilt_east=SLOPES[0], tilt_north=SLOPES[1])
    # the tide holds at the middle of the stations, which stand over 0, 0
    photos = replace(block.photos, tide=np.array([level_of(TANK)]))
    options = replace(block.options, water_level=level, water_tilt=tilt)
    solution = converged(replace(block, water=water, photos=photos, options=options))
    assert solution.warnings[0].startswith(TOLD)
    assert solution.sigma0 == pytest.approx(1.0, abs=0.4)  # three standard errors of 33 degrees of freedom
    sigma = np.sqrt(np.diagonal(solution.stations.covariance[0])[:3])
    assert np.abs(solution.stations.position[0] / sigma).max() < 4.0


@pytest.mark.slow
def test_control_that_contradicts_says_so_of_both_ways() -> None:
    _, block = tank()
    mixed = replace(block, control=replace(block.control, position=block.control.position[::-1]))
    with pytest.raises(AdjustmentError, match=r"no station agrees with .*; through the water, SINGLE-RAY: "):
        musatpy.adjust(mixed, causes=model.CauseSearch.NONE)


def test_without_refraction_there_is_no_water() -> None:
    _, block = tank()
    dry = replace(block, options=replace(block.options, refraction=model.Refraction.NONE))
    assert initial_photos(dry).found.tolist() == [""]
