"""The bottom of several models: how they match where they overlap, and one surface joined in the middle."""

from __future__ import annotations

import numpy as np
import pytest

from compilation.scenes import flat_images, pair
from musatpy.arrays import FloatArray
from musatpy.compilation.bottom import Bottom, bottom_of
from musatpy.compilation.compiled import compiled
from musatpy.compilation.datums import Datum
from musatpy.compilation.grids import grids_of
from musatpy.compilation.joined_surfaces import BottomPoints, Surface
from musatpy.errors import CompilationError
from musatpy.model.compilation import Compilation, ContourSpec, GridSpecs, StageReadings, StereomodelSpecs
from musatpy.model.tables import empty
from musatpy.surfaces.tin import Tin

_WEST, _EAST, _FAR = (200.0, 1000.0), (800.0, 1600.0), (1400.0, 1600.0)  # X of the models, m


def depths(xy: FloatArray) -> FloatArray:
    """Return the depths (k,) of a plane bottom at places (k, 2)."""
    return np.asarray(2.0 + 0.012 * xy[:, 0] + 0.003 * xy[:, 1])


def places(X: tuple[float, float], seed: int, number: int = 60) -> FloatArray:
    draws = np.random.default_rng(seed)
    corners = [[x, y] for x in X for y in (-500.0, 500.0)]
    return np.concatenate([corners, np.column_stack([draws.uniform(*X, number), draws.uniform(-500, 500, number)])])


def bottom(
    *extents: tuple[float, float],
    deeper: tuple[float, ...] = (),
    grids: GridSpecs | None = None,
    slips: tuple[float, ...] = (),
) -> Bottom:
    """Return the bottom of models of one pair of photos, each of its part of a plane, by so much deeper.

    The last points of each model were set at the heights `slips`, flagged as submerged all the same.
    """
    run = pair(3000.0, 1810.0)
    names = np.array([f"M{row}" for row in range(len(extents))])
    xy = [places(extent, row) for row, extent in enumerate(extents)]
    shift = [*deeper, *[0.0] * len(extents)]
    points = [np.column_stack([at, -depths(at) - more]) for at, more in zip(xy, shift, strict=False)]
    for at in points:
        at[len(at) - len(slips) :, 2] = slips
    model = np.repeat(np.arange(len(extents)), [len(at) for at in xy])
    count = len(model)
    deck = Compilation(
        titles=(),
        models=StereomodelSpecs.of_photos(names, np.full(len(names), "1"), np.full(len(names), "2"), 0.005),
        stages=StageReadings.on_stages(
            model=model,
            ids=np.array([f"{row}" for row in range(count)]),
            kind=np.full(count, "G"),
            submerged=np.ones(count, dtype=bool),
            xy=flat_images(run, np.concatenate(points)),
            sigma=np.full(count, np.nan),
        ),
        contours=ContourSpec(interval=2.0),
        grids=empty(GridSpecs) if grids is None else grids,
    )
    result = bottom_of(compiled(run, deck))
    assert result is not None
    return result


def test_models_that_overlap_make_one_surface_with_contours_across_the_join() -> None:
    result = bottom(_WEST, _EAST)
    (surface,), (lines,) = result.surfaces, [sheet.contours for sheet in result.sheets]
    assert surface.models == ("M0", "M1") and surface.tin is not None
    # 1400 x 1000 m; the seam leaves out what lies beyond it, and no corner.
    assert surface.tin.area == pytest.approx(1.4e6, rel=1e-9) and surface.left_out > 10
    assert len(surface.tin.z) + surface.left_out == 2 * 64
    assert [line.level for line in lines.lines] == list(range(4, 24, 2))
    for line in lines.lines:
        # Straight to the rounding of compiled points, in spite of triangles across the seam.
        np.testing.assert_allclose(depths(line.xy), line.level, rtol=0, atol=1e-6)
    (edge,) = result.edges
    assert edge.models == ("M0", "M1") and edge.rms < 1e-6


def test_the_edge_match_is_the_first_model_less_the_second() -> None:
    result = bottom(_WEST, _EAST, deeper=(0.0, 0.5))
    (edge,) = result.edges
    np.testing.assert_allclose(edge.difference, -0.5, rtol=0, atol=1e-6)
    assert len(edge.names) > 20 and edge.rms == pytest.approx(0.5, abs=1e-6)
    # In air a height has a sigma of .23 m here (H/B sqrt 2 of 5 um), through water 1.34 times that; triangles less.
    assert 1.34 * 0.23 < edge.expected < 1.5 * 1.34 * 0.23
    tin = result.surfaces[0].tin
    assert tin is not None
    on_west = tin.xy[:, 0] < 850.0  # the middles lie at 600 and 1200 m, give and take those of the drawn points
    np.testing.assert_allclose(tin.z[on_west] - depths(tin.xy[on_west]), 0.0, rtol=0, atol=1e-6)
    on_east = tin.xy[:, 0] > 950.0
    np.testing.assert_allclose(tin.z[on_east] - depths(tin.xy[on_east]), 0.5, rtol=0, atol=1e-6)


def test_models_apart_have_surfaces_of_their_own_and_a_third_may_join_them() -> None:
    result = bottom(_WEST, _FAR)
    assert [surface.models for surface in result.surfaces] == [("M0",), ("M1",)] and not result.edges
    joined = bottom(_WEST, _FAR, (900.0, 1500.0))
    assert [surface.models for surface in joined.surfaces] == [("M0", "M1", "M2")]
    assert [edge.models for edge in joined.edges] == [("M0", "M2"), ("M1", "M2")]


