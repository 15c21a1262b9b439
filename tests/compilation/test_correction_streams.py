"""Files of many points and posts corrected in chunks: the same as in one, and whole or not at all."""

import os
import signal
import struct
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest
import rasterio
from click.testing import Result

from cli.commands import musat
from compilation.scenes import pair
from musatpy.arrays import FloatArray
from musatpy.compilation import correction_rasters
from musatpy.compilation.correcting import Correction
from musatpy.compilation.correction_layers import Survey
from musatpy.compilation.correction_rasters import corrected_grid
from musatpy.compilation.stereomodels import set_up
from musatpy.geometry.systems import LocalRectangular
from musatpy.interchange import geotiff, xyz
from musatpy.interchange.any_file import write_layers
from musatpy.interchange.layers import Grid
from musatpy.pointfiles import point_tables

WEST, EAST, SOUTH, NORTH = -64.938, -64.932, 18.328, 18.336  # in the model


def words(record: Path, source: Path, target: Path, *options: str) -> list[str]:
    return ["as11", "correct", str(record), "21", "22", str(source), "-o", str(target), *options]


def corrected(record: Path, source: Path, target: Path, *options: str) -> Result:
    return musat(*words(record, source, target, *options))


def apparent(count: int) -> FloatArray:
    return np.random.default_rng(5).uniform([WEST, SOUTH, -12.0], [EAST, NORTH, -1.0], (count, 3))


def table(path: Path, points: FloatArray) -> Path:
    rows = [f"{i:04d},{x:.9f},{y:.9f},{z:.4f},ü {i}\n" for i, (x, y, z) in enumerate(points.tolist())]
    path.write_text("id,x,y,z,remark\n" + "".join(rows))
    return path


