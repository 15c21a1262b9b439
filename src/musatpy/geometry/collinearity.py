"""Collinearity and the rotations in it: image of a ground vector, ray of an image, and where rays meet.

With closed-form partial derivatives. Vectors stand in the working frame (geocentric axes, or those of a local job);
M takes them to the photo. The image vector is (x - xp, y - yp, -f): x - xp = -f U/S, y - yp = -f V/S with
(U, V, S) = M v. Of rays that meet, ray i starts at P_i with direction u_i; the partials of their conditions come as
six columns a ray, those by P_i and then by u_i (ETL-0306 section 3 in the corrected forms of docs/theory.md).

A rotation M takes vectors along three reference axes to the photo. All forms of its angles are three rotations one
after the other, so that matrices, rates and gimbal cases have one formula for all:

- `OMEGA_PHI_KAPPA`        (omega, phi, kappa), M = R3(kappa) R2(phi) R1(omega): the form of the adjustment
- `PHI_OMEGA_KAPPA`        (phi, omega, kappa), M = R3(kappa) R1(omega) R2(phi): phi is primary
- `AZIMUTH_TILT_SWING`     (alpha, t, s),       M = R3(s - pi) R1(t) R3(-alpha)

A small rotation w (rad, along the reference axes) is that of M (I - [w]x): it turns the photo by w.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, FloatArray

GIMBAL = 1e-10  # rad from the singular attitude of a form of angles: nearer, two of them turn about one line
_SINGULAR = 1e-14  # smallest eigenvalue from which rays are not parallel


def image(v: FloatArray, M: FloatArray, focal_length: FloatArray, principal_point: FloatArray) -> FloatArray:
    """Return plate coordinates (..., 2) mm of the vectors v (..., 3) from station to target. ETL-0306 (4.11)."""
    UVS, scale = _projection(v, M, focal_length)
    return scale * UVS[..., :2] + principal_point


def image_by_vector(
    v: FloatArray, M: FloatArray, focal_length: FloatArray, principal_point: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the image as `image` does, and its partial derivatives (..., 2, 3) mm/m by v alone."""
    UVS, scale = _projection(v, M, focal_length)
    return scale * UVS[..., :2] + principal_point, _differential(M, UVS, scale)