def test_a_submerged_point_above_the_water_is_not_in_the_bottom() -> None:
    (surface,) = bottom(_WEST, slips=(30.0, 0.2)).surfaces
    # The second one is less than three sigmas of its height above the water.
    assert surface.tin is not None and len(surface.tin.z) == 63
    assert -0.2 < surface.tin.z.min() < -0.1


def grid_specs(spacing: float, *corners: tuple[float, float], collocated: bool = False) -> GridSpecs:
    first, second = corners or ((np.nan, np.nan),) * 2
    return GridSpecs(
        ids=np.array(["A"]),
        collocated=np.array([collocated]),
        spacing=np.array([spacing]),
        first=np.array([first]),
        second=np.array([second]),
    )


def test_posts_stand_at_multiples_of_their_spacing_and_are_empty_beside_the_surface() -> None:
    result = bottom(_WEST, _EAST, grids=grid_specs(25.0, (1630.0, 410.0), (1490.0, -30.0)))
    (grid,) = result.grids
    assert (grid.west, grid.south, grid.depth.shape) == (1500.0, -25.0, (18, 6))
    place = grid.coordinates(Datum())
    # A plane is exact, to the rounding of compiled points; beyond X = 1600 m there is no surface.
    east = place[:, 0] > 1600.0
    np.testing.assert_allclose(grid.depth.ravel()[~east], depths(place[~east, :2]), rtol=0, atol=1e-6)
    assert np.isnan(grid.depth.ravel()[east]).all() and grid.empty == east.sum() == 18
    np.testing.assert_allclose(place[~east, 2], -grid.depth.ravel()[~east], rtol=0, atol=1e-12)
    assert (grid.sigma[np.isfinite(grid.depth)] > 0.1).all()


def test_a_grid_without_corners_covers_the_bottom_and_one_of_no_posts_is_refused() -> None:
    (grid,) = bottom(_WEST, _FAR, grids=grid_specs(90.0)).grids
    assert (grid.west, grid.south, grid.depth.shape) == (270.0, -450.0, (11, 15))
    assert grid.empty == 11 * 4  # X of 1080 to 1350 m, between the models
    with pytest.raises(CompilationError, match="grid A has 0 posts"):
        bottom(_WEST, grids=grid_specs(500.0, (210.0, 10.0), (400.0, 20.0)))
    with pytest.raises(
        CompilationError, match=r"grid A has 1\.4e\+14 posts: give another spacing \(1 to 250,000 posts\)"
    ):
        bottom(_WEST, _EAST, grids=grid_specs(1e-4))


def rolling(xy: FloatArray) -> FloatArray:
    """Return the depths (k,) of a smooth bottom at places (k, 2)."""
    return np.asarray(9.0 + 0.004 * xy[:, 0] + 1.5 * np.sin(xy[:, 0] / 150.0) * np.cos(xy[:, 1] / 130.0))


def noisy(seed: int, number: int = 150, sigma: float = 0.2) -> Surface:
    """Return the surface of points of the rolling bottom with errors."""
    draws = np.random.default_rng(seed)
    xy = draws.uniform(0.0, 1000.0, (number, 2))
    depth, sigmas = rolling(xy) + sigma * draws.normal(size=number), np.full(number, sigma)
    points = BottomPoints(xy=xy, depth=depth, sigma=sigmas, water=np.zeros(number))
    tin = Tin.of(np.column_stack([xy, depth]), sigmas)
    return Surface(models=("M",), points=points, tin=tin, plan=None)


@pytest.mark.slow
def test_posts_by_collocation_are_nearer_to_the_truth_and_know_how_near() -> None:
    """Of eight bottoms: two thirds of the triangles' errors at most; errors over sigmas by their 2,000 posts."""
    corners, error, tests, left_out = ((200.0, 200.0), (800.0, 800.0)), [], [], []
    for seed in range(8):
        surfaces = (noisy(seed),)
        by_tin, by_collocation = (
            grids_of(grid_specs(40.0, *corners, collocated=collocated), surfaces, 1.0)[0]
            for collocated in (False, True)
        )
        truth = rolling(by_tin.coordinates(Datum())[:, :2]).reshape(by_tin.depth.shape)
        error.append([np.square(grid.depth - truth).mean() for grid in (by_tin, by_collocation)])
        tests.append(np.square((by_collocation.depth - truth) / by_collocation.sigma).mean())
        assert by_tin.validation is None and by_collocation.validation is not None
        left_out.append(by_collocation.validation.standardised_rms)
    of_triangles, of_collocation = np.sqrt(np.mean(error, axis=0))
    assert of_collocation < 0.67 * of_triangles
    assert 0.8 < np.sqrt(np.mean(tests)) < 1.2 and 0.85 < np.mean(left_out) < 1.15


def test_posts_by_collocation_are_empty_where_there_is_no_surface() -> None:
    (grid,) = grids_of(grid_specs(100.0, (-300.0, 0.0), (1000.0, 1000.0), collocated=True), (noisy(1),), 1.0)
    (by_tin,) = grids_of(grid_specs(100.0, (-300.0, 0.0), (1000.0, 1000.0)), (noisy(1),), 1.0)
    assert grid.empty == by_tin.empty > 0
    np.testing.assert_array_equal(np.isnan(grid.depth), np.isnan(by_tin.depth))


@pytest.mark.parametrize(("number", "message"), [(4, "are too few"), (2001, "2001 points are too many")])
def test_too_few_or_too_many_points_for_a_collocation_are_refused(number: int, message: str) -> None:
    with pytest.raises(CompilationError, match=f"grid A: .*{message}"):
        grids_of(grid_specs(100.0, collocated=True), (noisy(2, number),), 1.0)
