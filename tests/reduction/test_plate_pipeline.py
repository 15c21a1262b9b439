"""The whole reduction of a plate and of a block, against plates that were made by undoing it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from musatpy.reduction import displacements
from musatpy.reduction.displacements import Curvature, Model, Refraction
from musatpy.reduction.distortion import Side
from musatpy.reduction.fiducials import FiducialLimits, Reason, Scales
from musatpy.reduction.planar import PlanarKind, PlanarTransformation
from musatpy.reduction.plate_steps import PlateReduction, reduce_plate, restore, transformation_covariance
from musatpy.reduction.readings import Calibration, Grid, MarkDistances, PlateReadings, ReductionPlan
from musatpy.reduction.readings_job import quantities
from reduction import plates
from reduction.plates import IDS, MARKS

STEPS = ("comparator", "fiducials", "reseau", "lens", "refraction", "curvature")
# where the plate lay on the comparator, and how the film shrank as a whole
LAID = PlanarTransformation(
    kind=PlanarKind.AFFINE, parameters=np.array([0.998, 0.0602, -0.0598, 0.9985, 140.0, -30.0])
)
CROSS_IDS = np.array([[f"{row}{column}" for column in range(6)] for row in range(5)])
PLAN = ReductionPlan(
    comparator=plates.comparator(),
    limits=FiducialLimits(residual=0.02),
    refraction=Model.US1976,
    curvature=True,
)


def _camera() -> Calibration:
    return Calibration(
        focal_length=plates.F,
        principal_point=plates.PRINCIPAL_POINT,
        mark_ids=IDS,
        marks=MARKS,
        mark_sigma=np.full((8, 2), 0.002),
        reseau=Grid(ids=CROSS_IDS, xy=plates.reseau().calibrated),
        lens=plates.lens(Side.IDEAL),
    )


def _read(on_film: np.ndarray) -> np.ndarray:
    """Readings of places on the film, by the comparator that the plan undoes."""
    return plates.comparator().inverse(LAID.inverse(on_film))


def _plate(xy: np.ndarray, attitude: tuple[float, float, float] = (0.03, -0.05, 1.2)) -> PlateReadings:
    """A plate whose points are refined to xy: everything that the reduction does, undone."""
    view = plates.view(attitude)
    seen = Curvature(view=view, height=5600.0).inverse(xy)
    K = displacements.constant(Model.US1976, 6000.0, 400.0)
    seen = Refraction(view=view, K=K).inverse(seen)
    film = plates.reseau().inverse(plates.lens(Side.IDEAL).inverse(seen))
    return PlateReadings(
        photo="7",
        mark_ids=IDS,
        marks=_read(MARKS),  # the deformation of this film leaves the marks where they are
        point_ids=np.array([f"P{i}" for i in range(len(xy))]),
        points=_read(film),
        cross_ids=CROSS_IDS.reshape(-1),
        crosses=_read(plates.reseau().measured.reshape(-1, 2)),
        camera_height=6000.0,
        ground_height=400.0,
        nadir=view.nadir,
    )


XY = 0.9 * plates.points()


@cache
def _done() -> PlateReduction:
    return reduce_plate(_plate(XY), _camera(), PLAN)


def test_everything_undone_is_reduced():
    done = _done()
    assert done.refusal is None
    assert tuple(one.name for one in done.steps) == STEPS
    np.testing.assert_allclose(done.xy, XY, rtol=0.0, atol=1e-8)  # six inverses of 1e-9
    assert done.ids.tolist() == [f"P{i}" for i in range(len(XY))]
    assert done.beyond_reseau == ()
    assert done.beyond_table == ()
    np.testing.assert_allclose(restore(done, done.xy), _plate(XY).points, rtol=0.0, atol=1e-8)  # as above


def test_every_step_says_what_it_did():
    done = _done()
    for name in ("comparator", "fiducials"):
        assert np.isnan(done.step(name).largest)
    for name, low, high in (
        ("reseau", 0.01, 0.08),
        ("lens", 0.01, 0.2),
        ("refraction", 0.005, 0.02),
        ("curvature", 0.005, 0.06),
    ):
        one = done.step(name)
        assert low < one.largest < high
        assert one.largest == np.linalg.norm(one.after - one.before, axis=1).max()
    np.testing.assert_allclose(done.marks.residuals, 0.0, atol=1e-10)  # rounding
    assert done.marks.fit.freedom == 10


def test_derivatives_by_the_readings():
    plate = _plate(XY)
    done = reduce_plate(plate, _camera(), PLAN)
    columns = []
    for axis in np.eye(2) * 1e-4:
        up, down = (
            reduce_plate(replace(plate, points=plate.points + sign * axis), _camera(), PLAN).xy for sign in (1, -1)
        )
        columns.append((up - down) / 2e-4)
    np.testing.assert_allclose(done.by_reading, np.stack(columns, axis=-1), rtol=0.0, atol=1e-8)  # 1e-12 / 1e-4
    want = PLAN.reading_sigma * np.linalg.norm(done.by_reading, axis=2)
    np.testing.assert_allclose(done.sigma, want, rtol=1e-12)


def test_covariance_of_the_marks_is_taken_through_the_later_steps():
    done = _done()
    applied, fit = done.step("fiducials"), done.marks.fit
    columns = []
    for i, size in enumerate(1e-5 / np.abs(applied.step.by_parameters(applied.before)).max(axis=(0, 1))):
        moved = []
        for sign in (1, -1):
            xy = applied.after + sign * size * applied.step.by_parameters(applied.before)[..., i]
            for later in done.steps[2:]:
                xy = later.step.apply(xy)
            moved.append(xy)
        columns.append((moved[0] - moved[1]) / (2.0 * size))
    J = np.stack(columns, axis=-1)
    want = J @ fit.covariance @ np.swapaxes(J, 1, 2)
    np.testing.assert_allclose(transformation_covariance(done), want, rtol=0.0, atol=1e-6 * np.abs(want).max())
    with pytest.raises(ValueError, match="no fit"):
        transformation_covariance(reduce_plate(_plate(XY), _camera(), replace(PLAN, fiducials=None)))


def test_repeated_readings_are_meaned_and_surer():
    plate = _plate(XY)
    off = np.array([[0.004, 0.0], [0.0, 0.01]])
    twice = replace(
        plate,
        point_ids=np.concatenate([plate.point_ids, plate.point_ids[:3]]),
        points=np.concatenate([plate.points + off[0], plate.points[:3] - off[0]]),
        mark_ids=np.concatenate([IDS, IDS]),
        marks=np.concatenate([plate.marks + off[1], plate.marks - off[1]]),
    )
    once = reduce_plate(plate, _camera(), PLAN)
    done = reduce_plate(twice, _camera(), replace(PLAN, repeat_limit=0.005))
    np.testing.assert_allclose(done.xy[:3], once.xy[:3], rtol=0.0, atol=1e-9)  # the same means
    np.testing.assert_allclose(done.sigma[:3], once.sigma[:3] / np.sqrt(2.0), rtol=1e-9)
    assert done.mark_means.largest == pytest.approx(0.01, abs=1e-12)
    assert done.mark_means.beyond.all()
    assert not done.point_means.beyond.any()
    assert done.mark_means.probability[1] < 1e-6  # 0.01 mm is more than 0.003


@pytest.mark.parametrize("left_out", STEPS)
def test_each_step_is_optional(left_out):
    plan, camera, plate = PLAN, _camera(), _plate(XY)
    if left_out == "comparator":
        plan = replace(plan, comparator=None)
        plate = replace(
            plate,
            marks=plates.comparator().apply(plate.marks),
            points=plates.comparator().apply(plate.points),
            crosses=plates.comparator().apply(plate.crosses),
        )
    elif left_out == "fiducials":
        plan = replace(plan, fiducials=None)
    elif left_out == "refraction":
        plan = replace(plan, refraction=None)
    else:
        plan = replace(plan, **{left_out: False})
    done = reduce_plate(plate, camera, plan)
    assert tuple(one.name for one in done.steps) == tuple(name for name in STEPS if name != left_out)
    assert done.refusal is None


def test_steps_without_calibration_or_readings_are_left_out():
    camera = replace(_camera(), reseau=None, lens=None)
    done = reduce_plate(_plate(XY), camera, PLAN)
    assert tuple(one.name for one in done.steps) == ("comparator", "fiducials", "refraction", "curvature")
    no_crosses = replace(_plate(XY), cross_ids=np.zeros(0, dtype=str), crosses=np.zeros((0, 2)))
    assert reduce_plate(no_crosses, _camera(), PLAN).step("reseau") is None


def test_crosses_alone_lead_to_the_fiducial_system():
    """Bilinear cells commute with affine transformations: marks before them make no difference."""
    without = replace(_camera(), mark_ids=IDS[:0], marks=MARKS[:0], mark_sigma=MARKS[:0])
    done = reduce_plate(_plate(XY), without, PLAN)
    assert done.step("fiducials") is None
    assert np.isnan(done.step("reseau").largest)
    assert done.step("lens").largest > 0.01
    np.testing.assert_allclose(done.xy, XY, rtol=0.0, atol=1e-8)  # as with marks


def test_a_camera_without_any_calibration_of_its_frame():
    camera = replace(_camera(), mark_ids=IDS[:0], marks=MARKS[:0], mark_sigma=MARKS[:0], reseau=None)
    assert reduce_plate(_plate(XY), camera, PLAN).refusal.reason is Reason.MISSING


# --- by distances ---


def _by_distances() -> tuple[Calibration, ReductionPlan]:
    sides = MARKS[4:]
    ends = np.array([["7", "5"], ["8", "6"], ["5", "6"], ["6", "7"], ["7", "8"], ["8", "5"]])
    row = {name: i for i, name in enumerate(IDS[4:])}
    distance = np.array([np.linalg.norm(sides[row[a]] - sides[row[b]]) for a, b in ends])
    known = MarkDistances(
        ends=ends,
        distance=distance,
        sigma=np.full(6, 0.002),
        first=("7", "5"),
        second=("8", "6"),
        scales=Scales.AFFINE,
    )
    camera = replace(_camera(), mark_ids=IDS[:0], marks=MARKS[:0], mark_sigma=MARKS[:0], distances=known)
    return camera, PLAN


def test_distances_refuse_too():
    camera, plan = _by_distances()
    plate = _plate(XY)
    without = replace(plate, mark_ids=IDS[:6], marks=plate.marks[:6])
    refusal = reduce_plate(without, camera, plan).refusal
    assert refusal.reason is Reason.MISSING
    assert refusal.ids == ("7", "8")
    moved = plate.marks.copy()
    moved[5] += [0.1, 0.2]
    done = reduce_plate(replace(plate, marks=moved), camera, plan)
    assert done.refusal.reason is Reason.LIMIT
    assert np.abs(done.mark_distances.residuals).max() > 0.02
    swapped = plate.marks.copy()
    swapped[[4, 6]] = swapped[[6, 4]]  # one axis turned round: a mirrored plate
    assert reduce_plate(replace(plate, marks=swapped), camera, plan).refusal.reason is Reason.DEGENERATE


def test_a_plate_without_points():
    empty = replace(_plate(XY), point_ids=np.zeros(0, dtype=str), points=np.zeros((0, 2)))
    done = reduce_plate(empty, _camera(), PLAN)
    assert done.refusal is None
    assert done.xy.shape == (0, 2)
    assert np.isnan(done.step("lens").largest)


# --- what a listing needs ---


def test_parameters_of_every_step_have_names():
    done = _done()
    named = {step: {one.name: one for one in quantities(done, step)} for step in STEPS}
    assert named["comparator"]["scale u"].value == 0.999
    fit = done.marks.fit
    assert named["fiducials"]["tx"].value == fit.plane.parameters[4]
    assert named["fiducials"]["tx"].sigma == pytest.approx(np.sqrt(fit.covariance[4, 4]), rel=1e-15)
    # the linear part (0.998 0.0602; -0.0598 0.9985): the u rail is turned by atan(-0.0598 / 0.998)
    assert named["fiducials"]["rotation"].value == pytest.approx(np.arctan2(-0.0598, 0.998), abs=1e-12)
    assert named["reseau"]["crosses measured"].value == 30
    gap = np.linalg.norm(plates.deformation(plates.reseau().calibrated), axis=-1).max()
    assert named["reseau"]["largest deformation"].value == pytest.approx(gap, abs=1e-9)
    assert named["lens"]["p3"].value == 3e-6
    assert named["lens"]["distortion at 45.000 mm"].value == 0.0045
    assert named["refraction"]["K"].value == displacements.constant(Model.US1976, 6000.0, 400.0)
    assert named["curvature"]["height above ground"].value == 5600.0
    assert quantities(reduce_plate(_plate(XY), _camera(), replace(PLAN, lens=False)), "lens") == ()


def test_sigmas_of_single_readings():
    """A reading's own sigma goes before that of the plan."""
    plate, camera = _plate(XY[:2]), replace(_camera(), lens=None, reseau=None)
    plan = ReductionPlan(fiducials=PlanarKind.SIMILARITY, reading_sigma=0.004)
    sigma = np.array([[0.001, 0.002], [np.nan, np.nan]])
    done = reduce_plate(replace(plate, point_sigma=sigma, points=XY[:2], marks=MARKS), camera, plan)
    np.testing.assert_allclose(done.sigma, [[0.001, 0.002], [0.004, 0.004]], rtol=1e-9)  # an identity
    unsure = np.full((8, 2), 0.004)
    unsure[0] = 5.0
    moved = MARKS + np.eye(8)[:, :1] * 0.05
    done = reduce_plate(replace(plate, mark_sigma=unsure, points=XY[:2], marks=moved), camera, plan)
    assert done.marks.residuals[0, 0] == pytest.approx(0.05, abs=1e-5)  # its weight is 1e-6 of the others'
