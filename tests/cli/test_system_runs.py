"""What `musat run` says of decks whose systems cannot be used, and what it writes for those whose can."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from cli.commands import musat
from record_rows import read_rows

FIXTURES = Path(__file__).parents[2] / "fixtures"
DECK = FIXTURES / "st_thomas_utm" / "st_thomas_utm.crd"


@pytest.fixture
def deck(tmp_path):
    return Path(shutil.copy(DECK, tmp_path / "job.crd"))


def changed(deck: Path, old: str, new: str, *cards: str) -> Path:
    """Put a text in the place of another and of the blanks behind it, and cards before the last one."""
    width = max(len(old), len(new))
    text = deck.read_text()
    assert text.count(old.ljust(width)) == 1
    *lines, end = text.replace(old.ljust(width), new.ljust(width)).splitlines()
    deck.write_text("\n".join([*lines, *cards, end]) + "\n")
    return deck


def errors(deck: Path) -> str:
    """Run a deck that cannot be used, and return what is said."""
    result = musat("run", deck)
    assert result.exit_code == 1
    assert result.stdout == ""
    assert "Traceback" not in result.stderr
    assert not list(deck.parent.glob("job.*st")) and not list(deck.parent.glob("*.json"))
    return result.stderr


def test_an_absent_geoid_grid(deck):
    last = sum(1 for _ in deck.open())
    said = errors(changed(deck, "EPSG:3992", "EPSG:3992", "SYT OUT GEOID egm96_15.gtx"))
    assert f"job.crd:{last} cols 14-70 SYT.text: geoid model egm96_15.gtx: there is no such file" in said
    assert "SYT OUT GEOID egm96_15.gtx" in said  # the card
    assert "^" * 57 in said


def test_a_geoid_grid_that_is_none(deck, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "g.gtx").write_text("no grid")
    said = errors(changed(deck, "EPSG:3992", "EPSG:3992", "SYT OUT GEOID g.gtx"))
    assert "SYT.text: geoid model g.gtx: PROJ cannot read" in said


def test_an_unknown_code(deck):
    said = errors(changed(deck, "EPSG:3992", "EPSG:9999"))
    assert "job.crd:6 cols 33-72 SYS.definition: EPSG:9999 is no coordinate system that PROJ knows" in said


def test_a_datum_shift(deck):
    """Of another ellipsoid, and one that a PROJ string asks for."""
    said = errors(changed(deck, "EPSG:3992", "EPSG:32620"))
    assert "job.crd:6 cols 33-72 SYS.definition: EPSG:32620 is on the ellipsoid WGS 84" in said
    assert "no datum is shifted" in said


def test_a_datum_shift_that_is_asked_for(deck):
    card = "SYT OUT PROJ +proj=utm +zone=20 +ellps=clrk66 +towgs84=11,72,-101"
    assert "asks for a datum shift" in errors(changed(deck, "EPSG:3992", "", card))


def test_points_beyond_the_projection(deck):
    said = errors(changed(deck, "  294608.1087", " 99460817.108"))
    assert "job.crd:9 cols 17-57 STX: +proj=utm +zone=20 +ellps=clrk66, ellipsoidal" in said
    assert "does not reach 99460817.108, 2028706.603" in said


def test_points_outside_the_area_are_a_warning(deck):
    result = musat("run", changed(deck, "EPSG:3992", "EPSG:26717"))
    assert result.exit_code == 0
    assert "warning: " in result.stderr
    assert "lie outside the area of NAD27 / UTM zone 17N" in result.stderr


def test_bad_words_are_found_and_expected(deck):
    said = errors(changed(deck, "SYS OUT PROJ GRID OPK  DMS SYST", "SYS OUT UTM  GRID PKO  DMS SYST"))
    assert "job.crd:6 cols 9-12 SYS.kind: 'UTM' is not A4 (one of GEOG, GEOC, LOCL, TANG, PROJ)" in said
    assert "job.crd:6 cols 19-22 SYS.angles: 'PKO' is not A4 (one of OPK, POK, ATS, MATR)" in said


def test_a_geoid_by_its_name_in_a_folder_of_proj(deck, tmp_path, monkeypatch):
    """The grid is found in PROJ_DATA; heights of the answer are above it, and the listing says so."""
    header = np.array([15.0, -70.0, 1.0, 1.0], ">f8").tobytes() + np.array([11, 11], ">i4").tobytes()
    (tmp_path / "grids").mkdir()
    (tmp_path / "grids" / "level.gtx").write_bytes(header + np.full((11, 11), -42.0, ">f4").tobytes())
    monkeypatch.setenv("PROJ_DATA", str(tmp_path / "grids"))
    result = musat("run", changed(deck, "EPSG:3992", "EPSG:3992", "SYT OUT GEOID level.gtx"))
    assert result.exit_code == 0, result.stderr
    assert "heights above level.gtx" in (tmp_path / "job.lst").read_text()
    stated = read_rows(tmp_path / "job.json")
    for row, answer in zip(stated["stations"], stated["stated"]["stations"], strict=True):
        assert answer["position"][2] - row["position"][2] == pytest.approx(42.0, abs=1e-9)
        assert answer["undulation"] == pytest.approx(-42.0, abs=1e-9)


def test_converted_decks_are_in_the_words_of_the_adjustment(deck, tmp_path):
    result = musat("convert", deck, tmp_path / "native.crd")
    assert result.exit_code == 0, result.stderr
    text = (tmp_path / "native.crd").read_text()
    assert "\nSTA 21 " in text and "\nSYS" not in text
    assert "warning: SYS cards are left out" in result.stderr


def record(path: Path) -> dict:
    return read_rows(path.with_suffix(".json"))


def test_a_restart_is_in_the_words_of_the_deck_and_converges_at_once(deck):
    assert musat("run", deck, "--punch", "restart").exit_code == 0
    first = record(deck)
    punched = deck.with_suffix(".pun").rename(deck.parent / "again.crd")
    words = [line for line in deck.read_text().splitlines() if line.startswith("SYS")]
    assert [line for line in punched.read_text().splitlines() if line.startswith("SYS")] == words
    assert musat("run", punched).exit_code == 0
    again = record(punched)
    assert len(again["iterations"]) < len(first["iterations"])
    for row, before in zip(again["stated"]["stations"], first["stated"]["stations"], strict=True):
        # the limits of the iteration: a millimetre, here in feet
        np.testing.assert_allclose(row["position"], before["position"], rtol=0, atol=0.004)


def test_a_result_is_in_the_system_of_the_answer(deck):
    assert musat("run", deck, "--punch", "result", "--punch-plates").exit_code == 0
    punched = deck.with_suffix(".pun").rename(deck.parent / "result.crd")
    text = punched.read_text()
    assert "SYS IN  PROJ GRID OPK  DMS LOCL EPSG:3992" in text
    assert "SYS OUT" not in text
    answer = record(deck)["stated"]["stations"]
    cards = [line for line in text.splitlines() if line.startswith("STX")]
    found = np.array([[line[16:30], line[30:44], line[44:57]] for line in cards], dtype=float)
    # four decimals on the card
    np.testing.assert_allclose(found, [row["position"] for row in answer], rtol=0, atol=5.01e-5)


def test_stations_may_be_computed_from_control_in_a_grid(deck):
    """The control stands in the grid; nothing is said of stations, and the answer is the same."""
    assert musat("run", deck).exit_code == 0
    first = record(deck)["stated"]["stations"]
    lines = [line for line in deck.read_text().splitlines() if line[:3] not in ("STX", "ATD")]
    lines.insert(3, "OP2 COMPUTE")
    other = deck.with_name("other.crd")
    other.write_text("\n".join(lines) + "\n")
    result = musat("run", other)
    assert result.exit_code == 0, result.stderr
    for row, before in zip(record(other)["stated"]["stations"], first, strict=True):
        np.testing.assert_allclose(row["position"], before["position"], rtol=0, atol=0.004)


def test_merged_decks_are_in_the_words_of_the_first(deck, tmp_path):
    native = FIXTURES / "st_thomas" / "st_thomas.crd"
    assert musat("extract", deck, "--photos", "21-22", "-o", tmp_path / "west.crd").exit_code == 0
    out = tmp_path / "all.crd"
    result = musat("merge", tmp_path / "west.crd", native, "-o", out, "--join-photos", "--prefer", "west.crd")
    assert result.exit_code == 0, result.stderr
    assert "SYS IN  PROJ GRID POK  GON LOCL +proj=utm" in out.read_text()
    assert musat("run", out).exit_code == 0
    assert musat("run", deck).exit_code == 0
    before = {row["point"]: np.array(row["position"]) for row in record(deck)["points"]}
    for row in record(out)["points"]:
        # coordinates of photo 23 and of the control are rounded once more, to .1 mm: 1.6e-11 rad
        assert (np.abs(row["position"] - before[row["point"]]) < [2e-10, 2e-10, 2e-3]).all()