def image_partials(
    v: FloatArray, M: FloatArray, dM: FloatArray, focal_length: FloatArray, principal_point: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what `image_by_vector` does, and the partial derivatives by attitude, (..., 2, 3) mm/rad.

    `dM` (..., 3, 3, 3) holds dM/d(omega, phi, kappa), the angle on the third axis from the end.
    """
    UVS, scale = _projection(v, M, focal_length)
    dUVS = np.einsum("...aij,...j->...ia", dM, v)
    image = scale * UVS[..., :2] + principal_point
    return image, _differential(M, UVS, scale), _differential(dUVS, UVS, scale)


def _projection(v: FloatArray, M: FloatArray, focal_length: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (U, V, S) (..., 3) and -f/S (..., 1)."""
    UVS = np.einsum("...ij,...j->...i", M, v)
    return UVS, (-np.asarray(focal_length) / UVS[..., 2])[..., None]


def _differential(dUVS: FloatArray, UVS: FloatArray, scale: FloatArray) -> FloatArray:
    """Return the differentials (..., 2, c) of the image for those of (U, V, S), (..., 3, c).

    dx = -(f/S)(dU - (U/S) dS), dy alike (docs/theory.md, closed form).
    """
    ratio = UVS[..., :2] / UVS[..., 2:]
    return scale[..., None] * (dUVS[..., :2, :] - ratio[..., None] * dUVS[..., 2:, :])


def in_front(v: FloatArray, M: FloatArray) -> BoolArray:
    """Return whether the targets of the vectors v (..., 3) lie in front of the camera (S < 0)."""
    return np.einsum("...j,...j->...", np.asarray(M)[..., 2, :], v) < 0


def ray(xy: FloatArray, M: FloatArray, focal_length: FloatArray, principal_point: FloatArray) -> FloatArray:
    """Return the unit ray (..., 3) in the working frame of plate coordinates xy (..., 2) mm. ETL-0306 (3.1)."""
    r = np.einsum("...ji,...j->...i", M, image_vector(xy, focal_length, principal_point))
    return r / np.linalg.norm(r, axis=-1, keepdims=True)


def ray_partials(
    xy: FloatArray, M: FloatArray, dM: FloatArray, focal_length: FloatArray, principal_point: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what `ray` does, and the partial derivatives by attitude, (..., 3, 3), and by xy, (..., 3, 2) 1/mm."""
    M = np.asarray(M)
    c = image_vector(xy, focal_length, principal_point)
    r = np.einsum("...ji,...j->...i", M, c)
    length = np.linalg.norm(r, axis=-1)[..., None, None]
    u = r[..., None] / length
    across = (np.eye(3) - u * np.swapaxes(u, -1, -2)) / length
    by_attitude = across @ np.einsum("...aji,...j->...ia", dM, c)
    by_xy = across @ np.swapaxes(M[..., :2, :], -1, -2)
    return u[..., 0], by_attitude, by_xy


def image_vector(xy: FloatArray, focal_length: FloatArray, principal_point: FloatArray) -> FloatArray:
    """Return (x - xp, y - yp, -f), (..., 3) mm."""
    xy = np.asarray(xy) - np.asarray(principal_point)
    f = np.broadcast_to(np.asarray(focal_length), xy.shape[:-1])
    return np.concatenate([xy, -f[..., None]], axis=-1)


def attitude_matrix(attitude: ArrayLike) -> FloatArray:
    """Return M = R3(kappa) R2(phi) R1(omega), (..., 3, 3), ground to photo, of attitudes (..., 3) in radians."""
    sine, cosine = np.sin(attitude), np.cos(attitude)
    so, sp, sk = sine[..., 0], sine[..., 1], sine[..., 2]
    co, cp, ck = cosine[..., 0], cosine[..., 1], cosine[..., 2]
    return _matrix(
        [
            [cp * ck, co * sk + so * sp * ck, so * sk - co * sp * ck],
            [-cp * sk, co * ck - so * sp * sk, so * ck + co * sp * sk],
            [sp, -so * cp, co * cp],
        ]
    )


def attitude_matrix_partials(attitude: ArrayLike) -> FloatArray:
    """Return dM/d(omega, phi, kappa), (..., 3, 3, 3) with the angle on the third axis from the end.

    dM/domega = M E1, dM/dkappa = -E3 M and dM/dphi = -(R3 e2)x M with the cross product matrices E of the axes.
    """
    attitude = np.asarray(attitude)
    M = attitude_matrix(attitude)
    kappa = attitude[..., 2]
    d_omega = np.zeros_like(M)
    d_omega[..., :, 1] = -M[..., :, 2]
    d_omega[..., :, 2] = M[..., :, 1]
    sk, ck = np.sin(kappa)[..., None], np.cos(kappa)[..., None]
    d_phi = np.stack([-ck * M[..., 2, :], sk * M[..., 2, :], ck * M[..., 0, :] - sk * M[..., 1, :]], axis=-2)
    d_kappa = np.stack([M[..., 1, :], -M[..., 0, :], np.zeros_like(M[..., 0, :])], axis=-2)
    return np.stack([d_omega, d_phi, d_kappa], axis=-3)


def attitude_from_matrix(M: ArrayLike) -> FloatArray:
    """Return (omega, phi, kappa), (..., 3) rad, of rotations M (..., 3, 3); |phi| <= 90 degrees.

    Near 90 degrees omega is what rounding makes it, and in the `GIMBAL` case zero: kappa, which turns about the
    same line there, is what it leaves of M.
    """
    M = np.asarray(M, dtype=float)
    cosine = np.hypot(M[..., 2, 1], M[..., 2, 2])
    omega = np.where(cosine < GIMBAL, 0.0, np.arctan2(-M[..., 2, 1], M[..., 2, 2]))
    phi = np.arctan2(M[..., 2, 0], cosine)
    so, co = np.sin(omega), np.cos(omega)
    kappa = np.arctan2(co * M[..., 0, 1] + so * M[..., 0, 2], co * M[..., 1, 1] + so * M[..., 1, 2])
    return np.stack([omega, phi, kappa], axis=-1)


def local_vertical(latitude: ArrayLike, longitude: ArrayLike) -> FloatArray:
    """Return the rotation geocentric -> (east, north, up), (..., 3, 3), rows E, N, U.

    The transpose of M-bar of ETL-0306 (3.7). Angles in radians.
    """
    sf, cf = np.sin(latitude), np.cos(latitude)
    sl, cl = np.sin(longitude), np.cos(longitude)
    return _matrix([[-sl, cl, 0.0 * sl], [-sf * cl, -sf * sl, cf], [cf * cl, cf * sl, sf]])


def wrapped(angle: FloatArray, about: FloatArray | float = 0.0) -> FloatArray:
    """Return angles (rad) brought within half a turn of others; what is there already comes back bit for bit."""
    return angle + 2.0 * np.pi * np.rint((about - angle) / (2.0 * np.pi))


def other_angles(attitude: FloatArray) -> FloatArray:
    """Return the other three angles (..., 3) of the same rotations, phi beyond 90 degrees or within."""
    return wrapped(attitude * [1.0, -1.0, 1.0] + np.pi)


def attitude_apart(attitude: FloatArray, other: FloatArray) -> FloatArray:
    """Return angles minus others (..., 3), each within half a turn, of those of the same rotation the nearer."""
    as_stated, otherwise = wrapped(attitude - other), wrapped(attitude - other_angles(other))
    far = np.abs(otherwise).sum(axis=-1, keepdims=True) < np.abs(as_stated).sum(axis=-1, keepdims=True)
    return np.where(far, otherwise, as_stated)


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a x b (..., 3).

    Few vectors at a time are the rule here, for which np.cross takes several times as long: it looks for its axes.
    """
    first = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out = np.empty((*first.shape, 3), dtype=first.dtype)
    out[..., 0] = first
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def skew(v: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) with skew(v) w = v x w of vectors v (..., 3)."""
    out = np.zeros((*v.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i, j], out[..., j, i] = -v[..., k], v[..., k]
    return out


def turn(w: FloatArray) -> FloatArray:
    """Return rotations (..., 3, 3) by about w (..., 3) rad: Cayley's formula gives one whatever the size of w."""
    W = skew(0.5 * w)
    return np.asarray(np.linalg.solve(np.eye(3) - W, np.eye(3) + W), dtype=float)


def orthogonal(A: FloatArray) -> FloatArray:
    """Return the rotations (..., 3, 3) nearest to matrices, as to what a card rounds.

    By the singular value decomposition (Horn, Hilden and Negahdaripour, J. Opt. Soc. Am. A 5 (1988) 1127).
    """
    U, _, Vt = np.linalg.svd(A)
    U[..., 2] *= np.sign(np.linalg.det(U) * np.linalg.det(Vt))[..., None]
    return U @ Vt


def _matrix(rows: list[list[Any]]) -> FloatArray:
    """Return the matrices (..., 3, 3) whose elements are the arrays (...) of three rows."""
    first = np.asarray(rows[0][0])
    out = np.empty((*first.shape, 3, 3), dtype=first.dtype)
    for i, row in enumerate(rows):
        for j, element in enumerate(row):
            out[..., i, j] = element
    return out


class AngleForm(StrEnum):
    """Which three angles state an attitude, in the order of their names."""

    OMEGA_PHI_KAPPA = "OPK"
    PHI_OMEGA_KAPPA = "POK"
    AZIMUTH_TILT_SWING = "ATS"


# Axis and sense of the rotation of each angle, in the order in which they are applied.
_ROTATIONS = {
    AngleForm.OMEGA_PHI_KAPPA: ((0, 1.0), (1, 1.0), (2, 1.0)),
    AngleForm.PHI_OMEGA_KAPPA: ((1, 1.0), (0, 1.0), (2, 1.0)),
    AngleForm.AZIMUTH_TILT_SWING: ((2, -1.0), (0, 1.0), (2, 1.0)),
}


_OFFSET = {AngleForm.AZIMUTH_TILT_SWING: np.array([0.0, 0.0, -np.pi])}  # a swing of 180 degrees turns nothing


def matrix_of(angles: ArrayLike, form: AngleForm) -> FloatArray:
    """Return M (..., 3, 3), reference axes to photo, of angles (..., 3) rad."""
    if form is AngleForm.OMEGA_PHI_KAPPA:
        return attitude_matrix(angles)
    first, second, third = _factors(angles, form)
    return third @ second @ first


def angles_of(M: ArrayLike, form: AngleForm) -> FloatArray:
    """Return the angles (..., 3) rad of rotations M (..., 3, 3).

    Phi, the omega that comes second, lie within 90 degrees, tilts within 0 and 180 degrees, all else within half a
    turn. In a `gimbal` case the first angle is zero and the third has the turn of both.
    """
    M = np.asarray(M, dtype=float)
    if form is AngleForm.OMEGA_PHI_KAPPA:
        return attitude_from_matrix(M)
    if form is AngleForm.PHI_OMEGA_KAPPA:
        first, half_turn = np.arctan2(M[..., 2, 0], M[..., 2, 2]), 1.0
        second = np.arctan2(-M[..., 2, 1], np.hypot(M[..., 2, 0], M[..., 2, 2]))
    else:
        first, half_turn = np.arctan2(-M[..., 2, 0], -M[..., 2, 1]), -1.0
        second = np.arctan2(np.hypot(M[..., 2, 0], M[..., 2, 1]), M[..., 2, 2])
    first = np.where(gimbal(M, form), 0.0, first)
    axis, sense = _ROTATIONS[form][0]
    # what the first angle leaves, whatever rounding made it
    rest = M @ np.swapaxes(_about(axis, sense * first), -1, -2)
    third = np.arctan2(-half_turn * rest[..., 1, 0], half_turn * rest[..., 0, 0])
    return np.stack([first, second, third], axis=-1)


def gimbal(M: ArrayLike, form: AngleForm) -> BoolArray:
    """Return (...) where first and third angle turn about one line, so that only their sum or difference is known.

    That is so at phi = 90 degrees (`OPK`), at omega = 90 degrees (`POK`), and at a tilt of zero (`ATS`): a truly
    vertical photograph has neither azimuth nor swing.
    """
    M = np.asarray(M, dtype=float)
    columns = (0, 1) if form is AngleForm.AZIMUTH_TILT_SWING else (0, 2)
    if form is AngleForm.OMEGA_PHI_KAPPA:
        columns = (1, 2)
    return np.hypot(M[..., 2, columns[0]], M[..., 2, columns[1]]) < GIMBAL


def turn_about_one_line(attitude: FloatArray, within: float) -> BoolArray:
    """Return (...) whether omega and kappa (..., 3) do: phi is within a small angle (rad) of +90 or -90 degrees."""
    return np.abs(np.cos(attitude[..., 1])) < within


def angle_rates(angles: ArrayLike, form: AngleForm) -> FloatArray:
    """Return B (..., 3, 3) with w = B d(angles): the axes of the three angles, as columns along the reference axes.

    Singular in the gimbal cases.
    """
    first, second, _ = _factors(angles, form)
    rotations = _ROTATIONS[form]
    B = np.empty(first.shape)
    B[..., :, 0] = np.eye(3)[rotations[0][0]] * rotations[0][1]
    B[..., :, 1] = first[..., rotations[1][0], :] * rotations[1][1]
    B[..., :, 2] = (second @ first)[..., rotations[2][0], :] * rotations[2][1]
    return B


def in_axes(M: ArrayLike, axes: ArrayLike) -> FloatArray:
    """Return M (..., 3, 3) referred to other axes, the rows of `axes` (..., 3, 3) along the present ones."""
    return np.asarray(M) @ np.swapaxes(np.asarray(axes), -1, -2)


def angles_by_turn(M: ArrayLike, form: AngleForm, turn: ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return angles (..., 3) of M, their partials (..., 3, k), and the gimbal cases (...), in which these are NaN.

    `turn` (..., 3, k) is the small rotation of M, along its reference axes, by k parameters.
    """
    angles, lost = angles_of(M, form), gimbal(M, form)
    rates = angle_rates(angles, form)
    rates[lost] = np.eye(3)
    partials = np.asarray(np.linalg.solve(rates, np.asarray(turn, dtype=float)), dtype=float)
    partials[lost] = np.nan
    return angles, partials, lost


def _factors(angles: ArrayLike, form: AngleForm) -> list[FloatArray]:
    """Return the three rotations (..., 3, 3) in the order in which they are applied."""
    turned: FloatArray = np.asarray(angles, dtype=float) + _OFFSET.get(form, np.zeros(3))
    return [_about(axis, sense * turned[..., i]) for i, (axis, sense) in enumerate(_ROTATIONS[form])]


def _about(axis: int, angle: FloatArray) -> FloatArray:
    """Return R1, R2 or R3 (..., 3, 3) of angles (...)."""
    zero = np.zeros_like(angle)
    return attitude_matrix(np.stack([angle if i == axis else zero for i in range(3)], axis=-1))


def first_pair(P: FloatArray, u: FloatArray) -> FloatArray:
    """Return the point half-way between the first two rays, (..., 3). ETL-0306 (3.2)-(3.6), corrected.

    P, u: (..., m, 3), m >= 2. Not finite where the two rays are parallel.
    """
    k = nearest_distances(P[..., 1, :] - P[..., 0, :], u[..., 0, :], u[..., 1, :])
    with np.errstate(invalid="ignore"):
        both = P[..., :2, :] + k[..., None] * u[..., :2, :]
    return 0.5 * (both[..., 0, :] + both[..., 1, :])


def nearest_distances(base: FloatArray, u1: FloatArray, u2: FloatArray) -> FloatArray:
    """Return how far (..., 2) along two rays u1, u2 (..., 3), which start a base apart, the other is nearest."""
    D = cross(u1, u2)
    with np.errstate(divide="ignore", invalid="ignore"):
        D2 = np.einsum("...i,...i->...", D, D)
        return np.stack([np.einsum("...i,...i->...", cross(base, u), D) / D2 for u in (u2, u1)], axis=-1)


def nearest_point(P: FloatArray, u: FloatArray) -> FloatArray:
    """Return the point (..., 3) with the least sum of squared distances from rays P, u (..., m, 3).

    Not finite where all rays of a point are parallel.
    """
    along = np.einsum("...mi,...mi->...m", u, P)
    N = u.shape[-2] * np.eye(3) - np.swapaxes(u, -1, -2) @ u
    t = np.sum(P - along[..., None] * u, axis=-2)
    # the determinant over the sum of the principal minors: about the smallest eigenvalue, where that is small
    minors = sum(N[..., i, i] * N[..., j, j] - np.square(N[..., i, j]) for i, j in ((0, 1), (0, 2), (1, 2)))
    singular = np.linalg.det(N) < _SINGULAR * minors
    N = np.where(singular[..., None, None], np.eye(3), N)
    X = np.linalg.solve(N, t[..., None])[..., 0]
    return np.where(singular[..., None], np.nan, X)


def widest_angle(u: FloatArray) -> FloatArray:
    """Return the largest angle (rad) between any two of the unit rays u (..., m, 3) of a point."""
    m = u.shape[-2]
    i, j = np.triu_indices(m, 1)
    sine = np.linalg.norm(cross(u[..., i, :], u[..., j, :]), axis=-1)
    cosine = np.einsum("...i,...i->...", u[..., i, :], u[..., j, :])
    return np.arctan2(sine, cosine).max(axis=-1, initial=0.0)


def coplanarity(P: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return B.(u_1 x u_2) of ray pairs, and its partials.

    P, u: (..., 2, 3). Returns values (...) and partials (..., 2, 6) by P and u of each ray.
    """
    u1, u2 = u[..., 0, :], u[..., 1, :]
    B = P[..., 1, :] - P[..., 0, :]
    D = cross(u1, u2)
    first = np.concatenate([-D, cross(u2, B)], axis=-1)
    second = np.concatenate([D, cross(B, u1)], axis=-1)
    return _dot(B, D), np.stack([first, second], axis=-2)


def scale_restraint(P: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the difference of the two distances along the middle ray of triples, and its partials.

    One distance comes from the model of rays 1 and 2, the other from that of rays 2 and 3:
    (B12 x u1).D12/|D12|^2 - (B23 x u3).D23/|D23|^2. P, u: (..., 3, 3). Returns values (...) in metres and
    partials (..., 3, 6).
    """
    B, first, second, outer = np.diff(P, axis=-2), u[..., :2, :], u[..., 1:, :], u[..., ::2, :]
    # k2 of the first model, ETL-0306 (3.3), and k1 of the second, (3.2): k = (B x a).D/|D|^2, a the outer ray
    D, Ba = cross(first, second), cross(B, outer)
    D2 = _dot(D, D)[..., None]
    k = _dot(Ba, D)[..., None] / D2
    # d(Ba.D) - k d(D.D) = dB.(a x D) + da.(D x B) + (Ba - 2k D).dD
    E, by_outer = Ba - 2.0 * k * D, cross(D, B)
    by_B, by_first, by_second = cross(outer, D), cross(second, E), cross(E, first)
    by_first[..., 0, :] += by_outer[..., 0, :]
    by_second[..., 1, :] += by_outer[..., 1, :]
    (B12, B23), (u1, other_u2), (u2, u3) = (
        np.moveaxis(gradient / D2, -2, 0) for gradient in (by_B, by_first, by_second)
    )
    by_P, by_u = np.stack([-B12, B12 + B23, -B23], axis=-2), np.stack([u1, u2 - other_u2, -u3], axis=-2)
    return k[..., 0, 0] - k[..., 1, 0], np.concatenate([by_P, by_u], axis=-1)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.einsum("...i,...i->...", a, b)
