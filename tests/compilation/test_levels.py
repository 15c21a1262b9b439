"""The bottom of several models, joined in the middle; contours, posts, and a datum in a grid file."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compilation.scenes import MODEL, deck_of_cards, flat_images, grid, pair, stage_card, surface_of
from musatpy import adjust, read_deck
from musatpy.arrays import FloatArray
from musatpy.as11_runs import of_solution
from musatpy.compilation.answers import places_of
from musatpy.compilation.bottom import Bottom, bottom_of, bottoms_of, grids_of
from musatpy.compilation.compiled import Compiled, DepthDatum, compiled
from musatpy.compilation.joined_surfaces import JoinedSurface
from musatpy.compilation.triangulation import AdjustedRun
from musatpy.compilation.verdicts import warnings_of
from musatpy.errors import CompilationError
from musatpy.formats.compilation_deck import compilation_bytes, read_compilation
from musatpy.model.compilation import (
    Compilation,
    ContourSpec,
    GridSpecs,
    SoundingDatum,
    StageReadings,
    StereomodelSpecs,
)
from musatpy.model.tables import empty
from musatpy.reports.compilation_bottom import contours_csv
from musatpy.units import DEGREE
from stage_readings import FIXTURES, compilation

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
        models=StereomodelSpecs(
            ids=names,
            left=np.full(len(names), "1"),
            right=np.full(len(names), "2"),
            pointing=np.full(len(names), 0.005),
        ),
        stages=StageReadings(
            model=model,
            ids=np.array([f"{row}" for row in range(count)]),
            kind=np.full(count, "G"),
            submerged=np.ones(count, dtype=bool),
            xy=flat_images(run, np.concatenate(points)),
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
    place = grid.coordinates(DepthDatum())
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


def noisy(seed: int, number: int = 150, sigma: float = 0.2) -> JoinedSurface:
    """Return the surface of points of the rolling bottom with errors."""
    draws = np.random.default_rng(seed)
    xy = draws.uniform(0.0, 1000.0, (number, 2))
    return surface_of(np.column_stack([xy, rolling(xy) + sigma * draws.normal(size=number)]), sigma)


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
        truth = rolling(by_tin.coordinates(DepthDatum())[:, :2]).reshape(by_tin.depth.shape)
        error.append([np.square(grid.depth - truth).mean() for grid in (by_tin, by_collocation)])
        tests.append(np.square((by_collocation.depth - truth) / by_collocation.sigma).mean())
        assert by_tin.validation is None and by_collocation.validation is not None
        left_out.append(by_collocation.validation.standardised_rms)
    of_triangles, of_collocation = np.sqrt(np.mean(error, axis=0))
    assert of_collocation < 0.67 * of_triangles
    assert 0.8 < np.sqrt(np.mean(tests)) < 1.2 and 0.85 < np.mean(left_out) < 1.15


@pytest.mark.slow
def test_posts_by_collocation_are_empty_where_there_is_no_surface() -> None:
    (grid,) = grids_of(grid_specs(100.0, (-300.0, 0.0), (1000.0, 1000.0), collocated=True), (noisy(1),), 1.0)
    (by_tin,) = grids_of(grid_specs(100.0, (-300.0, 0.0), (1000.0, 1000.0)), (noisy(1),), 1.0)
    assert grid.empty == by_tin.empty > 0
    np.testing.assert_array_equal(np.isnan(grid.depth), np.isnan(by_tin.depth))


@pytest.mark.parametrize(("number", "message"), [(4, "are too few"), (2001, "2001 points are too many")])
def test_too_few_or_too_many_points_for_a_collocation_are_refused(number: int, message: str) -> None:
    with pytest.raises(CompilationError, match=f"grid A: .*{message}"):
        grids_of(grid_specs(100.0, collocated=True), (noisy(2, number),), 1.0)


_SLOPE = 0.02  # of a beach that rises to the east through the water at X = 900 m


def beach(*cards: str) -> Compiled:
    """Return the compilation of points on a plane beach from 13.8 m of depth to 14.2 m of height, without error."""
    run = pair(3000.0, 1810.0)
    xy = grid((210.0, 1610.0), 700.0, 9)
    height = _SLOPE * (xy[:, 0] - 900.0)
    wet = height < 0.0
    images = np.where(
        wet[:, None, None],
        flat_images(run, np.column_stack([xy, height])),
        straight_images(run, np.column_stack([xy, height])),
    )
    readings = [stage_card(str(row), "GB" if wet[row] else "G ", stages) for row, stages in enumerate(images)]
    return compiled(run, deck_of_cards(MODEL, *cards, *readings))


def straight_images(run: AdjustedRun, points: FloatArray) -> FloatArray:
    """Return the images (k, 2, 2) mm of points on land."""
    gap = points[:, None] - run.block.photos.position
    return np.asarray(-run.block.cameras.focal_length[0] * gap[..., :2] / gap[..., 2:])


def levels(bottom: Bottom) -> list[float]:
    return [line.level for sheet in bottom.sheets for line in sheet.contours.lines]


def test_depths_count_from_the_datum_and_have_its_sigma() -> None:
    plain, below = beach(), beach("VDT MLLW        -0.1500  0.3000")
    depth, sigma = below.datum_depth, below.datum_depth_sigma
    bottom = _SLOPE * (plain.points.position[:, 0] - 900.0)
    np.testing.assert_allclose(depth, -0.15 - bottom, rtol=0, atol=1e-4)  # of readings in 1e-6 mm
    np.testing.assert_allclose(sigma**2, plain.datum_depth_sigma**2 + 0.3**2, rtol=1e-9)


def test_depths_end_at_the_deepest_dry_point_unless_the_foreshore_belongs_to_them() -> None:
    """Posts are 175 m apart, 3.5 m of height: the shallowest submerged one is 3.3 m deep."""
    (plain,) = bottoms_of(beach("CIN    2.000"))
    assert levels(plain) == [4.0, 6.0, 8.0, 10.0, 12.0]
    result = beach("CIN    2.000                         7.500")
    (bottom,) = bottoms_of(result)
    assert levels(bottom) == [-6.0, -4.0, -2.0, 0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0]
    for line in bottom.sheets[0].contours.lines:
        # To what six decimals of a stage leave: 0.5 nm at a scale of 1 to 20,000, over the slope.
        np.testing.assert_allclose(line.xy[:, 0], 900.0 - line.level / _SLOPE, rtol=0, atol=2e-3)
        assert line.xy[-1, 1] < line.xy[0, 1]  # deeper to the west, on the right
    _, *rows = contours_csv(bottom, places_of(result), result.datum).splitlines()
    cells = np.array([row.split(",") for row in rows], dtype=float)
    np.testing.assert_allclose(cells[:, 7], -cells[:, 2], rtol=0, atol=1e-4)


def test_contours_of_height_are_over_land_and_bottom() -> None:
    result = beach("CIN    2.000", "CIN    5.000  2                 H")
    depths, heights = bottoms_of(result)
    assert (depths.of, heights.of) == ("depth", "height") and levels(heights) == [-10.0, -5.0, 0.0, 5.0, 10.0]
    (sheet,) = heights.sheets
    assert sheet.name == "H1" and [line.index for line in sheet.contours.lines] == [True, False, True, False, True]
    for line in sheet.contours.lines:
        np.testing.assert_allclose(line.xy[:, 0], 900.0 + line.level / _SLOPE, rtol=0, atol=2e-3)
        assert line.xy[-1, 1] > line.xy[0, 1]  # the higher ground, in the east, on the right
    cells = [row.split(",") for row in contours_csv(heights, places_of(result), result.datum).splitlines()]
    assert cells[0][2] == "level" and all(row[1] == "H1" for row in cells[1:])
    np.testing.assert_allclose(
        [float(row[7]) for row in cells[1:]], [float(row[2]) for row in cells[1:]], atol=1e-4
    )


def test_listed_levels_stand_beside_those_of_the_interval() -> None:
    cards = "CIN    4.000  9", "CIL      4.000   5.500  99.000", "CIL  I   7.250"
    (bottom,) = bottoms_of(beach(*cards))
    assert levels(bottom) == [4.0, 5.5, 7.25, 8.0, 12.0]
    assert [line.level for line in bottom.sheets[0].contours.lines if line.index] == [7.25]
    (alone,) = bottoms_of(beach("CIN", "CIL      4.000   5.500"))
    assert levels(alone) == [4.0, 5.5]


def test_contours_may_be_those_of_the_posts_of_a_grid() -> None:
    """A plane is a plane in the posts too; what is beside the grid has none."""
    cards = (
        "GRD A           50.00" + "".join(f"{corner:13.2f}" for corner in (310.0, -400.0, 690.0)) + "      400.00",
        "CIN    2.000" + 31 * " " + "A",
    )
    (bottom,) = bottoms_of(beach(*cards))
    (sheet,) = bottom.sheets
    assert sheet.name == "A" and levels(bottom) == [6.0, 8.0, 10.0]
    for line in sheet.contours.lines:
        np.testing.assert_allclose(line.xy[:, 0], 900.0 - line.level / _SLOPE, rtol=0, atol=2e-3)
        assert (
            line.length == pytest.approx(800.0, abs=0.01) and line.xy[-1, 1] < line.xy[0, 1]
        )  # deeper to the west


def test_a_deck_without_contours_and_grids_has_no_bottom() -> None:
    assert bottom_of(beach()) is None and bottoms_of(beach()) == ()


# --- a datum that a grid file has ---


def tilted_datum(folder: Path) -> Path:
    """Return the file of a surface that is -0.15 m at 64.93 W and rises by 4 m a degree to the east."""
    east = -64.96 + 0.01 * np.arange(7.0)
    values = (-0.15 + 4.0 * (east + 64.93)) + np.zeros((8, 1))
    path = folder / "mllw.gtx"
    head = np.array([18.30, -64.96, 0.01, 0.01]).astype(">f8").tobytes() + np.array([8, 7]).astype(">i4").tobytes()
    path.write_bytes(head + values.astype(">f4").tobytes())
    return path


@pytest.fixture(scope="module")
def st_thomas() -> AdjustedRun:
    return of_solution(adjust(read_deck(FIXTURES / "st_thomas/st_thomas.crd")))


@pytest.mark.slow
def test_depths_below_a_datum_in_a_grid_file(st_thomas: AdjustedRun, tmp_path: Path) -> None:
    """Depths by the surface at each point, contours at its height there less their depth."""
    spec = SoundingDatum(name="MLLW", height=0.02, sigma=0.05, geoid=str(tilted_datum(tmp_path)))
    result = compiled(st_thomas, replace(compilation(), datum=spec))
    position = result.points.position
    surface = 0.02 - 0.15 + 4.0 * (position[:, 1] / DEGREE + 64.93)
    np.testing.assert_allclose(result.datum_depth, surface - position[:, 2], rtol=0, atol=1e-6)  # file: float32
    bottom = bottom_of(result)
    assert bottom is not None
    rows = [row.split(",") for row in contours_csv(bottom, places_of(result), result.datum).splitlines()[1:]]
    depth, longitude, height = (np.array([float(row[place]) for row in rows]) for place in (2, 6, 7))
    np.testing.assert_allclose(height, 0.02 - 0.15 + 4.0 * (longitude + 64.93) - depth, rtol=0, atol=1e-4)
    (posts,) = bottom.grids
    place = posts.coordinates(result.datum)
    np.testing.assert_allclose(
        place[:, 2], -0.13 + 4.0 * (place[:, 1] / DEGREE + 64.93) - posts.depth.ravel(), rtol=0, atol=1e-6
    )


def test_points_outside_the_grid_of_a_datum_have_no_depth_below_it(st_thomas: AdjustedRun, tmp_path: Path) -> None:
    path = tilted_datum(tmp_path)
    data = bytearray(path.read_bytes())
    data[8:16] = np.array(-64.935).astype(">f8").tobytes()  # it begins farther east
    path.write_bytes(data)
    spec = SoundingDatum(name="MLLW", geoid=str(path))
    result = compiled(st_thomas, replace(compilation(), datum=spec))
    west = result.points.position[:, 1] < -64.935 * DEGREE
    np.testing.assert_array_equal(np.isnan(result.datum_depth), west)
    assert f"{west.sum()} points lie outside the grid of the datum MLLW" in list(warnings_of(result))


def test_a_local_job_has_no_grid_of_heights() -> None:
    deck = beach().deck
    with pytest.raises(CompilationError, match="local job"):
        compiled(pair(3000.0, 1810.0), replace(deck, datum=SoundingDatum(geoid="any.gtx")))
    bad = compilation_bytes(replace(deck, datum=SoundingDatum(name="A", geoid="any.gtx")))
    with pytest.raises(Exception, match=r"VDT.geoid: the run is a local job"):
        read_compilation(bad, pair(3000.0, 1810.0).block)


@pytest.mark.parametrize(
    ("height", "side"), [(None, ""), (-0.15, ""), (19.0, ""), (21.0, "20.8 m above"), (-42.0, "42.2 m below")]
)
def test_a_sounding_datum_far_from_the_water_is_told(
    st_thomas: AdjustedRun, height: float | None, side: str
) -> None:
    """The height 0 of a job without a datum is none."""
    datum = None if height is None else SoundingDatum(name="MLLW", height=height)
    result = compiled(st_thomas, replace(compilation(), datum=datum))
    told = [text for text in warnings_of(result) if text.startswith("the sounding datum is")]
    assert len(told) == bool(side)
    assert side in "".join(told)
