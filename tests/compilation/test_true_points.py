"""Compiled points against the run, in the system of the answer, in their models and in words; models set up."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
import pytest

from altered import altered, with_options
from cli.commands import musat
from compilation.scenes import (
    MODEL,
    at_depth,
    compiled_again,
    deck_of_cards,
    flat_images,
    grid,
    pair,
    readings_at,
    stage_card,
)
from musatpy import model, read_deck
from musatpy.adjustment.job import adjust
from musatpy.arrays import FloatArray
from musatpy.as11_runs import of_solution
from musatpy.compilation.against_run import AgainstRun, ModelSetUp, against_run, model_set_up
from musatpy.compilation.compiled import compiled
from musatpy.compilation.stereomodels import set_up
from musatpy.compilation.triangulation import AdjustedRun, of_record
from musatpy.compilation.true_points import BEHIND, CompiledPoints, Readings, true_points
from musatpy.errors import CompilationError
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.reports.compilation import DOCUMENT, SET_UP
from musatpy.reports.record import dumps, record
from record_rows import read_rows, valid_rows
from stage_readings import DECK

FIXTURES = Path(__file__).parents[2] / "fixtures"
ONE, PHOTO = ({"water_level": level} for level in (model.WaterLevel.ONE, model.WaterLevel.PHOTO))


def kept_out(
    deck: str, program: model.Program, sigmas: bool, options: dict[str, object]
) -> tuple[model.Block, list[int]]:
    """Return a block with every second point of two rays kept out, and these; sigmas of tides, tilt and index."""
    block = read_deck(FIXTURES / deck)
    rays = np.bincount(block.plates.point, minlength=len(block.points.ids))
    rays[block.control.point] = 0
    chosen = np.flatnonzero(rays == 2)[::2]
    out = np.isin(block.plates.point, chosen)
    options |= {"program": program, "refraction": model.Refraction.RIGOROUS}
    block = altered(block, options=options, plates={"triangulated": block.plates.triangulated & ~out})
    if sigmas and block.water is not None:
        tide_sigma = np.full(len(block.photos.ids), 0.15)
        water = {"sigma": 0.002, "tilt_sigma": 1e-4}
        block = altered(block, photos={"tide_sigma": tide_sigma}, water=water)
    return block, chosen.tolist()


def readings_of(block: model.Block, point: int, factor: float) -> tuple[tuple[int, int], Readings]:
    """Return the photos of a point, and its images as readings with the sigmas of their cards times a factor."""
    rows = np.flatnonzero(block.plates.point == point)
    left, right = block.plates.photo[rows].tolist()
    return (left, right), Readings(
        ids=block.points.ids[[point]],
        submerged=block.points.bathymetric[[point]],
        xy=block.plates.xy[rows][None],
        sigma=factor * block.plate_sigmas[rows][None],
    )


def compare(run: AdjustedRun, solution: model.Solution, points: list[int]) -> None:
    """Hold compiled points against those of the run."""
    working = run.frame.working(solution.points.position)
    bathymetric = solution.bathymetric
    for point in points:
        photos, readings = readings_of(solution.block, point, solution.unit_sigma)
        compiled = true_points(run, photos, readings)
        np.testing.assert_allclose(run.frame.working(compiled.position)[0], working[point], rtol=0, atol=1e-6)
        np.testing.assert_allclose(compiled.covariance[0], solution.points.covariance[point], rtol=1e-6, atol=1e-9)
        rows = np.flatnonzero(solution.block.plates.point == point)
        np.testing.assert_allclose(compiled.residual[0], solution.plates.residual[rows], rtol=0, atol=1e-9)
        for row in np.flatnonzero(bathymetric.point == point):
            assert compiled.depth[0] == pytest.approx(bathymetric.depth[row], abs=1e-6)
            assert compiled.depth_sigma[0] == pytest.approx(bathymetric.depth_sigma[row], rel=1e-6)
            np.testing.assert_allclose(compiled.apparent[0], bathymetric.apparent[row], rtol=0, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("deck", "program", "sigmas", "options"),
    [
        ("st_thomas/st_thomas.crd", model.Program.IIA, False, {}),
        ("st_thomas/st_thomas.crd", model.Program.IIA, True, {}),
        ("st_thomas/st_thomas.crd", model.Program.IIIA, True, ONE),
        ("st_thomas/st_thomas.crd", model.Program.IIIA, True, {**ONE, "water_index": model.Treatment.ADJUST}),
        ("st_thomas/st_thomas.crd", model.Program.IIIA, True, PHOTO),
        ("st_thomas/st_thomas.crd", model.Program.IIIA, True, {**PHOTO, "water_index": model.Treatment.ADJUST}),
        ("cayman/cayman_clean.crd", model.Program.IIIA, False, {}),
        ("waves/strip.crd", model.Program.IIIA, False, {}),
        ("waves/unknown.crd", model.Program.IIIA, False, dict(PHOTO)),
        ("waves/unknown.crd", model.Program.IIA, False, {}),  # considered: their sigmas go into all others
    ],
)
def test_points_that_the_run_keeps_out_are_the_same_when_they_are_compiled(
    deck: str, program: model.Program, sigmas: bool, options: dict[str, object], tmp_path: Path
) -> None:
    """To 1e-6 m and 1e-6 of the sigmas, from the solution and from its record."""
    block, points = kept_out(deck, program, sigmas, dict(options))
    solution = adjust(block)
    assert solution.converged and len(points) >= (4 if deck == "waves/strip.crd" else 6)
    compare(of_solution(solution), solution, points[:2])
    path = tmp_path / "run.json"
    path.write_text(dumps(record(solution)))
    compare(of_record(path), solution, points)


@pytest.fixture(scope="module")
def strip() -> AdjustedRun:
    return of_solution(adjust(read_deck(FIXTURES / "st_thomas/st_thomas.crd")))


def one(strip: AdjustedRun, xy: list[list[float]]) -> CompiledPoints:
    return true_points(strip, (0, 1), readings_at(np.array([xy])))


def test_rays_that_give_no_point_are_told(strip: AdjustedRun) -> None:
    crossed = one(strip, [[-80.0, 0.0], [80.0, 0.0]])
    assert crossed.reasons == {0: BEHIND} and np.isnan(crossed.position).all() and np.isnan(crossed.depth).all()


def test_the_y_parallax_is_what_the_right_image_is_off(strip: AdjustedRun) -> None:
    """An image moved by 0.1 mm across its epipolar curve; the sigma of a pointing and of the stations."""
    at = one(strip, [[60.0, 20.0], [-30.0, 20.0]])
    moved = one(strip, [[60.0, 20.0], [-30.0, 20.1]])
    assert moved.y_parallax[0] - at.y_parallax[0] == pytest.approx(0.1, rel=0.01)  # the curve leans a little
    straight = one(strip, [[60.0, 20.0], [-30.0, 20.0 - at.y_parallax[0]]])
    assert abs(straight.y_parallax[0]) < 0.01 * abs(at.y_parallax[0])
    assert np.abs(straight.residual).max() < 0.01 * np.abs(at.residual).max()
    assert np.sqrt(2.0) * 0.005 < at.y_parallax_sigma[0] < 0.02


def test_a_run_that_has_not_converged_is_not_compiled_from() -> None:
    block = read_deck(FIXTURES / "st_thomas/st_thomas.crd")
    solution = adjust(with_options(block, max_iterations=1, max_passes=1))
    with pytest.raises(CompilationError, match="the run has not converged"):
        of_solution(solution)


def start() -> model.Block:
    block = read_deck(FIXTURES / "st_thomas/st_thomas.crd")
    return with_options(block, program=model.Program.IIIA, refraction=model.Refraction.RIGOROUS)


def against(solution: model.Solution, xy: np.ndarray, sigma: float) -> AgainstRun:
    """Return the points on photos 21 and 22, of plate coordinates xy (m, 2), beside those of the run."""
    result, rows = compiled_again(solution, xy, sigma)
    return against_run(result.models[0], np.ones(len(rows), dtype=bool))


@pytest.fixture(scope="module")
def solution() -> model.Solution:
    return adjust(start())


def test_the_same_readings_of_two_rays_are_the_same_point(solution: model.Solution) -> None:
    """Without sigma; points of three photos differ by what the third one adds, control is not tested."""
    found = against(solution, solution.block.plates.xy, 0.005 * solution.unit_sigma)
    rays = np.bincount(solution.block.plates.point)[found.points]
    control = of_solution(solution).control[found.points]
    same = (rays == 2) & ~control
    assert found.shared.all() and same.sum() >= 5
    assert found.length[same].max() < 1e-6 and found.sigma[same].max() < 1e-5 and np.isnan(found.test[same]).all()
    three = (rays == 3) & ~control
    assert three.any() and (found.sigma[three] > 0.01).all() and (found.test[three] < 3.0).all()
    assert np.isnan(found.sigma[control]).all() and control.any()


def test_a_point_of_which_the_run_has_kept_out_one_reading_is_not_tested() -> None:
    block = start()
    three = np.flatnonzero(np.bincount(block.plates.point) == 3)
    held = np.concatenate([block.control.point, block.equal_elevations.point])
    point = np.setdiff1d(three, held)[0]
    out = (block.plates.point == point) & (block.plates.photo == 0)
    solution = adjust(altered(block, plates={"triangulated": ~out}))
    found = against(solution, block.plates.xy, 0.005 * solution.unit_sigma)
    assert np.isnan(found.test[found.points == point]).all() and np.isfinite(found.length).all()


@pytest.mark.slow
@pytest.mark.parametrize("again", [True, False])
def test_differences_are_as_large_as_their_covariances_say(solution: model.Solution, again: bool) -> None:
    """Twenty-five runs of noise in plates and control; readings made again, or those of the run."""
    block, draws, tests = solution.block, np.random.default_rng(5), []
    exact = block.plates.xy + solution.plates.residual
    control = block.control
    full = np.isfinite(control.position).all(axis=1)
    for _ in range(25):
        xy = exact + 0.005 * draws.normal(size=exact.shape)
        truth = solution.points.position[control.point]
        metres = control.sigma * draws.normal(size=control.sigma.shape) / [6.04e6, 6.35e6, 1.0]
        moved = truth + metres[:, [1, 0, 2]]
        given = np.where(full[:, None], moved, control.position)
        run = adjust(altered(block, plates={"xy": xy}, control={"position": given}))
        read = exact + 0.005 * draws.normal(size=exact.shape) if again else xy
        found = against(run, read, 0.005 * run.unit_sigma)
        tests.append(found.test[np.isfinite(found.test)])
    assert np.sqrt(np.mean(np.square(np.concatenate(tests)))) == pytest.approx(1.0, abs=0.12)


_FEET = 1200.0 / 3937.0  # m, US survey foot


@pytest.fixture(scope="module")
def in_feet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the run whose answer is stated in State Plane feet, with what is compiled of it."""
    folder = tmp_path_factory.mktemp("feet")
    assert musat("run", "-q", FIXTURES / "st_thomas_utm/st_thomas_utm.crd", "-o", folder)
    result = musat("as11", "compile", folder / "st_thomas_utm.json", DECK, "-o", folder)
    assert result.exit_code == 0, result.output
    return folder


