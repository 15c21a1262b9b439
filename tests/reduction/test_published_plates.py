"""Published plate reductions, reproduced: see `published_plates` for the sources."""

import numpy as np
import pytest

from musatpy.reduction import fiducials, planar
from musatpy.reduction.displacements import Model
from musatpy.reduction.distortion import Lens, Side
from musatpy.reduction.fiducials import FiducialLimits, Marks
from musatpy.reduction.planar import PlanarKind
from musatpy.reduction.plate_steps import reduce_plate
from musatpy.reduction.readings import Calibration, PlateReadings, ReductionPlan
from reduction import published_plates as public

CASES = list(public.PARAMETERS)


def _fit(photo: str, kind: str) -> planar.Fit:
    """The published fits have unit weights."""
    ones = np.ones_like(public.MARKS)
    fit = planar.fit(PlanarKind(kind), public.READ[photo], public.MARKS, 0.0 * ones, ones)
    assert fit is not None
    return fit


@pytest.mark.parametrize(("photo", "kind"), CASES)
def test_fiducial_transformation_of_the_lab(photo, kind):
    fit = _fit(photo, kind)
    got, want = fit.plane.parameters, np.array(public.PARAMETERS[photo, kind])
    # Printed to 10 decimals, the two shifts to 4; the projective parameters of the lab minimize the algebraic
    # instead of the plate residuals, which moves them by a few of the last printed digits, the shifts by
    # micrometres.
    shifts = np.abs(want) > 1.0
    linear, shift = (3e-10, 5e-6) if kind == "PROJECTIVE" else (0.51e-10, 0.51e-4)
    np.testing.assert_allclose(got[~shifts], want[~shifts], rtol=0.0, atol=linear)
    np.testing.assert_allclose(got[shifts], want[shifts], rtol=0.0, atol=shift)
    # printed to 4 decimals
    np.testing.assert_allclose(fit.residuals, public.RESIDUALS[photo, kind], rtol=0.0, atol=0.51e-4)


@pytest.mark.parametrize("photo", ["027", "028"])
def test_scales_and_angle_of_the_lab(photo):
    found = planar.from_matrix(_fit(photo, "AFFINE").plane.matrix()[:2, :2])
    want = public.AFFINITY[photo]
    np.testing.assert_allclose(found.scale, want[:2], rtol=0.0, atol=0.51e-8)  # 8 decimals printed
    # 4 decimals of a degree printed
    np.testing.assert_allclose(np.rad2deg(found.non_orthogonality), want[2], rtol=0.0, atol=0.51e-4)


def _camera() -> Calibration:
    return Calibration(
        focal_length=public.FOCAL_LENGTH,
        principal_point=public.PRINCIPAL_POINT,
        mark_ids=public.MARK_IDS,
        marks=public.MARKS,
        mark_sigma=np.full((8, 2), np.nan),
        lens=Lens(centre=public.PRINCIPAL_POINT, side=Side.MEASURED, k=public.K, p=public.P),
    )


def test_reduction_of_photo_27_from_pixels_to_refined_coordinates():
    plate = PlateReadings(
        photo="27",
        mark_ids=public.MARK_IDS,
        marks=public.READ["027"],
        point_ids=public.POINT_IDS,
        points=public.POINTS_027,
        camera_height=public.CAMERA_HEIGHT,
        ground_height=public.GROUND_HEIGHT,
    )
    done = reduce_plate(plate, _camera(), ReductionPlan(refraction=Model.ARDC))
    # The lab transforms with parameters rounded to 4 decimals of the shifts: 0.5e-4 mm each.
    np.testing.assert_allclose(done.step("fiducials").after, public.FIDUCIAL_027, rtol=0.0, atol=0.6e-4)
    np.testing.assert_allclose(done.xy - public.PRINCIPAL_POINT, public.CORRECTED_027, rtol=0.0, atol=0.7e-4)


