"""Inertial attitudes: angles of the body, an independent bundle, errors against sigmas, what nothing determines."""

from dataclasses import replace

import numpy as np
import pyproj
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import musatpy
from altered import altered, put
from blocks import converged, simulation
from jobs.decks import merge
from musatpy.adjustment.job import prepared
from musatpy.adjustment.kinds import UNKNOWNS, direct_rows
from musatpy.errors import DeckError
from musatpy.formats.musat import deck_bytes, read_deck
from musatpy.geometry.body import BodyAngles, body_angles, body_matrix, inverse_right_jacobian, rotation_vector
from musatpy.geometry.collinearity import attitude_from_matrix
from musatpy.geometry.similarity import Similarity
from musatpy.jobs.extract import extracted
from musatpy.jobs.punch import Content, Punch, punched
from musatpy.model import Action, Block, CauseKind, Editing, Grade, ObservationKind, Solution, SystemSpec
from musatpy.simulation import Simulation
from musatpy.units import DEGREE

RNG = np.random.default_rng(8)
SPREAD = RNG.uniform(-np.pi, np.pi, (200, 3)) * [1.0, 0.49, 1.0]
TRUE = (0.15, -0.08, 0.3)


# --- angles and rotations ---


def test_roll_pitch_heading_are_those_of_scipy() -> None:
    R = Rotation.from_euler("ZYX", SPREAD[:, ::-1]).as_matrix()  # forward, right, down -> north, east, down
    to_ground = R[:, [1, 0, 2]] * [1.0, 1.0, -1.0] * np.array([1.0, 1.0, -1.0])[:, None] @ np.diag([1.0, -1.0, 1.0])
    np.testing.assert_allclose(np.swapaxes(body_matrix(SPREAD, BodyAngles("RPY")), 1, 2), to_ground, atol=1e-14)


def test_signs_of_roll_pitch_heading() -> None:
    forward, left, up = body_matrix(np.radians([0.0, 0.0, 90.0]), BodyAngles("RPY"))
    np.testing.assert_allclose([forward, left, up], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], atol=1e-15)
    assert body_matrix(np.radians([0.0, 10.0, 0.0]), BodyAngles("RPY"))[0, 2] > 0.1  # the nose goes up
    assert body_matrix(np.radians([10.0, 0.0, 0.0]), BodyAngles("RPY"))[1, 2] > 0.1  # the left side goes up


@pytest.mark.parametrize("form", list(BodyAngles))
def test_angles_come_back(form: BodyAngles) -> None:
    P = body_matrix(SPREAD, form)
    np.testing.assert_allclose(P @ np.swapaxes(P, 1, 2), np.broadcast_to(np.eye(3), P.shape), atol=1e-14)
    np.testing.assert_allclose(body_matrix(body_angles(P, form), form), P, atol=1e-14)
    small = 1e-9 * SPREAD
    np.testing.assert_allclose(body_angles(body_matrix(small, form), form), small, atol=1e-16)


def test_the_inverse_jacobian_is_that_of_differences() -> None:
    w = SPREAD[np.linalg.norm(SPREAD, axis=1) < 3.1]
    w = np.concatenate([w, 1e-5 * w, np.zeros((1, 3))])
    R = Rotation.from_rotvec(w)
    for axis, column in zip(np.eye(3), np.moveaxis(inverse_right_jacobian(w), 2, 0), strict=True):
        there, back = (rotation_vector((R * Rotation.from_rotvec(s * 1e-5 * axis)).as_matrix()) for s in (1, -1))
        np.testing.assert_allclose((there - back) / 2e-5, column, atol=1e-6)


# --- blocks ---


def flown(seed: int, free: bool = True, noise: float = 1.0, **tables: object) -> Simulation:
    """Two strips of three photos in opposite directions, over control; errors times `noise`, seconds of arc."""
    error = {"error": [noise * 10.0, noise * 10.0, noise * 20.0], "misalignment": list(TRUE), "free": free}
    spec = {
        "flight": {
            "strips": 2,
            "height": 1000.0,
            "reverse_alternate": True,
            "azimuth": 60.0,
            "attitude_scatter": 2.0,
        },
        "terrain": {"relief": 20.0},
        "points": {"scatter": 0.1, "extra": [{"number": 8}]},
        "control": [{"kind": "full", "number": 4, "sigma": 0.05, "error": 0.05 * noise}],
        "stations": {"position_error": 5.0, "attitude_error": 0.5},
        "measurement": {"noise": noise * 5.0, "sigma": 5.0},
        "inertial": error,
        "options": {"program": "IIIA"},
    }
    return simulation(
        seed,
        **{
            name: {**spec.get(name, {}), **table} if isinstance(table, dict) else table
            for name, table in {**spec, **tables}.items()
        },
    )


