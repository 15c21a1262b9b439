"""Compilation decks that are wrong, every message at its card, and the verdict of what is compiled."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

import stage_readings
from cli.commands import musat
from musatpy.compilation.triangulation import of_record
from musatpy.errors import DeckError
from musatpy.formats.compilation_deck import compilation_bytes, read_compilation
from musatpy.interchange.xyz import read as read_points
from musatpy.model import CoordinateSystem
from record_rows import read_rows, with_columns
from stage_readings import changed

FIXTURES, DECK = stage_readings.FIXTURES, stage_readings.DECK


def compiled(run: Path, deck: Path, *options: str, command: str = "compile") -> Result:
    return musat("as11", command, run, deck, "-o", deck.parent, *options)


CIN = "CIN    2.000  5   600.0    20.0"
PRF = "PRF NS       2122     N        S           50.00   2.000   0.300"
GRD = "GRD BAY        100.00"
PRE = "PRE NS       2122     M  0.000000    0.000000    100.000000  100.000000"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("MDL 2122     21       22 ", "MDL 2122     21       29 ",
         "changed.crd:4 cols 23-30 MDL.right: model 2122: the run has no photo 29"),
        ("MDL 2223     22       23      ", "MDL 2223     22       22      ", "one photo on both stages"),
        ("MDL 2223     22 ", "MDL 2122     22 ",
         "changed.crd:5 cols 5-12 MDL.model: model 2122 is already given on line 4"),
        ("STG 2122     202 ", "STG 2122     102 ", "point 102 is read twice in model 2122"),
        ("STG 2122     202 ", "STG 2129     202 ", "there is no MDL card of model 2129"),
        ("3.994012", "3.9940l2", "changed.crd:10 cols 25-35 STG.x_left"),
        (PRF, PRF.replace(" N ", " X "), "cols 23-30 PRF.start: point X is not read in model 2122"),
        (PRF, PRF.replace(" NS ", " XX "), "cols 5-12 PRF.profile: profile XX has 0 readings of class P"),
        (PRF, f"{PRF}L   40.0", "PRF.spacing: a single line (scan L) has none"),
        (PRF, f"{PRF}XZ", "changed.crd:6 col 66 PRF.zig: 'Z': the lag of lines read to and fro is not computed"),
        ("5.00         00000004", "5.00       A 00000004",
         "changed.crd:4 col 71 MDL.adjust: 'A': right stages are not corrected by points read again"),
        ("MDL 2122 ", "RED RAW\nMDL 2122 ", "changed.crd:4 cols 1-3: 'RED' is no card; expected one of"),
        (PRF, f"{PRE}\n{PRF}", "PRF.end: its ends stand on a PRE card too"),
        (GRD, "GRD BAY        100.00  18.32700000             ", "a grid has both corners, or none"),
        (PRF, PRF.replace("   50.00", "    0.01"), "changed.crd:6 cols 41-48 PRF.step: profile NS has"),
        (CIN, f"{CIN}\n{CIN}",
         "changed.crd:4 col 33 CIN.of: contours of this kind are already asked for on line 3"),
        (CIN, "CIN          5   600.0    20.0", "CIN.interval: neither an interval nor a CIL card"),
        (CIN, f"{CIN} D          BUY", "CIN.grid: there is no GRD card of this grid"),
        (CIN, f"{CIN} H    2.000", "CIN.drying: contours of height have none"),
        (CIN, f"{CIN}\nCIL      1.000           3.000 ", "CIL.level_1: levels stand one beside the other"),
        ("END", "PTM 2122     NS          31    1.000    2.000\nEND",
         "reading 32 of profile NS in model 2122, which has 31"),
        ("END", "PTM 2122     NS           1    1.000\nPTM 2122     NS           1    2.000\nEND",
         "a second time of a reading"),
        ("END", "WTR 1.333000\nEND", "WTR.index: the run has water of the index 1.340000"),
        ("END", "WTR 1.340000                               2.000\nEND",
         "WTR.tilt_sigma: the deck of the run states it"),
        ("END", "ELL WGS84\nEND", "ELL.name: the run is on another ellipsoid"),
        ("VDT MLLW        -0.1500  0.0500", "VDT MLLW        -0.1500  0.0500 nowhere.gtx",
         "VDT.geoid: geoid model nowhere.gtx"),
    ],
)  # fmt: skip
def test_a_bad_deck_is_refused_at_its_cards(
    run_record: Path, tmp_path: Path, old: str, new: str, message: str
) -> None:
    result = compiled(run_record, changed(tmp_path, (old, new)))
    assert result.exit_code == 1 and message in " ".join(result.output.split()), result.output
    assert "Traceback" not in result.output and not (tmp_path / "changed.lst").exists()


@pytest.mark.parametrize("command", ["compile", "setup"])
def test_what_is_wrong_with_run_and_cards_is_told_in_one_pass(
    run_record: Path, tmp_path: Path, command: str
) -> None:
    deck = changed(
        tmp_path, ("MDL 2122     21 ", "MDL 2122     29 "), ("3.994012", "3.9940l2"), (GRD, "GRD BAY          0.00")
    )
    result = compiled(run_record, deck, command=command)
    lines = [int(line) for line in re.findall(r"^\S*changed.crd:(\d+) ", result.output, re.M)]
    assert result.exit_code == 1 and lines == sorted(lines) and len(lines) == 3
    assert "not compiled, 3 errors" in result.output


@pytest.mark.parametrize("contents", ["", "\n\n", "END\n", "\x00\xff" * 40, "MDL 2122     21       22\nEND\n"])
def test_decks_of_nothing_are_refused(run_record: Path, tmp_path: Path, contents: str) -> None:
    deck = tmp_path / "nothing.crd"
    deck.write_bytes(contents.encode("latin-1"))
    result = compiled(run_record, deck)
    assert result.exit_code == 1 and "not compiled, " in result.output and "Traceback" not in result.output
    assert list(tmp_path.iterdir()) == [deck]


def test_index_and_ellipsoid_of_the_run_may_be_said_again(run_record: Path, tmp_path: Path) -> None:
    deck = changed(tmp_path, ("END", "WTR 1.340000\nELL clrk66\nEND"))
    assert not read_compilation(deck, of_record(run_record).block)[1]


def in_model(change: Callable[[np.ndarray], np.ndarray]) -> bytes:
    """Return the deck with all readings (2, 2) changed."""
    deck = stage_readings.compilation()
    xy = np.stack([change(reading) for reading in deck.stages.xy])
    return compilation_bytes(replace(deck, stages=replace(deck.stages, xy=np.round(xy, 4))))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda xy: xy[::-1], "left and right were exchanged"),
        (lambda xy: xy / 25.4, "they were in inches (factor 25.4)"),
        pytest.param(lambda xy: 1e3 * xy, "they were in micrometres (factor 0.001)", marks=pytest.mark.slow),
        pytest.param(lambda xy: xy[:, ::-1], "x and y were exchanged", marks=pytest.mark.slow),
    ],
)
def test_slips_of_a_whole_model_are_named_and_refused(
    run_record: Path, tmp_path: Path, change: Callable[[np.ndarray], np.ndarray], said: str
) -> None:
    deck = tmp_path / "slip.crd"
    deck.write_bytes(in_model(change))
    message = f"slip.crd:4 cols 14-30 MDL: model 2122: most of its readings give no points, but would if {said}"
    result = compiled(run_record, deck)
    assert result.exit_code == 1 and message in result.output and not (tmp_path / "slip.lst").exists()


def test_a_slip_may_be_compiled_anyway_and_is_a_warning_then(run_record: Path, tmp_path: Path) -> None:
    deck = tmp_path / "slip.crd"
    kept = [line for line in in_model(lambda xy: xy[::-1]).decode().splitlines() if line[:3] not in ("CIN", "GRD")]
    deck.write_text("\n".join(kept) + "\n")
    result = compiled(run_record, deck, "--anyway")
    assert result.exit_code == 4 and "left and right were exchanged" in (tmp_path / "slip.lst").read_text()
    assert "slip.crd:8 cols 25-68 STG: warning: point 102 of model 2122 has no position: " in result.output
    assert "and 247 more readings without a position" in result.output


def apart(record: dict[str, Any]) -> None:
    record["station_pairs"] = [pair for pair in record["station_pairs"] if pair["photos"] != ["21", "22"]]


def one_above_the_other(record: dict[str, Any]) -> None:
    """Put photo 22 400 m above photo 21."""
    left, right = (row for row in record["stations"] if row["photo"] in ("21", "22"))
    right["position"] = [*left["position"][:2], left["position"][2] + 400.0]


@pytest.mark.parametrize(
    ("change", "message"),
    [(apart, "share no point of the run"), (one_above_the_other, "have no base across the vertical: ")],
)
def test_photos_that_make_no_model_are_told_at_their_card(
    run_record: Path, tmp_path: Path, change: Callable[[dict[str, Any]], None], message: str
) -> None:
    record = read_rows(run_record)
    change(record)
    (tmp_path / "run.json").write_text(json.dumps(with_columns(record)))
    result = compiled(tmp_path / "run.json", changed(tmp_path))
    place = "changed.crd:4 cols 23-30 MDL.right: model 2122: photos 21 and 22"
    assert result.exit_code == 1 and f"{place} {message}" in result.output


def test_places_by_two_coordinates_of_a_geocentric_job_are_refused(run_record: Path, tmp_path: Path) -> None:
    block = of_record(run_record).block
    geocentric = replace(block, options=replace(block.options, system=CoordinateSystem.GEOCENTRIC))
    ends = PRE.replace("2122     M", "2122     J")
    deck = changed(tmp_path, (PRF, f"{ends}\n{PRF.replace(' N ', '   ').replace(' S ', '   ')}"))
    with pytest.raises(DeckError) as error:
        read_compilation(deck, geocentric)
    assert [(fault.card, fault.field) for fault in error.value.problems] == [("PRE", "system"), ("GRD", "first_1")]


TRUST = Path(__file__).parents[2] / "fixtures" / "trust"
MIRRORED = TRUST / "as11_mirrored.crd"  # plates mirrored in y


@pytest.fixture(scope="module")
def local_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The record of a local job whose images are without errors."""
    folder = tmp_path_factory.mktemp("run")
    assert musat("run", "-q", TRUST / "local_run.crd", "-o", folder).exit_code == 0
    return folder / "local_run.json"


