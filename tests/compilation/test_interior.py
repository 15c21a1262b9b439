"""Stages that were read raw: reduced as plates are, undone step by step, and every fault of their cards."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cli.commands import musat
from json_schema import violations
from musatpy import adjust, read_deck
from musatpy.arrays import FloatArray
from musatpy.compilation.compiled import REFUSED, compiled
from musatpy.compilation.driving import GEOGRAPHIC, IN_MODEL, columns_of, driven, in_model
from musatpy.compilation.interior import refined_stages
from musatpy.compilation.loop import Drive, Loop
from musatpy.compilation.stage_chains import RawLoop, StageChain, chain_of
from musatpy.compilation.stereomodels import set_up
from musatpy.compilation.triangulation import Triangulation, of_solution
from musatpy.errors import CompilationError, DeckError
from musatpy.formats.compilation_deck import compilation_bytes, read_compilation
from musatpy.model.compilation import Compilation
from musatpy.reduction.plate_steps import restore
from musatpy.reports.compilation import DOCUMENT
from musatpy.units import DEGREE
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
    assert musat("run", "-q", RAW, "-o", tmp_path).exit_code == 0
    result = musat("as11", "compile", tmp_path / "st_thomas_raw.json", path)
    assert result.exit_code == 0, result.output
    listing = path.with_suffix(".lst").read_text()
    assert "Plate Reduction" in listing and listing.index("Plate Reduction") < listing.index("Model Set-Up")
    record = read_rows(path.with_suffix(".json"))
    assert [row["photo"] for row in record["reduction"]["plates"]] == ["21", "22"]
    assert all(row["reason"] is None for row in record["points"])
    assert not list(violations(with_columns(record, DOCUMENT.schema()), DOCUMENT.schema(), DOCUMENT.schema()))


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


MARKS = np.array([[100.0, -300.0, -12.0], [-500.0, 900.0, -1.0], [0.0, 0.0, 40.0], [300.0, 5.0, -25.0]])


def raw_deck(run: Triangulation, *changes: tuple[str, str]) -> Compilation:
    return read_compilation(deck(*changes), run.block)[0]


def chain(run: Triangulation, *changes: tuple[str, str]) -> StageChain:
    contents = raw_deck(run, *changes)
    assert contents.raw is not None
    return chain_of(contents.raw, "21", "22")


@pytest.mark.parametrize("side", ["IDEAL   ", "MEASURED"])
@pytest.mark.parametrize("kind", ["SIMILARITY", "AFFINE    ", "PROJECTIVE"])
def test_readings_come_back_from_refined_coordinates(run: Triangulation, side: str, kind: str) -> None:
    """To 1e-9 mm, as the steps are undone one by one; and the other way round."""
    given = chain(run, ("AFFINE       30.00 IDEAL   ", f"{kind}   30.00 {side}"))
    readings = raw_deck(run).stages.xy
    refined = given.plates(readings)
    np.testing.assert_allclose(given.readings(refined)[0], readings, rtol=0, atol=1e-9)
    for place, plate in enumerate((given.left, given.right)):
        step_by_step = restore(plate.plate, refined[:, place])
        np.testing.assert_allclose(given.readings(refined)[0][:, place], step_by_step, rtol=0, atol=1e-9)
    assert np.abs(refined - readings).max() > 50.0  # a comparator with axes of its own
    for axis, step in enumerate(1e-3 * np.eye(2)):
        by = (given.readings(refined + step)[0] - given.readings(refined - step)[0]) / 2e-3
        np.testing.assert_allclose(given.readings(refined)[1][..., axis], by, rtol=0, atol=1e-9)


@pytest.mark.parametrize("drive", Drive)
def test_marks_and_raw_stages_are_inverse(run: Triangulation, drive: Drive) -> None:
    loop = RawLoop(loop=Loop(stereo=set_up(run, "21", "22"), drive=drive), chain=chain(run))
    np.testing.assert_allclose(loop.mark(loop.stages(MARKS).xy), MARKS, rtol=0, atol=1e-9)


def test_partials_of_raw_stages(run: Triangulation) -> None:
    """Central differences over 1 m; the vertical is held, and what its turn adds is up to 1.5e-6 of them."""
    loop, h = RawLoop(loop=Loop(stereo=set_up(run, "21", "22")), chain=chain(run)), 0.5
    partials = loop.stages(MARKS).by_mark
    for axis, step in enumerate(h * np.eye(3)):
        by = (loop.stages(MARKS + step).xy - loop.stages(MARKS - step).xy) / (2 * h)
        np.testing.assert_allclose(partials[..., axis], by, rtol=0.0, atol=1.6e-6 * np.abs(partials).max())


def test_compiled_readings_are_those_that_the_loop_would_set(run: Triangulation) -> None:
    """The loop at the points of the run sets the stages as their own measurements do, but for their residuals."""
    contents, stereo = raw_deck(run), set_up(run, "21", "22")
    loop = RawLoop(loop=Loop(stereo=stereo), chain=chain(run))
    names, points = contents.stages.ids.tolist(), run.block.points.ids.tolist()
    rows = [points.index(name) for name in names]
    marks = stereo.model(run.frame.working(run.position[rows]))
    off = loop.stages(marks).xy - contents.stages.xy
    assert 0.001 < np.abs(off).max() < 0.03 and np.sqrt(np.mean(np.square(off))) < 0.01


@pytest.mark.parametrize(
    ("photos", "message"),
    [
        (("21", "23"), "photo 23: 0 marks measured"),
        (("20", "22"), "photo 20 has no interior orientation"),
    ],
)
def test_photos_without_an_interior_orientation_are_told(
    run: Triangulation, photos: tuple[str, str], message: str
) -> None:
    contents = raw_deck(run)
    assert contents.raw is not None
    with pytest.raises(CompilationError, match=message):
        chain_of(contents.raw, *photos)


def path_in_job(run: Triangulation) -> FloatArray:
    level = run.frame.system(set_up(run, "21", "22").working(MARKS[:2]))
    return np.column_stack([[0.0, 4.0], level / [DEGREE, DEGREE, 1.0]])


def test_a_path_may_be_in_the_system_of_the_job(run: Triangulation) -> None:
    stereo = set_up(run, "21", "22")
    assert columns_of(stereo, of_job=True) == GEOGRAPHIC and columns_of(stereo, of_job=False) == IN_MODEL
    path = in_model(stereo, path_in_job(run), GEOGRAPHIC)
    np.testing.assert_allclose(path[:, 1:], MARKS[:2], rtol=0, atol=1e-6)
    result = driven(RawLoop(loop=Loop(stereo=stereo), chain=chain(run)), path, 2.0)
    assert len(result.t) == 9 and not len(result.off(Loop(stereo=stereo)))


def test_raw_stages_are_driven_at_the_shell(run: Triangulation, tmp_path: Path) -> None:
    assert musat("run", "-q", RAW, "-o", tmp_path).exit_code == 0
    path, interior = tmp_path / "path.csv", tmp_path / "interior.crd"
    rows = [",".join(f"{value:.10f}" for value in row) for row in path_in_job(run)]
    path.write_text("\n".join(["t,lat,lon,height", *rows, ""]))
    interior.write_bytes(b"\n".join(line for line in deck().splitlines() if not line.startswith(b"STG")))
    words = ["as11", "drive", str(tmp_path / "st_thomas_raw.json"), "21", "22", str(path), "--job"]
    result = musat(*words, "--interior", interior, "--rate", "5")
    assert result.exit_code == 0 and "21 cycles at 5 Hz, " in result.output, result.output
    first = (tmp_path / "path.stages.csv").read_text().splitlines()[1].split(",")
    loop = RawLoop(loop=Loop(stereo=set_up(run, "21", "22")), chain=chain(run))
    np.testing.assert_allclose([float(cell) for cell in first[1:]], loop.stages(MARKS[:1]).xy.ravel(), atol=2e-6)
    interior.write_bytes(deck(("RED RAW    ", "RED REFINED")))
    result = musat(*words, "--interior", interior)
    assert (
        result.exit_code == 1 and "its stages are refined: an interior orientation needs a RED RAW" in result.output
    )


def test_a_refused_plate_has_no_chain(run: Triangulation) -> None:
    card = next(line for line in deck().decode().splitlines() if line.startswith("FMS 22") and line[13:15] == "1 ")
    moved = card[:18] + f"{float(card[18:30]) + 0.5:12.7f}" + card[30:]
    with pytest.raises((CompilationError, DeckError), match="photo 22: "):
        chain(run, (card, moved))