def in_state_plane(position: FloatArray) -> FloatArray:
    """Return feet, feet, metres of latitudes, longitudes (rad) and heights on the ellipsoid of the job, by PROJ."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a string of PROJ has no datum: none is shifted
        project = pyproj.Proj(pyproj.CRS.from_epsg(3992).to_proj4())
    east, north = project(*np.degrees(position[:, [1, 0]]).T)
    return np.column_stack([east, north, position[:, 2]])


@pytest.mark.slow
def test_points_are_stated_as_the_answer_of_the_run(in_feet: Path) -> None:
    record = valid_rows(in_feet / "st_thomas_as11.json", DOCUMENT.schema())
    for name in ("position", "apparent"):
        of_job = np.array([row[name] for row in record["points"]], dtype=float)
        stated = np.array([row[name] for row in record["stated"]["points"]], dtype=float)
        np.testing.assert_allclose(stated, in_state_plane(of_job), rtol=0, atol=1e-6)
    assert record["stated"]["answer"]["definition"] == "EPSG:3992"


def test_covariances_are_of_the_stated_coordinates(in_feet: Path) -> None:
    """By central differences of 10 m along east, north and up."""
    record = read_rows(in_feet / "st_thomas_as11.json")
    position = np.array([row["position"] for row in record["points"]])
    ellipsoid = Ellipsoid.of(model.EllipsoidSpec(name="clrk66"))
    at, axes = ellipsoid.geocentric(position), ellipsoid.frame(position)
    J = np.empty((len(at), 3, 3))
    for axis in range(3):
        sides = [in_state_plane(ellipsoid.geographic(at + step * axes[:, axis])) for step in (10.0, -10.0)]
        J[:, :, axis] = (sides[0] - sides[1]) / 20.0
    covariance = J @ np.array([row["covariance"] for row in record["points"]]) @ np.swapaxes(J, 1, 2)
    stated = np.array([row["covariance"] for row in record["stated"]["points"]])
    np.testing.assert_allclose(stated, covariance, rtol=1e-5, atol=1e-9)
    listing = (in_feet / "st_thomas_as11.lst").read_text()
    assert "Point Compilation: True Coordinates Of The Answer" in listing and "US survey foot" in listing
    assert max(len(line) for line in listing.replace("\f", "").splitlines()) <= 132


def test_files_have_the_coordinates_of_the_answer(in_feet: Path) -> None:
    head, *rows = (in_feet / "st_thomas_as11.contours.csv").read_text().splitlines()
    assert head == "line,surface,depth,index,closed,E,N,h"
    east = np.array([float(row.split(",")[5]) for row in rows])
    # The bay lies some 310 km from the false origin of the zone.
    assert (east * _FEET > 309_000.0).all() and (east * _FEET < 313_000.0).all()
    for name in ("profiles", "BAY"):
        assert ",E,N,h" in f",{(in_feet / f'st_thomas_as11.{name}.csv').read_text().splitlines()[0]}"


def test_places_in_the_model_come_back_by_the_axes_of_the_record(in_feet: Path) -> None:
    """Round trip below 1e-9 m, with what the record says of the model and nothing else."""
    record = read_rows(in_feet / "st_thomas_as11.json")
    ellipsoid = Ellipsoid.of(model.EllipsoidSpec(name="clrk66"))
    for of_model in record["models"]:
        rows = [row for row in record["points"] if row["model"] == of_model["model"]]
        axes, origin = np.array(of_model["axes"]), np.array(of_model["origin"])
        for name, place in (("position", "model_position"), ("apparent", "model_apparent")):
            in_model = np.array([row[place] for row in rows], dtype=float)
            geocentric = in_model @ axes + origin + of_model["working_origin"]
            given = ellipsoid.geocentric(np.array([row[name] for row in rows], dtype=float))
            np.testing.assert_allclose(geocentric, given, rtol=0, atol=1e-8)  # rounding of 6e6 m
        height = np.array(of_model["origin_position"])[2]
        assert height == pytest.approx(np.mean(of_model["tides"]), abs=1e-9)
        assert of_model["scale"] == pytest.approx(of_model["height"] / 0.15225, rel=1e-4)


TIDES = (0.4, -0.3)
POINTS = {"DEEP": -12.0, "BETWEEN": 0.05, "ABOVE": 3.0}


def told() -> dict[str, tuple[str | None, FloatArray]]:
    """Return the remarks of points, all flagged as submerged, of one on land, and of one on the shore."""
    run = pair(3000.0, 1810.0, TIDES)
    heights = {**POINTS, "LAND": 8.0, "SHORE": 0.05, "SLIP": -6.0}
    xyz = np.array([[700.0, 300.0, height] for height in heights.values()])
    gap = xyz[:, None] - run.block.photos.position
    straight = -run.block.cameras.focal_length[0] * gap[..., :2] / gap[..., 2:]
    wet = xyz[:, None, 2] < run.block.photos.tide
    xy = np.where(wet[..., None], flat_images(run, np.minimum(xyz, [np.inf, np.inf, min(TIDES)])), straight)
    xy = np.where(wet.all(axis=1)[:, None, None], flat_images(run, xyz), xy)
    high = altered(run, block={"photos": {"tide": np.full(2, 0.4)}})
    half = flat_images(high, at_depth(xyz[:, :2], -0.05))
    xy[1] = np.where(wet[1, :, None], half[1], straight[1])
    xy[5, 1, 1] += 0.1  # a slip of the right stage in y
    kinds = {"LAND": "G ", "SHORE": "S "}
    readings = [stage_card(name, kinds.get(name, "GB"), xy[row]) for row, name in enumerate(heights)]
    result = compiled(run, deck_of_cards(MODEL, *readings))
    return dict(zip(heights, zip(result.remarks, result.points.incidence, strict=True), strict=True))


def test_remarks_say_why_there_is_no_depth_and_angles_are_those_of_wet_rays() -> None:
    found = told()
    assert {name: remark for name, (remark, _) in found.items()} == {
        "DEEP": None,
        "BETWEEN": "between the tides",
        "ABOVE": "above the water",
        "LAND": "dry",
        "SHORE": "shoreline",
        "SLIP": "y-parallax",
    }
    wet = {name: np.isfinite(angles).tolist() for name, (_, angles) in found.items()}
    assert wet["DEEP"] == [True, True] and wet["BETWEEN"] == [True, False]
    assert wet["ABOVE"] == wet["LAND"] == [False, False]
    # By the tangents of the rays of the apparent point, some 9 m below the water.
    deep = found["DEEP"][1]
    run = pair(3000.0, 1810.0, TIDES)
    xy = flat_images(run, np.array([[700.0, 300.0, -12.0]]))[0]
    np.testing.assert_allclose(np.tan(deep), np.linalg.norm(xy, axis=1) / 152.4, rtol=1e-6)


_H, _BASE, _F, _POINTING = 3000.0, 1810.0, 152.4, 0.005


def with_points(run: AdjustedRun, points: FloatArray) -> AdjustedRun:
    """Return a run with submerged points (r, 3)."""
    ids = np.array([f"P{row}" for row in range(len(points))])
    block = replace(run.block, points=model.Points(ids=ids, bathymetric=np.ones(len(points), dtype=bool)))
    none = np.full((len(points), 3, 3), np.nan)
    return replace(run, block=block, position=points, point_covariance=none, control=np.zeros(len(points), bool))


def set_up_of(run: AdjustedRun, *cards: str) -> ModelSetUp:
    deck = deck_of_cards(MODEL, *cards)
    result = compiled(run, deck)
    return model_set_up(result.models[0], deck.stages.kind)


def test_the_run_predicts_the_stages_and_the_parallax_of_straight_rays() -> None:
    points = at_depth(grid((200.0, 1600.0), 1700.0), 30.0)
    run = with_points(pair(_H, _BASE), points)
    xy = flat_images(run, points)
    again = set_up_of(run, *(stage_card(f"P{row}", "RB", xy[row]) for row in (0, 7))).again
    # "Noise-free readings: below .001 um"; the cards have six decimals, rounded to half of that.
    assert np.abs(again.predicted - xy).max() < 1e-6
    assert np.abs(again.read - again.predicted)[[0, 7]].max() < 1e-6
    assert np.isnan(again.read[1]).all()
    assert np.abs(again.parallax).max() < 1e-6
    # 30.1 um at the scale of the water (a test of model points has the height that straight rays meet at).
    assert np.abs(again.straight).max() == pytest.approx(0.0299, abs=1e-4)


def test_points_that_a_photo_does_not_show_are_not_in_the_model() -> None:
    run = pair(_H, _BASE)
    points = at_depth(np.array([[900.0, 0.0], [-1500.0, 0.0], [900.0, 2500.0]]), 5.0)
    run = with_points(altered(run, block={"cameras": {"format_size": np.full((1, 2), 228.6)}}), points)
    assert set_up_of(run).again.points.tolist() == [0]


def test_standard_errors_to_expect_are_those_of_the_normal_case() -> None:
    expected = set_up_of(pair(_H, _BASE)).expected
    middle = (expected.depth == 0.0) & (np.abs(expected.place[:, :2]) < 1.0).all(axis=1)
    (row,) = np.flatnonzero(middle)
    scale = _H / _F
    # Of two vertical photos without errors of their own: H/B sqrt 2 in height, 1/sqrt 2 across the base.
    assert expected.sigma[row, 2] == pytest.approx(np.sqrt(2.0) * _H / _BASE * scale * _POINTING, rel=1e-6)
    assert expected.sigma[row, 1] == pytest.approx(np.sqrt(0.5) * scale * _POINTING, rel=1e-6)
    np.testing.assert_array_equal(expected.pointing, expected.sigma[:, 2])  # the run has no errors
    assert not expected.of_run.any()
    deep = expected.depth == 30.0
    assert np.isfinite(expected.points.depth_sigma[deep]).all() and (expected.points.depth[deep] > 29.9).all()
    np.testing.assert_allclose(expected.points.depth[deep], 30.0, rtol=0, atol=1e-6)


def test_a_model_without_water_stands_on_the_mean_ground() -> None:
    """Points at 40 and 60 m: the model begins at 50 m, and that is where errors are expected."""
    wet = pair(_H, _BASE)
    dry = altered(wet, block={"water": None, "photos": {"tide": np.full(2, np.nan)}})
    points = np.array([[700.0, 100.0, 40.0], [1100.0, -200.0, 60.0], [np.nan] * 3])
    run = with_points(dry, points)
    expected = set_up_of(run).expected
    assert set_up(run, "1", "2").height == pytest.approx(_H - 50.0, abs=1e-9)
    middle = (np.abs(expected.place) < 1.0).all(axis=1)
    scale = (_H - 50.0) / _F
    assert middle.sum() == 1 and (expected.depth == 0.0).all()
    up = np.sqrt(2.0) * (_H - 50.0) / _BASE * scale * _POINTING
    assert expected.sigma[middle, 2] == pytest.approx(up, rel=1e-6)


@pytest.mark.slow
def test_the_command_lists_the_models_before_anything_is_read(run_record: Path, tmp_path: Path) -> None:
    record, deck = run_record, tmp_path / "models.crd"
    deck.write_text("MDL 2122     21       22                                   5.00\nEND\n")
    result = musat("as11", "setup", record, deck)
    assert result.exit_code == 0 and "1 model set up" in result.output
    listing = (tmp_path / "models.setup.lst").read_text()
    for title in ("Options", "Model Set-Up", "Scales, And", "Model Axes", "Points Of The Run", "Standard Errors"):
        assert f"\n{title}" in listing
    assert max(map(len, listing.splitlines())) <= 132
    values = valid_rows(tmp_path / "models.setup.json", SET_UP.schema())
    # 5 um at H/B of 1.68 and a scale of 1 to 15,740 make .187 m in height; stations add what the run says.
    middle = next(row for row in values["expected"] if row["depth"] == 0.0 and max(map(abs, row["place"])) < 1.0)
    ratio = values["models"][0]["height"] / values["models"][0]["base"]
    pointing = np.sqrt(2.0) * ratio * values["models"][0]["scale"] * 5e-6
    assert middle["pointing_sigma"] == pytest.approx(pointing, rel=0.03)  # tilts of some degrees
    assert np.hypot(middle["pointing_sigma"], middle["run_sigma"]) == pytest.approx(middle["sigma"][2], rel=1e-9)
    assert middle["run_sigma"] > 0.05
