"""Forms of attitudes against matrices built otherwise, their rates against differences, and the gimbal cases."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from musatpy.geometry.collinearity import (
    AngleForm,
    angle_rates,
    angles_by_turn,
    angles_of,
    attitude_from_matrix,
    attitude_matrix,
    gimbal,
    in_axes,
    matrix_of,
    orthogonal,
)

OPK, POK, ATS = AngleForm
FORMS = pytest.mark.parametrize("form", list(AngleForm))
ANGLES = np.random.default_rng(3).uniform(-1.0, 1.0, (40, 3)) * [3.0, 1.4, 3.0]
ROUNDING = 1e-14  # of matrices: a few multiplications of numbers up to 1


def angles_in(form):
    return np.add(np.abs(ANGLES), [0.0, 0.02, 0.0]) if form is ATS else ANGLES


def of_scipy(angles, form):
    """M by intrinsic active rotations: M transposed carries photo axes into reference axes."""
    if form is ATS:
        angles = angles * [-1.0, 1.0, 1.0] - [0.0, 0.0, np.pi]
    order = {OPK: "XYZ", POK: "YXZ", ATS: "ZXZ"}[form]
    return Rotation.from_euler(order, angles).as_matrix().swapaxes(1, 2)


@FORMS
def test_matrices_are_those_of_another_library(form):
    angles = angles_in(form)
    np.testing.assert_allclose(matrix_of(angles, form), of_scipy(angles, form), rtol=0, atol=ROUNDING)


@FORMS
def test_angles_come_back(form):
    angles = angles_in(form)
    # near tilts of 0.02 azimuth and swing are 50 times less sure than the matrix
    np.testing.assert_allclose(angles_of(matrix_of(angles, form), form), angles, rtol=0, atol=1e-12)


def test_tilt_and_swing_are_those_of_the_tilted_photograph():
    """The axis of a camera points along the azimuth; the nadir is imaged at the swing, clockwise from +y."""
    azimuth, tilt, swing = 0.7, 0.1, 2.0
    M = matrix_of(np.array([azimuth, tilt, swing]), ATS)
    axis = M.T @ [0.0, 0.0, -1.0]
    expected = [np.sin(tilt) * np.sin(azimuth), np.sin(tilt) * np.cos(azimuth), -np.cos(tilt)]
    np.testing.assert_allclose(axis, expected, rtol=0, atol=ROUNDING)
    nadir = M @ [0.0, 0.0, -1.0]
    image = nadir[:2] / -nadir[2]
    np.testing.assert_allclose(
        image, np.tan(tilt) * np.array([np.sin(swing), np.cos(swing)]), rtol=0, atol=ROUNDING
    )


def central(function, at, step=6e-6):
    """d(function)/d(at) by central differences: h = eps^(1/3) leaves about 1e-10."""
    sides = [(function(at + step * e), function(at - step * e)) for e in np.eye(3)]
    return np.stack([(a - b) / (2.0 * step) for a, b in sides], axis=-1)


@FORMS
def test_rates_are_the_small_rotations(form):
    """M(angles + d) = M(angles) (I - [w]x) with w = B d."""
    angles = angles_in(form)[:8]
    for row, B in zip(angles, angle_rates(angles, form), strict=True):
        dM = central(lambda x: matrix_of(x, form), row)
        for i in range(3):
            W = -matrix_of(row, form).T @ dM[:, :, i]
            np.testing.assert_allclose([W[2, 1], W[0, 2], W[1, 0]], B[:, i], rtol=0, atol=1e-9)


def restated(angles, form, axes, to):
    """Return angles in another form and along other axes, at rest, their partials by the old ones, gimbal cases."""
    turn = axes @ angle_rates(angles, form)  # the small rotation along the new axes
    return angles_by_turn(in_axes(matrix_of(angles, form), axes), to, turn)


@pytest.mark.parametrize("to", list(AngleForm))
@FORMS
def test_partials_of_restated_angles(form, to):
    axes = of_scipy(np.array([[0.3, -0.2, 1.1]]), OPK)[0]
    for angles in angles_in(form)[:8]:
        out, partials, lost = restated(angles, form, axes, to)
        assert not lost
        np.testing.assert_allclose(matrix_of(out, to), matrix_of(angles, form) @ axes.T, rtol=0, atol=ROUNDING)
        want = central(lambda x: restated(x, form, axes, to)[0], angles)
        # near a gimbal case angles bend: the differences are worse by the cube of the rates
        np.testing.assert_allclose(partials, want, rtol=0, atol=1e-9 * max(1.0, np.abs(partials).max()) ** 3)


@pytest.mark.parametrize(
    ("form", "angles"),
    [
        (OPK, [0.4, np.pi / 2, 0.7]),
        (OPK, [0.4, -np.pi / 2, 0.7]),
        (POK, [0.4, np.pi / 2, 0.7]),
        (ATS, [0.4, 0, 0.7]),
    ],
)
def test_gimbal_cases_are_told_and_keep_the_rotation(form, angles):
    M = matrix_of(np.array([angles, [0.1, 0.2, 0.3]]), form)
    assert gimbal(M, form).tolist() == [True, False]
    out, partials, lost = angles_by_turn(M, form, np.broadcast_to(np.eye(3), (2, 3, 3)))
    assert lost.tolist() == [True, False]
    assert out[0, 0] == 0.0
    assert np.isnan(partials[0]).all() and np.isfinite(partials[1]).all()
    np.testing.assert_allclose(matrix_of(out, form), M, rtol=0, atol=1e-10)  # the limit of a gimbal case


SINGULAR = {OPK: (np.pi / 2, -np.pi / 2), POK: (np.pi / 2, -np.pi / 2), ATS: (0.0, np.pi)}


@pytest.mark.parametrize("off", [0.0, 1e-9, -1e-9, 1e-6, -1e-6, 1e-3, -1e-3])
def test_angles_keep_the_rotation_at_and_near_their_singular_attitude(off):
    """Whatever rounding makes of two angles that turn about one line, together they are right: to 1e-6 degrees."""
    rng = np.random.default_rng(90)
    for form, seconds in SINGULAR.items():
        for second in seconds:
            angles = rng.uniform(-np.pi, np.pi, (200, 3))
            angles[:, 1] = second + np.radians(off)
            M = matrix_of(angles, form)
            # matrices as files have them, of 12 decimals, too
            for given, sure in ((M, 2e-10), (M.round(12), 1e-8)):
                np.testing.assert_allclose(matrix_of(angles_of(given, form), form), M, rtol=0, atol=sure)
            np.testing.assert_allclose(attitude_matrix(attitude_from_matrix(M)), M, rtol=0, atol=2e-10)


def test_rounded_matrices_become_rotations_and_mirrors_do_not():
    M = of_scipy(ANGLES, OPK)
    rounded = np.round(M, 6)
    rotation = orthogonal(rounded)
    assert 0.0 < np.abs(rotation - rounded).max() < 1.5e-6  # three roundings of 5e-7 meet in one element at most
    np.testing.assert_allclose(rotation @ rotation.swapaxes(1, 2), np.tile(np.eye(3), (40, 1, 1)), atol=ROUNDING)
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0, atol=ROUNDING)
    mirrored = M * [[1.0], [1.0], [-1.0]]
    assert np.abs(orthogonal(mirrored) - mirrored).max(axis=(1, 2)).min() > 0.1
