"""The loop of a plotter: marks to stages, driven paths, marks without stages; the formulas of ETL-0306, section 5.

(5.1) to (5.17) stand here once more, by scalars, misprints put right, with the least squares of their equations by
numpy: what the formulas of arrays say must be the same. docs/as11_of_1983.md has what each shortcut costs.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cli.commands import musat
from compilation.scenes import MODEL, at_depth, curved_images, deck_of_cards, flat_images, grid, pair, readings_at
from musatpy import model, read_deck
from musatpy.adjustment.job import adjust
from musatpy.arrays import FloatArray
from musatpy.as11_runs import of_solution
from musatpy.compilation.compiled import Compiled, compiled
from musatpy.compilation.loop import Drive, stages
from musatpy.compilation.printed import AS_1983, Shortcuts, printed_points, true_coordinates
from musatpy.compilation.stereomodels import Stereomodel, set_up
from musatpy.compilation.triangulation import AdjustedRun
from musatpy.compilation.true_points import true_points
from musatpy.compilation.verdicts import warnings_of
from musatpy.errors import CompilationError
from musatpy.reports.record import dumps, record
from musatpy.units import DEGREE

FIXTURES = Path(__file__).parents[2] / "fixtures"
UNITS = np.array([DEGREE, DEGREE, 1.0])
MARKS = np.array([[100.0, -300.0, -12.0], [-500.0, 900.0, -1.0], [0.0, 0.0, 40.0], [300.0, 5.0, -25.0]])


@pytest.fixture(scope="module")
def solution() -> model.Solution:
    return adjust(read_deck(FIXTURES / "st_thomas/st_thomas.crd"))


def test_stages_of_true_marks_are_traced_images() -> None:
    run = pair(3000.0, 1810.0, (0.4, -0.3))
    points = at_depth(grid((200.0, 1600.0), 1700.0, 5), 12.0)
    stereo = set_up(run, "1", "2")
    marks = stereo.model(run.frame.working(points))
    np.testing.assert_allclose(stages(stereo, marks), flat_images(run, points), rtol=0.0, atol=1e-10)


def test_true_marks_need_water(solution: model.Solution) -> None:
    run = of_solution(solution)
    dry = replace(run, block=replace(run.block, water=None))
    with pytest.raises(CompilationError, match="drive AIR"):
        stages(set_up(dry, "21", "22"), MARKS)
    assert stages(set_up(dry, "21", "22"), MARKS, Drive.AIR).shape == (4, 2, 2)


@pytest.fixture(scope="module")
def record_file(solution: model.Solution, tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("run") / "run.json"
    run.write_text(dumps(record(solution)))
    return run


def test_a_path_is_driven_at_its_rate_and_told_where_it_leaves_the_plates(
    solution: model.Solution, record_file: Path, tmp_path: Path
) -> None:
    """10 m in one second at a scale of 1 to 15,740: .63 mm/s, by the job too; then 4 km, off the plates."""
    path = tmp_path / "path.csv"
    path.write_text("t,X,Y,Z\n0,0,0,-5\n1,10,0,-5\n")
    result = musat("as11", "drive", record_file, "21", "22", path)
    assert result.exit_code == 0 and "51 cycles at 50 Hz" in result.output
    speed = float(result.output.rsplit("stages up to ", 1)[1].split(" mm/s")[0])
    assert speed == pytest.approx(10.0 * 152.25 / 2400.0, rel=0.05)
    head, *rows = (tmp_path / "path.stages.csv").read_text().splitlines()
    assert head == "t,x1,y1,x2,y2" and len(rows) == 51 and rows[-1].startswith("1.0000,")
    stereo = set_up(of_solution(solution), "21", "22")
    level = stereo.run.frame.level(stereo.working(np.array([[0.0, 0.0, -5.0], [10.0, 0.0, -5.0]])))
    places = (f"{t},{lat!r},{lon!r},{height!r}" for t, (lat, lon, height) in enumerate((level / UNITS).tolist()))
    path.write_text("\n".join(["t,lat,lon,height", *places, ""]))
    assert musat("as11", "drive", record_file, "21", "22", path, "--job").exit_code == 0
    in_job = np.genfromtxt(tmp_path / "path.stages.csv", delimiter=",", skip_header=1)
    np.testing.assert_allclose(in_job, np.genfromtxt(rows, delimiter=","), rtol=0.0, atol=2e-6)
    path.write_text("t,X,Y,Z\n0,0,0,-5\n10,4000,0,-5\n")
    result = musat("as11", "drive", record_file, "21", "22", path, "--rate", "10")
    cells = np.genfromtxt(tmp_path / "path.stages.csv", delimiter=",", skip_header=1)
    outside = cells[(np.abs(cells[:, 1:]) > 114.3).any(axis=1), 0]
    told = f"{len(outside)} cycles off the plates, t = {outside[0]:g} to {outside[-1]:g} s"
    assert 0 < len(outside) < len(cells) == 101 and told in result.output


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,X,Y,Z\n0,0,0,0\n", "1 rows: a path has two"),
        ("t,X,Y,Z\n0,0,0,0\n1,a,0,0\n", "col 3 x: 'a' is not a number"),
        ("t,X,Y,Z\n0,0,0,0\n0,0,0,0\n", "time does not go on"),
        ("t,X,Y,Z\n0,0,0,0\n1e9,0,0,0\n", "5e+10 cycles from t = 0 to 1e+09 s: t counts seconds"),
    ],
)
def test_paths_that_cannot_be_driven(text: str, message: str, record_file: Path, tmp_path: Path) -> None:
    path = tmp_path / "path.csv"
    path.write_text(text)
    result = musat("as11", "drive", record_file, "21", "22", path)
    assert result.exit_code == 1 and message in result.output


_PLACES = grid((200.0, 1600.0), 1700.0)
_DEPTH = 30.0


@pytest.fixture(scope="module")
def run() -> AdjustedRun:
    """Return the pair of section 5: H 3000 m, f 152.4 mm, base 1810 m."""
    return pair(3000.0, 1810.0)


def marks(stereo: Stereomodel, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the marks (k, 3) without x-parallax, in the middle of the rays, and their y-parallaxes (k,) mm.

    By scalars: each ray at the height where both have the same X.
    """
    place, parallax = np.empty((len(xy), 3)), np.empty(len(xy))
    (x1, y1, z1), (x2, y2, z2) = stereo.stations
    f = 152.4
    for row, ((a, b), (c, d)) in enumerate(xy):
        fall = (x2 - x1) / (a - c)  # both cameras look straight down from one height
        assert z1 == pytest.approx(z2)
        Y = [y1 + b * fall, y2 + d * fall]
        place[row] = x1 + a * fall, np.mean(Y), z1 - f * fall
        parallax[row] = d - b - (y2 - y1) / fall * -1.0
    return place, parallax


