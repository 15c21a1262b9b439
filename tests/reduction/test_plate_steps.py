"""Repeated readings, distances between marks, reseau, lens, atmosphere and curvature: what each step is for."""

import math

import numpy as np
import pytest
from scipy import integrate, stats

from musatpy.reduction import displacements, fiducials
from musatpy.reduction.displacements import DOWN, Curvature, Model, Refraction, View
from musatpy.reduction.distortion import Lens, Side
from musatpy.reduction.fiducials import Axes, Scales
from musatpy.reduction.planar import PlanarKind, PlanarTransformation, invert
from musatpy.reduction.readings import mean_readings
from musatpy.reduction.reseau import Reseau
from raw_plates import before
from reduction import plates

VERTICAL = View(focal_length=plates.F, principal_point=plates.PRINCIPAL_POINT, nadir=DOWN)


# --- repeated readings ---


def test_means_and_their_spread():
    ids = np.array(["b", "a", "b", "c", "b", "a"])
    xy = np.array([[1.0, 0.0], [5.0, 5.0], [2.0, 0.0], [7.0, 8.0], [3.0, 3.0], [5.0, 5.2]])
    means = mean_readings(ids, xy, reading_sigma=0.5, limit=1.5)
    assert means.ids.tolist() == ["b", "a", "c"]
    assert means.count.tolist() == [3, 2, 1]
    np.testing.assert_allclose(means.xy, [[2.0, 1.0], [5.0, 5.1], [7.0, 8.0]], atol=1e-15)  # rounding
    np.testing.assert_allclose(means.sigma[:2], [[1.0, math.sqrt(3.0)], [0.0, math.sqrt(0.02)]], atol=1e-14)
    assert np.isnan(means.sigma[2]).all()
    assert means.freedom == 3
    np.testing.assert_allclose(means.pooled, [math.sqrt(2.0 / 3.0), math.sqrt(6.02 / 3.0)], atol=1e-14)
    assert means.largest == 2.0
    assert means.beyond.tolist() == [False, False, False, False, True, False]
    want = [stats.chi2.sf(2.0 / 0.25, 3), stats.chi2.sf(6.02 / 0.25, 3)]
    np.testing.assert_allclose(means.probability, want, rtol=1e-10)  # of the series


# --- distances between marks ---

# what the film and comparator did: shrinkage and shear, a turn and a shift
FILM = PlanarTransformation(kind=PlanarKind.AFFINE, parameters=np.array([0.9985, 0.0007, 0.0007, 0.9991, 0.0, 0.0]))
TURN = PlanarTransformation(
    kind=PlanarKind.SIMILARITY, parameters=np.array([math.cos(0.4), math.sin(0.4), 130.0, 20.0])
)
SIDE_MARKS = np.array([[112.0, 0.0], [0.0, 112.006], [-112.004, 0.0], [0.0, -111.998]])
CORNER_MARKS = np.array([[106.0, 106.0], [-106.0, 106.0], [-106.0, -106.0], [106.0, -106.0]])
ENDS = np.array([[0, 2], [3, 1], [0, 1], [1, 2], [2, 3], [3, 0]])


def _distances(marks: np.ndarray) -> np.ndarray:
    return np.linalg.norm(marks[ENDS[:, 1]] - marks[ENDS[:, 0]], axis=1)


@pytest.mark.parametrize(
    ("marks", "axes"),
    [
        (SIDE_MARKS, Axes(first=(2, 0), second=(3, 1))),
        (CORNER_MARKS, Axes(first=(2, 0), second=(3, 1), corners=True)),
    ],
)
def test_distances_give_the_fiducial_system(marks, axes):
    """Marks on their axes: shape from the distances, place from the lines that join them."""
    read = TURN.apply(before(FILM, marks))
    fit = fiducials.fit_distances(Scales.AFFINE, read, ENDS, _distances(marks), np.full(6, 0.003), axes)
    np.testing.assert_allclose(fit.plane.apply(read), marks, rtol=0.0, atol=1e-10)  # rounding of 100 mm
    np.testing.assert_allclose(fit.residuals, 0.0, atol=1e-10)
    assert fit.freedom == 3