def test_chunks_of_a_text_file_are_the_whole_of_it(
    run_record: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Seven lines at a time, blank ones and one off the plate among them: the same bytes as in one chunk."""
    points = apparent(60)
    points[20, 0] = -64.5
    table(tmp_path / "a.csv", points)
    text = (tmp_path / "a.csv").read_text().splitlines(keepends=True)
    (tmp_path / "a.csv").write_text("".join([*text[:10], "\n", "  \n", *text[10:]]))
    assert corrected(run_record, tmp_path / "a.csv", tmp_path / "whole.csv").exit_code == 0
    monkeypatch.setattr(point_tables, "CHUNK", 7)
    result = corrected(run_record, tmp_path / "a.csv", tmp_path / "parts.csv")
    assert "points: 59 of 60 with a position" in result.output
    assert (tmp_path / "parts.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()
    rows = (tmp_path / "parts.csv").read_text().splitlines()
    assert rows[0].startswith("x,y,z,id,remark,depth [m],") and rows[1].split(",")[3:5] == ["0000", "ü 0"]


def test_a_cloud_keeps_what_its_points_have(run_record: Path, tmp_path: Path) -> None:
    """Intensity, class, time and a dimension of its own stay; points off the plate go with all that is theirs."""
    points = apparent(500)
    points[::50, 0] = -64.5
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.array([1e-9, 1e-9, 1e-4]), np.array([-65.0, 18.0, 0.0])
    header.add_extra_dims([laspy.ExtraBytesParams(name="swath", type="u2")])
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = points.T
    cloud.intensity, cloud.gps_time = np.arange(500), np.arange(500) * 0.5
    cloud.classification, cloud.swath = np.arange(500) % 30, np.arange(500) % 7
    cloud.write(tmp_path / "a.laz")
    result = corrected(run_record, tmp_path / "a.laz", tmp_path / "true.las")
    assert result.exit_code == 0 and "points: 490 of 500 with a position" in result.output
    kept = np.arange(500) % 50 > 0
    found = laspy.read(tmp_path / "true.las")
    for name in ("intensity", "gps_time", "classification", "swath"):
        np.testing.assert_array_equal(found[name], np.array(cloud[name])[kept])
    data = (tmp_path / "true.las").read_bytes()  # and as LAS 1.4 R15 has it: points of 30 bytes, then their own
    (start,), (length,), (count,) = (
        struct.unpack_from(*at) for at in (("<I", data, 96), ("<H", data, 105), ("<Q", data, 247))
    )
    assert (length, count) == (30 + 2 + 5 * 4, 490)
    scale, offset = np.array(struct.unpack_from("<6d", data, 131)).reshape(2, 3)
    rows = np.array([struct.unpack_from("<3i", data, start + length * row) for row in range(count)])
    np.testing.assert_allclose(rows * scale + offset, found.xyz, rtol=0.0, atol=1e-9)
    depths = [struct.unpack_from("<f", data, start + length * row + 32)[0] for row in range(count)]
    np.testing.assert_array_equal(depths, found["depth"])
    table(tmp_path / "a.csv", points[kept])
    assert corrected(run_record, tmp_path / "a.csv", tmp_path / "true.csv").exit_code == 0
    rows = xyz.read(tmp_path / "true.csv")
    # Both files hold 0.1 mm, and columns of the cloud single precision.
    np.testing.assert_allclose(found.xyz, rows.xyz, rtol=0.0, atol=1.1e-4)
    np.testing.assert_allclose(found["depth"], rows.columns["depth"].values, rtol=0.0, atol=1.1e-4)
    np.testing.assert_allclose(found["sigma_up"], rows.columns["sigma_up"].values, rtol=0.0, atol=1.1e-4)


@pytest.mark.parametrize(("source", "target"), [("a.las", "t.csv"), ("a.csv", "t.laz"), ("a.xyz", "t.csv")])
def test_points_go_from_one_format_into_another(run_record: Path, tmp_path: Path, source: str, target: str) -> None:
    points = apparent(100)
    np.savetxt(tmp_path / "a.csv", points, "%.9f", ",", header="x,y,z", comments="")
    np.savetxt(tmp_path / "a.xyz", points, "%.9f")
    assert corrected(run_record, tmp_path / "a.csv", tmp_path / "expected.csv").exit_code == 0
    header = laspy.LasHeader(version="1.2", point_format=0)
    header.scales, header.offsets = np.array([1e-9, 1e-9, 1e-4]), np.array([-65.0, 18.0, 0.0])
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = points.T
    cloud.write(tmp_path / "a.las")
    result = corrected(run_record, tmp_path / source, tmp_path / target)
    assert result.exit_code == 0, result.output
    expected = xyz.read(tmp_path / "expected.csv")
    if target.endswith("laz"):
        found = laspy.read(tmp_path / target)
        coordinates, sigma = found.xyz, found["sigma_depth"]
    else:
        rows = xyz.read(tmp_path / target)
        coordinates, sigma = rows.xyz, rows.columns["sigma_depth"].values
    np.testing.assert_allclose(coordinates, expected.xyz, rtol=0.0, atol=1.1e-4)
    np.testing.assert_allclose(sigma, expected.columns["sigma_depth"].values, rtol=0.0, atol=1.1e-4)


def test_texts_do_not_go_into_a_cloud(run_record: Path, tmp_path: Path) -> None:
    table(tmp_path / "a.csv", apparent(10))
    result = corrected(run_record, tmp_path / "a.csv", tmp_path / "true.las")
    assert result.exit_code == 1 and "columns remark: texts; expected: numbers" in result.output
    assert not (tmp_path / "true.las").exists()


def bottom(path: Path) -> Grid:
    """Write a raster of apparent heights of a slope, with an empty post."""
    height = -2.0 - 0.05 * np.add.outer(np.arange(60.0), np.arange(40.0))
    height[30, 20] = np.nan
    grid = Grid(west=-64.9365, south=18.3300, spacing=2e-5, bands={"z": height})
    crs = "+proj=longlat +ellps=clrk66 +type=crs"
    with rasterio.open(
        path, "w", driver="GTiff", width=40, height=60, count=1, dtype="float64", nodata=np.nan, crs=crs,
        transform=rasterio.Affine(2e-5, 0.0, grid.west - 1e-5, 0.0, -2e-5, grid.south + 59.5 * 2e-5),
    ) as dataset:  # fmt: skip
        dataset.write(height[::-1], 1)
    return grid


@pytest.mark.slow
def test_rows_of_a_raster_are_the_whole_of_it(
    run_record: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bottom(tmp_path / "a.tif")
    assert corrected(run_record, tmp_path / "a.tif", tmp_path / "whole.tif").exit_code == 0
    monkeypatch.setattr(correction_rasters, "CHUNK", 160)
    assert corrected(run_record, tmp_path / "a.tif", tmp_path / "parts.tif").exit_code == 0
    whole, parts = (geotiff.read(tmp_path / f"{name}.tif") for name in ("whole", "parts"))
    for name in ("height", "depth", "sigma"):
        # An apparent place is sought until it is still by 1e-7 m.
        np.testing.assert_allclose(parts.bands[name], whole.bands[name], rtol=0.0, atol=1e-7)
    assert 1 < np.isnan(whole.bands["depth"]).sum() < 150  # beside the empty post, and at edges


@pytest.mark.slow
@pytest.mark.parametrize(("south", "fall"), [(1500.0, -0.01), (-1500.0, 0.01)])
def test_as_many_rows_are_read_as_posts_move_over(
    south: float, fall: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Posts of 2 cm, whose apparent places lie several rows north or south of them: by single rows as in one."""
    run = pair(3000.0, 1810.0)
    cameras = replace(run.block.cameras, format_size=np.full((1, 2), 228.6))
    run = replace(run, block=replace(run.block, cameras=cameras))
    correction = Correction(stereo=set_up(run, "1", "2"), system=LocalRectangular(), pointing=0.005)
    height = -8.0 + fall * np.add.outer(np.arange(30.0), np.arange(6.0))
    grid = Grid(west=1500.0, south=south, spacing=0.02, bands={"z": height})
    whole, tally = corrected_grid(correction, grid, "z")
    assert tally.shift > 0.04 and tally.known > 10
    monkeypatch.setattr(correction_rasters, "CHUNK", 6)
    parts, _ = corrected_grid(correction, grid, "z")
    np.testing.assert_allclose(parts.bands["height"], whole.bands["height"], rtol=0.0, atol=1e-7)


@pytest.mark.slow
def test_posts_of_a_raster_become_points(run_record: Path, tmp_path: Path) -> None:
    bottom(tmp_path / "a.tif")
    assert corrected(run_record, tmp_path / "a.tif", tmp_path / "true.tif").exit_code == 0
    assert corrected(run_record, tmp_path / "a.tif", tmp_path / "true.csv").exit_code == 0
    grid, points = geotiff.read(tmp_path / "true.tif"), xyz.read(tmp_path / "true.csv")
    at = np.rint((points.xyz[:, :2] - [grid.west, grid.south]) / grid.spacing).astype(int)
    known = np.isfinite(grid.bands["height"])
    assert len(points.xyz) == known.sum()
    for values, name in ((points.xyz[:, 2], "height"), (points.columns["depth"].values, "depth")):
        np.testing.assert_allclose(values, grid.bands[name][at[:, 1], at[:, 0]], rtol=0.0, atol=0.51e-4)


def test_a_raster_does_not_become_lines(run_record: Path, tmp_path: Path) -> None:
    bottom(tmp_path / "a.tif")
    result = corrected(run_record, tmp_path / "a.tif", tmp_path / "true.gpkg")
    assert result.exit_code == 1 and "a raster becomes a raster or points" in result.output


def test_a_survey_of_chunks() -> None:
    points = np.column_stack([np.arange(100_003.0), np.zeros(100_003), -np.arange(100_003.0)])
    whole = Survey.of([points])
    parts = Survey.of([*np.array_split(points, 13), np.empty((0, 3))])
    assert whole.count == parts.count == 100_003 and whole.heights == parts.heights == (-100_002.0, 0.0)
    np.testing.assert_array_equal(whole.few, parts.few)
    steps = np.diff(parts.few[:, 0])
    assert 20_000 <= len(parts.few) <= 40_000 and (steps == steps[0]).all()


# --- killed, or without room ---

_FULL = """
import resource, signal, sys
from musatpy.cli.main import main
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
limit = int(sys.argv.pop(1))
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
main()
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["true.tif", "true.csv", "true.laz", "true.gpkg", "true.dxf"])
def test_a_full_disk_leaves_the_old_file(run_record: Path, tmp_path: Path, name: str) -> None:
    source = tmp_path / ("a.tif" if name == "true.tif" else "a.csv")
    if name == "true.tif":
        bottom(source)
    else:
        np.savetxt(source, apparent(3000), "%.9f", ",", header="x,y,z", comments="")
    (tmp_path / name).write_bytes(b"of an earlier run")
    command = [sys.executable, "-B", "-c", _FULL, "20000", *words(run_record, source, tmp_path / name)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ran.returncode == 1 and "Traceback" not in ran.stderr and name in ran.stderr, ran.stderr
    assert (tmp_path / name).read_bytes() == b"of an earlier run"
    assert sorted(left.name for left in tmp_path.iterdir()) == sorted([source.name, name])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["true.tif", "true.csv", "true.laz"])
def test_a_killed_process_leaves_the_old_file(run_record: Path, tmp_path: Path, name: str) -> None:
    """Killed while it writes: the old file is whole, and the next run takes away what was left."""
    source, target = tmp_path / "a.xyz", tmp_path / name
    if name == "true.tif":
        source = tmp_path / "a.tif"
        height = np.full((2000, 1500), -5.0)
        with rasterio.open(
            source, "w", driver="GTiff", width=1500, height=2000, count=1, dtype="float64",
            crs="+proj=longlat +ellps=clrk66 +type=crs", transform=rasterio.Affine(4e-6, 0, WEST, 0, -4e-6, NORTH),
        ) as dataset:  # fmt: skip
            dataset.write(height, 1)
    else:
        np.savetxt(source, apparent(600_000), "%.9f")
    target.write_bytes(b"of an earlier run")
    command = [sys.executable, "-m", "musatpy", *words(run_record, source, target)]
    process = subprocess.Popen(command, env=os.environ | {"OPENBLAS_NUM_THREADS": "1"})
    begun = f".{name}.{process.pid}.*"

    def written() -> int:
        files = [one / name if one.is_dir() else one for one in tmp_path.glob(begun)]
        return sum(file.stat().st_size for file in files if file.exists())

    deadline = time.monotonic() + 60.0
    while written() <= 1000 and time.monotonic() < deadline:
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert written() and target.read_bytes() == b"of an earlier run"
    small = tmp_path / "small.csv"
    np.savetxt(small, apparent(5), "%.9f", ",", header="x,y,z", comments="")
    if name == "true.tif":
        bottom(small := tmp_path / "small.tif")
    assert corrected(run_record, small, target).exit_code == 0
    assert not list(tmp_path.glob(begun)) and target.read_bytes() != b"of an earlier run"


def test_a_raster_that_is_not_read_as_it_was_written_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a file system loses without a word shows when the file is read again."""
    given = Grid(west=0.0, south=0.0, spacing=1.0, bands={"z": np.arange(12.0).reshape(3, 4)})
    monkeypatch.setattr(geotiff, "_sum", lambda *_: 0)
    with pytest.raises(Exception, match="what is read is not what was written"):
        write_layers(tmp_path / "a.tif", {"grid": given})
    assert not list(tmp_path.iterdir())