def cards(place: FloatArray, parallax: FloatArray | None, loop: str = " ", flags: str = "GB") -> list[str]:
    """Return the cards of model points, submerged if not flagged otherwise, with and without y-parallaxes (mm)."""
    lines = [f"{MODEL}  {loop}"]
    for row, (X, Y, Z) in enumerate(place):
        py = "" if parallax is None else f"{1e3 * parallax[row]:8.2f}"
        lines.append(f"MPT 1        {row:<8} {flags}{X:12.4f}{Y:12.4f}{Z:12.4f}{py}")
    return lines


def points(run: AdjustedRun, *deck: str) -> Compiled:
    return compiled(run, deck_of_cards(*deck))


def test_points_are_true_with_their_parallaxes_and_off_without(run: AdjustedRun) -> None:
    true = at_depth(_PLACES, _DEPTH)
    place, parallax = marks(set_up(run, "1", "2"), flat_images(run, true))
    result = points(run, *cards(place, parallax))
    # .005 um of the card's y-parallax and .05 mm of its coordinates, at a scale of 1 to 20,000.
    assert np.abs(result.points.position - true).max() < 5e-4
    assert np.abs(result.points.y_parallax).max() < 1e-5
    assert not list(warnings_of(result))
    without = points(run, *cards(place, None))
    lost = np.linalg.norm(without.points.position - true, axis=1).max()
    assert 0.05 < lost < 0.1 and np.isnan(without.points.y_parallax).all()
    (warning,) = warnings_of(without)
    # Up to .083 m where the straight rays meet best (ETL-0306 has 30 m as the deepest of St. Thomas).
    told = float(warning.split("up to ")[1].split(" m")[0])
    assert warning.startswith("model 1 has model points without y-parallax") and told == pytest.approx(
        0.083, rel=0.05
    )


def test_dry_points_need_no_parallax(run: AdjustedRun) -> None:
    place, _ = marks(set_up(run, "1", "2"), flat_images(run, at_depth(_PLACES, 0.0)))
    place[:, 2] += 5.0
    result = points(run, *cards(place, None, flags="G "))
    stereo = set_up(run, "1", "2")
    assert np.abs(stereo.model(run.frame.working(result.points.position)) - place).max() < 1e-4
    assert not list(warnings_of(result))


def test_marks_of_a_loop_through_the_water_are_the_true_points(run: AdjustedRun) -> None:
    """Nothing is lost without y-parallaxes there; one that the operator saw stays a y-parallax of the point."""
    true = at_depth(_PLACES, _DEPTH)
    place = set_up(run, "1", "2").model(run.frame.working(true))
    result = points(run, *cards(place, None, "T"))
    assert np.abs(result.points.position - true).max() < 1e-4  # .05 mm of the card
    assert np.isnan(result.points.y_parallax).all() and not list(warnings_of(result))
    seen = points(run, *cards(place, np.full(len(place), 0.008), "T"))
    # that of the point is of the right image, across its epipolar line, which is not quite along Y.
    np.testing.assert_allclose(seen.points.y_parallax, 0.008, rtol=0.01)


