"""Jobs in other coordinate systems: their runs, files, punched decks, and every reason why one cannot be."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
import pytest

from cli.commands import musat
from musatpy.formats.musat import read_deck, write_deck
from musatpy.model import Control, SystemSpec
from musatpy.model.tables import taken
from record_rows import read_rows

FIXTURES = Path(__file__).parents[2] / "fixtures"
DECK = FIXTURES / "st_thomas_utm" / "st_thomas_utm.crd"
UTM = "+proj=utm +zone=20 +ellps=clrk66"
FILES = {"patb": "job.im", "bingo": "itera.dat", "giant": "job.img"}
METRES = 6e-4  # 0.3 mm are half of the last digit of a second on the cards; the files have four decimals and more
RADIANS = 3e-9  # seven decimals of a gon, and four of a second on the cards: 0.8e-9 and 0.24e-9, of three turns


@pytest.fixture
def deck(tmp_path):
    return Path(shutil.copy(DECK, tmp_path / "job.crd"))


def well(*arguments) -> str:
    result = musat(*arguments)
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.mark.slow
@pytest.mark.parametrize("family", FILES)
def test_a_job_comes_back_from_files_in_its_system(tmp_path, family):
    files, back = tmp_path / FILES[family], tmp_path / "back.crd"
    assert f"{family}: coordinates and attitudes of " in well("convert", DECK, files)
    read = musat("convert", "--deck", DECK, files, back)  # the files do not say their system, the reading does
    assert read.exit_code == 0
    assert f"{files.name}: warning: read as coordinates and attitudes of +proj=utm +zone=20" in read.stderr
    job, again = read_deck(DECK), read_deck(back)
    where = dict(zip(job.points.ids[job.control.point], job.control.position, strict=True))
    marks = again.points.ids[again.control.point]
    assert len(marks) >= 4
    pairs = [(job.photos.position, again.photos.position)]
    pairs.append((np.array([where[name] for name in marks]), again.control.position))
    for one, other in pairs:
        np.testing.assert_array_equal(np.isnan(one), np.isnan(other))
        metres = np.nan_to_num(one - other) * [6.4e6, 6.4e6, 1.0]
        assert np.abs(metres).max() < METRES
    assert np.abs(job.photos.attitude - again.photos.attitude).max() < RADIANS


def test_a_station_of_a_file_is_that_of_proj(tmp_path):
    """E, N and h by PROJ, and the rotation by the meridian convergence that PROJ gives."""
    well("convert", DECK, tmp_path / "job.im")
    words = (tmp_path / "job.ori").read_text().splitlines()[:3]
    centre = np.array(words[0].split()[1:4], dtype=float)
    to_ground = np.array(" ".join(words[1:]).split(), dtype=float).reshape(3, 3)
    photos = read_deck(DECK).photos
    latitude, longitude = np.degrees(photos.position[0, :2])
    utm = pyproj.Proj(UTM)
    expected = [*utm(longitude, latitude), photos.position[0, 2]]
    np.testing.assert_allclose(centre, expected, rtol=0.0, atol=2e-5)  # five decimals in the file
    omega, phi, kappa = photos.attitude[0]
    c, s = np.cos, np.sin
    R1 = np.array([[1, 0, 0], [0, c(omega), s(omega)], [0, -s(omega), c(omega)]])
    R2 = np.array([[c(phi), 0, -s(phi)], [0, 1, 0], [s(phi), 0, c(phi)]])
    turn = np.radians(utm.get_factors(longitude, latitude).meridian_convergence)
    R3 = np.array([[c(kappa), s(kappa), 0], [-s(kappa), c(kappa), 0], [0, 0, 1]])
    grid = np.array([[c(turn), -s(turn), 0], [s(turn), c(turn), 0], [0, 0, 1]])  # grid axes along east, north, up
    assert abs(turn) > 1e-3  # the test would not see it else
    # PROJ differentiates numerically for the convergence: 1e-8; the file has twelve decimals
    np.testing.assert_allclose(to_ground.T, R3 @ R2 @ R1 @ grid.T, rtol=0.0, atol=1e-8)


@pytest.mark.slow
def test_a_result_is_punched_in_the_system_of_the_answer(deck, tmp_path):
    well("run", deck, "--punch", "result", "--punch-family", "patb")
    east = float((tmp_path / "job.ori").read_text().split()[1])
    assert f"{east:.3f}" in (tmp_path / "job.lst").read_text()  # US feet of EPSG:3992, as the listing has them


@pytest.mark.slow
def test_an_answer_in_a_grid_is_read_with_its_deck_too(tmp_path):
    """A geographic deck that has only SYS OUT: its files are in that system, both ways."""
    text = geographic_deck(tmp_path)
    deck = tmp_path / "out.crd"
    deck.write_text(text)
    assert "EPSG:3992" in well("convert", deck, tmp_path / "out.im")
    well("convert", "--deck", deck, tmp_path / "out.im", tmp_path / "again.crd")
    gap = (read_deck(deck).photos.position - read_deck(tmp_path / "again.crd").photos.position) * [6.4e6, 6.4e6, 1]
    assert np.abs(gap).max() < METRES


def geographic_deck(folder: Path) -> str:
    """Return the geographic deck of the job with the SYS OUT card of the fixture."""
    well("convert", DECK, folder / "plain.crd")
    out = next(line for line in DECK.read_text().splitlines() if line.startswith("SYS OUT"))
    lines = (folder / "plain.crd").read_text().splitlines()
    place = next(row for row, line in enumerate(lines) if line.startswith("ELL")) + 1
    return "\n".join([*lines[:place], out, *lines[place:]]) + "\n"


@pytest.mark.parametrize("family", ["patb", "giant"])
def test_files_in_a_tangent_plane_come_back(tmp_path, family):
    """Full control only: of others the plane says nothing."""
    block = read_deck(DECK)
    plane = SystemSpec(kind="TANG", origin=(0.32, -1.1334, 0.0), axes="GRID")
    deck = tmp_path / "plane.crd"
    write_deck(replace(block, given_in=plane, stated_in=None, control=full(block.control)), deck)
    files = tmp_path / FILES[family]
    assert f"{family}: coordinates and attitudes of tangent plane at" in well("convert", deck, files)
    well("convert", "--deck", deck, files, tmp_path / "back.crd")
    again = read_deck(tmp_path / "back.crd")
    gap = (block.photos.position - again.photos.position) * [6.4e6, 6.4e6, 1.0]
    assert np.abs(gap).max() < METRES
    assert np.abs(block.photos.attitude - again.photos.attitude).max() < RADIANS


def full(control: Control) -> Control:
    """Return the control of which all coordinates are known."""
    return taken(control, np.flatnonzero(np.isfinite(control.position).all(axis=1)))


def test_a_deck_without_its_camera_and_a_place_beyond_the_system_are_refused(tmp_path):
    well("convert", DECK, tmp_path / "job.im")
    part, stations = tmp_path / "part.crd", tmp_path / "job.ori"
    part.write_text("\n".join(line for line in DECK.read_text().splitlines() if line[:3] != "CAM") + "\n")
    refused = musat("convert", "--deck", part, tmp_path / "job.im", tmp_path / "x.crd")
    assert "a deck with SYS IN must be whole where it has stations" in refused.stderr
    stations.write_text(stations.read_text().replace("    294608.10870", "9999294608.10870"))
    beyond = musat("convert", "--deck", DECK, tmp_path / "job.im", tmp_path / "x.crd")
    assert "job.im: +proj=utm +zone=20" in beyond.stderr and "does not reach" in beyond.stderr
    assert (refused.exit_code, beyond.exit_code, (tmp_path / "x.crd").exists()) == (1, 1, False)


def changed(deck: Path, old: str, new: str, *cards: str) -> Path:
    """Put a text in the place of another and of the blanks behind it, and cards before the last one."""
    width = max(len(old), len(new))
    text = deck.read_text()
    assert text.count(old.ljust(width)) == 1
    *lines, end = text.replace(old.ljust(width), new.ljust(width)).splitlines()
    deck.write_text("\n".join([*lines, *cards, end]) + "\n")
    return deck


def test_a_geoid_grid_that_is_none(deck, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "g.gtx").write_text("no grid")
    result = musat("run", changed(deck, "EPSG:3992", "EPSG:3992", "SYT OUT GEOID g.gtx"))
    assert (result.exit_code, result.stdout, list(tmp_path.glob("job.*st"))) == (1, "", [])
    assert "SYT.text: geoid model g.gtx: PROJ cannot read" in result.stderr


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
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