def deck(path: Path, change: Callable[[str, list[float]], tuple[str, list[float]]]) -> Path:
    """Write the deck with its readings put right, y not mirrored, and then changed: point, plate coordinates."""
    lines = []
    for line in MIRRORED.read_text().splitlines():
        if line.startswith("STG"):
            xy = [float(line[first : first + 11]) for first in (24, 35, 46, 57)]
            head, xy = change(line[:24], [xy[0], -xy[1], xy[2], -xy[3]])
            line = head + "".join(f"{value:11.6f}" for value in xy) + line[68:]
        lines.append(line)
    path.write_text("\n".join(lines) + "\n")
    return path


def judged(local_run: Path, path: Path, *options: str) -> tuple[Result, dict[str, object]]:
    result = musat("as11", "compile", local_run, path, "-o", path.parent, *options)
    return result, json.loads(path.with_suffix(".json").read_text())["verdict"]


def moved(point: str, off: float) -> Callable[[str, list[float]], tuple[str, list[float]]]:
    """Return a change of the right y (mm) of one point."""

    def change(head: str, xy: list[float]) -> tuple[str, list[float]]:
        return head, [*xy[:3], xy[3] + (off if head[13:21].strip() == point else 0.0)]

    return change


def test_mirrored_plates_are_rejected(local_run: Path, tmp_path: Path) -> None:
    """All y-parallaxes of 1,500 sigmas ended with status 0."""
    path = tmp_path / "mirrored.crd"
    path.write_bytes(MIRRORED.read_bytes())
    result, verdict = judged(local_run, path)
    assert result.exit_code == 4 and "mirrored.crd: REJECTED, 30 points in 1 model, listing" in result.stdout
    assert "mirrored.crd: rejected: model M: half of its y-parallaxes are beyond 1438.3 sigmas" in result.stderr
    assert verdict["grade"] == "REJECTED" and verdict["reasons"][0]["concern"] == "single observations"
    listing = path.with_suffix(".lst").read_text()
    assert "*** REJECTED ***" in listing.splitlines()[0] and "REJECTED: not to be used\n- model M: half" in listing


