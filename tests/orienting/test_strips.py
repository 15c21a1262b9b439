"""Strips oriented by `musat orient`, and pairs without water."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from altered import added, altered
from cli.commands import musat
from json_schema import violations
from musatpy import model
from musatpy.arrays import FloatArray
from musatpy.formats.musat import deck_bytes
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.model.tables import empty, taken
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.strip import orient_strip
from musatpy.orienting.answer import answer_of
from musatpy.orienting.strip_answer import StripAnswer, strip_answer
from musatpy.orienting.task import task_of
from musatpy.reports import orientation, orientation_strip
from orientation.twomedia.geometries import HOUSE, KINDS, Kind, Scene, dry, geometry, scene, strip_scene
from orienting.decks import UNITS, deck_block, strip_block
from orienting.test_orient import orient, record, written
from record_rows import with_columns


def run(folder: Path, block: model.Block, *options: str) -> Result:
    """Return what became of the deck of a block."""
    return orient(written(folder, block), *options)


def record_in(folder: Path) -> dict[str, list[dict[str, object]]]:
    return record(folder / "job.crd")


def errors(folder: Path, true: Scene, name: str) -> np.ndarray:
    """Return the errors of the stations over their sigmas."""
    rows = record_in(folder)["stations"]
    station = UNITS[name] * true.stations * HOUSE
    place = np.array([row["position"] for row in rows], dtype=float)
    order = [int(str(row["photo"])) for row in rows]
    return np.asarray((place - station[order]) / np.array([row["position_sigma"] for row in rows], dtype=float))


@pytest.mark.parametrize(
    ("name", "plane", "grade"),
    [("lab", "ADJUST", "ACCEPTED"), ("lab", "LEVEL", "ACCEPTED"), ("aerial", "KNOWN", "ACCEPTED")],
)
def test_a_strip_from_its_deck(name: str, plane: str, grade: str, tmp_path: Path) -> None:
    block, true = strip_block(name, 6, plane=model.PlaneTreatment(plane))
    result = run(tmp_path, block, "--punch", "--csv")
    assert result.exit_code == 0 and f"job.crd: {grade}, STRIP of 6 photos" in result.output
    values, schema = record_in(tmp_path), orientation_strip.DOCUMENT.schema()
    assert not list(violations(with_columns(values, schema), schema, schema))
    assert np.abs(errors(tmp_path, true, name)).max() < 4.0  # of 18 that depend on each other
    away = np.array([row["position"] for row in values["against_iiia"]], dtype=float)
    assert 0.0 < np.abs(away).max() < 0.02 * UNITS[name] * true.kind.H  # of first values
    listing = (tmp_path / "job.lst").read_text()
    assert max(map(len, listing.splitlines())) <= 132
    assert all(
        title in listing
        for title in ("Joins Of The Triplets", "Control Of The Strip", "The Joined Triplets Less IIIA")
    )
    assert len((tmp_path / "job_tables/joins_of_the_triplets.csv").read_text().splitlines()) == 4


@pytest.mark.slow
def test_a_strip_has_the_sigmas_of_its_errors() -> None:
    """Errors of stations, points and water over their sigmas, of 100 draws of images and control: one.

    Each draw is adjusted from the triplets of the strip without errors, which is all that its answer has of them.
    """
    stations, points, water, chains = [], [], [], {}
    strips = [("lab", 4, "ADJUST"), ("lab", 4, "LEVEL"), ("aerial", 6, "ADJUST"), ("aerial", 4, "KNOWN")]
    for name, photos, plane in strips:
        task = task_of(strip_block(name, photos, noise=0.0, plane=model.PlaneTreatment(plane))[0])
        chains[name, photos, plane] = orient_strip(task.sights, task.plane)
    for draw in range(100):
        name, photos, plane = strips[draw % 4]
        block, true = strip_block(name, photos, seed=draw, plane=model.PlaneTreatment(plane))
        answer = strip_answer(task_of(block), chains[strips[draw % 4]])
        assert answer.solution is not None
        truth = UNITS[name] * true.stations[[int(photo) for photo in answer.photos]] * HOUSE
        stations.append((answer.position - truth) / answer.position_sigma)
        truth = UNITS[name] * true.points[[int(point) for point in answer.task.sights.points]] * HOUSE
        points.append(((answer.point_position - truth) / answer.point_sigma)[answer.control == ""])
        water.append((answer.water - [0.0, 0.0, UNITS[name] * true.d, 1.34]) / answer.water_sigma)
    # three deviations of the root mean squares by their scatter, .046 and .019
    assert np.sqrt(np.mean(np.square(np.concatenate(stations)))) == pytest.approx(1.0, abs=0.14)
    assert np.sqrt(np.mean(np.square(np.concatenate(points)))) == pytest.approx(1.0, abs=0.06)
    # slopes of 50 draws, levels of 75: three deviations of such a root mean square are 0.30 and 0.24
    assert np.isfinite(water).sum(axis=0).tolist() == [50, 50, 75, 0]
    assert (np.abs(np.sqrt(np.nanmean(np.square(water)[:, :3], axis=0)) - 1.0) < [0.30, 0.30, 0.24]).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lab", "aerial"])
def test_a_tide_and_a_tilt_with_sigmas_are_priors_of_the_water(name: str) -> None:
    """The water is near what the deck states of it, far nearer than triplets find it; stations fit their sigmas."""
    over = []
    for seed in range(5):
        block, true = strip_block(name, 4, seed=seed)
        level, draws = UNITS[name] * true.d, np.random.default_rng(seed)
        answer = answer_of(stated(block, level + 0.1 * draws.normal(), 1e-4 * draws.normal(size=2)))
        assert isinstance(answer, StripAnswer) and answer.solution is not None
        assert abs(answer.water[2] - level) < 0.4 and answer.water_sigma[2] < 0.12
        truth = UNITS[name] * true.stations[[int(photo) for photo in answer.photos]] * HOUSE
        over.append((answer.position - truth) / answer.position_sigma)
    assert 0.6 < np.sqrt(np.mean(np.square(over))) < 1.4  # 60 coordinates that depend on each other


def stated(block: model.Block, tide: float, tilt: FloatArray) -> model.Block:
    """Return a block with a tide of sigma 0.1 m, and a tilt of sigma 1e-4."""
    photos, water = block.photos, block.water
    assert water is not None
    return replace(
        block,
        photos=replace(photos, tide=np.full(len(photos.ids), tide), tide_sigma=np.full(len(photos.ids), 0.1)),
        water=replace(water, tilt_east=float(tilt[0]), tilt_north=float(tilt[1]), tilt_sigma=1e-4),
    )


@pytest.mark.slow
def test_a_plane_that_only_its_prior_determines(tmp_path: Path) -> None:
    """From the air the level has a sigma of 0.08 of the depth, of 0.008 with a tide of sigma 0.1 m."""
    block, true = strip_block("aerial", 5, limit=0.02)
    result = run(tmp_path, stated(block, true.d, np.zeros(2)))
    assert result.exit_code == 0 and "plane of water only with its prior (0.00" in result.output
    result = run(tmp_path, block)
    assert "plane of water not determined (0.08" in result.output and "DOUBTFUL" in result.output


def narrow_strip() -> model.Block:
    """Return a strip from the air whose rays are so parallel that IIIA creeps towards the plane."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(KINDS, "aerial", Kind(3000.0, 900.0, 5.0, 25.0, 800.0, 0.3))
        return strip_block("aerial", 5)[0]


