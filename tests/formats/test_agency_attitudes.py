"""Attitudes of other agencies: their rotations written out, and the rays that they and the model's give."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from formats.agency_blocks import deck_of, random_job
from formats.deck_edits import in_system
from musatpy.errors import DeckError
from musatpy.formats import parts, system_rows
from musatpy.formats.families import RecordSet, agencies
from musatpy.formats.job_tables import role_of
from musatpy.formats.records.files import read_records
from musatpy.formats.records.frames import JobFrame, matrix_of
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import CoordinateSystem
from musatpy.units import GON

bingo, giant, patb = (agencies()[name] for name in ("bingo", "giant", "patb"))


def R1(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, s], [0, -s, c]])


def R2(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])


def R3(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


def test_phi_omega_kappa_is_that_of_the_published_reader():
    """The elements that the public reader of BINGO files (RotMatBLUH) gives for phi, omega, kappa."""
    p, o, k = 0.3, -0.2, 2.5
    sp, cp, so, co, sk, ck = np.sin(p), np.cos(p), np.sin(o), np.cos(o), np.sin(k), np.cos(k)
    elements = [
        [ck * cp + sk * so * sp, sk * co, -ck * sp + sk * so * cp],
        [-sk * cp + ck * so * sp, ck * co, sk * sp + ck * so * cp],
        [co * sp, -so, co * cp],
    ]
    found = matrix_of("phi-omega-kappa", np.array([[p, o, k]]))[0]
    np.testing.assert_allclose(found, elements, rtol=0, atol=1e-15)  # rounding errors


def image_rays(M, station, point):
    """Return x/-z, y/-z of a ground point in the photo."""
    vector = np.einsum("kij,kj->ki", M, point - station)
    return vector[:, :2] / vector[:, 2:]


@pytest.mark.parametrize("system", list(CoordinateSystem))
@pytest.mark.parametrize("name", ["patb", "patb turned", "bingo", "giant"])
def test_a_file_gives_the_rays_of_the_deck(tmp_path, name, system):
    """Rotation and position of a file, taken as they are there, image a point as the deck's do."""
    family, block = agencies()[name.split()[0]], random_job(7, system)
    if name == "patb turned":
        folder = Path(shutil.copytree(family.folder, tmp_path / "turned"))
        text = (folder / "ori.toml").read_text().replace('"matrix photo to ground"', '"matrix ground to photo"')
        (folder / "ori.toml").write_text(text)
        family = RecordSet(folder)
    family.dump_one(block, tmp_path / {"bingo": "itera.dat", "giant": "job.frm"}.get(name, "job.im"))
    file, place = list(family.found(tmp_path).items())[-1]
    table = next(iter(read_records(place.read_bytes(), file, "x").tables.values()))
    level, down = attitude_matrix(block.photos.attitude), np.array([100.0, 200.0, -1500.0])
    if name == "giant":
        M = np.array([R3(k) @ R2(p) @ R1(o) for o, p, k in columns_of(table, "omega", "phi", "kappa")])
        station, ground = np.zeros((len(M), 3)), np.tile(down, (len(M), 1))  # in the vertical axes of the station
    else:
        station = columns_of(table, *"xyz")
        axes = np.broadcast_to(np.eye(3), (len(station), 3, 3))
        if system is not CoordinateSystem.LOCAL:
            axes = Ellipsoid("clrk66").frame(Ellipsoid("clrk66").geographic(station))
        ground = station + np.einsum("kji,j->ki", axes, down)
    if name == "bingo":
        M = np.array([R3(k) @ R1(o) @ R2(p) for p, o, k in columns_of(table, "phi", "omega", "kappa") * GON])
    elif name != "giant":
        M = columns_of(table, *(f"a{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3))).reshape(-1, 3, 3)
        M = M if name == "patb turned" else np.swapaxes(M, 1, 2)
    expected = image_rays(level, np.zeros((len(M), 3)), np.tile(down, (len(M), 1)))
    # Angles are written to 1e-7 gon (giant: 1e-3 seconds beyond 100 degrees) or elements to 1e-12; rays at up to 70
    # degrees enlarge that some tens of times.
    allowed = {"bingo": 1e-7, "giant": 2e-7}.get(name, 1e-9)
    np.testing.assert_allclose(image_rays(M, station, ground), expected, rtol=0, atol=allowed)
    again = family.load_one(place, deck_of(block, tmp_path))
    np.testing.assert_allclose(attitude_matrix(again.photos.attitude), level, rtol=0, atol=allowed)


def columns_of(table, *names):
    return np.stack([table[name] for name in names], axis=1)


def test_sigmas_of_packed_angles_are_metres_on_the_ellipsoid():
    block = in_system(CoordinateSystem.GEOGRAPHIC)
    frame = JobFrame(CoordinateSystem.GEOGRAPHIC, block.ellipsoid)
    place, ellipsoid, step = block.photos.position, Ellipsoid("clrk66"), 1e-6
    eastward, northward = np.array([0.0, step, 0.0]), np.array([step, 0.0, 0.0])
    east = ellipsoid.geocentric(place + eastward) - ellipsoid.geocentric(place)
    north = ellipsoid.geocentric(place + northward) - ellipsoid.geocentric(place)
    expected = np.stack([np.linalg.norm(east, axis=1), np.linalg.norm(north, axis=1)], axis=1) / step
    # the chord of a millionth of a radian, from coordinates with a rounding error of 1e-9 m
    np.testing.assert_allclose(frame.radii(place)[:, :2], expected, rtol=1e-6)


def test_giant_writes_angles_packed(tmp_path):
    block = in_system(CoordinateSystem.GEOGRAPHIC)
    giant.dump_one(block, tmp_path / "job.frm")
    first = (tmp_path / "job.frm").read_text().splitlines()[0]
    assert first[8:20].strip() == "-811836.0000" and first[20:32].strip() == "192100.00000"
    assert first[44:68].split() == ["1711.3240", "-2037.5888"]  # of 0 17 11.3240, -0 20 37.5888


def test_attitudes_in_geocentric_axes_need_a_position():
    file = patb.files[-1]
    frame = JobFrame(CoordinateSystem.GEOCENTRIC, in_system(CoordinateSystem.GEOCENTRIC).ellipsoid)
    with pytest.raises(DeckError, match="need a position on the same row"):
        frame.attitude(file, np.eye(3).reshape(1, 9), None)


@pytest.mark.parametrize("path", ["systems.kind", "matrices.sigma"])
def test_files_of_records_state_no_systems(path):
    assert role_of(path, {path}) in system_rows.TABLES
    assert parts.held_attributes(role_of(path, {path})) == ()  # so that a target of these is refused
