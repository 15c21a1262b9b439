"""What contours are asked for: depths, heights, listed levels, the foreshore, posts; a datum in a grid file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from compilation.scenes import flat_images, grid, pair
from musatpy import adjust, read_deck
from musatpy.arrays import FloatArray
from musatpy.compilation.bottom import Bottom, bottom_of, bottoms_of
from musatpy.compilation.compiled import Compiled, compiled
from musatpy.compilation.file_places import places_of
from musatpy.compilation.triangulation import Triangulation, of_solution
from musatpy.errors import CompilationError
from musatpy.formats.compilation_deck import compilation_bytes, read_compilation
from musatpy.model.compilation import Compilation, SoundingDatum
from musatpy.reports.compilation_bottom import contours_csv
from musatpy.units import DEGREE
from stage_readings import FIXTURES, compilation

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
    lines = ["MDL 1        1        2                                          5.00", *cards]
    for row, stages in enumerate(images.reshape(-1, 4)):
        flag = "B" if wet[row] else " "
        lines.append(f"STG 1        {row:<8} G{flag}" + "".join(f"{value:11.6f}" for value in stages))
    deck, warnings = read_compilation("\n".join([*lines, "END", ""]).encode())
    assert not warnings and compilation_bytes(read_compilation(compilation_bytes(deck))[0]) == compilation_bytes(
        deck
    )
    return compiled(run, deck)


def straight_images(run: Triangulation, points: FloatArray) -> FloatArray:
    """Return the images (k, 2, 2) mm of points on land."""
    gap = points[:, None] - run.block.photos.position
    return np.asarray(-run.block.cameras.focal_length[0] * gap[..., :2] / gap[..., 2:])


def levels(bottom: Bottom) -> list[float]:
    return [line.level for sheet in bottom.sheets for line in sheet.contours.lines]


def test_depths_count_from_the_datum_and_have_its_sigma() -> None:
    plain, below = beach(), beach("VDT MLLW        -0.1500  0.3000")
    depth, sigma = below.datum_depth
    bottom = _SLOPE * (plain.gathered("position")[:, 0] - 900.0)
    np.testing.assert_allclose(depth, -0.15 - bottom, rtol=0, atol=1e-4)  # of readings in 1e-6 mm
    np.testing.assert_allclose(sigma**2, plain.datum_depth[1] ** 2 + 0.3**2, rtol=1e-9)


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
def st_thomas() -> Triangulation:
    return of_solution(adjust(read_deck(FIXTURES / "st_thomas/st_thomas.crd")))


def with_datum(spec: SoundingDatum) -> Compilation:
    return replace(compilation(), datum=spec)


def test_depths_below_a_datum_in_a_grid_file(st_thomas: Triangulation, tmp_path: Path) -> None:
    """Depths by the surface at each point, contours at its height there less their depth."""
    spec = SoundingDatum(name="MLLW", height=0.02, sigma=0.05, geoid=str(tilted_datum(tmp_path)))
    result = compiled(st_thomas, with_datum(spec))
    position = result.gathered("position")
    surface = 0.02 - 0.15 + 4.0 * (position[:, 1] / DEGREE + 64.93)
    np.testing.assert_allclose(result.datum_depth[0], surface - position[:, 2], rtol=0, atol=1e-6)  # file: float32
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


def test_points_outside_the_grid_of_a_datum_have_no_depth_below_it(
    st_thomas: Triangulation, tmp_path: Path
) -> None:
    path = tilted_datum(tmp_path)
    data = bytearray(path.read_bytes())
    data[8:16] = np.array(-64.935).astype(">f8").tobytes()  # it begins farther east
    path.write_bytes(data)
    result = compiled(st_thomas, with_datum(SoundingDatum(name="MLLW", geoid=str(path))))
    west = result.gathered("position")[:, 1] < -64.935 * DEGREE
    np.testing.assert_array_equal(np.isnan(result.datum_depth[0]), west)
    assert f"{west.sum()} points lie outside the grid of the datum MLLW" in list(result.warnings())


def test_a_local_job_has_no_grid_of_heights() -> None:
    deck = beach().deck
    with pytest.raises(CompilationError, match="local job"):
        compiled(pair(3000.0, 1810.0), replace(deck, datum=SoundingDatum(geoid="any.gtx")))
    bad = compilation_bytes(replace(deck, datum=SoundingDatum(name="A", geoid="any.gtx")))
    with pytest.raises(Exception, match=r"VDT.geoid: the run is a local job"):
        read_compilation(bad, pair(3000.0, 1810.0).block)


@pytest.mark.parametrize(
    ("height", "side"), [(-0.15, ""), (19.0, ""), (21.0, "20.8 m above"), (-42.0, "42.2 m below")]
)
def test_a_sounding_datum_far_from_the_water_is_told(st_thomas: Triangulation, height: float, side: str) -> None:
    result = compiled(st_thomas, with_datum(SoundingDatum(name="MLLW", height=height)))
    told = [text for text in result.warnings() if text.startswith("the sounding datum is")]
    assert len(told) == bool(side)
    assert side in "".join(told)


def test_the_height_0_of_a_job_is_no_sounding_datum(st_thomas: Triangulation) -> None:
    result = compiled(st_thomas, with_datum(None))
    assert not any("sounding datum" in text for text in result.warnings())