def strip_over_land() -> model.Block:
    """Return a strip of the laboratory of whose points all are dry, but for three."""
    true = strip_scene("lab", 5)
    points = true.points.copy()
    land = ~np.isin(np.arange(len(points)), [20, 60, 90])
    points[land, 2] = -true.d - np.random.default_rng(3).uniform(0.02, 0.4, land.sum())
    raised = scene(true.kind, points, true.stations, true.angles, plane=(0.0, 0.0))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("orienting.decks.strip_scene", lambda *_: raised)
        return strip_block("lab", 5)[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("strip", "why"),
    [
        (narrow_strip, "limits not reached in 60 iterations"),
        (strip_over_land, "the images do not determine the level of the water and the tilt of the water"),
    ],
)
def test_where_iiia_does_not_hold_the_plane_there_are_no_sigmas(
    strip: Callable[[], model.Block], why: str, tmp_path: Path
) -> None:
    result = run(tmp_path, strip(), "--punch")
    text = " ".join(result.output.split())
    assert result.exit_code == 0 and "DOUBTFUL" in text
    assert f"first values by joined triplets, without sigmas ({why}" in text
    values, schema = record_in(tmp_path), orientation_strip.DOCUMENT.schema()
    assert not list(violations(with_columns(values, schema), schema, schema))
    fit, water = dict(values["fit"]), dict(values["plane"])
    assert fit["adjusted"] is False and why in str(fit["unadjusted"]) and not values["against_iiia"]
    assert water["verdict"] == "not determined" and water["level_sigma"] is None
    assert water["slope_sigma"] == [None, None]
    for row in values["stations"]:
        assert row["position_sigma"] == row["attitude_sigma"] == [None] * 3
    assert all(row["sigma"] == [None] * 3 for row in values["points"])
    assert "no, first values without sigmas" in (tmp_path / "job.lst").read_text()
    assert (tmp_path / "job.pun").exists()


