"""Photographs round a monument: horizontal, upward and rolled cameras, by cards and from nothing but plates."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from monuments import FOCAL_LENGTH, Monument, angles, monument, rotation
from musatpy import adjust, adjustment, verdict
from musatpy.adjustment.first_lenses import with_first_lenses
from musatpy.adjustment.initial import initial_photos
from musatpy.model import Grade, Program, Solution
from musatpy.model.lenses import Ports
from musatpy.orientation.absolute import Targets, absolute_orientation
from musatpy.reports import positions
from musatpy.reports.positions import STATIONS
from musatpy.statistics import Statistics

SMALL = {"photos": 16, "points": 150, "control": 8}
LENS = {"F": 0.25, "XP": 0.05, "YP": -0.08, "K1": -1.2e-4, "K2": 1.5e-7, "K3": -1e-10, "P1": 1e-5, "P2": -8e-6}
POLE = 3  # the photo that looks along X in a block that `facing` turns


@lru_cache
def upright(seed: int = 1) -> Monument:
    return monument(seed, **SMALL)


def facing(photo: int, beside: float = 0.0, seed: int = 1) -> np.ndarray:
    """A rotation of the block after which a photo looks so many degrees beside X: its phi is 90 less that."""
    z = upright(seed).M[photo, 2]
    side = np.cross(z, [0.3, 0.2, 0.9])
    side /= np.linalg.norm(side)
    return rotation(0.0, 0.0, np.radians(beside)) @ np.stack([z, side, np.cross(z, side)])


def by_turns(attitude: np.ndarray) -> np.ndarray:
    """(3, 3) small turns along the ground axes by omega, phi, kappa, by differences."""
    M, columns = rotation(*attitude), []
    for step in 1e-6 * np.eye(3):
        change = M.T @ (rotation(*(attitude + step)) - rotation(*(attitude - step))) / 2e-6  # -[w]x
        columns.append([change[1, 2], change[2, 0], change[0, 1]])
    return np.array(columns).T


def errors_over_sigmas(of: Monument, solution: Solution) -> np.ndarray:
    """Errors of stations, turns and points over their sigmas."""
    stations = solution.stations
    variance = np.einsum("nii->ni", stations.covariance[:, :3, :3])
    B = np.array([by_turns(attitude) for attitude in stations.attitude])
    of_turns = np.einsum("nij,njk,nik->ni", B, stations.covariance[:, 3:, 3:], B)
    parts = (
        (stations.position - of.C, variance),
        (of.turns(stations.attitude), of_turns),
        (solution.points.position - of.ground, np.einsum("pii->pi", solution.points.covariance)),
    )
    return np.concatenate([(error / np.sqrt(square)).ravel() for error, square in parts])


@pytest.mark.parametrize("program", Program)
@pytest.mark.parametrize("beside", [0.0, 1e-5, 0.5, 40.0, 90.0])
def test_a_block_turned_as_a_whole_is_adjusted_alike(program: Program, beside: float) -> None:
    """Turned by 90 degrees against the pole all photos look about as aerial ones do, or up: nothing may change."""
    A = facing(POLE, beside)
    plain, turned = (monument(1, turned=R, program=program, **SMALL) for R in (None, A))
    before, after = adjust(plain.block), adjust(turned.block)
    assert before.converged and after.converged
    assert after.sigma0 == pytest.approx(before.sigma0, rel=1e-7)
    np.testing.assert_allclose(after.plates.residual, before.plates.residual, atol=2e-7)  # limits of iterations, mm
    np.testing.assert_allclose(after.stations.position, before.stations.position @ A.T, atol=2e-6)
    np.testing.assert_allclose(after.points.position, before.points.position @ A.T, atol=2e-6)
    np.testing.assert_allclose(after.points.covariance, A @ before.points.covariance @ A.T, rtol=1e-3, atol=1e-10)
    expected = A @ before.stations.covariance[:, :3, :3] @ A.T
    np.testing.assert_allclose(after.stations.covariance[:, :3, :3], expected, rtol=1e-3, atol=1e-9)
    for row, attitude in enumerate(after.stations.attitude):
        M = rotation(*attitude)
        np.testing.assert_allclose(M, rotation(*before.stations.attitude[row]) @ A.T, atol=2e-7)
        if row == POLE and beside < 1e-3:
            continue  # of which omega and kappa have no small errors
        B, b = by_turns(attitude), by_turns(before.stations.attitude[row])
        expected = A @ b @ before.stations.covariance[row, 3:, 3:] @ b.T @ A.T
        covariance = B @ after.stations.covariance[row, 3:, 3:] @ B.T
        np.testing.assert_allclose(covariance, expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize("seed", range(1, 4))
def test_approximate_attitudes_converge_where_phi_passes_90_degrees(seed: int) -> None:
    turned = monument(seed, off=(1.0, 6.0), turned=facing(POLE, seed=seed), **SMALL)
    solution = adjustment.adjust(turned.block)  # without the search for what is off
    assert solution.converged and len(solution.iterations) < 10
    assert solution.sigma0 == pytest.approx(1.0, abs=0.1)
    assert np.abs(turned.turns(solution.stations.attitude)).max() < np.radians(0.1)


@pytest.mark.parametrize("turned", [None, pytest.param(rotation(1.9, 0.4, -2.0), marks=pytest.mark.slow)])
def test_photos_round_a_monument_are_found_from_plates_and_control(turned: np.ndarray | None) -> None:
    """Errors in sigmas: the root mean square of some 550 dependent ones is within 0.8 and 1.2 for ten seeds."""
    of = monument(2, off=None, initial="COMPUTE", turned=turned, **SMALL)
    solution = adjust(of.block)
    assert solution.converged and verdict(solution).grade is Grade.ACCEPTED, verdict(solution)
    assert (np.abs(of.M[:, 2, 2]) < 0.9).sum() > 8  # not a block of vertical photos
    rms = float(np.sqrt(np.mean(np.square(errors_over_sigmas(of, solution)))))
    assert 0.7 < rms < 1.3


@pytest.mark.slow
def test_sixty_photos_are_found_and_their_errors_are_those_of_their_sigmas() -> None:
    of = monument(1, off=None, initial="COMPUTE", turned=rotation(0.4, 1.0, 2.0))
    solution = adjust(of.block)
    assert solution.converged and verdict(solution).grade is Grade.ACCEPTED, verdict(solution)
    rms = float(np.sqrt(np.mean(np.square(errors_over_sigmas(of, solution)))))
    assert 0.8 < rms < 1.2


def self_calibrated(**block: object) -> Monument:
    """A free network with a scale bar, its camera wholly unknown: out by 0.25 mm, and 1 mm in the corners."""
    given = {"points": 150, "control": 0, "noise": 0.0004, "lens": LENS, "bar": True, "datum": "FREE"}
    return monument(1, **{**given, **block})


@pytest.mark.parametrize(
    "block",
    [
        {"photos": 16, "off": (0.3, 3.0)},
        pytest.param({"photos": 60, "off": None, "initial": "COMPUTE"}, marks=pytest.mark.slow),
        pytest.param({"photos": 60, "off": (0.3, 3.0), "turned": rotation(1.9, 0.4, -2.0)}, marks=pytest.mark.slow),
    ],
)
def test_a_free_network_with_one_scale_bar_calibrates_its_camera(block: dict[str, object]) -> None:
    """Sigma0 by chance within 0.9 to 1.1 from 600 observations on; eight errors within four of their sigmas."""
    of = self_calibrated(**block)
    solution = adjustment.adjust(of.block)
    assert solution.converged and solution.parameters is not None
    images, stations = solution.block.plates.count, 6 * solution.block.photos.count
    points = 3 * len(np.flatnonzero(solution.points.rays > 1))
    assert (
        solution.degrees_of_freedom == 2 * int(solution.plates.triangulated.sum()) + 1 - stations - points - 8 + 6
    )
    assert solution.sigma0 == pytest.approx(1.0, abs=0.1) and images > 600
    true = np.array([FOCAL_LENGTH + LENS["F"], *(LENS[name] for name in list(LENS)[1:])])
    error = (np.asarray(solution.parameters.value) - true) / np.asarray(solution.parameters.sigma)
    assert np.abs(error).max() < 4.0


def test_lengths_of_micrometres_are_printed_and_a_scale_bar_alone_is_not_tested() -> None:
    """Small lengths print with six decimals; what has no redundancy has no variance component."""
    of = self_calibrated(photos=8, points=60, off=(0.01, 0.1), lens=None, noise=0.0001)
    solution = adjustment.adjust(of.block)
    sections = {section.title: section for section in positions.sections(Statistics(solution))}
    row = sections["Adjusted Ground Points"].lines[0].split()
    printed = np.array(row[3:], dtype=float)
    np.testing.assert_allclose(printed[:3], solution.points.position[0], atol=0.6e-6)
    np.testing.assert_allclose(printed[3:], Statistics(solution).point_sigmas[0], atol=0.6e-6)
    assert "distances" not in Statistics(solution).components


def test_pairs_tell_the_first_focal_length_and_radial_distortion() -> None:
    """A focal length 14 % off, images bent by 0.7 mm: to a step of 5 %, K1 to a half."""
    off = 4.0
    block = monument(1, photos=6, points=80, control=4, off=None, initial="COMPUTE", lens={**LENS, "F": off}).block
    first, _, notes = with_first_lenses(block)
    lens = dict(zip(first.lens_unknowns.parameter.tolist(), first.lens_unknowns.value.tolist(), strict=True))
    assert lens["F"] == pytest.approx(FOCAL_LENGTH + off, rel=0.05) and "mm of camera C35" in notes[0]
    assert lens["K1"] == pytest.approx(LENS["K1"], rel=0.5)


def test_pairs_behind_a_port_meet_outside_it() -> None:
    """The images of a camera in water whose focal length is right: rays inside would want a third more."""
    block = monument(
        1, photos=6, points=80, control=4, off=None, initial="COMPUTE", lens=dict.fromkeys(LENS, 0.0)
    ).block
    r = np.linalg.norm(block.plates.xy, axis=1, keepdims=True) / block.cameras.focal_length
    refracted = np.tan(np.arcsin(1.33 * np.sin(np.arctan(r)))) / r
    flat = {"distance": 1e-3, "thickness": 0.0, "glass_index": 1.5, "water_index": 1.33}
    port = Ports(
        camera=np.zeros(1, int), tilt=np.zeros((1, 2)), **{name: np.full(1, x) for name, x in flat.items()}
    )
    block = replace(block, plates=replace(block.plates, xy=block.plates.xy * refracted), ports=port)
    assert with_first_lenses(block)[2] == ()


@pytest.mark.slow
def test_given_attitudes_are_checked_where_omega_and_kappa_turn_about_one_line() -> None:
    values = initial_photos(monument(1, off=(0.05, 0.5), turned=facing(POLE, 0.2), initial="CHECK", **SMALL).block)
    assert np.abs(values.difference[POLE, 3:]).max() > np.radians(20.0)
    assert not values.beyond.any()


def test_omega_and_kappa_that_are_only_known_together_have_no_sigmas() -> None:
    solution = adjust(monument(1, turned=facing(POLE), **SMALL).block)
    assert verdict(solution).grade is Grade.ACCEPTED
    statistics = Statistics(solution)
    sigmas = statistics.station_sigmas
    assert np.isnan(sigmas[POLE, [3, 5]]).all() and sigmas[POLE, 4] < 1e-2
    assert np.isfinite(np.delete(sigmas, POLE, axis=0)).all()
    assert "photo R03: Y-tilt within a degree of 90" in " ".join(solution.warnings)
    M = np.array([rotation(*attitude) for attitude in solution.stations.attitude])
    np.testing.assert_allclose(STATIONS.raw(statistics)["rotation"], M, atol=1e-12)
    beside = adjust(monument(1, turned=facing(POLE, 2.0), **SMALL).block)
    assert np.isfinite(Statistics(beside).station_sigmas).all()
    assert "Y-tilt" not in " ".join(beside.warnings)


def test_a_card_with_phi_beyond_90_degrees_is_the_same_attitude() -> None:
    block = upright().block
    omega, phi, kappa = block.photos.attitude.T
    assert (np.abs(phi) < 0.5 * np.pi).all()
    other = np.stack([omega + np.pi, np.pi - phi, kappa - np.pi], axis=1)
    stated = monument(1, attitude=other, **SMALL).block
    M = [np.array([rotation(*attitude) for attitude in of.photos.attitude]) for of in (block, stated)]
    np.testing.assert_allclose(*M, atol=1e-12)
    assert (np.abs(stated.photos.attitude[:, 1]) <= 0.5 * np.pi).all()


@pytest.mark.parametrize("turn", [-2.0 * np.pi, 0.0, 2.0 * np.pi])
def test_angles_at_the_wrap_stay_on_cards(turn: float) -> None:
    """Photos upside down, and a photo of which the cards say 360 degrees, that is adjusted a little beyond."""
    M = upright().M
    A = M[POLE]  # after which all angles of the photo are zero
    attitude = np.array([angles((m @ A.T)[None])[0] for m in M])
    attitude[POLE, 2] = turn
    solution = adjustment.adjust(monument(1, turned=A, attitude=attitude, **SMALL).block)
    assert solution.converged and solution.sigma0 == pytest.approx(1.0, abs=0.1)
    assert np.abs(solution.stations.attitude).max() <= 2.0 * np.pi
    again = replace(solution.block, photos=replace(solution.block.photos, attitude=solution.stations.attitude))
    assert adjustment.adjust(again).sum_of_squares == pytest.approx(solution.sum_of_squares, rel=1e-6)


@pytest.mark.parametrize("seed", [30, 45, 70, 87])
def test_a_model_is_placed_on_control_whichever_way_is_up(seed: int) -> None:
    """Seeds of which the plane similarity as the only start ended metres off."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-5.0, 5.0, (4, 3))
    R, up = rotation(*rng.uniform(-np.pi, np.pi, 3)), rng.normal(size=3)
    y = 3.0 * x @ R.T + 100.0 + rng.normal(0.0, 0.005, (4, 3))
    targets = Targets(model=x, position=y, known=np.ones((4, 3), dtype=bool), weight=np.ones(4))
    placement = absolute_orientation(targets, up / np.linalg.norm(up), 0.01)
    assert placement is not None
    np.testing.assert_allclose(placement[0].apply(x), y, atol=0.05)
