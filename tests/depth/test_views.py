"""Depth factors over a model: the printed approximations of Groeneveld Meijer (1964), rays, and what is missing."""

import re
from pathlib import Path

import numpy as np
import pytest

from musatpy.depth.cameras import CameraStations
from musatpy.depth.views import (
    PairPlaces,
    VerticalPair,
    contour_picture,
    factor_table,
    factors,
    model_of,
    normalised,
    read_places,
    single_value,
)
from musatpy.errors import DepthError
from musatpy.refraction.apparent import Stations
from musatpy.refraction.depth_factor import model_factor

PAPER = VerticalPair(height=2500.0, base=1126.0, index=1.35)  # feet
DEPTHS = np.array([0.0, 10.0, 25.0, 50.0, 100.0])
# The model of Figure 3: as wide as the flight lines of 40 % side overlap are apart, and its corner
X, Y = (one.ravel() for one in np.meshgrid(np.linspace(0.0, 1126.0, 13), np.linspace(-1125.0, 1125.0, 19)))


def test_the_model_is_worst_at_its_corners() -> None:
    """Table 2: the largest departures from the factors of 25 feet are in the corners."""
    found = PAPER.formula(PairPlaces.at(X, Y, PAPER.base), DEPTHS)
    off = normalised(found, found.factor[:, 2])
    for place in np.delete(off.place, 2).tolist():
        assert (abs(X[place] - 563.0), abs(Y[place])) == (563.0, 1125.0)
    # the printed d2 of the corner is 1600 feet, of which this place has 1592: the factor is 0.001 less
    np.testing.assert_allclose(100.0 * off.departure.relative, [-0.16, -0.08, 0.0, 0.15, 0.44], atol=0.015)
    np.testing.assert_allclose(off.departure.error, [0.0, -0.012, 0.0, 0.110, 0.65], atol=0.02)


def test_a_single_value_for_the_model() -> None:
    """Table 3 with its value of 1.410: within 4.1 per cent everywhere, contour by contour."""
    factor = PAPER.formula(PairPlaces.at(X, Y, PAPER.base), np.array([25.0])).factor[:, 0]
    found = single_value(factor, 1.410, 25.0, 0.01)
    assert found.levels[0] == factor.max() and found.levels[-1] == factor.min()
    np.testing.assert_allclose(found.levels[1:-1], np.arange(1.46, 1.365, -0.01), atol=1e-12)
    np.testing.assert_allclose(found.departure.error[1:-1], np.arange(1.25, -1.01, -0.25), atol=1e-9)
    assert 100.0 * np.abs(found.departure.relative).max() < 4.1
    assert found.within[0] == 1.0
    for level, part in zip(found.levels, found.within, strict=True):
        assert part == pytest.approx(np.mean(np.abs(factor - 1.41) <= abs(level - 1.41) + 1e-9))


def test_rays_of_the_pair_are_near_the_formula() -> None:
    by_rays = PAPER.exact(X, Y, DEPTHS)
    by_formula = PAPER.formula(PairPlaces.at(X, Y, PAPER.base), DEPTHS)
    assert not by_rays.fault.any()
    # 2e-4 at the corners at 100 feet, where the rays miss each other by 1.7 feet; tests/refraction/test_apparent.py
    np.testing.assert_allclose(by_rays.factor, by_formula.factor, atol=3e-4)
    # where both distances are equal nothing is approximate; a zero depth is a millionth of the height
    middle = X == 563.0
    np.testing.assert_allclose(by_rays.factor[middle], by_formula.factor[middle], atol=1e-6)


def test_depths_are_those_below_the_tides_of_the_cameras_that_see_a_place() -> None:
    """Two pairs of one shape far from each other, one at high and one at low water, have the same factors."""
    place = np.array([[0.0, 0.0, 2500.0], [1126.0, 0.0, 2500.0]])
    far = place + np.array([90000.0, 0.0, 40.0])
    stations = Stations(position=np.vstack([place, far]), level=np.array([0.0, 0.0, 40.0, 40.0]))
    cameras = CameraStations(names=("1", "2", "3", "4"), stations=stations, limit=np.radians(40.0))
    x, y = np.array([200.0, 90200.0]), np.array([300.0, 300.0])
    low, high = factors(model_of(cameras, 1.35), x, y, DEPTHS).factor
    np.testing.assert_allclose(low, high, atol=1e-6)  # one step of the iteration
    pair = Stations(position=place, level=np.zeros(2))
    alone = factors(model_of(CameraStations(names=("1", "2"), stations=pair), 1.35), x[:1], y[:1], DEPTHS)
    np.testing.assert_allclose(low, alone.factor[0], atol=1e-6)


def test_a_place_that_no_camera_sees_has_a_reason() -> None:
    position = np.array([[0.0, 0.0, 900.0], [500.0, 0.0, 900.0]])
    stations = Stations(position=position, level=np.zeros(2))
    cameras = CameraStations(names=("1", "2"), stations=stations, limit=np.radians(30.0))
    x = np.array([250.0, -300.0, 5000.0])
    found = factors(model_of(cameras, 1.34), x, np.zeros(3), np.array([5.0]))
    assert np.isnan(found.factor[:, 0]).tolist() == [False, True, True]
    assert found.reasons() == ["no camera sees it", "only one camera sees it"]
    text = factor_table({"x": x, "y": np.zeros(3)}, found)
    assert [line.split()[-1] for line in text[1:4]] == [f"{found.factor[0, 0]:.4f}", "-", "-"]
    assert text[4:] == ["-: no camera sees it", "-: only one camera sees it"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n", "no columns x, y or d1, d2, s, t among a, b"),
        ("x,y\n", "no places"),
    ],
)
def test_places_that_cannot_be_read(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "places.csv").write_text(text)
    with pytest.raises(DepthError, match=message):
        read_places(tmp_path / "places.csv")


# --- pictures ---


@pytest.mark.slow
def test_a_picture_of_contours(tmp_path: Path) -> None:
    """The contours of the picture are those of the formula: the lines are looked for among its paths."""
    x, y = np.linspace(0.0, 1126.0, 61), np.linspace(-1125.0, 1125.0, 61)
    factor = model_factor(x, y[:, None], 25.0, 2500.0, 1126.0, 1.35)
    stations = np.array([[0.0, 0.0], [1126.0, 0.0]])
    for suffix, start in ((".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")):
        path = tmp_path / f"model{suffix}"
        contour_picture(path, x, y, factor, stations, title="F", step=0.01)
        assert path.read_bytes().startswith(start)
    text = (tmp_path / "model.svg").read_text()
    assert len(re.findall(r"<text[^>]*>1\.4\d*</text>", text)) >= 3  # labels of contours


def test_a_picture_of_another_kind(tmp_path: Path) -> None:
    with pytest.raises(DepthError, match=r"a picture is \.png, \.svg or \.pdf, not '\.bmp'"):
        contour_picture(
            tmp_path / "a.bmp", np.arange(3.0), np.arange(3.0), np.eye(3), np.zeros((2, 2)), title="", step=0.1
        )
