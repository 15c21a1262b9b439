"""`musat orient`: decks of laboratories and flights without stations, against their truth and program IIIA."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

import musatpy
from adjustment.test_lenses import SIDES, TRUE, through_lens, unknowns
from altered import altered
from cli.commands import musat
from json_schema import violations
from musatpy import model
from musatpy.formats.musat import deck_bytes
from musatpy.model import Block
from musatpy.model.tables import taken
from musatpy.orienting.answer import answer_of
from musatpy.orienting.task import task_of
from musatpy.reports import orientation
from orientation.twomedia.geometries import KINDS, geometry, scene
from orienting.decks import deck_block
from record_rows import read_rows, with_columns
from reference.networks import Plan, simulate


def written(folder: Path, block: Block, *edits: tuple[str, str]) -> Path:
    """Return the deck of a block, with cards edited by regular expressions."""
    text = deck_bytes(block).decode()
    for pattern, new in edits:
        text, count = re.subn(pattern, new, text, flags=re.MULTILINE)
        assert count, pattern
    deck = folder / "job.crd"
    deck.write_text(text, encoding="ascii")
    return deck


def orient(deck: Path, *options: str) -> Result:
    return musat("orient", deck, *options)


@pytest.mark.parametrize("side", SIDES)
def test_images_are_made_ideal_by_cards_of_a_lens(side: model.DistortionSide) -> None:
    """Values of CAL cards with which images were displaced: as without a lens, to 1e-10 of the focal length."""
    perfect, _, _ = deck_block("aerial", "TRIPLET", 0)
    bent = unknowns(through_lens(perfect, side, TRUE), *TRUE)
    focal = perfect.cameras.focal_length[0]
    values = np.array([value + focal * (name == "F") for name, value in TRUE.items()])
    images = [
        task_of(block).sights.image for block in (perfect, altered(bent, lens_unknowns={"value": values}), bent)
    ]
    np.testing.assert_allclose(images[1], images[0], atol=1e-10)
    assert np.abs(images[2] - images[0]).max() > 1e-5


def record(deck: Path) -> dict[str, Any]:
    values: dict[str, Any] = read_rows(deck.with_suffix(".json"))
    return values


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "method", "control", "plane"),
    [
        ("lab", "SINGLE-RAY", 20, "determined"),
        ("lab", "SINGLE-FERMAT", 20, "determined"),
        ("lab", "COMBINED", 5, "determined"),
        ("lab", "TRIPLET", 0, "determined"),
        ("aerial", "SINGLE-RAY", 20, "not determined"),
        ("aerial", "PAIR-INDEPENDENT", 0, "not determined"),
    ],
)
def test_a_deck_without_stations(name: str, method: str, control: int, plane: str, tmp_path: Path) -> None:
    block, truth, _ = deck_block(name, method, control)
    deck = written(tmp_path, block)
    result = orient(deck)
    assert result.exit_code == 0, result.output
    values = record(deck)
    schema = orientation.DOCUMENT.schema()
    assert not list(violations(with_columns(values, schema), schema, schema))
    assert values["plane"]["verdict"] == plane
    assert (values["verdict"]["grade"] == "ACCEPTED") == (plane == "determined")
    assert values["fit"]["sigma0"] == pytest.approx(1.0, abs=0.5)  # 10 conditions at least
    for photo, row in enumerate(values["stations"]) if control else ():
        sigma = np.array([*row["position_sigma"], *row["attitude_sigma"]])
        error = np.array(
            [*(row["position"] - truth.station[0, photo]), *(row["attitude"] - truth.attitude[0, photo])]
        )
        assert np.abs(error / sigma).max() < 4.0


@pytest.mark.parametrize(
    ("name", "method", "control"),
    [
        ("lab", "SINGLE-RAY", 20),
        pytest.param("tank", "SINGLE-FERMAT", 20, marks=pytest.mark.slow),
        pytest.param("aerial", "SINGLE-RAY", 20, marks=pytest.mark.slow),
        pytest.param("lab", "COMBINED", 8, marks=pytest.mark.slow),
        pytest.param("aerial", "COMBINED", 12, marks=pytest.mark.slow),
    ],
)
def test_the_run_of_what_is_punched_stays_where_it_is(name: str, method: str, control: int, tmp_path: Path) -> None:
    """IIIA solves the same problem: its first step is none, to the digits of the cards."""
    block, _, _ = deck_block(name, method, control)
    deck = written(tmp_path, block)
    assert orient(deck, "--punch").exit_code == 0
    values = record(deck)
    solution = musatpy.adjust(musatpy.read_deck(deck.with_suffix(".pun")))
    assert solution.sigma0 == pytest.approx(values["fit"]["sigma0"], rel=1e-6)
    assert solution.degrees_of_freedom == values["fit"]["redundancy"]
    for photo, row in enumerate(values["stations"]):
        sigma = np.sqrt(np.diagonal(solution.stations.covariance[photo]))
        np.testing.assert_allclose(sigma, [*row["position_sigma"], *row["attitude_sigma"]], rtol=1e-4)
        assert np.abs((solution.stations.position[photo] - row["position"]) / sigma[:3]).max() < 1e-3
    assert solution.water is not None
    np.testing.assert_allclose(solution.water.tilt_sigma, values["plane"]["slope_sigma"], rtol=1e-4)
    places = dict(zip(solution.block.points.ids.tolist(), solution.points.covariance, strict=True))
    for row in (row for row in values["points"] if row["sigma"] and row["sigma"][0]):
        np.testing.assert_allclose(row["sigma"], np.sqrt(np.diagonal(places[row["point"]])), rtol=1e-4)


@pytest.mark.slow
def test_the_listing_begins_with_what_it_is_worth(tmp_path: Path) -> None:
    deck = written(tmp_path, deck_block("aerial", "TRIPLET", 0)[0])
    assert orient(deck, "--csv").exit_code == 0
    listing = deck.with_suffix(".lst").read_text()
    page = listing.partition("\f")[0]
    assert "*** DOUBTFUL ***" in page and "the plane of water is not determined" in page
    for title in ("Exposure Stations: Positions", "Correlations Of The Unknowns", "Images: Residuals And Tests"):
        assert title in listing
    assert max(map(len, listing.splitlines())) <= 132
    assert len((tmp_path / "job_tables/points.csv").read_text().splitlines()) == 31
    assert orient(deck, "--strict").exit_code == 4


def test_a_wrong_image_is_named_and_left_out(tmp_path: Path) -> None:
    block, _, _ = deck_block("lab", "SINGLE-RAY", 20)
    deck = written(tmp_path, block, (r"^(PLT 0        7 +)61\.1", r"\g<1>61.6"))
    result = orient(deck)
    assert result.exit_code == 0 and "left out, as they do not fit: 7" in result.output
    points = {row["point"]: row for row in record(deck)["points"]}
    assert points["7"]["outlier"] and points["7"]["rays"] == 0 and not points["8"]["outlier"]


def test_a_flag_that_contradicts_the_water_is_named(tmp_path: Path) -> None:
    block, _, _ = deck_block("lab", "SINGLE-RAY", 20)
    dry = (r"^((PLT 0        4|CTX 4 ).*) B( .*)$", r"\1  \3")
    result = orient(written(tmp_path, block, dry))
    assert "4" in result.output and ("stand under" in result.output or "do not fit" in result.output)


BAD: tuple[tuple[str, int, tuple[str, str] | None, str], ...] = (
    ("SINGLE-RAY", 20, (r"^ORI.*\n", ""), "no ORI card"),
    ("SINGLE-RAY", 4, None, "8 conditions for 9 unknowns; 1 more are needed"),
    ("SINGLE-RAY", 20, (r"^(ORI.{38}) {8}", r"\1NOWHERE "), "photo NOWHERE has no images"),
    ("COMBINED", 5, ("COMBINED  ", "SINGLE-RAY"), "takes 1 different photos, not 2"),
    ("SINGLE-RAY", 20, (r"^((?:PLT|CTX).*) B( .*)$", r"\1  \2"), "no point is flagged submerged"),
    ("SINGLE-RAY", 20, ("ADJUST       ", "KNOWN        "), "the plane is KNOWN, and there is no tide of 0"),
    ("TRIPLET", 0, (r"^(ORI.{24})ADJUST", r"\1LEVEL "), "no plane of water is known in the axes of a model"),
    (
        "TRIPLET",
        0,
        (r"^((?:PLT|CTX).*) B( .*)$", r"\1  \2"),
        "of dry points PAIR-INDEPENDENT and",
    ),
    ("SINGLE-RAY", 20, ("SINGLE-RAY  ", "DOUBLE-RAY  "), "cols 5-20"),
    ("SINGLE-RAY", 20, (r" \.100", " -.10"), "must be greater than zero"),
)


@pytest.mark.parametrize(
    ("method", "control", "share", "message"),
    [
        ("PAIR-INDEPENDENT", 0, 2, "no point can be used: only one of the photos shows it"),
        ("COMBINED", 20, 2, "COMBINED: points that photos 0, 1 all show: 0; 5 are needed to start from"),
        ("COMBINED", 5, 2, "10 conditions for 15 unknowns; 5 more are needed: control points, of two"),
        ("TRIPLET", 0, 3, "points that photos 0, 1, 2 all show: 0; 4 are needed to start from"),
    ],
)
def test_photos_without_common_points(method: str, control: int, share: int, message: str, tmp_path: Path) -> None:
    """Each photo shows every second point, or of the triplet all but every third."""
    block, _, _ = deck_block("lab", method, control)
    shows = block.plates.point % share == block.plates.photo
    rows = np.flatnonzero(shows != (method == "TRIPLET"))
    result = orient(written(tmp_path, replace(block, plates=taken(block.plates, rows))))
    assert result.exit_code == 1, result.output
    assert message in " ".join(result.output.split())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plane", "tide", "sigma", "tilt", "message"),
    [
        ("ADJUST", -201.5, 0.01, 0.0, "level -201.5, by them alone -199.4"),
        ("ADJUST", 50.0, 0.5, 0.0, "level 50, by them alone -199.4"),  # over the camera
        ("KNOWN", 50.0, np.nan, 0.0, "tilt along X 0, by them alone 0.02957"),
        ("LEVEL", 50.0, np.nan, 0.0, "tilt along Y 0, by them alone 0.02005"),
        ("ADJUST", np.nan, np.nan, 0.2, "tilt along X 0.2, by them alone 0.02957"),
    ],
)
def test_water_that_contradicts_the_images_is_named(
    plane: str, tide: float, sigma: float, tilt: float, message: str, tmp_path: Path
) -> None:
    """And no points are left out for it. The tilts are .03 and .02, the level has a sigma of .3 cm."""
    block, _, _ = deck_block("lab", "SINGLE-RAY", 20, plane=model.PlaneTreatment(plane))
    assert block.water is not None
    water = replace(block.water, tilt_east=tilt, tilt_north=0.1, tilt_sigma=1e-4) if tilt else block.water
    photos = replace(block.photos, tide=np.array([tide]), tide_sigma=np.array([sigma]))
    result = orient(written(tmp_path, replace(block, water=water, photos=photos)))
    assert result.exit_code == 1, result.output
    assert "the images contradict the water that is given" in result.output
    assert message in result.output


@pytest.mark.slow
@pytest.mark.parametrize("method", ["PAIR-INDEPENDENT", "COMBINED", "TRIPLET"])
def test_cameras_of_different_focal_lengths(method: str, tmp_path: Path) -> None:
    """The second photo again with twice the focal length, images and their sigmas: nothing changes.

    Station cards name the cameras; roughly where the photos stand.
    """
    block, truth, _ = deck_block("lab", method, 20 if method == "COMBINED" else 0)
    block = replace(block, photos=replace(block.photos, position=truth.station[0] + 20.0))
    cameras, scale = block.cameras, np.where(block.plates.photo == 1, 2.0, 1.0)[:, None]
    double = model.Cameras(
        ids=np.array(["CAM", "LONG"]),
        focal_length=cameras.focal_length * [1.0, 2.0],
        principal_point=np.repeat(cameras.principal_point, 2, axis=0),
        format_size=np.repeat(cameras.format_size, 2, axis=0) * 2.0,
    )
    plates = replace(block.plates, xy=scale * block.plates.xy, sigma=scale * block.plates.sigma)
    camera = np.arange(len(block.photos.ids)) == 1
    mixed = replace(block, cameras=double, plates=plates, photos=replace(block.photos, camera=camera.astype(int)))
    stations = []
    for number, each in enumerate((block, mixed)):
        folder = tmp_path / str(number)
        folder.mkdir()
        deck = written(folder, each)
        assert orient(deck).exit_code == 0
        stations.append(record(deck)["stations"])
    for one, other in zip(*stations, strict=True):
        assert other["position"] == pytest.approx(one["position"], rel=1e-6, abs=1e-4)  # digits of the plates


def test_a_tide_to_start_from_may_be_wrong(tmp_path: Path) -> None:
    """Without a sigma it binds nothing, be it above the camera."""
    block, truth, _ = deck_block("lab", "SINGLE-RAY", 20)
    block = replace(block, photos=replace(block.photos, tide=np.array([50.0])))
    deck = written(tmp_path, block)
    assert orient(deck).exit_code == 0
    station = record(deck)["stations"][0]
    assert np.abs((station["position"] - truth.station[0, 0]) / station["position_sigma"]).max() < 4.0


def test_an_answer_that_most_points_contradict_is_none(tmp_path: Path) -> None:
    """Images of the points in another order."""
    block, _, _ = deck_block("lab", "SINGLE-RAY", 20)
    mixed = np.random.default_rng(1).permutation(20)
    result = orient(written(tmp_path, replace(block, plates=replace(block.plates, point=mixed))))
    assert result.exit_code == 1, result.output
    assert re.search("no orientation fits more than|does not converge|no solution", result.output)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "control", "status", "message"),
    [
        ("SINGLE-RAY", 20, 4, "rejected: nothing determines "),
        ("PAIR-INDEPENDENT", 0, 3, "from any start: the points lie on a line, about which"),
    ],
)
def test_points_on_a_line_hold_no_photos(
    method: str, control: int, status: int, message: str, tmp_path: Path
) -> None:
    """Photos and water may turn about the line of the control; a pair does not converge."""
    photos, along = geometry("lab", method), np.linspace(-1.0, 1.0, 20)
    points = np.stack([0.5 + 0.9 * along, 0.2 + 0.5 * along, 2.8 + 0.2 * along], axis=1)
    line = scene(KINDS["lab"], points, photos.stations, photos.angles)
    result = orient(written(tmp_path, deck_block("lab", method, control, true=line)[0]))
    assert result.exit_code == status, result.output
    assert message in result.output and (tmp_path / "job.lst").exists() == (status == 4)


@pytest.mark.parametrize(("method", "control", "edit", "message"), BAD)
def test_bad_decks(method: str, control: int, edit: tuple[str, str] | None, message: str, tmp_path: Path) -> None:
    deck = written(tmp_path, deck_block("lab", method, control)[0], *([edit] if edit else []))
    result = orient(deck)
    assert result.exit_code == 1, result.output
    assert message in " ".join(result.output.split())
    assert not deck.with_suffix(".lst").exists()


def test_photos_are_named_where_the_deck_has_more(tmp_path: Path) -> None:
    block, _, _ = deck_block("lab", "TRIPLET", 0)
    named = (r"^ORI TRIPLET .{29}.{26}", f"ORI {'PAIR-INDEPENDENT':16} FULL  ADJUST        {'1':8} {'2':8} {'':8}")
    deck = written(tmp_path, block, named)
    assert orient(deck).exit_code == 0
    assert [row["photo"] for row in record(deck)["stations"]] == ["1", "2"]


@pytest.mark.parametrize("number", [1, 8])
def test_points_that_no_condition_uses_have_a_reason(number: int) -> None:
    block, _, _ = deck_block("lab", "SINGLE-RAY", 20 - number)
    assert [reason for _, reason in answer_of(block).task.left_out] == [
        "no two components of it are known: a single photo gives it no place"
    ] * number


@pytest.mark.slow
@pytest.mark.parametrize(("system", "places"), [("LOCL", 1e-8), ("GEOG", 0.05), ("GEOC", 0.05)])
@pytest.mark.parametrize(("method", "photos"), [("SINGLE-RAY", 1), ("COMBINED", 2)])
def test_a_flight_in_any_system(system: str, places: float, method: str, photos: int) -> None:
    """Noise-free, at tides of each photo: to rounding, or what the sea falls away from a plane at 1 km (0.08 m)."""
    simulated = simulate(Plan(system=model.CoordinateSystem(system), submerged=True, noise=0.0))
    block, truth = simulated.block, simulated.truth
    count = len(block.points.ids)
    control = model.Control(
        point=np.arange(count),
        kind=np.full(count, model.ControlKind.FULL),
        fixed=np.zeros(count, dtype=bool),
        position=truth.points,
        sigma=np.full((count, 3), 0.05),
    )
    nothing = np.full(block.photos.position.shape, np.nan)
    named = dict(zip(("first", "second"), block.photos.ids[1 : 1 + photos].tolist(), strict=False))
    spec = model.OrientationSpec(method=model.OrientationMethod(method), **named)
    without = replace(block.photos, position=nothing, attitude=nothing)
    answer = answer_of(replace(block, control=control, orientation=spec, photos=without))
    rows = slice(1, 1 + photos)
    metres = [6.37e6, 6.01e6, 1.0] if system == "GEOG" else 1.0
    assert np.abs((answer.position - truth.position[rows]) * metres).max() < places
    assert np.abs(answer.attitude - truth.attitude[rows]).max() < max(places / 3000.0, 1e-12)


@pytest.mark.slow
def test_other_exact_solutions_of_a_minimum_set_are_listed(tmp_path: Path) -> None:
    """Four full points and one in plan: nine conditions for nine unknowns."""
    block, _, _ = deck_block("lab", "SINGLE-RAY", 5, noise=0.0)
    kinds = np.array([model.ControlKind.FULL] * 4 + [model.ControlKind.HORIZONTAL])
    block = replace(block, control=replace(block.control, kind=kinds))
    deck = written(tmp_path, block)
    result = orient(deck)
    count = re.search(r"other exact solutions: (\d+)", result.output)
    values = record(deck)
    assert result.exit_code == 0 and values["fit"]["redundancy"] == 0
    assert count and len(values["other_roots"]) == int(count[1])
    assert ("Other Exact Solutions" in deck.with_suffix(".lst").read_text()) == (count[1] != "0")


@pytest.mark.slow
def test_the_study_of_a_deck(tmp_path: Path) -> None:
    deck = written(tmp_path, deck_block("lab", "SINGLE-RAY", 20)[0])
    assert orient(deck, "--study").exit_code == 0
    text = deck.with_suffix(".study.txt").read_text()
    assert re.search(r"^ +5\.0 +\.10 +\.050 +25 +100\.0 +\.0 +\.0$", text, re.MULTILINE)
    assert "At hand: depth 0.388 of H, 0 % dry: .004 of the depth" in text
    for picture in ("correlations", "basins", "precision"):
        assert deck.with_suffix(f".{picture}.png").read_bytes().startswith(b"\x89PNG")
