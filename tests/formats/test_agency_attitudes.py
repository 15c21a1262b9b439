"""Attitudes of other agencies: their rotations written out, and the rays that they and the model's give."""

from dataclasses import replace

import numpy as np
import pytest

from formats.agency_blocks import random_job
from formats.deck_edits import in_system
from musatpy.errors import DeckError
from musatpy.formats import parts, system_rows
from musatpy.formats.families import agencies
from musatpy.formats.job_tables import role_of
from musatpy.formats.records.files import read_records
from musatpy.formats.records.frames import JobFrame, matrix_of, values_of_matrix
from musatpy.formats.records.layout import ATTITUDES
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


@pytest.mark.parametrize("seed", range(5))
def test_matrices_are_the_products_of_their_rotations(seed):
    a, b, c = np.random.default_rng(seed).uniform(-1.5, 1.5, 3)
    M = R3(c) @ R2(b) @ R1(a)
    expected = {
        "omega-phi-kappa": (np.array([a, b, c]), M),
        "phi-omega-kappa": (np.array([a, b, c]), R3(c) @ R1(b) @ R2(a)),
        "matrix ground to photo": (M.ravel(), M),
        "matrix photo to ground": (M.T.ravel(), M),
    }
    assert set(expected) == set(ATTITUDES)
    for kind, (values, matrix) in expected.items():
        # a few rounding errors of sines and cosines
        np.testing.assert_allclose(matrix_of(kind, values[None])[0], matrix, rtol=0, atol=1e-15)
        np.testing.assert_allclose(values_of_matrix(kind, matrix[None])[0], values, rtol=0, atol=4e-15)


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
@pytest.mark.parametrize("family", [patb, bingo])
def test_a_file_gives_the_rays_of_the_deck(tmp_path, family, system):
    """Rotation and position of a file, taken as they are there, image a point as the deck's do."""
    block = random_job(7, system)
    family.dump_one(block, tmp_path / ("job.im" if family is patb else "itera.dat"))
    file, place = list(family.found(tmp_path).items())[-1]
    (table,) = read_records(place.read_bytes(), file, "x").tables.values()
    station = np.stack([table[axis] for axis in "xyz"], axis=1)
    if family is patb:
        elements = np.stack([table[f"a{i}{j}"] for i in (1, 2, 3) for j in (1, 2, 3)], axis=1)
        M = np.swapaxes(elements.reshape(-1, 3, 3), 1, 2)
    else:
        angles = np.stack([table[name] for name in ("phi", "omega", "kappa")], axis=1) * GON
        M = np.array([R3(k) @ R1(o) @ R2(p) for p, o, k in angles])
    xyz, level = station, attitude_matrix(block.photos.attitude)
    if system is CoordinateSystem.LOCAL:
        axes = np.broadcast_to(np.eye(3), (len(xyz), 3, 3))
    else:
        ellipsoid = Ellipsoid("clrk66")
        axes = ellipsoid.frame(ellipsoid.geographic(xyz))
    ground = xyz + np.einsum("kji,j->ki", axes, np.array([100.0, 200.0, -1500.0]))
    expected = image_rays(level, np.zeros((len(xyz), 3)), np.tile([100.0, 200.0, -1500.0], (len(xyz), 1)))
    # Angles are written to 1e-7 gon or elements to 1e-12; rays at up to 70 degrees enlarge that some tens of times.
    np.testing.assert_allclose(image_rays(M, xyz, ground), expected, rtol=0, atol=1e-7 if family is bingo else 1e-9)


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
    assert [first[44:56].strip(), first[56:68].strip()] == [
        "1711.3240",
        "-2037.5888",
    ]  # of 0 17 11.3240, -0 20 37.5888


def test_the_matrix_may_go_the_other_way():
    file = patb.files[-1]
    turned = replace(file, attitude="matrix ground to photo")
    frame = JobFrame(None, None)
    attitude, nowhere = np.array([[0.1, -0.2, 2.0]]), np.zeros((1, 3))
    one, other = frame.file_attitude(file, attitude, nowhere), frame.file_attitude(turned, attitude, nowhere)
    np.testing.assert_array_equal(one.reshape(3, 3), other.reshape(3, 3).T)
    np.testing.assert_allclose(frame.attitude(turned, other, nowhere), attitude, atol=1e-15)  # rounding errors


def test_attitudes_in_geocentric_axes_need_a_position():
    file = patb.files[-1]
    frame = JobFrame(CoordinateSystem.GEOCENTRIC, in_system(CoordinateSystem.GEOCENTRIC).ellipsoid)
    with pytest.raises(DeckError, match="need a position on the same row"):
        frame.attitude(file, np.eye(3).reshape(1, 9), None)


@pytest.mark.parametrize("path", ["systems.kind", "matrices.sigma"])
def test_files_of_records_state_no_systems(path):
    assert role_of(path, {path}) in system_rows.TABLES
    assert parts.held_attributes(role_of(path, {path})) == ()  # so that a target of these is refused
