"""Stages that were read raw: reduced as a triangulation reduces its plates, and every fault of their cards."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from json_schema import violations
from musatpy import adjust, read_deck
from musatpy.cli.main import main as musat
from musatpy.compilation.compiled import REFUSED, compiled
from musatpy.compilation.interior import refined_stages
from musatpy.compilation.triangulation import Triangulation, of_solution
from musatpy.errors import DeckError
from musatpy.formats.compilation_deck import compilation_bytes, read_compilation
from musatpy.reports.compilation import schema
from record_rows import read_rows, with_columns
from stage_readings import FIXTURES

RAW = FIXTURES / "st_thomas_raw" / "st_thomas_raw.crd"
INTERIOR = ("RED", "CMP", "DST", "LNS", "FID", "FMS")
_MODEL = "MDL 1        21       22"


@pytest.fixture(scope="module")
def run() -> Triangulation:
    """Return the run of the raw deck."""
    return of_solution(adjust(read_deck(RAW)))


def deck(*changes: tuple[str, str]) -> bytes:
    """Return a deck of one model: interior orientation and readings of the raw deck, with texts replaced."""
    block = read_deck(RAW)
    photos, points = block.photos.ids[block.plates.photo], block.points.ids[block.plates.point]
    readings = {
        key: xy
        for *key, xy in reversed(list(zip(photos.tolist(), points.tolist(), block.plates.xy, strict=True)))
        for key in [tuple(key)]
    }
    cards = [line for line in RAW.read_text().splitlines() if line[:3] in INTERIOR]
    cards = [line for line in cards if not (line.startswith("FMS") and line[4:6] not in ("21", "22"))]
    cards.append(_MODEL)
    wet = dict(zip(block.points.ids.tolist(), block.points.bathymetric.tolist(), strict=True))
    for point in (point for photo, point in sorted(readings) if photo == "21" and ("22", point) in readings):
        xy = np.concatenate([readings[photo, point] for photo in ("21", "22")])
        flag = "B" if wet[point] else " "
        cards.append(f"STG 1        {point:<8} R{flag}" + "".join(f"{value:11.6f}" for value in xy))
    text = "\n".join([*cards, "END", ""])
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text.encode()


def test_raw_stages_become_the_refined_plates_of_the_run(run: Triangulation) -> None:
    # Refraction in the air goes by the stations: here those of the deck, as in the run.
    contents, warnings = read_compilation(deck(), replace(run.block, photos=read_deck(RAW).photos))
    assert not warnings and contents.raw is not None
    refined, reduced = refined_stages(contents)
    assert reduced is not None and [plate.photo for plate in reduced.plates] == ["21", "22"]
    block = run.block
    photos, points = block.photos.ids[block.plates.photo], block.points.ids[block.plates.point]
    plates = dict(zip(zip(photos.tolist(), points.tolist(), strict=True), block.plates.xy, strict=True))
    once = 0
    for name, xy in zip(refined.stages.ids.tolist(), refined.stages.xy, strict=True):
        expected = np.stack([plates[photo, name] for photo in ("21", "22")])
        # Six decimals of a stage; a point that the run read twice is its mean there, some micrometres off.
        once += bool(np.abs(xy - expected).max() < 2e-6)
        assert np.abs(xy - expected).max() < 0.01
    assert once >= len(refined.stages.ids) - 3


def test_an_interior_orientation_is_written_as_it_was_read(run: Triangulation) -> None:
    contents, _ = read_compilation(deck(), run.block)
    data = compilation_bytes(contents)
    again, _ = read_compilation(data, run.block)
    assert compilation_bytes(again) == data and b"FMS 21" in data and b"CMP" in data
    assert again.raw is not None and contents.raw is not None
    assert np.array_equal(again.raw.plates.xy, contents.raw.plates.xy)


def test_the_command_lists_what_the_reduction_did(tmp_path: Path) -> None:
    path = tmp_path / "raw.crd"
    path.write_bytes(deck())
    runner = CliRunner()
    assert runner.invoke(musat, ["run", "-q", str(RAW), "-o", str(tmp_path)]).exit_code == 0
    result = runner.invoke(musat, ["as11", "compile", str(tmp_path / "st_thomas_raw.json"), str(path)])
    assert result.exit_code == 0, result.output
    listing = path.with_suffix(".lst").read_text()
    assert "Plate Reduction" in listing and listing.index("Plate Reduction") < listing.index("Model Set-Up")
    record = read_rows(path.with_suffix(".json"))
    assert [row["photo"] for row in record["reduction"]["plates"]] == ["21", "22"]
    assert all(row["reason"] is None for row in record["points"])
    assert not list(violations(with_columns(record, schema()), schema(), schema()))


def test_models_set_up_without_readings_have_the_residuals_of_their_marks(run: Triangulation) -> None:
    """The officer measures the marks first: plates without points are listed as those with points are."""
    lines = [line for line in deck().decode().splitlines() if not line.startswith("STG")]
    contents, _ = read_compilation("\n".join([*lines, ""]).encode(), run.block)
    alone, full = (refined_stages(given)[1] for given in (contents, read_compilation(deck(), run.block)[0]))
    assert alone is not None and full is not None and [plate.photo for plate in alone.plates] == ["21", "22"]
    for plate, other in zip(alone.plates, full.plates, strict=True):
        np.testing.assert_array_equal(plate.residuals, other.residuals)


def test_readings_on_a_refused_plate_have_no_point(run: Triangulation) -> None:
    # Half a millimetre on one mark of photo 22; the run goes on without the plate.
    card = next(line for line in deck().decode().splitlines() if line.startswith("FMS 22") and line[13:15] == "1 ")
    x = float(card[18:30])
    moved = card[:18] + f"{x + 0.5:12.7f}" + card[30:]
    readings = deck((card, moved), ("STOP", "GO  "))
    result = compiled(run, read_compilation(readings, run.block)[0])
    assert set(result.reasons) == {REFUSED}
    with pytest.raises(DeckError, match="photo 22"):
        compiled(run, read_compilation(deck((card, moved)), run.block)[0])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("FID RC8  1 ", "FID RC9  1 ", "the run has no camera RC9"),
        ("FMS 21       2 ", "FMS 29       2 ", "photo 29 is in no model"),
        ("FMS 21       2 ", "FMS 21       Z ", "mark Z"),
        ("FID RC8  2 ", "FID RC8  1 ", "mark 1 of camera RC8 is already given on line"),
        ("FMS 22 ", "FMS 21 ", "photo 22 has no measured fiducial marks"),
    ],
)
def test_faults_of_the_interior_orientation_are_told_at_their_cards(
    run: Triangulation, old: str, new: str, said: str
) -> None:
    with pytest.raises(DeckError) as error:
        read_compilation(deck((old, new)), run.block)
    problem = next(problem for problem in error.value.problems if said in problem.message)
    text = deck((old, new)).decode().splitlines()
    assert problem.line is not None and problem.card == text[problem.line - 1][:3]


def test_raw_stages_need_the_run_and_unused_cards_are_told(run: Triangulation) -> None:
    with pytest.raises(DeckError, match="beside the run"):
        read_compilation(deck())
    refined = deck(("RED RAW    ", "RED REFINED"))
    contents, warnings = read_compilation(refined, run.block)
    assert contents.raw is None and "FMS" in warnings[0].message and "not used" in warnings[0].message