@pytest.mark.parametrize(
    ("given", "want"),
    [(public.FIDUCIAL_027, public.CORRECTED_027), (public.FIDUCIAL_028, public.CORRECTED_028)],
)
def test_corrections_of_the_lab(given, want):
    plate = PlateReadings(
        photo="27",
        mark_ids=public.MARK_IDS[:0],
        marks=public.MARKS[:0],
        point_ids=public.POINT_IDS,
        points=given,
        camera_height=public.CAMERA_HEIGHT,
        ground_height=public.GROUND_HEIGHT,
    )
    done = reduce_plate(plate, _camera(), ReductionPlan(fiducials=None, refraction=Model.ARDC))
    # Five decimals printed in and out. The lab takes refraction at the radius before distortion: K * 0.01 mm =
    # 1e-7 mm.
    np.testing.assert_allclose(done.xy - public.PRINCIPAL_POINT, want, rtol=0.0, atol=1.1e-5)


def test_calibrated_distances_give_the_coordinates_of_the_marks():
    fit = fiducials.fit_distances(
        fiducials.Scales.AFFINE,
        public.READ["027"],
        np.array([[0, 1], [2, 3], [4, 5], [6, 7]]),
        public.DISTANCES,
        np.full(4, 0.003),
        fiducials.Axes(first=(4, 5), second=(7, 6)),
    )
    assert fit is not None
    # The lab's affine transformation leaves 11 um of pixel noise at the marks; the side marks that carry the axes
    # lie within 7 um of them on the certificate.
    np.testing.assert_allclose(fit.plane.apply(public.READ["027"]), public.MARKS, rtol=0.0, atol=0.025)
    assert np.abs(fit.residuals).max() < 0.012  # one pixel
    assert fit.freedom == 1


def test_noobeed_interior_orientation():
    reading, mark = public.NOOBEED_SIGMAS
    ids = np.array(["1", "2", "3", "4"])
    solution = fiducials.transform(
        PlanarKind.AFFINE,
        Marks(ids=ids, xy=public.NOOBEED_READ, sigma=np.full((4, 2), reading)),
        Marks(ids=ids, xy=public.NOOBEED_MARKS, sigma=np.full((4, 2), mark)),
        FiducialLimits(),
    )
    fit = solution.fit
    assert fit is not None
    assert solution.refusal is None
    np.testing.assert_allclose(fit.plane.parameters[:4], public.NOOBEED_LINEAR, rtol=0.0, atol=0.51e-15)
    np.testing.assert_allclose(fit.plane.parameters[4:], public.NOOBEED_SHIFT, rtol=0.0, atol=0.51e-3)  # printed
    for row, want in ((0, public.NOOBEED_COVARIANCE_A), (2, public.NOOBEED_COVARIANCE_C)):
        np.testing.assert_allclose(fit.covariance[row], want, rtol=0.0, atol=0.51e-15)  # 15 decimals printed


@pytest.mark.parametrize("report", public.USGS)
def test_distortion_of_usgs_certificates(report):
    f, K, P, radial, decentring = public.USGS[report]
    r = f * np.tan(np.deg2rad(public.FIELD_ANGLES))
    at = np.stack([r, np.zeros_like(r)], axis=-1)
    # the reports' coefficients are of the correction
    lens = Lens(centre=np.zeros(2), side=Side.IDEAL, k=-np.array([*K, 0.0]))
    np.testing.assert_allclose(1e3 * lens.distortion(at)[:, 0], radial, rtol=0.0, atol=0.5)  # whole um
    # Decentring is tabulated by its profile sqrt(P1^2 + P2^2) r^2: the tangential distortion in the direction of P.
    P = np.array(P)
    across = r[:, None] * np.array([-P[1], P[0]]) / np.hypot(*P)
    tangential = Lens(centre=np.zeros(2), side=Side.IDEAL, p=np.array([*P, 0.0])).distortion(across)
    np.testing.assert_allclose(1e3 * np.linalg.norm(tangential, axis=1), decentring, rtol=0.0, atol=0.5)
