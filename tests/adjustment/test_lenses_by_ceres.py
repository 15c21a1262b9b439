"""A dry block with an unknown lens, adjusted by pycolmap (Ceres) too: one minimum, one lens."""

from typing import Any

import numpy as np
import pytest

from adjustment.test_lenses import TRUE, through_lens, unknowns
from blocks import converged, simulation
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.model import Block, DistortionSide, Solution

pytestmark = pytest.mark.slow
OPENCV = ("F", "XP", "YP", "K1", "K2", "P1", "P2", "B1")  # what that model of a lens has, by our names


def flown(strips: int, photos: int) -> Block:
    """A dry local block with fixed control, its images through a lens."""
    block = simulation(
        3,
        job={"system": "LOCL", "centre": [0.0, 0.0]},
        terrain={"level": 60.0, "relief": 150.0, "wavelength": 900.0},
        flight={"photos": photos, "strips": strips, "height": 1200.0, "reverse_alternate": True,
                "side_overlap": 0.5, "attitude_scatter": 4.0},
        points={"per_site": 3},
        control=[{"kind": "full", "number": 3 * strips, "sigma": 0.05, "fixed": True}],
        stations={"position_error": 1.0, "attitude_error": 0.1},
        options={"program": "IIIA", "refraction": "NONE"},
    ).block  # fmt: skip
    return unknowns(through_lens(block, DistortionSide.IDEAL, {name: TRUE[name] for name in OPENCV}), *OPENCV)


def by_pycolmap(pycolmap: Any, block: Block, first: Solution) -> tuple[float, dict[str, float]]:
    """The weighted squares and the lens of pycolmap, from the given stations and points a metre off ours."""
    sigma = block.options.plate_sigma  # a pixel: y down, x right, looking along z
    f, centre = block.cameras.focal_length[0] / sigma, block.cameras.principal_point[0] / sigma
    scene, config = pycolmap.Reconstruction(), pycolmap.BundleAdjustmentConfig()
    parameters = [f, f, centre[0], -centre[1], 0.0, 0.0, 0.0, 0.0]
    camera = pycolmap.Camera(camera_id=1, model="OPENCV", width=1, height=1, params=parameters)
    scene.add_camera_with_trivial_rig(camera)
    points = first.points.position + np.random.default_rng(0).normal(0.0, 1.0, first.points.position.shape)
    points[block.control.point] = block.control.position
    numbers = [scene.add_point3D(X, pycolmap.Track()) if np.isfinite(X).all() else -1 for X in points]
    M = np.diag([1.0, -1.0, -1.0]) @ attitude_matrix(block.photos.attitude)
    for photo in range(block.photos.count):
        rows = np.flatnonzero((block.plates.photo == photo) & first.plates.triangulated)
        pixels = block.plates.xy[rows] * [1.0, -1.0] / sigma
        image = pycolmap.Image(name=str(photo), keypoints=pixels, camera_id=1, image_id=photo + 1)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(M[photo]), -M[photo] @ block.photos.position[photo])
        scene.add_image_with_trivial_frame(image, pose)
        for keypoint, point in enumerate(block.plates.point[rows].tolist()):
            scene.add_observation(numbers[point], pycolmap.TrackElement(photo + 1, keypoint))
        config.add_image(photo + 1)
    for point in block.control.point.tolist():
        config.add_constant_point(numbers[point])
    options = pycolmap.BundleAdjustmentOptions(
        refine_focal_length=True, refine_principal_point=True, refine_extra_params=True, print_summary=False
    )
    solver, options.ceres.auto_select_solver_type = options.ceres.solver_options, False
    solver.linear_solver_type = type(solver.linear_solver_type).SPARSE_SCHUR
    solver.function_tolerance = solver.gradient_tolerance = solver.parameter_tolerance = 1e-16
    solver.initial_trust_region_radius, solver.max_num_iterations = 1e12, 100
    summary = pycolmap.create_default_ceres_bundle_adjuster(options, config, scene).solve()
    fx, fy, cx, cy, k1, k2, p1, p2 = scene.cameras[1].params
    f = fy * sigma
    values = (f, cx * sigma, -cy * sigma, k1 / f**2, k2 / f**4, p2 / f, -p1 / f, fx / fy - 1.0)
    return 2.0 * summary.ceres_summary.final_cost, dict(zip(OPENCV, values, strict=True))


def test_minimum_and_lens_are_those_of_ceres() -> None:
    """200 photographs, OPENCV: the same sum of squares to 1e-9, parameters to 1e-6 of their sigmas."""
    pycolmap = pytest.importorskip("pycolmap")
    block = flown(10, 20)
    solution = converged(block)
    assert solution.parameters is not None
    squares, lens = by_pycolmap(pycolmap, block, solution)
    assert solution.sum_of_squares == pytest.approx(squares, rel=1e-9)
    expected = [lens[name] for name in solution.parameters.parameter.tolist()]
    np.testing.assert_array_less(np.abs(solution.parameters.value - expected), 1e-6 * solution.parameters.spread)