PLACES = grid((200.0, 1600.0), 1700.0)


def errors(model: Stereomodel, points: FloatArray, xy: FloatArray, mode: Shortcuts) -> FloatArray:
    """Return the errors (k, 3) of compiled points against working coordinates."""
    return np.asarray(model.working(printed_points(model, xy, mode)) - points)


def flat(tides: tuple[float, float], depth: float) -> tuple[Stereomodel, FloatArray, FloatArray]:
    """Return a model, working coordinates of points, and their images; H 3000 m, f 152.4 mm, base 1810 m."""
    run = pair(3000.0, 1810.0, tides)
    points = at_depth(PLACES, depth)
    return set_up(run, "1", "2"), run.frame.working(points), flat_images(run, points)


@pytest.mark.parametrize("tides", [(0.0, 0.0), (0.4, -0.3)])
@pytest.mark.parametrize("depth", [0.0, 1.0, 30.0])
def test_own_rays_give_the_truth(tides: tuple[float, float], depth: float) -> None:
    """To 1e-10 m, tides of their own included: rounding of coordinates of some kilometres."""
    model, points, xy = flat(tides, depth + 0.5)
    assert np.abs(errors(model, points, xy, Shortcuts())).max() < 1e-10


def test_verticals_of_the_points_are_exact_over_a_sphere() -> None:
    """To .13 mm, what the curvature of the water does within a ray; so are the rays of the images."""
    model = set_up(pair(2400.0, 1500.0, sphere=True), "1", "2")
    points, xy = curved_images(model, grid((0.0, 1500.0), 1300.0), 25.0)
    assert np.abs(errors(model, points, xy, Shortcuts())).max() < 1.3e-4
    image = true_points(model.run, model.photos, readings_at(xy))
    assert np.abs(model.run.frame.working(image.position) - points).max() < 1.3e-4


def true_point(B: FloatArray, P: FloatArray, water: FloatArray, n: float) -> FloatArray:
    """Return X, Y, Z by (5.1) to (5.17), photo by photo, and the least squares of their four equations.

    (5.4) with By2, each photo with its own factor in (5.11) and (5.12), and c3 = Q in (5.23), which is not 0.
    """
    A, a = [], []
    for (Bx, By, Bz), (Px, Py, Pz), Zw in zip(B, P, water, strict=True):
        part = (Bz - Zw) / (Bz - Pz)
        Xw, Yw = Bx + part * (Px - Bx), By + part * (Py - By)  # (5.1) to (5.4)
        D = math.hypot(Xw - Bx, Yw - By)  # (5.5), (5.6)
        i = math.atan(D / (Bz - Zw))  # (5.7), (5.8)
        k = math.tan(math.asin(math.sin(i) / n)) / D if D else 0.0  # (5.9) to (5.12)
        for axis, (W, b) in enumerate(((Xw, Bx), (Yw, By))):
            r = -k * (W - b)  # (5.17a) to (5.17d)
            A.append([1.0 - axis, float(axis), -r])
            a.append(W - r * Zw)
    return np.linalg.lstsq(np.array(A), np.array(a), rcond=None)[0]


def test_the_formulas_of_arrays_are_those_of_the_report() -> None:
    """Of 300 pairs of rays, of which neither meets the other: to the rounding of some kilometres.

    The last point is below a camera: D is zero, by which the formulas divide, and the ray goes straight down.
    """
    draws = np.random.default_rng(51)
    B = draws.uniform([-100.0, -100.0, 2900.0], [100.0, 100.0, 3100.0], (300, 2, 3))
    B[:, 1, 0] += 1800.0
    P = draws.uniform([200.0, -1500.0, -30.0], [1600.0, 1500.0, -1.0], (300, 1, 3)) + draws.normal(size=(300, 2, 3))
    P[..., 2] = P[:, :1, 2]
    P[-1, 0, :2] = B[-1, 0, :2]
    water, n = draws.uniform(-0.5, 0.5, (300, 2)), 1.34
    expected = [true_point(*of, n) for of in zip(B, P, water, strict=True)]
    np.testing.assert_allclose(true_coordinates(B, P, water, n), expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize("tides", [(0.0, 0.0), (0.4, -0.3)])
def test_the_program_of_1983_to_the_letter(tides: tuple[float, float]) -> None:
    """One model point, one vertical and one height of water, over a sphere."""
    stereo = set_up(pair(2400.0, 1500.0, tides, sphere=True), "1", "2")
    _, xy = curved_images(stereo, grid((0.0, 1500.0), 1300.0, 5), 20.0)
    water = np.full(2, np.mean(tides) - stereo.run.frame.height(stereo.origin[None])[0])
    expected = [true_point(stereo.stations, [point, point], water, 1.34) for point in stereo.half_way(xy)]
    np.testing.assert_allclose(printed_points(stereo, xy, AS_1983), expected, rtol=0, atol=1e-8)