@pytest.mark.slow
def test_what_a_strip_punches_iiia_starts_from(tmp_path: Path) -> None:
    run(tmp_path, strip_block("lab", 6)[0], "--punch")
    adjusted = tmp_path / "adjusted.crd"
    adjusted.write_bytes((tmp_path / "job.pun").read_bytes())
    result = musat("run", adjusted)
    assert result.exit_code == 0 and re.search(r"ACCEPTED, .* [2-5] iterations", result.output)


@pytest.mark.slow
def test_a_wrong_image_is_named_whatever_the_order_of_the_names(tmp_path: Path) -> None:
    block, _ = strip_block("lab", 4)
    plates, ids = block.plates, block.points.ids[::-1]
    image = int(np.flatnonzero((plates.photo == 2) & ~np.isin(plates.point, block.control.point))[3])
    xy = plates.xy.copy()
    xy[image] += 5.0
    wrong = replace(block, plates=replace(plates, xy=xy), points=replace(block.points, ids=ids))
    result = run(tmp_path, wrong)
    assert f"left out, as they do not fit: {ids[plates.point[image]]}\n" in result.output
    out = [row["point"] for row in record_in(tmp_path)["points"] if row["outlier"]]
    assert out == [ids[plates.point[image]]]


@pytest.mark.slow
def test_a_strip_without_control_is_a_model(tmp_path: Path) -> None:
    assert "ACCEPTED" in run(tmp_path, strip_block("lab", 6, control=False)[0]).output
    values = record_in(tmp_path)
    assert dict(values["job"])["system"] == "MODEL" and not values["control"]
    assert 0.0 < max(np.abs(row["position"]).max() for row in values["against_iiia"]) < 0.02


@pytest.mark.slow
def test_a_strip_from_the_air_says_that_it_creeps(tmp_path: Path) -> None:
    """Without control the sigma of the level is a third of the depth; six control points make it a twentieth."""
    result = run(tmp_path, strip_block("aerial", 8, control=False)[0])
    text = " ".join(result.output.split())
    assert result.exit_code == 0 and "DOUBTFUL" in text
    creep = re.search(r"scale and height creep along the strip, heights by ([0-9.]+) \(one sigma, at 4\)", text)
    # in first bases of 1800 m: 2.4 m. Strips without control and errors stay within it, as those with control do
    assert creep and 1e-3 < float(creep[1]) < 2e-3
    strict = run(tmp_path, strip_block("aerial", 8, control=False)[0], "--strict")
    assert strict.exit_code == 4
    held = run(tmp_path, strip_block("aerial", 8)[0])
    assert "ACCEPTED" in held.output and "plane of water determined (0.05" in held.output


@pytest.mark.slow
def test_what_does_not_fit_a_strip_is_named(tmp_path: Path) -> None:
    """A wrong control point goes; two of six are too many to be wrong cards; images with twice their errors."""
    block, true = strip_block("lab", 6)
    ids = block.points.ids[block.control.point].tolist()
    result = run(tmp_path, altered(block, control={"position": added(np.s_[2, 1], 10.0)}))
    assert f"left out, as they do not fit: {ids[2]}\n" in result.output and result.exit_code == 0
    assert ids[2] not in [row["point"] for row in record_in(tmp_path)["control"]]
    assert np.abs(errors(tmp_path, true, "lab")).max() < 4.0
    result = run(tmp_path, altered(block, control={"position": added(np.s_[1:3, 2], 5.0)}))
    assert result.exit_code == 4 and "the strip does not fit its control, at " in result.output
    assert all(point in result.output for point in ids[1:3]) and "left out" not in result.output
    assert len(record_in(tmp_path)["control"]) == len(ids)
    result = run(tmp_path, strip_block("lab", 5, noise=2.0)[0])
    assert "job.crd: REJECTED" in result.output
    doubt = r"sigma0 [12]\.[0-9]+: the images and the control do not fit, by the test of 99.9 %"
    assert re.search(doubt, result.output)