def test_kinds_of_scales():
    """Each kind of scales is exact where the film did no more than it says."""
    axes = Axes(first=(2, 0), second=(3, 1))
    for scales, film, elements in (
        (Scales.UNIFORM, [0.9985, 0.0, 0.0, 0.9985, 0.0, 0.0], 1),
        (Scales.AXES, [0.9985, 0.0, 0.0, 0.9991, 0.0, 0.0], 2),
    ):
        shrunk = PlanarTransformation(kind=PlanarKind.AFFINE, parameters=np.array(film))
        read = before(shrunk, SIDE_MARKS) + np.array([130.0, 20.0])
        fit = fiducials.fit_distances(scales, read, ENDS, _distances(SIDE_MARKS), np.full(6, 0.003), axes)
        np.testing.assert_allclose(fit.plane.apply(read), SIDE_MARKS, rtol=0.0, atol=1e-10)  # rounding
        assert fit.freedom == 6 - elements
        np.testing.assert_allclose(np.linalg.norm(fit.plane.matrix()[:2, 0]), 0.9985, rtol=1e-12)


def test_distances_scatter_as_their_sigmas_say():
    rng = np.random.default_rng(2)
    axes = Axes(first=(2, 0), second=(3, 1))
    fits = [
        fiducials.fit_distances(
            Scales.AFFINE,
            SIDE_MARKS,
            ENDS,
            _distances(SIDE_MARKS) + rng.normal(0.0, 0.003, 6),
            np.full(6, 0.003),
            axes,
        )
        for _ in range(250)
    ]
    assert np.mean([fit.sigma0**2 for fit in fits]) == pytest.approx(1.0, abs=0.2)  # 250 of freedom 3: 5.2 %


def test_distances_that_do_not_do():
    axes = Axes(first=(2, 0), second=(3, 1))
    sigma = np.full(6, 0.003)
    known = _distances(SIDE_MARKS)
    # too few
    assert fiducials.fit_distances(Scales.AFFINE, SIDE_MARKS, ENDS[:2], known[:2], sigma[:2], axes) is None
    one_way = np.array([[0, 2], [2, 0]])
    assert fiducials.fit_distances(Scales.AXES, SIDE_MARKS, one_way, known[[0, 0]], sigma[:2], axes) is None
    mirrored = SIDE_MARKS * [1.0, -1.0]
    assert fiducials.fit_distances(Scales.AXES, mirrored, ENDS, known, sigma, axes) is None
    parallel = Axes(first=(2, 0), second=(2, 0))
    assert fiducials.fit_distances(Scales.AXES, SIDE_MARKS, ENDS, known, sigma, parallel) is None
    assert fiducials.fit_distances(Scales.AXES, 0.0 * SIDE_MARKS, ENDS, known, sigma, axes) is None


# --- reseau ---


def test_cells_agree_along_their_sides():
    one = plates.reseau()
    x = np.array([one.measured[1, 2] * (1 - s) + one.measured[1, 3] * s for s in np.linspace(0.1, 0.9, 5)])
    gap = np.array([0.0, 1e-9])
    up, down = one.apply(x + gap), one.apply(x - gap)
    np.testing.assert_allclose(up, down, rtol=0.0, atol=1e-8)  # the points differ by 2e-9


def test_smooth_deformation_is_undone():
    """Bilinear between crosses 44 mm apart, of a deformation that bends by 0.04 mm over 110 mm."""
    one, xy = plates.reseau(), plates.points()
    deformed = xy + plates.deformation(xy)
    inside = one.inside(deformed)
    assert inside.sum() > 30
    np.testing.assert_allclose(one.apply(deformed)[inside], xy[inside], rtol=0.0, atol=0.0025)
    bilinear = Reseau(calibrated=one.calibrated, measured=one.calibrated * 0.999 + 0.01)
    np.testing.assert_allclose(bilinear.apply(xy * 0.999 + 0.01), xy, rtol=0.0, atol=1e-10)  # exact


def test_a_cross_that_is_missing_takes_its_cells_out():
    one = plates.reseau()
    measured = one.measured.copy()
    measured[2, 3] = np.nan
    part = Reseau(calibrated=one.calibrated, measured=measured)
    near = one.calibrated[2, 3] + [3.0, 3.0]
    far = one.calibrated[0, 0] + [3.0, 3.0]
    assert part.inside(np.stack([near, far])).tolist() == [False, True]
    np.testing.assert_array_equal(part.apply(far[None]), one.apply(far[None]))
    assert np.isfinite(part.apply(near[None])).all()


