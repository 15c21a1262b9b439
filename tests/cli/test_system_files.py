"""Other agencies' files in the system of a deck: written, read again, and run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyproj
import pytest
from click.testing import CliRunner

from musatpy.cli.main import main
from musatpy.formats.musat import read_deck

DECK = Path(__file__).parents[2] / "fixtures" / "st_thomas_utm" / "st_thomas_utm.crd"
UTM = "+proj=utm +zone=20 +ellps=clrk66"
FILES = {"patb": "job.im", "bingo": "itera.dat", "giant": "job.img"}
METRES = {"patb": 1e-4, "bingo": 1e-4, "giant": 1e-3}  # twice the rounding of the files and the deck, and of a sum
RADIANS = 3e-8  # seven decimals of a gon, four of a second, are 1.6e-9 and 5e-10; of a deck's second too


def musat(*arguments) -> str:
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.mark.parametrize("family", FILES)
def test_a_job_comes_back_from_files_in_its_system(tmp_path, family):
    files, back = tmp_path / FILES[family], tmp_path / "back.crd"
    assert f"{family}: coordinates and attitudes of " in musat("convert", DECK, files)
    musat("convert", "--deck", DECK, files, back)
    job, again = read_deck(DECK), read_deck(back)
    place = pyproj.Geod(ellps="clrk66")
    for one, other in ((job.photos, again.photos), (job.control, again.control)):
        other = {len(other.position): other.position}[len(one.position)] if one is job.photos else other.position
        one = one.position[: len(other)]
        known = np.isfinite(one).all(axis=1)
        a, b = np.degrees(one[known]), np.degrees(other[known])
        _, _, gap = place.inv(a[:, 1], a[:, 0], b[:, 1], b[:, 0])
        assert np.max(gap) < METRES[family]
        assert np.abs(one - other)[known, 2].max() < METRES[family]
    assert np.abs(job.photos.attitude - again.photos.attitude).max() < RADIANS


def test_a_station_of_a_file_is_that_of_proj(tmp_path):
    """E, N and h by PROJ, and the rotation by the meridian convergence that PROJ gives."""
    musat("convert", DECK, tmp_path / "job.im")
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


def test_a_result_is_punched_in_the_system_of_the_answer(tmp_path):
    deck = tmp_path / "job.crd"
    deck.write_bytes(DECK.read_bytes())
    musat("run", deck, "--punch", "result", "--punch-family", "patb")
    east = float((tmp_path / "job.ori").read_text().split()[1])
    lines = (tmp_path / "job.lst").read_text()
    assert f"{east:.3f}" in lines  # US feet of EPSG:3992, as the listing has them