def test_one_plane_for_each_triplet_is_given_up(tmp_path: Path) -> None:
    deck = tmp_path / "job.crd"
    cards = deck_bytes(strip_block("lab", 4)[0]).decode().splitlines(keepends=True)
    deck.write_text("".join(f"{card[:34]}FREE  {card[40:]}" if card[:3] == "ORI" else card for card in cards))
    result = musat("orient", deck)
    assert result.exit_code == 1 and "IIIA holds one plane of water for the whole strip" in result.output


@pytest.mark.slow
def test_photos_of_a_strip_in_any_order(tmp_path: Path) -> None:
    block, true = strip_block("lab", 5)
    shuffled = np.array([3, 0, 2, 4, 1])
    plates = replace(block.plates, photo=np.argsort(shuffled)[block.plates.photo])
    photos = replace(block.photos, ids=block.photos.ids[shuffled])
    assert run(tmp_path, replace(block, photos=photos, plates=plates)).exit_code == 0
    order = [row["photo"] for row in record_in(tmp_path)["stations"]]
    assert order == [str(photo) for photo in range(5)]
    assert np.abs(errors(tmp_path, true, "lab")).max() < 4.0


@pytest.mark.slow
def test_the_picture_and_the_study_of_a_strip(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("musatpy.orientation.twomedia.study._STARTS", 3)
    assert run(tmp_path, strip_block("lab", 4)[0], "--study").exit_code == 0
    assert (tmp_path / "job.strip.png").read_bytes().startswith(b"\x89PNG")
    assert "Method TRIPLET" in (tmp_path / "job.study.txt").read_text()


@pytest.mark.parametrize(
    ("photos", "card", "message"),
    [
        (3, {}, "STRIP takes 4 photos at least, not 3: TRIPLET takes 3"),
        (5, {"first": "1", "second": "2", "third": "3"}, "STRIP takes all photos that have images"),
        (5, {"plane": model.PlaneTreatment.LEVEL}, "no plane of water is known in the axes of a model"),
    ],
)
def test_cards_that_no_strip_can_have(photos: int, card: dict[str, object], message: str, tmp_path: Path) -> None:
    result = run(tmp_path, strip_block("lab", photos, control=False, **card)[0])
    assert result.exit_code == 1 and message in " ".join(result.output.split())


def two_strips_side_by_side() -> model.Block:
    """Return a block of 20 photos in two rows, by what they show; the coordinates on the plates are nothing."""
    block, _ = strip_block("lab", 20)
    X, Y = np.meshgrid(np.arange(0.0, 60.0, 2.0), np.arange(0.0, 30.0, 2.0))
    stations = [(x, y) for y in (10.0, 20.0) for x in np.arange(10.0, 60.0, 5.0)]
    shown = [np.flatnonzero((np.abs(X - x) < 9) & (np.abs(Y - y) < 9)) for x, y in stations]
    photo = np.repeat(np.arange(len(stations)), [len(points) for points in shown])
    plates = model.PlateMeasurements(photo=photo, point=np.concatenate(shown), xy=np.ones((len(photo), 2)))
    points = model.Points(ids=[str(row) for row in range(X.size)], bathymetric=np.ones(X.size, dtype=bool))
    return replace(block, points=points, plates=plates, control=empty(model.Control))


@pytest.mark.parametrize(
    ("strip", "missing", "message"),
    [
        (lambda: strip_block("lab", 8)[0], [3], "three photos on end need 5 points that all of them show"),
        (
            lambda: strip_block("lab", 9)[0],
            [4, 5, 6],
            "a gap: no photos of these have 5 points in common: 0, 1, 2, 3 | 7, 8",
        ),
        (two_strips_side_by_side, [], "a block, or branches, is not for STRIP"),
    ],
)
def test_gaps_and_branches_are_refused_in_words(
    strip: Callable[[], model.Block], missing: list[int], message: str, tmp_path: Path
) -> None:
    block = strip()
    seen = np.flatnonzero(~np.isin(block.plates.photo, missing))
    result = run(tmp_path, replace(block, plates=taken(block.plates, seen)))
    assert result.exit_code == 1 and message in " ".join(result.output.split())


AERIAL = Path(__file__).parents[2] / "fixtures" / "trust" / "aerial_single_no_start.crd"


def dry_pair(folder: Path, method: str, seed: int = 1, noise: float = 5e-6) -> tuple[Path, Orientation]:
    """Write the deck of an aerial pair all of whose points stand above the water, and return it with the truth."""
    wet = geometry("aerial", "PAIR-INDEPENDENT")
    points = dry(KINDS["aerial"], wet.points, len(wet.points))
    true = scene(wet.kind, points, wet.stations, wet.angles)
    block, truth, _ = deck_block("aerial", method, 0, true=true, seed=seed, noise=noise)
    return written(folder, replace(block, water=None)), truth


def turned(attitude: FloatArray) -> FloatArray:
    """Return the rotation from the first photo to the second."""
    first, second = attitude_matrix(attitude)
    return np.asarray(second @ first.T)


@pytest.mark.parametrize("method", ["PAIR-INDEPENDENT", "PAIR-SUCCESSIVE"])
def test_a_pair_without_water_is_the_relative_orientation(method: str, tmp_path: Path) -> None:
    """Five unknowns, no plane; rotation and base are those that the images were made with."""
    deck, truth = dry_pair(tmp_path, method, noise=0.0)
    result = orient(deck, "--punch")
    assert result.exit_code == 0, result.output
    assert (
        f"{method} of 0, 1, sigma0 0.0" in result.stdout and "no point under water: straight rays" in result.stdout
    )
    values, schema = record(deck), orientation.DOCUMENT.schema()
    assert not list(violations(with_columns(values, schema), schema, schema))
    assert values["plane"] is None and values["fit"]["redundancy"] == 15
    assert all(row["depth"] is None for row in values["points"])
    attitude = np.array([row["attitude"] for row in values["stations"]])
    # Plate coordinates have seven decimals of a millimetre: 3e-10 of an angle, which the geometry makes ten times.
    np.testing.assert_allclose(turned(attitude), turned(truth.attitude[0]), rtol=0, atol=1e-8)
    base = np.diff([row["position"] for row in values["stations"]], axis=0)[0] @ attitude_matrix(attitude)[0].T
    true = np.diff(truth.station[0], axis=0)[0] @ attitude_matrix(truth.attitude[0])[0].T
    np.testing.assert_allclose(base / np.linalg.norm(base), true / np.linalg.norm(true), rtol=0, atol=1e-8)
    listing = deck.with_suffix(".lst").read_text()
    assert "Unknowns, redundancy ............................. 5, 15" in listing and "Plane Of Water" not in listing


@pytest.mark.slow
def test_a_dry_pair_has_the_sigmas_of_its_errors(tmp_path: Path) -> None:
    """Errors of omega, phi, kappa of photo 2 against photo 1 over their sigmas, of eight draws: as of one sigma."""
    over = []
    for seed in range(8):
        deck, truth = dry_pair(tmp_path, "PAIR-SUCCESSIVE", seed)
        assert orient(deck, "-q").exit_code == 0
        row = record(deck)["stations"][1]
        errors = turned(truth.attitude[0]).T @ attitude_matrix(np.array(row["attitude"]))
        # photo 1 stands in its own axes; small angles between both second photos
        angles = 0.5 * np.array(
            [errors[1, 2] - errors[2, 1], errors[2, 0] - errors[0, 2], errors[0, 1] - errors[1, 0]]
        )
        over.append(np.linalg.norm(angles) / np.linalg.norm(row["attitude_sigma"]))
    assert 0.5 < np.sqrt(np.mean(np.square(over))) < 1.6


def test_a_run_starts_from_the_punched_pair_and_comes_to_the_same(tmp_path: Path) -> None:
    deck, _ = dry_pair(tmp_path, "PAIR-INDEPENDENT")
    assert orient(deck, "--punch").exit_code == 0
    (tmp_path / "again").mkdir()
    again = tmp_path / "again" / "pair.crd"
    again.write_bytes(deck.with_suffix(".pun").read_bytes())
    result = musat("run", again)
    assert result.exit_code == 0, result.output
    found, fit = record(again)["solution"], record(deck)["fit"]
    squares = found["sigma0"] ** 2 * found["degrees_of_freedom"]
    assert squares == pytest.approx(fit["sigma0"] ** 2 * fit["redundancy"], rel=1e-4)


def test_what_the_air_does_not_determine_is_said_so(tmp_path: Path) -> None:
    """Twenty control points 24 to 70 m deep, from 3,900 m: it "did not converge from any start"."""
    result = orient(AERIAL, "-o", str(tmp_path))
    assert result.exit_code == 0 and "does not converge" not in result.output
    assert "doubtful: the plane of water is not determined: the sigma of its level is 0.548 of" in result.output
    assert "plane of water not determined (0.548 of the depth)" in result.stdout