def misalignment(solution: Solution) -> np.ndarray:
    assert solution.parameters is not None
    return solution.parameters.value[solution.parameters.kind == ObservationKind.MISALIGNMENT]


@pytest.mark.parametrize("angles, camera", [("RPY", 90.0), ("OPK", 0.0), ("POK", 180.0)])
def test_data_without_errors_give_the_truth(angles: str, camera: float) -> None:
    made = flown(
        3,
        noise=0.0,
        inertial={
            "angles": angles,
            "misalignment": [*TRUE[:2], camera - 0.3],
            "misalignment_error": [20.0, 20.0, 20.0],
        },
    )
    solution = converged(made.block)
    assert solution.sigma0 < 0.01
    np.testing.assert_allclose(misalignment(solution), [*TRUE[:2], camera - 0.3], atol=2e-6)  # least counts
    np.testing.assert_allclose(solution.stations.attitude, made.truth.attitude, atol=1e-7)


@pytest.mark.parametrize("system", ["GEOC", "LOCL"])
def test_other_systems_give_the_truth(system: str) -> None:
    made = flown(4, noise=0.0, job={"system": system, "centre": [18.0, -65.0]})
    np.testing.assert_allclose(misalignment(converged(made.block)), TRUE, atol=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize("tilt", [0.0, 60.0, 110.0, 175.0])
def test_an_independent_bundle_finds_the_same(tilt: float) -> None:
    """Scipy minimises the same squares by rotations of its own, the scene turned about the east by any angle."""
    made = flown(5, job={"system": "LOCL"}, inertial={"angles": "OPK"})
    turn = Rotation.from_euler("X", tilt, degrees=True)
    block = turned(made.block, turn)
    solution = converged(altered(block, options={"initial": "GIVEN"}))
    photos, points, n = block.photos, block.points.count, block.photos.count
    start_P = body_matrix(block.inertial_attitudes.angles, BodyAngles("OPK"))
    f, (photo, point) = block.cameras.focal_length[0], (block.plates.photo, block.plates.point)
    M0 = Rotation.from_matrix(body_matrix(photos.attitude, BodyAngles("OPK")))

    def residuals(x: np.ndarray) -> np.ndarray:
        position, turns = photos.position + x[: 3 * n].reshape(n, 3), x[3 * n : 6 * n].reshape(n, 3)
        B, ground = (
            Rotation.from_euler("XYZ", -x[6 * n : 6 * n + 3]).inv(),
            x[6 * n + 3 :].reshape(points, 3) * 100.0,
        )
        M = M0 * Rotation.from_rotvec(turns)
        u = np.einsum("kij,kj->ki", M.as_matrix()[photo], ground[point] - position[photo])
        images = (-f * u[:, :2] / u[:, 2:] - block.plates.xy) / 0.005
        e = (Rotation.from_matrix(start_P) * (B * M).inv()).as_rotvec() / block.inertial_attitudes.sigma
        control = (ground[block.control.point] - block.control.position) / block.control.sigma
        return np.concatenate([images.ravel(), e.ravel(), control.ravel()])

    ground = solution.points.position + RNG.normal(0.0, 1.0, (points, 3))
    answer = least_squares(
        residuals,
        np.concatenate([np.zeros(6 * n + 3), ground.ravel() / 100.0]),
        x_scale="jac",
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    )
    assert 2.0 * answer.cost == pytest.approx(solution.sum_of_squares, rel=1e-9)
    angles = answer.x[6 * n : 6 * n + 3]
    B = Rotation.from_euler("XYZ", -angles).inv().as_matrix()
    sigma = (
        np.sqrt(np.diagonal(np.linalg.inv(answer.jac.T @ answer.jac)))[6 * n : 6 * n + 3] / DEGREE * solution.sigma0
    )
    np.testing.assert_allclose(
        body_matrix(misalignment(solution) * DEGREE, BodyAngles("OPK")), B, atol=1e-7
    )  # scipy takes differences
    np.testing.assert_allclose(solution.parameters.sigma, sigma, rtol=1e-4)


def turned(block: Block, turn: Rotation) -> Block:
    """A local block and its inertial attitudes, turned."""
    M, P = (
        body_matrix(a, BodyAngles("OPK")) @ turn.inv().as_matrix()
        for a in (block.photos.attitude, block.inertial_attitudes.angles)
    )
    return altered(
        block,
        photos={
            "position": block.photos.position @ turn.as_matrix().T,
            "attitude": body_angles(M, BodyAngles("OPK")),
        },
        control={"position": block.control.position @ turn.as_matrix().T, "sigma": lambda s: np.full_like(s, 0.05)},
        inertial_attitudes={"angles": body_angles(P, BodyAngles("OPK"))},
    )


def test_photos_without_attitude_cards_start_from_the_inertial_unit() -> None:
    block = flown(6).block
    none = altered(block, photos={"attitude": np.full_like(block.photos.attitude, np.nan)})
    first, second = (converged(one) for one in (block, none))
    assert first.sum_of_squares == pytest.approx(second.sum_of_squares, rel=1e-6)


def test_a_wrong_record_is_found_and_dropped() -> None:
    block = flown(7).block
    wrong = altered(block, inertial_attitudes={"angles": lambda a: a + put((4, 1), 0.5 * DEGREE)(np.zeros_like(a))})
    edited = musatpy.adjust(wrong, options=replace(wrong.options, editing=Editing.EDIT))
    (finding,) = edited.findings
    assert (finding.kind, finding.action) == (CauseKind.INERTIAL_ATTITUDE, Action.DROPPED)
    assert finding.photo == block.photos.ids[4]
    assert finding.size[1] == pytest.approx(-1800.0, abs=60.0)  # y is left, and the nose too high
    assert edited.block.inertial_attitudes.count == block.inertial_attitudes.count - 1
    assert musatpy.verdict(edited).grade is Grade.ACCEPTED


# --- what nothing determines ---


def test_one_strip_with_antennas_needs_no_control_unless_its_misalignment_is_free() -> None:
    """Positions on a line leave the turn about it, which inertial attitudes hold."""
    strip = {"flight": {"strips": 1, "photos": 4}, "antenna": {}, "options": {"program": "IIIA"}}
    of_units: tuple[dict[str, object], ...] = ({"inertial": {}}, {"inertial": {"free": True}}, {})
    held, free, none = (simulation(3, **strip, **unit).block for unit in of_units)
    read_deck(deck_bytes(held))
    for block in (free, none):
        with pytest.raises(DeckError, match="its datum needs"):
            read_deck(deck_bytes(block))


def test_a_strip_of_one_heading_does_not_determine_a_roll() -> None:
    """Observed stations of a straight strip hold everything but its roll, which a free misalignment takes up.

    Even where residuals are nil, which by themselves would make all sigmas small.
    """
    block = flown(
        9,
        noise=0.0,
        flight={"strips": 1, "photos": 5, "attitude_scatter": 0.0},
        control=[],
        stations={"position_error": 0.0, "position_sigma": 0.02, "attitude_error": 0.05},
        terrain={"relief": 0.0},
    ).block
    held = converged(altered(block, misalignments={"free": np.array([False])}))
    assert musatpy.verdict(held).grade is Grade.ACCEPTED
    solution = converged(block)
    assert np.isnan(solution.parameters.sigma).tolist() == [True, False, False]
    verdict = musatpy.verdict(solution)
    assert verdict.grade is Grade.DOUBTFUL
    assert any("OMEGA of misalignment" in reason.text for reason in verdict.reasons)


def test_a_free_network_is_free_in_what_a_misalignment_takes_up() -> None:
    """Of vertical photos a misalignment takes up the rotation of the block about the vertical, and no other one."""
    level = {"job": {"system": "LOCL"}, "flight": {"attitude_scatter": 0.0}}
    made = flown(10, **level, control=[], stations={"attitude_error": 0.0}, options={"datum": "FREE"})
    free = converged(made.block)
    held = converged(altered(made.block, misalignments={"free": np.array([False])}))
    assert free.observations["inner constraints"] == held.observations["inner constraints"] + 1 == 5
    assert free.sum_of_squares == pytest.approx(held.sum_of_squares, abs=10.0)  # of two unknowns more


def test_a_block_that_turns_takes_its_misalignment_along() -> None:
    """Vertical photos that turn about the vertical leave their bodies where they were."""
    level = {"job": {"system": "LOCL"}, "flight": {"attitude_scatter": 0.0}}
    job, state = prepared(flown(10, **level, stations={"attitude_error": 0.0}).block, None)
    (kind,) = (kind for kind in UNKNOWNS if kind.observed is ObservationKind.MISALIGNMENT)
    R = Rotation.from_euler("Z", 0.01).as_matrix()
    move = Similarity(scale=1.0, rotation=R, shift=np.zeros(3))
    moved = kind.transformed(job.network, state, np.zeros(3), move)
    moved = replace(moved, attitude=attitude_from_matrix(state.M @ R.T))
    before, after = (dict(direct_rows(job.network, one)) for one in (state, moved))
    (rows,) = (kind for kind in before if kind.observed is ObservationKind.INERTIAL_ATTITUDE)
    np.testing.assert_allclose(after[rows].residual, before[rows].residual, atol=5e-7)  # of second order
    assert moved.parameters[kind.observed][2] - state.parameters[kind.observed][2] == pytest.approx(
        -0.573, abs=1e-3
    )


# --- errors against sigmas ---


def errors(draws: int, **inertial: object) -> tuple[np.ndarray, float]:
    """RMS of errors over sigmas (misalignment, attitudes, heights), and the share of sigma0 that passes."""
    squares, passed = [], 0
    for seed in range(1000, 1000 + draws):
        made = flown(seed, inertial=inertial)
        solution, truth = converged(made.block), made.truth
        factor = solution.sigma0**2
        low, high = chi2.ppf([0.025, 0.975], solution.degrees_of_freedom)
        passed += low < solution.sum_of_squares < high
        turned = np.mod(solution.stations.attitude - truth.attitude + np.pi, 2.0 * np.pi) - np.pi
        angle = turned**2 / np.diagonal(solution.stations.covariance, axis1=1, axis2=2)[:, 3:] * factor
        value = (misalignment(solution) - TRUE) ** 2 / solution.parameters.spread**2 * factor
        height = (
            (solution.points.position - truth.points.job)[:, 2] ** 2 / solution.points.covariance[:, 2, 2] * factor
        )
        squares.append(np.concatenate([value, angle.mean(axis=0), [height.mean()]]))
    return np.sqrt(np.mean(squares, axis=0)), passed / draws


@pytest.mark.slow
@pytest.mark.parametrize(
    "prior",
    [{}, {"free": False, "misalignment_sigma": [60.0, 60.0, 60.0], "misalignment_error": [60.0, 60.0, 60.0]}],
)
def test_errors_agree_with_their_sigmas(prior: dict[str, object]) -> None:
    rms, passed = errors(50, **prior)
    np.testing.assert_allclose(rms, 1.0, atol=0.3)  # of 50 draws, three sigmas
    assert 0.86 < passed < 0.99


# --- conventions ---


def _scaled(*factors: float):
    return lambda angles: angles * factors


def _transposed(angles: np.ndarray) -> np.ndarray:
    """R' in place of R = Rz Ry Rx."""
    return Rotation.from_euler("ZYX", angles[:, ::-1]).inv().as_euler("ZYX")[:, ::-1]


def _in_order(angles: np.ndarray) -> np.ndarray:
    """Angles of the same R, as Rx Ry Rz."""
    return Rotation.from_euler("ZYX", angles[:, ::-1]).as_euler("XYZ")


WRONG = {
    "roll negative": _scaled(-1.0, 1.0, 1.0),
    "roll negative and with pitch negative": _scaled(-1.0, -1.0, 1.0),
    "heading negative": _scaled(1.0, 1.0, -1.0),
    "roll and pitch exchanged": lambda angles: angles[:, [1, 0, 2]],
    "heading counterclockwise from east": lambda angles: angles * [1, 1, -1] + [0, 0, np.pi / 2],
    "in gons": _scaled(*[1.0 / 0.9] * 3),
    "in radians": _scaled(*[DEGREE] * 3),
    "from body to ground": _transposed,
    "rotations in the opposite order": _in_order,
}


def rejected(block: Block, **options: object) -> str:
    """The reason of the verdict that names a convention; the values of the deck stay."""
    solution = musatpy.adjust(block, **options)
    verdict = musatpy.verdict(solution)
    assert verdict.grade in (Grade.REJECTED, Grade.FAILED)
    np.testing.assert_array_equal(solution.block.inertial_attitudes.angles, block.inertial_attitudes.angles)
    assert [cause.kind for cause in solution.causes] == [CauseKind.INERTIAL_CONVENTION]
    return next(reason.text for reason in verdict.reasons if "inertial attitudes" in reason.text)


SLOW = [pytest.param(words, marks=pytest.mark.slow) for words in list(WRONG)[1:]]


@pytest.mark.parametrize("words", ["roll negative", *SLOW])
def test_the_convention_that_fits_is_named(words: str) -> None:
    block = flown(11, inertial={"free": False}).block
    text = rejected(altered(block, inertial_attitudes={"angles": WRONG[words]}))
    assert f"{words}," in text
    assert "nothing was changed" in text


# roll and pitch negative, with a misalignment turned by 180 degrees, are a heading of 180 degrees more
@pytest.mark.slow
@pytest.mark.parametrize("words", [words for words in WRONG if " and with " not in words])
def test_it_is_named_where_misalignment_and_starts_are_unknown(words: str) -> None:
    block = altered(flown(12).block, inertial_attitudes={"angles": WRONG[words]})
    attitude = np.full_like(block.photos.attitude, np.nan)
    assert f"{words}," in rejected(altered(block, photos={"attitude": attitude}))


@pytest.mark.slow
@pytest.mark.parametrize("true, read", [("RPY", "OPK"), ("OPK", "RPY"), ("POK", "OPK")])
def test_other_angles_are_named(true: str, read: str) -> None:
    block = flown(13, inertial={"angles": true, "free": False}).block
    assert f"read as {true} (" in rejected(altered(block, inertial_convention={"angles": read}))


@pytest.mark.slow
def test_wrong_control_is_no_matter_of_conventions() -> None:
    block = flown(17, inertial={"free": False}).block
    wrong = altered(block, control={"position": lambda at: at + put((1, 2), 30.0)(np.zeros_like(at))})
    solution = musatpy.adjust(wrong)
    assert solution.misread == ""
    assert (solution.causes[0].kind, solution.causes[0].points) == (
        CauseKind.VERTICAL,
        (block.points.ids[block.control.point[1]],),
    )


@pytest.mark.slow
def test_a_misalignment_of_the_other_sense_is_named() -> None:
    block = flown(14, inertial={"misalignment": [1.0, -2.0, 88.0], "free": False}).block
    inverse = body_angles(
        np.swapaxes(body_matrix(block.misalignments.angles, BodyAngles("OPK")), 1, 2), BodyAngles("OPK")
    )
    assert "with the misalignment from body to camera," in rejected(
        altered(block, misalignments={"angles": inverse})
    )
    turned = block.misalignments.angles - [0.0, 0.0, 90.0 * DEGREE]
    assert "with kappa of the misalignment 90 degrees more," in rejected(
        altered(block, misalignments={"angles": turned})
    )
    other = block.misalignments.angles + 3.0 * DEGREE
    assert "with a misalignment of 1.0" in rejected(altered(block, misalignments={"angles": other}))


# --- decks ---


def test_attitudes_along_a_grid_turn_by_its_convergence() -> None:
    block = flown(15, job={"centre": [18.0, -65.0]}).block
    stated = replace(block, given_in=SystemSpec(kind="PROJ", axes="GRID", definition="EPSG:26720"))
    data = deck_bytes(stated)
    cards = [line for line in data.decode().splitlines() if line.startswith("INS")]
    latitude, longitude = block.photos.position[0, :2] / DEGREE
    convergence = pyproj.Proj("EPSG:26720").get_factors(longitude, latitude).meridian_convergence
    assert abs(convergence) > 0.5
    heading = block.inertial_attitudes.angles[0, 2] / DEGREE - convergence
    assert float(cards[0][40:54]) == pytest.approx(heading, abs=1e-6)
    back = read_deck(data)
    np.testing.assert_allclose(back.inertial_attitudes.angles, block.inertial_attitudes.angles, atol=1e-9)
    np.testing.assert_allclose(back.misalignments.angles, block.misalignments.angles, atol=1e-12)


def test_merged_decks_have_the_attitudes_of_both() -> None:
    block = flown(16).block
    first = np.arange(6) < 4
    parts = [extracted(block, rows).block for rows in (first, ~first)]
    assert [part.inertial_attitudes.count for part in parts] == [4, 2]
    whole = merge(*parts).block
    assert deck_bytes(whole).count(b"\nINS") == 6
    assert whole.inertial_convention == block.inertial_convention
    with pytest.raises(DeckError, match=r"inertial convention angles is RPY in .*, OPK in"):
        merge(parts[0], altered(parts[1], inertial_convention={"angles": "OPK"}))


def test_a_result_has_them_in_its_sigmas() -> None:
    """Their cards would count them twice."""
    result, notes = punched(converged(flown(16).block), Punch(content=Content.RESULT))
    assert not {card[:3] for card in deck_bytes(result).decode().splitlines()} & {"INS", "INO", "MIS"}
    assert "inertial attitudes are left out: 6" in notes