# --- lens ---


def test_table_at_its_radii_and_between():
    lens = Lens(centre=np.zeros(2), side=Side.MEASURED, radius=plates.RADII, radial=plates.TABLE)
    r = np.array([20.0, 32.5, 155.0, 10.0, 180.0])
    at = np.stack([0.6 * r, 0.8 * r], axis=-1)
    # linear between, from zero at the centre, and on along the last interval beyond
    want = np.array([0.002, 0.00325, -0.006, 0.001, -0.001])
    got = lens.distortion(at)
    np.testing.assert_allclose(got, want[:, None] * [0.6, 0.8], rtol=0.0, atol=1e-16)
    assert lens.beyond_table(at).tolist() == [False, False, False, False, True]


def test_decentring_is_largest_along_its_axis():
    """Along the axis of P it is radial, three times the profile; across it tangential, once (Brown 1966)."""
    p = np.array([3e-8, -4e-8, 0.0])
    lens = Lens(centre=np.zeros(2), side=Side.MEASURED, p=p)
    axis = p[:2] / 5e-8
    along = lens.distortion(100.0 * axis)
    across = lens.distortion(100.0 * np.array([-axis[1], axis[0]]))
    np.testing.assert_allclose(along, 3 * 5e-4 * axis, rtol=1e-12)
    np.testing.assert_allclose(across, 5e-4 * axis, rtol=1e-12)


def test_a_distortion_that_has_no_inverse_is_not_a_number():
    lens = Lens(centre=np.zeros(2), side=Side.IDEAL, k=np.array([0.0, -1e-2, 0.0, 0.0]))
    assert np.isnan(lens.apply(np.array([[100.0, 50.0]]))).all()
    # what has an inverse is not lost by its neighbour
    both = invert(
        lambda xy: xy + lens.distortion(xy),
        lambda xy: np.eye(2) + lens.distortion_partials(xy),
        np.array([[0.01, 0.02], [100.0, 50.0]]),
    )
    assert np.isfinite(both[0]).all()
    assert np.isnan(both[1]).all()


# --- atmosphere ---

# U.S. Standard Atmosphere 1976, tables by geopotential height: Pa, kg/m^3
ATMOSPHERE = {
    0.0: (101325.0, 1.2250),
    5000.0: (54019.9, 0.73612),
    11000.0: (22632.1, 0.36392),
    20000.0: (5474.89, 0.08803),
}


@pytest.mark.parametrize("height", ATMOSPHERE)
def test_standard_atmosphere(height):
    # the thinnest density has four digits
    np.testing.assert_allclose(displacements.air(height), ATMOSPHERE[height], rtol=6e-5)


def test_refraction_of_a_ray_traced_through_the_layers():
    """n sin(q) is the same in all flat layers (Snell): the ray is integrated, without any formula for K."""
    camera, ground, q = 7000.0, 500.0, math.radians(40.0)

    def n(z: float) -> float:
        return 1.0 + 2.26e-4 * displacements.air(z)[1]

    sine = n(camera) * math.sin(q)
    reach, _ = integrate.quad(lambda z: math.tan(math.asin(sine / n(z))), ground, camera, epsabs=1e-9, limit=200)
    straight = math.atan(reach / (camera - ground))
    K = displacements.constant(Model.US1976, camera, ground)
    # first order in n - 1 = 3e-4: of 6e-5 rad, 2e-8; and the heights are geopotential in both
    assert K * math.tan(q) == pytest.approx(q - straight, rel=1e-3)
    image = plates.PRINCIPAL_POINT + plates.F * math.tan(q) * np.array([0.6, 0.8])
    want = plates.PRINCIPAL_POINT + plates.F * math.tan(straight) * np.array([0.6, 0.8])
    got = Refraction(view=VERTICAL, K=K).apply(image)
    np.testing.assert_allclose(got, want, rtol=0.0, atol=2e-5)  # 1e-3 of the 15 um moved


