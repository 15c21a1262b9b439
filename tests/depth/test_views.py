"""Depth factors over a model, by `musat depth`: Groeneveld Meijer's (1964) tables, rays, and what is missing."""

import re
from pathlib import Path

import numpy as np
import pytest

from cli.commands import musat
from refraction.test_apparent import model_factor

PAPER = ("--height", 2500, "--base", 1126, "--index", 1.35)  # feet
# The model of Figure 3: as wide as the flight lines of 40 % side overlap are apart
MODEL = ("--width", 2250, "--grid", "13,19")


def numbers(*words: object) -> list[list[float]]:
    """Return the lines of numbers that a command prints, NaN for a dash."""
    result = musat("depth", *words)
    assert result.exit_code == 0, result.output
    lines = [line.replace("%", "").split() for line in result.output.splitlines()]
    rows = [line for line in lines if line and all(re.fullmatch(r"-?[\d.]+|-", cell) for cell in line)]
    return [[np.nan if cell == "-" else float(cell) for cell in line] for line in rows]


def test_the_model_is_worst_at_its_corners() -> None:
    """Table 2: the largest departures from the factors of 25 feet are in the corners."""
    rows = [row for row in numbers("errors", *PAPER, *MODEL) if len(row) == 9]
    depth, x, y, _, _, _, _, error, percent = np.array(rows).T
    assert depth.tolist() == [0.0, 10.0, 25.0, 50.0, 100.0]
    corners = np.abs(np.stack([x - 563.0, y]))[:, depth != 25.0]
    np.testing.assert_array_equal(corners, np.tile([[563.0], [1125.0]], 4))
    # the printed d2 of the corner is 1600 feet, of which this place has 1592: the factor is 0.001 less
    np.testing.assert_allclose(percent, [-0.16, -0.08, 0.0, 0.15, 0.44], atol=0.02)
    np.testing.assert_allclose(error, [0.0, -0.012, 0.0, 0.110, 0.65], atol=0.02)


def test_a_single_value_for_the_model() -> None:
    """Table 3 with its value of 1.410: within 4.1 per cent everywhere, contour by contour."""
    rows = [row for row in numbers("errors", *PAPER, *MODEL, "--value", 1.41) if len(row) == 5]
    level, _, error, percent, within = np.array(rows).T
    np.testing.assert_allclose(level[1:-1], np.arange(1.46, 1.365, -0.01), atol=1e-9)
    np.testing.assert_allclose(error[1:-1], np.arange(1.25, -1.01, -0.25), atol=1e-9)
    assert np.abs(percent).max() < 4.1 and within[0] == 100.0
    x, y = np.meshgrid(np.linspace(0.0, 1126.0, 13), np.linspace(-1125.0, 1125.0, 19))
    factor = model_factor(x, y, 25.0, 2500.0, 1126.0, 1.35)
    np.testing.assert_allclose((level[0], level[-1]), (factor.max(), factor.min()), atol=5e-5)
    for part, off in zip(within[1:-1], np.abs(level[1:-1] - 1.41), strict=True):
        assert part == pytest.approx(100.0 * np.mean(np.abs(factor - 1.41) <= off + 1e-9), abs=0.5)


def test_rays_of_the_pair_are_near_the_formula() -> None:
    by_rays, by_formula = (np.array(numbers("table", *PAPER, *MODEL, *how)) for how in (("--exact",), ()))
    np.testing.assert_array_equal(by_rays[:, :2], by_formula[:, :2])
    # 2e-4 at the corners at 100 feet, where the rays miss each other by 1.7 feet; tests/refraction/test_apparent.py
    np.testing.assert_allclose(by_rays, by_formula, atol=4e-4)
    # where both distances are equal nothing is approximate; a zero depth is a millionth of the height
    middle = by_rays[:, 0] == 563.0
    np.testing.assert_array_equal(by_rays[middle], by_formula[middle])


def stations(folder: Path, *lines: str) -> tuple[object, ...]:
    path = folder / "stations.csv"
    path.write_text("\n".join(["name,x,y,z,tide", *lines, ""]))
    return ("--cameras", path, "--index", 1.35, "--angle")


def test_depths_are_those_below_the_tides_of_the_cameras_that_see_a_place(tmp_path: Path) -> None:
    """Two pairs of one shape far from each other, one at high and one at low water, have the same factors."""
    pair, far = ("1,0,0,2500,0", "2,1126,0,2500,0"), ("3,90000,0,2540,40", "4,91126,0,2540,40")
    (tmp_path / "places.csv").write_text("x,y\n200,300\n90200,300\n")
    at = ("--at", tmp_path / "places.csv")
    low, high = (row[2:] for row in numbers("table", *stations(tmp_path, *pair, *far), 40, *at))
    assert low == high == numbers("table", *stations(tmp_path, *pair), 40, *at)[0][2:]


def test_a_place_that_no_camera_sees_has_a_reason(tmp_path: Path) -> None:
    (tmp_path / "places.csv").write_text("x,y\n250,0\n-300,0\n5000,0\n")
    words = (*stations(tmp_path, "1,0,0,900,0", "2,500,0,900,0"), 30, "--at", tmp_path / "places.csv")
    assert [np.isnan(row[2]) for row in numbers("table", *words, "--depths", 5)] == [False, True, True]
    lines = musat("depth", "table", *words, "--depths", 5).output.splitlines()
    assert lines[-2:] == ["-: no camera sees it", "-: only one camera sees it"]


@pytest.mark.parametrize(
    ("text", "message"),
    [("a,b\n1,2\n", "no columns x, y or d1, d2, s, t among a, b"), ("x,y\n", "no places")],
)
def test_places_that_cannot_be_read(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "places.csv").write_text(text)
    result = musat("depth", "table", *PAPER, "--at", tmp_path / "places.csv")
    assert result.exit_code == 1 and message in result.output


@pytest.mark.slow
def test_a_picture_of_contours(tmp_path: Path) -> None:
    for suffix, start in ((".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")):
        path = tmp_path / f"model{suffix}"
        assert musat("depth", "picture", path, *PAPER, *MODEL).exit_code == 0
        assert path.read_bytes().startswith(start)
    labels = re.findall(r"<text[^>]*>(1\.\d+)</text>", (tmp_path / "model.svg").read_text())
    x, y = np.linspace(0.0, 1126.0, 61), np.linspace(-1125.0, 1125.0, 61)
    factor = model_factor(x, y[:, None], 25.0, 2500.0, 1126.0, 1.35)
    assert len(labels) >= 3 and all(factor.min() - 0.01 < float(label) < factor.max() + 0.01 for label in labels)
    result = musat("depth", "picture", tmp_path / "a.bmp", *PAPER)
    assert result.exit_code == 1 and "a picture is .png, .svg or .pdf, not '.bmp'" in result.output
