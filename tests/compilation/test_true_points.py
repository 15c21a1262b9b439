"""Compiled points against the run: two-ray points that it was told to keep out are the same estimates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compilation.scenes import pair
from musatpy import model, read_deck
from musatpy.adjustment.job import adjust
from musatpy.compilation.run_records import of_record
from musatpy.compilation.triangulation import Triangulation, of_solution
from musatpy.compilation.true_points import BEHIND, PARALLEL_RAYS, Readings, TruePoints, true_points
from musatpy.errors import CompilationError
from musatpy.reports.record import dumps, record

FIXTURES = Path(__file__).parents[2] / "fixtures"
ONE, PHOTO = ({"water_level": level} for level in (model.WaterLevel.ONE, model.WaterLevel.PHOTO))


def kept_out(
    deck: str, program: model.Program, sigmas: bool, options: dict[str, object]
) -> tuple[model.Block, list[int]]:
    """Return a block with every second point of two rays kept out, and these; sigmas of tides, tilt and index."""
    block = read_deck(FIXTURES / deck)
    rays = np.bincount(block.plates.point, minlength=len(block.points.ids))
    rays[block.control.point] = 0
    chosen = np.flatnonzero(rays == 2)[::2]
    out = np.isin(block.plates.point, chosen)
    options |= {"program": program, "refraction": model.Refraction.RIGOROUS}
    block = replace(
        block,
        options=replace(block.options, **options),  # type: ignore[arg-type]
        plates=replace(block.plates, triangulated=block.plates.triangulated & ~out),
    )
    if sigmas and block.water is not None:
        tide_sigma = np.full(len(block.photos.ids), 0.15)
        water = replace(block.water, sigma=0.002, tilt_sigma=1e-4)
        block = replace(block, photos=replace(block.photos, tide_sigma=tide_sigma), water=water)
    return block, chosen.tolist()


def readings_of(block: model.Block, point: int, factor: float) -> tuple[tuple[int, int], Readings]:
    """Return the photos of a point, and its images as readings with the sigmas of their cards times a factor."""
    rows = np.flatnonzero(block.plates.point == point)
    left, right = block.plates.photo[rows].tolist()
    return (left, right), Readings(
        ids=block.points.ids[[point]],
        submerged=block.points.bathymetric[[point]],
        xy=block.plates.xy[rows][None],
        sigma=factor * block.plate_sigmas[rows][None],
    )


def compare(run: Triangulation, solution: model.Solution, points: list[int]) -> None:
    """Hold compiled points against those of the run."""
    working = run.frame.working(solution.points.position)
    bathymetric = solution.bathymetric
    for point in points:
        photos, readings = readings_of(solution.block, point, solution.unit_sigma)
        compiled = true_points(run, photos, readings)
        np.testing.assert_allclose(run.frame.working(compiled.position)[0], working[point], rtol=0, atol=1e-6)
        np.testing.assert_allclose(compiled.covariance[0], solution.points.covariance[point], rtol=1e-6, atol=1e-9)
        rows = np.flatnonzero(solution.block.plates.point == point)
        np.testing.assert_allclose(compiled.residual[0], solution.plates.residual[rows], rtol=0, atol=1e-9)
        for row in np.flatnonzero(bathymetric.point == point):
            assert compiled.depth[0] == pytest.approx(bathymetric.depth[row], abs=1e-6)
            assert compiled.depth_sigma[0] == pytest.approx(bathymetric.depth_sigma[row], rel=1e-6)
            np.testing.assert_allclose(compiled.apparent[0], bathymetric.apparent[row], rtol=0, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("deck", "program", "sigmas", "options"),
    [
        ("st_thomas/st_thomas.crd", model.Program.IIA, False, {}),
        ("st_thomas/st_thomas.crd", model.Program.IIA, True, {}),
        ("st_thomas/st_thomas.crd", model.Program.IIIA, True, ONE),
        ("st_thomas/st_thomas.crd", model.Program.IIIA, True, {**ONE, "water_index": model.Treatment.ADJUST}),
        ("st_thomas/st_thomas.crd", model.Program.IIIA, True, PHOTO),
        ("st_thomas/st_thomas.crd", model.Program.IIIA, True, {**PHOTO, "water_index": model.Treatment.ADJUST}),
        ("cayman/cayman_clean.crd", model.Program.IIIA, False, {}),
    ],
)
def test_points_that_the_run_keeps_out_are_the_same_when_they_are_compiled(
    deck: str, program: model.Program, sigmas: bool, options: dict[str, object], tmp_path: Path
) -> None:
    """To 1e-6 m and 1e-6 of the sigmas, from the solution and from its record."""
    block, points = kept_out(deck, program, sigmas, dict(options))
    solution = adjust(block)
    assert solution.converged and len(points) >= 6
    compare(of_solution(solution), solution, points[:2])
    path = tmp_path / "run.json"
    path.write_text(dumps(record(solution)))
    compare(of_record(path), solution, points)


@pytest.fixture(scope="module")
def strip() -> Triangulation:
    return of_solution(adjust(read_deck(FIXTURES / "st_thomas/st_thomas.crd")))


def one(strip: Triangulation, xy: list[list[float]]) -> TruePoints:
    readings = Readings(
        ids=np.array(["P"]), submerged=np.array([True]), xy=np.array([xy]), sigma=np.full((1, 2, 2), 0.005)
    )
    return true_points(strip, (0, 1), readings)


def test_rays_that_give_no_point_are_told(strip: Triangulation) -> None:
    crossed = one(strip, [[-80.0, 0.0], [80.0, 0.0]])
    assert crossed.reasons == {0: BEHIND} and np.isnan(crossed.position).all() and np.isnan(crossed.depth).all()
    assert PARALLEL_RAYS


def test_the_y_parallax_is_what_the_right_image_is_off(strip: Triangulation) -> None:
    """An image moved by 0.1 mm across its epipolar curve; the sigma of a pointing and of the stations."""
    at = one(strip, [[60.0, 20.0], [-30.0, 20.0]])
    moved = one(strip, [[60.0, 20.0], [-30.0, 20.1]])
    assert moved.y_parallax[0] - at.y_parallax[0] == pytest.approx(0.1, rel=0.01)  # the curve leans a little
    straight = one(strip, [[60.0, 20.0], [-30.0, 20.0 - at.y_parallax[0]]])
    assert abs(straight.y_parallax[0]) < 0.01 * abs(at.y_parallax[0])
    assert np.abs(straight.residual).max() < 0.01 * np.abs(at.residual).max()
    assert np.sqrt(2.0) * 0.005 < at.y_parallax_sigma[0] < 0.02


def test_a_run_that_has_not_converged_is_not_compiled_from() -> None:
    block = read_deck(FIXTURES / "st_thomas/st_thomas.crd")
    solution = adjust(replace(block, options=replace(block.options, max_iterations=1, max_passes=1)))
    with pytest.raises(CompilationError, match="the run has not converged"):
        of_solution(solution)


def test_the_sigma_of_a_y_parallax_is_that_of_both_pointings() -> None:
    """Vertical photos from one height: y right less y left, whose sigma is that of a coordinate times root 2."""
    run = pair(3000.0, 1810.0)
    xy = np.array([[[46.0, 20.0], [-46.0, 20.007]]])
    readings = Readings(
        ids=np.array(["A"]), submerged=np.zeros(1, dtype=bool), xy=xy, sigma=np.full((1, 2, 2), 0.005)
    )
    points = true_points(run, (0, 1), readings)
    assert points.y_parallax[0] == pytest.approx(0.007, rel=1e-9)
    assert points.y_parallax_sigma[0] == pytest.approx(0.005 * np.sqrt(2.0), rel=1e-9)