def test_plates_that_are_right_are_accepted(local_run: Path, tmp_path: Path) -> None:
    result, verdict = judged(local_run, deck(tmp_path / "right.crd", moved("", 0.0)))
    assert (result.exit_code, verdict) == (0, {"grade": "ACCEPTED", "reasons": [], "notes": []})
    assert "right.crd: ACCEPTED, 30 points in 1 model" in result.stdout and not result.stderr


@pytest.mark.parametrize("off", [-0.1, 0.1])
def test_one_slip_in_y_is_a_doubt(local_run: Path, tmp_path: Path, off: float) -> None:
    """Of either sign; one reading of 14 sigmas spoils its own point alone."""
    path = deck(tmp_path / "slip.crd", moved("G5", off))
    result, verdict = judged(local_run, path)
    assert (result.exit_code, verdict["grade"]) == (0, "DOUBTFUL")
    said = r"doubtful: 1 y-parallax beyond the test \(limit 3.6\): point G5 of model M by 1\d\.\d sigmas"
    assert re.search(said, result.stderr)
    assert judged(local_run, path, "--strict")[0].exit_code == 4
    pair = musat("diff", path.with_suffix(".lst"), path.with_suffix(".json"))
    assert pair.exit_code == 0 and "not compared: Warnings" not in pair.output, pair.output


