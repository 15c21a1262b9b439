"""Wrong antenna positions, single ones and of whole lines, are named first, with their size."""

from functools import cache
from typing import Any

import numpy as np
import pytest

import musatpy
from adjustment.test_antennas import flown
from altered import altered
from musatpy.model import Block, Cause, CauseKind, LeverArms

ARM = np.array([0.3, -0.2, 1.5])


@cache
def four_strips(**antenna: Any) -> Block:
    """Four strips of five photos with control, the lever arm known, shifts of lines to some centimetres."""
    known = {"lever_arm_sigma": None, "lever_arm_error": [0.0] * 3, "drift": [0.0] * 3, "drift_sigma": None}
    known |= {"shift": [0.05] * 3, "shift_sigma": [0.05] * 3}
    flight = {"strips": 4, "photos": 5, "height": 1000.0, "reverse_alternate": True, "side_overlap": 0.4}
    scatter = {"attitude_scatter": [2.0, 2.0, 3.0], "station_scatter": [0.5, 0.5, 0.5]}
    control = [{"kind": "full", "number": 5, "sigma": 0.03, "error": 0.03}]
    points = {"extra": [{"number": 80}]}
    return flown(1, known | antenna, flight=flight | scatter, points=points, control=control).block


def moved(by: np.ndarray) -> Block:
    block = four_strips()
    return altered(block, antenna_positions={"position": block.antenna_positions.position + by})


def line(name: str) -> np.ndarray:
    return np.flatnonzero(four_strips().antenna_positions.line == name)


def first_cause(block: Block) -> Cause:
    return musatpy.adjust(block).causes[0]


@pytest.mark.slow
@pytest.mark.parametrize("correlation", [[0.0, 0.0, 0.0], [0.6, -0.3, 0.2]])
def test_a_single_position_is_named_with_its_error(correlation: list[float]) -> None:
    block = four_strips() if not any(correlation) else None
    block = block or flown(1, {"correlation": correlation, "lever_arm_error": [0.0] * 3}).block
    error = np.where((np.arange(block.photos.count) == 2)[:, None], [1.5, -0.8, 2.0], 0.0)
    cause = first_cause(altered(block, antenna_positions={"position": block.antenna_positions.position + error}))
    assert cause.kind is CauseKind.ANTENNA and cause.photos == (block.photos.ids[2],)
    assert "antenna position of photo 3" in cause.name
    np.testing.assert_array_less(np.abs(np.array(cause.size) - [1.5, -0.8, 2.0]), 3.5 * np.array(cause.sigma))


@pytest.mark.slow
@pytest.mark.parametrize("slip", [0.4, -0.05])
def test_a_slip_of_the_time_of_a_line(slip: float) -> None:
    block, of_line = four_strips(), line("L2")
    speed = np.zeros((block.photos.count, 3))
    speed[of_line] = np.gradient(block.antenna_positions.position[of_line], 5.0, axis=0)
    cause = first_cause(moved(slip * speed))
    assert cause.kind is CauseKind.ANTENNA_TIMES and cause.component == "line L2"
    assert cause.photos == tuple(block.photos.ids[of_line])
    assert cause.size[0] == pytest.approx(slip, abs=4.0 * cause.sigma[0]) and cause.sigma[0] < 0.01


@pytest.mark.slow
def test_no_slip_is_tried_with_two_positions_on_a_line() -> None:
    block, of_line = four_strips(), line("L2")
    step = np.zeros((block.photos.count, 3))
    step[of_line] = [-40.0, 0.0, 0.0]
    names = np.array(["A", "A", "B", "B", "C"])
    lines = block.antenna_positions.line.copy()
    lines[of_line] = names
    cut = altered(moved(step), antenna_positions={"line": lines})
    assert all(cause.kind is not CauseKind.ANTENNA_TIMES for cause in musatpy.adjust(cut).causes)


@pytest.mark.slow
@pytest.mark.parametrize("signs", [[1, 1, -1], [-1, -1, -1], [-1, 1, 1]])
def test_a_wrong_sign_of_a_lever_arm(signs: list[int]) -> None:
    block = four_strips()
    wrong = LeverArms(camera=[0], offset=[ARM * signs], sigma=np.full((1, 3), np.nan))
    causes = musatpy.adjust(altered(block, lever_arms=wrong)).causes
    if signs == [-1, 1, 1]:  # a principal point off in x explains it as well
        causes = tuple(cause for cause in causes if cause.kind is not CauseKind.PRINCIPAL_POINT)
    cause = causes[0]
    assert cause.kind is CauseKind.LEVER_ARM_SIGN
    assert cause.component == ", ".join("xyz"[k] for k in range(3) if signs[k] < 0) + " of camera CAM1"
    np.testing.assert_allclose(cause.size, ARM * signs - ARM)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["in order", "reversed", "one line reversed"])
def test_exchanged_lines(how: str) -> None:
    block, first, second = four_strips(), line("L1"), line("L2")
    order = np.arange(block.photos.count)
    if how == "one line reversed":
        order[first] = first[::-1]
    else:
        turn = -1 if how == "reversed" else 1
        order[first], order[second] = second[::turn], first[::turn]
    position = block.antenna_positions.position[order]
    cause = first_cause(altered(block, antenna_positions={"position": position}))
    assert cause.kind is CauseKind.ANTENNA_LINES
    lines = "line L1" if how == "one line reversed" else "lines L1 and L2"
    assert cause.component == lines + (", in reversed order" if how != "in order" else "")
