"""`musat merge`, `extract`, `list` and `run --punch`: what they write, say, and refuse."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest

from cli.commands import musat
from musatpy.formats.families import agencies
from musatpy.formats.musat import read_deck
from musatpy.formats.parts import deck_parts
from musatpy.geometry.geodesy import frame_of
from musatpy.model import ControlKind
from record_rows import read_rows

FIXTURES = Path(__file__).parents[2] / "fixtures"
CAYMAN = FIXTURES / "cayman" / "cayman_modified.crd"
HARBOUR = FIXTURES / "own_formats" / "harbour"
ST_THOMAS = FIXTURES / "st_thomas" / "st_thomas.crd"


@pytest.fixture
def decks(tmp_path: Path) -> tuple[Path, Path]:
    """The two ends of the strip, with photo 841 in both."""
    west, east = tmp_path / "west.crd", tmp_path / "east.crd"
    for path, photos in ((west, "837-841"), (east, "841-846")):
        result = musat("extract", CAYMAN, "--photos", photos, "-o", path)
        assert result.exit_code == 0, result.output
    return west, east


def cards(path: Path) -> list[str]:
    return sorted(line[:72] for line in path.read_text().splitlines())


def test_extract_says_what_it_leaves_out_and_what_cannot_be_run_yet(tmp_path: Path) -> None:
    out = tmp_path / "new" / "west.crd"
    result = musat("extract", CAYMAN, "--photos", "837-841", "-o", out)
    assert (result.exit_code, result.stderr) == (0, "")
    lines = result.stdout.splitlines()
    assert lines[:2] == ["photos left out: 5", "    842  843  844  845  846"]
    assert "points left with one ray, and nothing known of them: 5" in lines
    counts = "5 photos, 55 points, 117 plate measurements, 24 control points; 5 warnings of musat check"
    assert lines[-1] == f"{out}: {counts}"
    assert os.listdir(out.parent) == ["west.crd"] and musat("run", "-q", out).exit_code == 0
    result = musat("extract", CAYMAN, "--photos", "841", "-o", out)
    assert result.exit_code == 0
    assert result.stderr.count("it cannot be run yet") == len(result.stderr.splitlines()) > 0
    assert (musat("check", out).exit_code, musat("list", out).exit_code) == (1, 0)


def test_extract_by_files_and_titles(tmp_path: Path) -> None:
    (tmp_path / "photos.txt").write_text("837, 838  # the first\n\n840-841\n")
    (tmp_path / "area.txt").write_text("-81.5 19\n-81.4 19\n-81.4 20\n-81.5 20\n")
    out = tmp_path / "part.crd"
    result = musat(
        "extract", CAYMAN, "--photos-from", tmp_path / "photos.txt", "--area", tmp_path / "area.txt",
        "--title", "ENDS", "--title", "OF THE STRIP", "--drop-single", "-o", out,
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    block = read_deck(out)
    assert block.titles == ("ENDS", "OF THE STRIP")
    assert block.photos.ids.tolist() == ["837", "838", "840", "841", "845", "846"]
    assert "points dropped with their only ray: " in result.stdout


def test_extract_by_a_box_of_stations_or_points(tmp_path: Path) -> None:
    photos = {}
    for by in ("stations", "points"):
        out = tmp_path / f"{by}.crd"
        result = musat("extract", CAYMAN, "--box=-81.30,19,-81.25,20", "--by", by, "-o", out)
        assert result.exit_code == 0, result.output
        record = json.loads(musat("list", out, "--json").stdout)[0]  # it cannot be run
        photos[by] = {row["photo"] for row in record["photos"]}
    assert photos["stations"] == {"841"} < photos["points"] < {str(photo) for photo in range(837, 847)}


def test_merge_makes_the_strip_of_its_parts(decks: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "all.crd"
    result = musat("merge", *decks, "--join-photos", "-o", out)
    assert (result.exit_code, result.stderr) == (0, "")
    assert cards(out) == cards(CAYMAN)
    assert "given alike in several decks, and kept once: measurement: 21" in result.stdout
    assert result.stdout.splitlines()[-1].startswith(f"{out}: 10 photos, 98 points, 241 plate measurements")


@pytest.mark.slow
def test_decks_that_contradict_one_another_leave_no_deck(decks: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "all.crd"
    before = sorted(os.listdir(tmp_path))
    result = musat("merge", *decks, "-o", out)
    assert (result.exit_code, result.stdout) == (1, "")
    assert result.stderr == f"photo 841 is in several decks: {decks[0]}, {decks[1]}\n"
    text = decks[1].read_text().replace("GEOG WATPT ", "GEOG NONE  ")
    decks[1].write_text(text)
    result = musat("merge", *decks, "--join-photos", "-o", out)
    assert f"option refraction is WATPT in {decks[0]}, NONE in {decks[1]}" in result.stderr
    assert sorted(os.listdir(tmp_path)) == before
    assert musat("merge", *decks, "--join-photos", "--options-from", "east", "-o", out).exit_code == 0
    assert read_deck(out).options.refraction == "NONE"


@pytest.mark.slow
def test_merge_with_prefixes_and_new_names_lists_control_that_is_near(
    decks: tuple[Path, Path], tmp_path: Path
) -> None:
    names, out = tmp_path / "names.txt", tmp_path / "all.crd"
    names.write_text("east photo 841 E1\n* camera RC8 RC8A\neast point 1118 9118\n")
    result = musat(
        "merge", *decks, "--rename", names, "--prefix", "east=E", "--point-prefix", f"{decks[1]}=E",
        "--shared", "1104,1108, 2057", "--near", "1", "-o", out,
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    block = read_deck(out)
    assert block.photos.ids.tolist()[5:] == ["E1", "E842", "E843", "E844", "E845", "E846"]
    assert block.cameras.ids.tolist() == ["RC8A"]
    assert {"1104", "E1201", "E2059", "2059", "1118", "9118"} <= set(block.points.ids.tolist())
    assert "points in several decks, each one point: 3\n    1104  2057  1108\n" in result.stdout
    assert f"    {decks[1]} point 9118 1118  # 0.000 m from that of {decks[0]}\n" in result.stdout


def test_list_prints_pages_or_json() -> None:
    result = musat("list", CAYMAN, ST_THOMAS)
    assert (result.exit_code, result.stderr) == (0, "")
    pages = result.stdout.split("\f")
    heads = [page.splitlines()[0].split() for page in pages]
    pages_of = [(str(deck), page) for deck in (CAYMAN, ST_THOMAS) for page in "12"]
    assert [(head[1], head[-1]) for head in heads] == pages_of
    assert all(len(page.splitlines()) <= 60 for page in pages)
    records = json.loads(musat("list", CAYMAN, ST_THOMAS, "--json", "--few", "12").stdout)
    assert [len(record["photos"]) for record in records] == [10, 3]
    assert [len(part) for part in records[0]["strong_parts"]] == [7, 3]


@pytest.mark.parametrize("command", ["list", "extract", "merge"])
def test_a_deck_that_cannot_be_read_is_told_with_its_cards(command: str, tmp_path: Path) -> None:
    bad = tmp_path / "bad.crd"
    bad.write_text(ST_THOMAS.read_text().replace("2434.2851", "2434.28x1"))
    extra = {"list": [], "extract": ["--photos", "21"], "merge": [ST_THOMAS]}[command]
    out = [] if command == "list" else ["-o", tmp_path / "out.crd"]
    result = musat(command, bad, *extra, *out)
    assert (result.exit_code, result.stdout) == (1, "")
    assert "STA.height: '2434.28x1' is not F10.4" in result.stderr and "^^^^" in result.stderr
    assert os.listdir(tmp_path) == ["bad.crd"]
    missing = musat(command, tmp_path / "missing.crd", *extra, *out)
    assert missing.exit_code == 1
    assert "No such file" in missing.stderr


def test_run_punches_a_restart(tmp_path: Path) -> None:
    deck = Path(shutil.copy(ST_THOMAS, tmp_path / "job.crd"))
    result = musat("run", deck, "--punch", "restart")
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.endswith(f", punched deck {tmp_path}/job.pun\n")
    assert sorted(os.listdir(tmp_path)) == ["job.crd", "job.json", "job.lst", "job.pun"]
    again = musat("run", tmp_path / "job.pun", "-o", tmp_path / "again")
    assert again.exit_code == 0
    first, second = (read_rows(tmp_path / name) for name in ("job.json", "again/job.json"))
    assert second["solution"]["sigma0"] == pytest.approx(first["solution"]["sigma0"], rel=1e-8)
    assert {line[:3] for line in cards(tmp_path / "job.pun")} == {line[:3] for line in cards(deck)}


def test_run_punches_a_result(tmp_path: Path) -> None:
    result = musat(
        "run", ST_THOMAS, "-o", tmp_path, "-q", "--punch", "result", "--punch-points", "control",
        "--punch-kind", "V", "--punch-plates",
    )  # fmt: skip
    assert result.exit_code == 0
    assert "the plate coordinates are in the sigmas of the result already" in result.stderr
    lines = cards(tmp_path / "st_thomas.pun")
    assert [line[4:13].split() for line in lines if line.startswith("CTG")] == [
        [name, kind] for name, kind in zip(("101", "102", "103", "104", "105", "106"), "VVVVVC", strict=True)
    ]
    assert sum(line.startswith("PLT") for line in lines) == 48
    assert not any(line.startswith("EQL") for line in lines)


def test_run_punches_files_of_another_family(tmp_path: Path) -> None:
    result = musat("run", ST_THOMAS, "-o", tmp_path, "--punch", "result", "--punch-family", "patb")
    assert result.exit_code == 0
    assert result.stdout.endswith(f", punched decks {tmp_path}/st_thomas.con, {tmp_path}/st_thomas.ori\n")
    assert "punched files: patb holds no tides: 3 left out" in result.stderr
    record = read_rows(tmp_path / "st_thomas.json")
    parts, _ = agencies()["patb"].read(tmp_path / "st_thomas.ori", deck_parts(ST_THOMAS))
    frame = frame_of(read_deck(ST_THOMAS).options.system, read_deck(ST_THOMAS).ellipsoid)
    punched = frame.working(parts["stations"]["photos.position"])
    adjusted = frame.working(np.array([row["position"] for row in record["stations"]]))
    np.testing.assert_allclose(punched, adjusted, atol=2e-5)  # the files have five decimals of a metre
    options = ("--punch", "restart", "--punch-family", "harbour", "--formats", HARBOUR)
    own = musat("run", ST_THOMAS, "-q", "-o", tmp_path / "own", *options)
    assert own.exit_code == 0, own.stderr
    files = set(os.listdir(tmp_path / "own"))
    assert files > {"st_thomas.json", "st_thomas.lst"} and "st_thomas.pun" not in files and len(files) == 4


def test_decks_are_not_read_by_formats_of_records() -> None:
    result = musat("check", ST_THOMAS, "--formats", HARBOUR)
    assert result.exit_code == 1
    assert "has formats of records, not of cards: convert such files to a deck first" in result.stderr


def test_two_runs_into_one_folder_punch_no_files_of_one_name(tmp_path: Path) -> None:
    result = musat("run", ST_THOMAS, CAYMAN, "-o", tmp_path, "--punch", "result", "--punch-family", "bingo")
    assert result.exit_code == 2
    assert "image.dat" in result.stderr and os.listdir(tmp_path) == []


def test_a_result_without_sigmas_is_exact_control_and_approximate_stations(tmp_path: Path) -> None:
    punched = ("--punch", "result", "--no-punch-sigmas", "--punch-plates")
    assert musat("run", ST_THOMAS, "-q", "-o", tmp_path, *punched).exit_code == 0
    block = read_deck(tmp_path / "st_thomas.pun")
    assert np.isnan(block.photos.position_sigma).all() and np.isnan(block.photos.attitude_sigma).all()
    check = block.control.kind == ControlKind.CHECK
    assert (block.control.fixed == ~check).all() and block.control.fixed.sum() > 5


def test_names_that_do_not_fit_are_told_once_each(decks: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "all.crd"
    result = musat("merge", *decks, "--prefix", "east=LONGER", "-o", out)
    assert (result.exit_code, result.stdout) == (1, "")
    lines = result.stderr.splitlines()
    assert len(lines) == 6  # photos 841 to 846, on many cards each
    assert lines[0].startswith(f"{out} cols 5-12 STA.photo: ") and "'LONGER841' is not A8" in lines[0]
    assert not out.exists()


def test_a_family_that_does_not_name_its_photos_is_said(tmp_path):
    musat("convert", ST_THOMAS, tmp_path / "job.hbi", "--to", "harbour", "--formats", HARBOUR)
    nameless = shutil.copytree(HARBOUR, tmp_path / "harbour")
    stations = nameless / "stations.toml"
    stations.write_text(stations.read_text().replace('target = "photos.ids"', 'target = ""', 1))
    result = musat("convert", tmp_path / "job.hbi", tmp_path / "o.crd", "--from", "harbour", "--formats", nameless)
    assert result.exit_code == 1
    assert "no field has the target photos.ids, which names the rows of attitudes" in result.stderr