def test_a_y_parallax_below_the_limit_of_all_together_is_no_doubt(local_run: Path, tmp_path: Path) -> None:
    _, verdict = judged(local_run, deck(tmp_path / "small.crd", moved("G5", 0.02)))
    assert verdict["grade"] == "ACCEPTED"


def test_points_on_the_other_side_of_the_water_are_doubts(local_run: Path, tmp_path: Path) -> None:
    """An x-parallax of 1.5 mm raises G1 by some metres, above the water; G2 has lost its flag."""

    def change(head: str, xy: list[float]) -> tuple[str, list[float]]:
        point = head[13:21].strip()
        head = head.replace("GB", "G ") if point == "G2" else head
        return head, [*xy[:2], xy[2] - (1.5 if point == "G1" else 0.0), xy[3]]

    result, verdict = judged(local_run, deck(tmp_path / "sides.crd", change))
    texts = [reason["text"] for reason in verdict["reasons"]]
    assert result.exit_code == 0 and len(texts) == 2, texts
    assert texts[0].startswith("1 point flagged as submerged, above the water: point G1 of model M by")
    assert texts[1].startswith("1 point not flagged as submerged, below the water: point G2 of model M by")


def test_where_nothing_is_compiled_the_status_is_not_0(local_run: Path, tmp_path: Path) -> None:
    """Without a tide no reading of a submerged point makes one."""
    record = json.loads(local_run.read_text())
    record["adjusted_water"]["tide"] = [None] * 3
    (tmp_path / "run.json").write_text(json.dumps(record))
    path = deck(tmp_path / "none.crd", moved("", 0.0))
    result = musat("as11", "compile", tmp_path / "run.json", path, "-o", tmp_path)
    assert result.exit_code == 4, result.output
    assert "rejected: none of 30 readings gives a point: nothing is compiled (it is submerged" in result.stderr
    points = TRUST / "local_points.csv"
    result = musat("as11", "correct", tmp_path / "run.json", "1", "2", points, "-o", tmp_path / "true.csv")
    assert result.exit_code == 1 and "no tide of photo 1, 2, 3" in result.stderr


def test_a_table_is_corrected_in_a_local_job(local_run: Path, tmp_path: Path) -> None:
    """It was refused: the run is a local job, and the file is in local."""
    result = musat("as11", "correct", local_run, "1", "2", TRUST / "local_points.csv", "-o", tmp_path / "true.csv")
    assert result.exit_code == 0, result.output
    assert "true.csv: 2 points, 2 corrected" in result.stdout
    # depths by the index at first: 3 and 4 m of apparent depth below the water
    heights = read_points(tmp_path / "true.csv").columns["true_z"].values.tolist()
    assert heights == pytest.approx([-4.08, -5.47], abs=0.01)
    table = musat("as11", "correct", local_run, "1", "2", TRUST / "local_points.csv", "-o", tmp_path / "true.xyz")
    assert table.exit_code == 0, table.output


def test_a_doubt_about_the_run_is_one_about_what_is_corrected(local_run: Path, tmp_path: Path) -> None:
    record = json.loads(local_run.read_text())
    record["verdict"] |= {
        "grade": "DOUBTFUL",
        "reasons": [{"grade": "DOUBTFUL", "concern": "sigma0", "text": "so", "section": ""}],
    }
    (tmp_path / "run.json").write_text(json.dumps(record))
    words = ("as11", "correct", tmp_path / "run.json", "1", "2", TRUST / "local_points.csv", "-o")
    result = musat(*words, tmp_path / "true.csv")
    assert result.exit_code == 0 and "doubtful: the run is doubtful: so" in result.stderr
    assert "true.csv: 2 points, 2 corrected" in result.stdout
    assert musat(*words, tmp_path / "strict.csv", "--strict").exit_code == 4
