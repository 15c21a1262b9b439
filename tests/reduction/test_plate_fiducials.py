"""Fiducial transformations: exact, by chance, exchanged marks; partials of all steps of the reduction."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from musatpy.reduction import fiducials, planar
from musatpy.reduction.displacements import Curvature, Refraction
from musatpy.reduction.distortion import Side
from musatpy.reduction.fiducials import FiducialLimits, Reason
from musatpy.reduction.planar import Comparator, PlanarKind, PlanarTransformation
from raw_plates import before
from reduction import plates
from reduction.plates import CORNERS, IDS, MARKS, SIDES

TURNED = PlanarTransformation(kind=PlanarKind.SIMILARITY, parameters=np.array([0.3, 0.95, 210.0, -40.0]))
NOISE = np.random.default_rng(8).normal(0.0, 0.003, (8, 2))


def _transform(kind, xy, ids=IDS, limits=None, calibrated=MARKS):
    limits = limits or FiducialLimits()
    return fiducials.transform(kind, plates.marks(xy, ids), plates.marks(calibrated), limits)


@pytest.mark.parametrize("kind", PlanarKind)
@pytest.mark.slow
def test_covariance_is_that_of_many_plates(kind):
    """The parameters of 250 noisy plates scatter as the covariance says, of marks and readings both unsure."""
    rng = np.random.default_rng(5)
    exact = before(TURNED, MARKS)
    found = []
    for _ in range(250):
        read = exact + rng.normal(0.0, 0.003, MARKS.shape)
        known = MARKS + rng.normal(0.0, 0.002, MARKS.shape)
        found.append(planar.fit(kind, read, known, np.full((8, 2), 0.003), np.full((8, 2), 0.002)))
    spread = np.std([one.plane.parameters for one in found], axis=0)
    claimed = np.sqrt(np.diagonal(found[0].cofactor))
    # the standard deviation of 250 has a relative error of 4.5 %: four of them
    np.testing.assert_allclose(spread / claimed, 1.0, atol=0.18)
    mean_variance = np.mean([one.sigma0**2 for one in found])
    assert mean_variance == pytest.approx(1.0, abs=0.13)  # freedom of 8 or more: 250 of them have 3.2 %
    normalized = np.concatenate([one.normalized.ravel() for one in found])
    assert np.std(normalized) == pytest.approx(1.0, abs=0.05)  # 4000 values: 1.1 %


@pytest.mark.slow
def test_a_grid_plate_calibrates_a_comparator():
    """Scales and angles scatter over 250 readings of a grid as their covariance says."""
    rng = np.random.default_rng(7)
    one = plates.comparator()
    x = np.linspace(-100.0, 100.0, 5)
    grid = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    read = before(one, grid)
    zero, sigma = np.zeros_like(grid), np.full(grid.shape, 0.002)
    found, claimed = [], np.zeros((4, 4))
    for _ in range(250):
        fit = planar.fit(PlanarKind.AFFINE, read + rng.normal(0.0, 0.002, read.shape), grid, sigma, zero)
        got = planar.from_matrix(fit.plane.matrix()[:2, :2])
        assert got.left_handed
        found.append(got.parameters())
        claimed += planar.parameter_covariance(got, fit.linear_covariance) / 250
    np.testing.assert_allclose(
        np.mean(found, axis=0), one.parameters(), rtol=0.0, atol=2e-6
    )  # 5 of 6e-6 / sqrt(250)
    spread = np.std(found, axis=0) / np.sqrt(np.diagonal(claimed))
    np.testing.assert_allclose(spread, 1.0, atol=0.18)  # 250 have 4.5 %: four of them


# --- refusals ---


def in_the_order(*order: int) -> np.ndarray:
    """Return the readings of the corners, or of all marks, in another order than their names."""
    return before(TURNED, MARKS)[list(order)]


@pytest.mark.parametrize(
    ("read", "ids", "reason", "names"),
    [
        # a projective transformation of four marks fits them under any names: they must be looked at before
        (in_the_order(0, 2, 1, 3), "1234", Reason.SWAPPED, [{"2": "3", "3": "2"}]),
        # opposite ones of four could be a mirrored plate
        (in_the_order(2, 1, 0, 3), "1234", Reason.MIRRORED, [..., {"1": "3", "3": "1"}, {"2": "4", "4": "2"}]),
        (in_the_order(1, 4, 2, 3, 0, 5, 6, 7), "12345678", Reason.SWAPPED, [{"1": "2", "2": "5", "5": "1"}]),
        (in_the_order(1, 0, 2, 3, 4, 5, 6, 7) + NOISE, "12345678", Reason.SWAPPED, [{"1": "2", "2": "1"}]),
        (in_the_order(0, 1, 2, 3, 6, 5, 4, 7) + NOISE, "12345678", Reason.SWAPPED, [{"5": "7", "7": "5"}]),
        # under the name of one that was not measured
        (in_the_order(0, 1, 2, 3, 4, 5, 6), "1234568", Reason.SWAPPED, [{"8": "7"}]),
        (np.add(in_the_order(0, 1, 2, 3), [[0, 0], [9, 4], [0, 0], [0, 0]]), "1234", Reason.MISPLACED, []),
        (in_the_order(*range(8)) + 9.0 * np.eye(8)[:, 1:3], "12345678", Reason.MISPLACED, []),
    ],
    ids=[
        "neighbours of four",
        "opposite ones of four",
        "a ring",
        "corners",
        "sides",
        "one not measured",
        "one of four",
        "two of eight",
    ],
)
@pytest.mark.parametrize("kind", PlanarKind)
def test_marks_under_wrong_names_or_out_of_place_are_named(kind, read, ids, reason, names):
    calibrated = CORNERS if len(ids) == 4 else MARKS
    solution = _transform(kind, read, np.array(list(ids)), calibrated=calibrated)
    refusal = solution.refusal
    assert refusal.reason is reason and solution.fit is None
    for exchange, expected in zip(refusal.exchanges, names, strict=True):
        assert exchange.mirrored if expected is ... else dict(exchange.names) == expected
    if reason is Reason.MISPLACED:
        assert refusal.ids == ("2",) if len(ids) == 4 else ("2", "3")


def test_marks_on_a_line():
    line = np.stack([np.linspace(-100, 100, 4), np.linspace(-50, 50, 4)], axis=1)
    refusal = _transform(PlanarKind.AFFINE, line, calibrated=line).refusal
    assert refusal.reason is Reason.DEGENERATE
    assert _transform(PlanarKind.SIMILARITY, line, calibrated=line).refusal is None


def test_normalized_residuals_need_control():
    fit = planar.fit(PlanarKind.PROJECTIVE, SIDES + 0.01, SIDES, np.zeros((4, 2)), np.ones((4, 2)))
    assert fit.freedom == 0
    assert np.isnan(fit.sigma0)
    assert np.isnan(fit.normalized).all()
    np.testing.assert_array_equal(fit.covariance, fit.cofactor)


PLANES = {
    "similarity": PlanarTransformation(kind=PlanarKind.SIMILARITY, parameters=np.array([0.99, 0.3, 4.0, -7.0])),
    "affine": PlanarTransformation(
        kind=PlanarKind.AFFINE, parameters=np.array([0.99, 0.01, -0.02, 1.02, 4.0, -7.0])
    ),
    "projective": PlanarTransformation(
        kind=PlanarKind.PROJECTIVE, parameters=np.array([0.99, 0.01, 4.0, -0.02, 1.02, -7.0, 2e-5, -3e-5])
    ),
}
STEPS = {
    **PLANES,
    "comparator": plates.comparator(),
    "reseau": plates.reseau(),
    "lens, measured side": plates.lens(Side.MEASURED),
    "lens, ideal side": plates.lens(Side.IDEAL),
    "refraction, tilted": Refraction(view=plates.view(), K=9e-5),
    "curvature, tilted": Curvature(view=plates.view(), height=6000.0),
}


def central(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray, size: float) -> np.ndarray:
    """Return derivatives (..., k) of function(at (..., k)), differences of steps of a size."""
    steps = size * np.eye(at.shape[-1])
    return np.stack([(function(at + step) - function(at - step)) / (2.0 * size) for step in steps], axis=-1)


@pytest.mark.parametrize("name", STEPS)
def test_partials_by_coordinates(name):
    step, xy = STEPS[name], plates.points()
    # 1e-9 is 1e-7 mm over the whole plate
    np.testing.assert_allclose(step.partials(xy), central(step.apply, xy, 1e-4), rtol=0.0, atol=1e-9)


def test_a_lens_of_the_ideal_side_is_iterated():
    lens, xy = plates.lens(Side.IDEAL), plates.points()
    # 1e-9 is what `invert` promises
    np.testing.assert_allclose(lens.apply(xy + lens.distortion(xy)), xy, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", PLANES)
def test_plane_by_parameters(name):
    plane, xy = PLANES[name], plates.points()
    got = plane.by_parameters(xy)
    columns = []
    for axis in np.eye(len(plane.parameters)):
        moved = replace(plane, parameters=plane.parameters + 1e-30j * axis)
        columns.append(moved.apply(xy).imag / 1e-30)
    np.testing.assert_allclose(got, np.stack(columns, axis=-1), rtol=0.0, atol=1e-12 * np.abs(got).max())


def test_comparator_by_parameters():
    one, xy = plates.comparator(), plates.points()

    def moved(p: np.ndarray) -> np.ndarray:
        other = Comparator(scale=(p[0], p[1]), non_orthogonality=p[2], rotation=p[3], left_handed=True)
        return other.apply(xy)

    want = central(moved, one.parameters(), 1e-5)
    # sines of 100 mm bend: h^2 / 6 * 100 = 2e-9, and rounding 1e-16 * 100 / h = 1e-9
    np.testing.assert_allclose(one.by_parameters(xy), want, rtol=0.0, atol=1e-8)


def test_partials_at_the_centre_and_beyond_the_table():
    one = plates.lens(Side.MEASURED)
    for xy in (one.centre[None] + 1e-3, np.array([[150.0, 150.0]])):
        np.testing.assert_allclose(one.partials(xy), central(one.apply, xy, 1e-4), rtol=0.0, atol=1e-9)
    at = np.stack([one.centre, one.centre])
    np.testing.assert_array_equal(one.apply(at), at)
    assert np.isfinite(one.partials(at)).all()