def test_the_two_atmospheres_agree_over_ground_at_sea_level():
    """Within 5 urad up to 30 km: 1 um at 100 mm."""
    for camera in (1000.0, 3000.0, 6000.0, 9000.0, 12000.0, 15000.0, 20000.0, 30000.0):
        a, b = (displacements.constant(model, camera, 0.0) for model in Model)
        assert a == pytest.approx(b, abs=5e-6)


@pytest.mark.parametrize(
    ("model", "camera", "ground"),
    [
        (Model.ARDC, 30500.0, 0.0),
        (Model.US1976, 48000.0, 0.0),
        (Model.US1976, 1000.0, 1000.0),
        (Model.US1976, 1000.0, 2000.0),
        (Model.US1976, float("nan"), 0.0),
        (Model.ARDC, 3000.0, -600.0),
    ],
)
def test_heights_that_the_models_do_not_have(model, camera, ground):
    with pytest.raises(ValueError, match="needs"):
        displacements.constant(model, camera, ground)


def test_refraction_of_a_vertical_photo_is_the_textbook_formula():
    K, xy = 8e-5, plates.points()
    away = xy - plates.PRINCIPAL_POINT
    r2 = np.square(away).sum(axis=1, keepdims=True)
    want = xy - away * K * (1.0 + r2 / plates.F**2)  # dr = K (r + r^3/f^2)
    got = Refraction(view=VERTICAL, K=K).apply(xy)
    np.testing.assert_allclose(got, want, rtol=0.0, atol=5e-6)  # second order: K^2 * 150 mm * 4


def test_refraction_of_a_tilted_photo_turns_rays_by_their_angle():
    """The ray turns towards the nadir by K tan(angle), whatever the photo's tilt."""
    K, view, xy = 8e-5, plates.view((0.3, -0.2, 0.7)), plates.points()

    def rays(image: np.ndarray) -> np.ndarray:
        v = np.concatenate([image - view.principal_point, np.full((len(image), 1), -view.focal_length)], axis=1)
        return v / np.linalg.norm(v, axis=1)[:, None]

    before = rays(xy) @ view.nadir
    after = rays(Refraction(view=view, K=K).apply(xy)) @ view.nadir
    tangent = np.sqrt(1.0 - before**2) / before
    turned = np.arctan2(np.sqrt(1.0 - before**2), before) - np.arctan2(np.sqrt(1.0 - after**2), after)
    np.testing.assert_allclose(turned, K * tangent, rtol=5e-4)  # K tan^2, of second order


# --- curvature ---


def test_curvature_of_a_vertical_photo_is_the_textbook_formula():
    height, xy = 6000.0, plates.points()
    one = Curvature(view=VERTICAL, height=height, radius=6.37e6)
    away = xy - plates.PRINCIPAL_POINT
    r2 = np.square(away).sum(axis=1, keepdims=True)
    want = xy + away * height * r2 / (2.0 * 6.37e6 * plates.F**2)  # dr = H' r^3 / (2 R f^2)
    # second order: (4e-4)^2 * 150 mm
    np.testing.assert_allclose(one.apply(xy), want, rtol=0.0, atol=5e-5)


@pytest.mark.parametrize("attitude", [(0.0, 0.0, 0.0), (0.15, -0.1, 2.0)])
def test_curvature_of_points_on_a_sphere(attitude):
    """Points seen on the sphere are corrected to where a plane of the same distances would show them."""
    radius, height = 6.371e6, 5000.0
    view = plates.view(attitude)
    n = view.nadir
    across = np.linalg.svd(n[None])[2][1:]  # two directions of the horizon
    angle = np.linspace(0.0, 2.0 * math.pi, 9)[:-1]
    s = 3000.0
    flat = s * (np.cos(angle)[:, None] * across[0] + np.sin(angle)[:, None] * across[1])
    drop = radius * (1.0 - math.cos(s / radius))

    def image(v: np.ndarray) -> np.ndarray:
        return view.principal_point - view.focal_length * v[:, :2] / v[:, 2:]

    seen = image(flat * (math.sin(s / radius) * radius / s) + n * (height + drop))
    want = image(flat + n * height)
    got = Curvature(view=view, height=height, radius=radius).apply(seen)
    assert np.abs(seen - want).max() > 0.01
    np.testing.assert_allclose(got, want, rtol=0.0, atol=2e-5)  # of second order
