"""Compilation against the clock: the loop, batches of points, a raster of ten million posts, contours, soundings.

    python tests/benchmarks/bench_compilation.py [POSTS [POINTS]]

CPU seconds; batches also as ratios to the bare tangent of the same rays in air (`refraction.flat.air_tangent`), by
turns with it in one process. The raster and a text file of points are corrected, and a raster is contoured, in
processes of their own, whose peak memory is told.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyproj

from musatpy.arrays import FloatArray
from musatpy.compilation.loop import stages
from musatpy.compilation.rasters import RasterBottom
from musatpy.compilation.stereomodels import Stereomodel, set_up
from musatpy.compilation.triangulation import of_record
from musatpy.compilation.true_points import Readings, true_points
from musatpy.geometry.crs import system_of
from musatpy.interchange import geotiff
from musatpy.interchange.layers import Grid, Posts
from musatpy.refraction.flat import air_tangent
from musatpy.surfaces.tin import Tin

ROOT = Path(__file__).parents[2]
DECK = ROOT / "fixtures/st_thomas/st_thomas.crd"
WAVES = ROOT / "fixtures/waves/strip.crd"
POSTS, POINTS, BATCH, FEW, CYCLES, TURNS = 10_000_000, 2_000_000, 100_000, 5000, 3000, 7
_MUSAT = [sys.executable, "-m", "musatpy"]
# The command, and the most memory that its process had: `ru_maxrss` of a child has that of its parent before it.
_MEASURED = """
import atexit, sys
from pathlib import Path
from musatpy.cli.main import main
status = Path("/proc/self/status")
atexit.register(lambda: print(next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))))
main()
"""


def seconds(work: Callable[[], object], times: int = 3) -> float:
    """Return the least CPU time of something."""
    spent = []
    for _ in range(times):
        start = time.process_time()
        work()
        spent.append(time.process_time() - start)
    return min(spent)


def places(number: int) -> FloatArray:
    """Return points (n, 3) of the model of photos 21 and 22, down to 25 m."""
    return np.random.default_rng(1).uniform([-700.0, -1400.0, -25.0], [700.0, 1400.0, -1.0], (number, 3))


def measured(*arguments: str) -> tuple[list[str], str]:
    """Return the lines that a command prints, and time and memory of its process in words."""
    start, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-c", _MEASURED, *arguments]
    *lines, peak = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    wall = time.perf_counter() - start
    return lines, f"{wall:.1f} s, {cpu:.1f} s CPU, at most {int(peak.split()[1]) / 1024:.0f} MB"


def loop_cycles(stereo: Stereomodel) -> None:
    """Print the time of a cycle of the loop, one mark, both stages, and its CPU time, which others disturb less."""
    marks, spent = places(CYCLES), []
    for mark in marks:
        start = time.perf_counter(), time.process_time_ns()
        stages(stereo, mark[None])
        spent.append((1e3 * (time.perf_counter() - start[0]), 1e-6 * (time.process_time_ns() - start[1])))
    (median, most), (cpu, most_cpu) = np.quantile(spent, [0.5, 0.99], axis=0).T
    print(f"loop, a cycle: median {median:.3f} ms, 99 % within {most:.3f} ms (asked: 5 ms)")
    print(f"    CPU: median {cpu:.3f} ms, 99 % within {most_cpu:.3f} ms")


def batches(stereo: Stereomodel) -> None:
    """Print points a second of marks to stages, stages to marks, and stages to points with sigmas."""
    marks = places(BATCH)
    xy = stages(stereo, marks)
    readings = Readings(
        ids=np.arange(BATCH).astype(str), submerged=np.ones(BATCH, bool), xy=xy,
        sigma=np.full(xy.shape, 0.005),
    )  # fmt: skip
    H, depth = np.full(BATCH, stereo.height), -marks[:, 2]
    D = np.linalg.norm(marks[:, None, :2] - stereo.stations[:, :2], axis=-1)

    def bare() -> None:
        for side in range(2):
            air_tangent(H, depth, D[:, side], stereo.index)

    for name, work in (
        ("mark to stages", lambda: stages(stereo, marks)),
        ("stages to points with sigmas", lambda: true_points(stereo.run, stereo.photos, readings)),
    ):
        turns = [(seconds(bare, 1), seconds(work, 1)) for _ in range(TURNS)]
        tangents, spent = (min(column) for column in zip(*turns, strict=True))
        print(f"{name}: {BATCH / spent:,.0f} points/s, {spent / tangents:.1f} times the tangents")
    print(f"tangents of both rays: {BATCH / tangents / 1e6:.2f} M points/s")


def through_waves(folder: Path) -> None:
    """Print points a second through the waves of a run."""
    subprocess.run([*_MUSAT, "run", "-q", str(WAVES), "-o", str(folder)], check=True)
    stereo = set_up(of_record(folder / "strip.json"), "837", "838")
    marks = np.random.default_rng(2).uniform([-250.0, -600.0, -20.0], [250.0, 600.0, -2.0], (FEW, 3))
    xy = stages(stereo, marks)
    readings = Readings(
        ids=np.arange(FEW).astype(str), submerged=np.ones(FEW, bool), xy=xy, sigma=np.full(xy.shape, 0.005)
    )
    for name, work in (
        ("mark to stages", lambda: stages(stereo, marks)),
        ("stages to points with sigmas", lambda: true_points(stereo.run, stereo.photos, readings)),
    ):
        print(f"{name} through waves: {FEW / seconds(work):,.0f} points/s")


def raster(stereo: Stereomodel, record: Path, folder: Path, posts: int) -> None:
    """Print time and memory of the correction of a raster over the model, in metres of UTM."""
    run = stereo.run
    assert run.map_system is not None and run.map_system.ellipsoid is not None
    middle = system_of("EPSG:26720", run.map_system.ellipsoid).coordinates(run.frame.level(stereo.origin[None]))[0]
    columns = int(np.sqrt(posts / 2.0))
    rows, spacing = posts // columns, 1200.0 / columns
    y, x = np.mgrid[:rows, :columns]
    height = (-8.0 - 5.0 * np.sin(x / columns * 6.0) * np.cos(y / rows * 9.0)).astype(float)
    grid = Grid(
        west=middle[0] - 600.0, south=middle[1] - 1200.0, spacing=spacing, bands={"z": height},
        crs=pyproj.CRS.from_epsg(26720),
    )  # fmt: skip
    source, target = folder / "apparent.tif", folder / "true.tif"
    geotiff.write(source, grid)
    said, spent = measured("as11", "correct", str(record), "21", "22", str(source), "-o", str(target))
    print(f"{said[0]}\nas11 correct, {rows * columns:,} posts: {spent}")


def text_file(record: Path, folder: Path, points: int) -> None:
    """Print time and memory of the correction of a text file of points, in degrees."""
    source, draws = folder / "apparent.xyz", np.random.default_rng(2)
    with source.open("w") as file:
        for _ in range(0, points, BATCH):
            rows = draws.uniform([-64.940, 18.325, -15.0], [-64.930, 18.340, -1.0], (BATCH, 3)).tolist()
            file.write("".join(f"{x:.9f} {y:.9f} {z:.3f}\n" for x, y, z in rows))
    target = str(folder / "true.xyz")
    said, spent = measured("as11", "correct", str(record), "21", "22", str(source), "-o", target)
    print(f"{said[0]}\nas11 correct, text of {source.stat().st_size / 1e6:.0f} MB: {spent}")


def contours(folder: Path) -> None:
    """Print the time of the contours of a million posts, written as GeoPackage and DXF."""
    y, x = np.mgrid[:1000, :1000] * 2.0
    depth = 10.0 + 8.0 * np.sin(x / 200.0) * np.cos(y / 300.0)
    depth += np.random.default_rng(4).normal(0.0, 0.02, depth.shape)  # rough: pieces of every length
    grid = Grid(west=2e5, south=2e6, spacing=2.0, bands={"depth": depth}, crs=pyproj.CRS.from_epsg(26720))
    geotiff.write(folder / "depth.tif", grid)
    targets = ["-o", str(folder / "c.gpkg"), "-o", str(folder / "c.dxf")]
    said, spent = measured("as11", "contours", str(folder / "depth.tif"), *targets, "--interval", "0.5")
    print(f"{said[0]}\nas11 contours of a million posts, as GeoPackage and DXF: {spent} (asked: 15 s)")


def soundings() -> None:
    """Print the time of 100,000 soundings on a network and on a raster of a million points."""
    draws = np.random.default_rng(3)
    xyz = draws.uniform(0.0, 5000.0, (1_000_000, 3))
    tin, at = Tin.of(xyz), draws.uniform(100.0, 4900.0, (100_000, 2))
    print(f"100,000 soundings on a million points: {seconds(lambda: tin.at(at), 1):.2f} s (asked: 5 s)")
    depth = draws.uniform(1.0, 20.0, (1000, 1000))
    posts = Posts(west=0.0, south=0.0, spacing=5.0, shape=depth.shape)
    bottom = RasterBottom(posts=posts, depth=depth, sigma=0.1 * depth, system=None, metres=np.ones(2))
    print(f"100,000 soundings on a million posts: {seconds(lambda: bottom.at(at), 1):.2f} s (asked: 5 s)")


def main() -> None:
    """Print the figures."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        subprocess.run([*_MUSAT, "run", "-q", str(DECK), "-o", str(folder)], check=True)
        record = folder / "st_thomas.json"
        stereo = set_up(of_record(record), "21", "22")
        loop_cycles(stereo)
        batches(stereo)
        through_waves(folder)
        posts, points = (int(given) for given in [*sys.argv[1:], *map(str, (POSTS, POINTS)[len(sys.argv) - 1 :])])
        raster(stereo, record, folder, posts)
        text_file(record, folder, points)
        contours(folder)
        soundings()


if __name__ == "__main__":
    main()
