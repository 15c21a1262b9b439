"""`musat orient` of strips: decks of laboratories and flights, against their truth and program IIIA."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from json_schema import violations
from musatpy import model
from musatpy.cli.main import main as musat
from musatpy.formats.musat import deck_bytes
from musatpy.model.tables import taken
from musatpy.reports import orientation_strip
from orientation.twomedia.geometries import HOUSE, Scene
from orienting.decks import UNITS, strip_block
from record_rows import read_rows, with_columns


def run(folder: Path, block: model.Block, *options: str, command: str = "orient") -> Result:
    """Return what became of the deck of a block."""
    deck = folder / "job.crd"
    deck.write_bytes(deck_bytes(block))
    return CliRunner().invoke(musat, [command, str(deck), *options])


def record(folder: Path) -> dict[str, list[dict[str, object]]]:
    return dict(read_rows(folder / "job.json"))


def errors(folder: Path, true: Scene, name: str) -> np.ndarray:
    """Return the errors of the stations over their sigmas."""
    rows = record(folder)["stations"]
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
    values, schema = record(tmp_path), orientation_strip.schema()
    assert not list(violations(with_columns(values, schema), schema, schema))
    assert np.abs(errors(tmp_path, true, name)).max() < 4.0  # of 18 that depend on each other
    away = np.array([row["sigmas"] for row in values["against_iiia"]], dtype=float)
    assert 1e-6 < np.abs(away).max() < 3.0
    listing = (tmp_path / "job.lst").read_text()
    assert max(map(len, listing.splitlines())) <= 132
    assert all(
        title in listing for title in ("Joins Of The Triplets", "Control Of The Strip", "The Strip Less IIIA")
    )
    assert len((tmp_path / "job_tables/joins_of_the_triplets.csv").read_text().splitlines()) == 4


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", ["lab", "aerial"])
def test_a_strip_over_a_known_plane_stays_within_three_sigmas_of_iiia(name: str, seed: int, tmp_path: Path) -> None:
    """Twelve photos; over an unknown plane one strip in twelve is up to 3.4 away."""
    block, _ = strip_block(name, 12, seed=seed, plane=model.PlaneTreatment.KNOWN)
    assert run(tmp_path, block).exit_code == 0
    away = np.array([row["sigmas"] for row in record(tmp_path)["against_iiia"]], dtype=float)
    assert 1e-6 < np.abs(away).max() < 3.0


@pytest.mark.slow
def test_what_a_strip_punches_iiia_starts_from(tmp_path: Path) -> None:
    run(tmp_path, strip_block("lab", 6)[0], "--punch")
    adjusted = tmp_path / "adjusted.crd"
    adjusted.write_bytes((tmp_path / "job.pun").read_bytes())
    result = CliRunner().invoke(musat, ["run", str(adjusted)])
    assert result.exit_code == 0 and re.search(r"ACCEPTED, .* [2-5] iterations", result.output)


@pytest.mark.slow
def test_a_wrong_image_is_named_whatever_the_order_of_the_names(tmp_path: Path) -> None:
    block, _ = strip_block("lab", 6)
    plates, ids = block.plates, block.points.ids[::-1]
    image = int(np.flatnonzero((plates.photo == 2) & ~np.isin(plates.point, block.control.point))[3])
    xy = plates.xy.copy()
    xy[image] += 5.0
    wrong = replace(block, plates=replace(plates, xy=xy), points=replace(block.points, ids=ids))
    result = run(tmp_path, wrong)
    assert f"left out, as they do not fit: {ids[plates.point[image]]}\n" in result.output
    out = [row["point"] for row in record(tmp_path)["points"] if row["outlier"]]
    assert out == [ids[plates.point[image]]]


@pytest.mark.slow
def test_a_strip_without_control_is_a_model(tmp_path: Path) -> None:
    result = run(tmp_path, strip_block("lab", 6, control=False)[0])
    assert result.exit_code == 0 and "ACCEPTED" in result.output
    values = record(tmp_path)
    assert dict(values["job"])["system"] == "MODEL" and not values["control"]  # type: ignore[arg-type]
    assert max(np.abs(row["position"]).max() for row in values["against_iiia"]) < 0.02  # type: ignore[call-overload]


@pytest.mark.slow
def test_a_strip_from_the_air_says_that_it_creeps(tmp_path: Path) -> None:
    result = run(tmp_path, strip_block("aerial", 8)[0])
    text = " ".join(result.output.split())
    assert result.exit_code == 0 and "DOUBTFUL" in text
    creep = re.search(r"scale and height creep along the strip, by ([0-9.]+) % and ([0-9.]+) ", text)
    assert creep and 0.02 < float(creep[1]) < 0.5 and 2.0 < float(creep[2]) < 20.0
    assert run(tmp_path, strip_block("aerial", 8)[0], "--strict").exit_code == 4


@pytest.mark.slow
def test_a_strip_that_fits_much_of_its_control_badly_keeps_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Two of six are too many to be wrong cards. IIIA, beside it, need not look for causes."""
    monkeypatch.setattr("musatpy.pipeline.causes_of", lambda *_: ())
    block, _ = strip_block("lab", 4)
    away = block.control.position.copy()
    away[1:3, 2] += 5.0
    result = run(tmp_path, replace(block, control=replace(block.control, position=away)))
    ids = block.points.ids[block.control.point]
    assert "DOUBTFUL" in result.output and "the strip does not fit its control, at " in result.output
    assert all(str(point) in result.output for point in ids[1:3]) and "left out" not in result.output
    assert len(record(tmp_path)["control"]) == len(ids)


@pytest.mark.slow
def test_a_strip_whose_images_do_not_fit_is_rejected(tmp_path: Path) -> None:
    """Errors of twice the sigma of the images; points that no test of a single one finds are kept."""
    block, _ = strip_block("lab", 5, noise=2.0)
    result = run(tmp_path, block)
    assert "job.crd: REJECTED" in result.output
    assert re.search(r"sigma0 [12]\.[0-9]+: the images do not fit, by the test of 99.9 %", result.output)


@pytest.mark.slow
def test_a_strip_whose_known_plane_does_not_settle(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("musatpy.orientation.twomedia.strip._PASSES", 2)
    block, _ = strip_block("lab", 4, plane=model.PlaneTreatment.KNOWN)
    result = run(tmp_path, block)
    assert result.exit_code == 3 and "not converged: the plane that is known moves triplets" in result.output
    assert "*** NOT CONVERGED ***" in (tmp_path / "job.lst").read_text()


@pytest.mark.slow
def test_photos_of_a_strip_in_any_order(tmp_path: Path) -> None:
    block, true = strip_block("lab", 5)
    shuffled = np.array([3, 0, 2, 4, 1])
    plates = replace(block.plates, photo=np.argsort(shuffled)[block.plates.photo])
    photos = replace(block.photos, ids=block.photos.ids[shuffled])
    assert run(tmp_path, replace(block, photos=photos, plates=plates)).exit_code == 0
    order = [row["photo"] for row in record(tmp_path)["stations"]]
    assert order == [str(photo) for photo in range(5)]
    assert np.abs(errors(tmp_path, true, "lab")).max() < 4.0


@pytest.mark.slow
def test_the_picture_and_the_study_of_a_strip(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("musatpy.orienting.studied._STARTS", 3)
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


def test_a_gap_is_refused_in_words(tmp_path: Path) -> None:
    block, _ = strip_block("lab", 8)
    without = block.plates.photo != 3
    result = run(tmp_path, replace(block, plates=taken(block.plates, np.flatnonzero(without))))
    assert result.exit_code == 1 and "three photos on end need 5 points that all of them show" in result.output
