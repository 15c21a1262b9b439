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
from musatpy.reduction.plate_steps import PlateReduction, reduce_plate
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


def test_crosses_alone_lead_to_the_fiducial_system():
    """Bilinear cells commute with affine transformations: marks before them make no difference."""
    without = replace(_camera(), mark_ids=IDS[:0], marks=MARKS[:0], mark_sigma=MARKS[:0])
    done = reduce_plate(_plate(XY), without, PLAN)
    assert done.step("fiducials") is None
    assert np.isnan(done.step("reseau").largest)
    assert done.step("lens").largest > 0.01
    np.testing.assert_allclose(done.xy, XY, rtol=0.0, atol=1e-8)  # as with marks


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
