"""What models of structure from motion cost beside bare numpy in the same run: reading, thinning, correcting.

A model of COLMAP is read and thinned against `numpy.fromfile` of the same bytes. Points of a cloud go back through
the cameras of their file and meet anew, with sigmas, against a projection of them all into one photograph.
`python tests/benchmarks/bench_models.py` prints the ratios.
"""

from __future__ import annotations

import struct
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from musatpy.compilation.triangulation import of_stations
from musatpy.correction.file_cameras import ByFileCameras
from musatpy.geometry.systems import LocalRectangular
from musatpy.model import Water
from musatpy.reduction.pixel_lens import PixelLens
from musatpy.sfm.block import TURN, Placement
from musatpy.sfm.colmap import read_model
from musatpy.sfm.source import FileCameras
from musatpy.sfm.thinning import thinned
from musatpy.sfm.wet import Wet

LENS = PixelLens(width=5472, height=3648, focal=(3680.0, 3680.0), centre=(2740.0, 1830.0), k=(-0.01, 0.007))
STRIPS, PHOTOS, HEIGHT, BASE, SPACING = 20, 50, 80.0, 16.0, 42.0
POINTS, RAYS, CLOUD, SIZE = 200_000, 5, 8000, 0.0024
NAMES = np.array([f"DJI_{number:05d}.JPG" for number in range(STRIPS * PHOTOS)])


def seconds(function: Callable[[], object]) -> float:
    """Return the processor time of the best of three."""
    best = np.inf
    for _ in range(3):
        start = time.process_time()
        function()
        best = min(best, time.process_time() - start)
    return best


def scene(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return stations (n, 3) that look down on water at zero, and places (count, 3) of points."""
    rng = np.random.default_rng(1)
    grid = np.stack(np.meshgrid(np.arange(STRIPS) * SPACING, np.arange(PHOTOS) * BASE), axis=-1).reshape(-1, 2)
    low, high = grid.min(axis=0), grid.max(axis=0)
    place = np.column_stack([rng.uniform(low, high, (count, 2)), rng.uniform(-5.0, 3.0, count)])
    return np.column_stack([grid, np.full(len(grid), HEIGHT)]), place


def model(folder: Path) -> None:
    """Write a model of COLMAP: 200,000 points, a million images."""
    station, place = scene(POINTS)
    near = np.argpartition(np.linalg.norm(place[:, None, :2] - station[None, ::7, :2], axis=2), RAYS, axis=1)[
        :, :RAYS
    ]
    photo, point = near.reshape(-1) * 7, np.repeat(np.arange(POINTS), RAYS)
    ray = (place[point] - station[photo]) * [1.0, -1.0, -1.0]
    rows = np.zeros(len(photo), dtype=[("xy", "<f8", 2), ("point", "<i8")])
    rows["xy"], rows["point"] = LENS.pixels(ray[:, :2] / ray[:, 2:]), point + 1
    of_lens = (1, 3, LENS.width, LENS.height, LENS.focal[0], *LENS.centre, *LENS.k)
    (folder / "cameras.bin").write_bytes(struct.pack("<QiiQQ5d", 1, *of_lens))
    with (folder / "images.bin").open("wb") as file:
        file.write(struct.pack("<Q", len(station)))
        for number, (name, (x, y, z)) in enumerate(zip(NAMES.tolist(), station.tolist(), strict=True)):
            some = rows[photo == number]
            file.write(struct.pack("<I7dI", number + 1, 0.0, 1.0, 0.0, 0.0, -x, y, z, 1) + name.encode() + b"\0")
            file.write(struct.pack("<Q", len(some)) + some.tobytes())
    with (folder / "points3D.bin").open("wb") as file:
        file.write(struct.pack("<Q", POINTS))
        for number, xyz in enumerate(place.tolist(), 1):
            file.write(struct.pack("<Q3d3BdQ", number, *xyz, 1, 2, 3, 0.0, RAYS) + bytes(8 * RAYS))


def method() -> ByFileCameras:
    """Return the correction by cameras of a file that stand where the adjusted ones do."""
    station, _ = scene(1)
    n = len(station)
    R, f = np.broadcast_to(TURN, (n, 3, 3)), LENS.focal[0] * SIZE
    placement = Placement(scale=1.0, rotation=np.eye(3), shift=np.zeros(3), ellipsoid=None)
    extent = np.array([[[0.0, 0.0], [LENS.width, LENS.height]]])
    cameras = FileCameras(
        program="colmap", photos=NAMES, camera=np.zeros(n, dtype=int), rotation=R, centre=station, lenses=(LENS,),
        extent=extent, placement=placement, to_geocentric=None, size=SIZE, held=True,
    )  # fmt: skip
    camera = np.tile([f, LENS.width * SIZE, LENS.height * SIZE], (n, 1))
    sigma = np.tile([0.02, 0.02, 0.02, 1e-5, 1e-5, 1e-5, 0.02], (n, 1))
    run = of_stations(
        tuple(NAMES.tolist()), station, np.broadcast_to(np.eye(3), (n, 3, 3)), camera, np.zeros(n), sigma,
        Water(index=1.34),
    )  # fmt: skip
    return ByFileCameras(
        system=LocalRectangular(), cameras=cameras, run=run, lenses=(LENS,), rows=np.arange(n), sigma=0.5 * SIZE,
        most=12,
    )  # fmt: skip


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        model(folder)
        bare = seconds(lambda: [np.fromfile(path, np.uint8) for path in folder.iterdir()])
        read = seconds(lambda: read_model(folder))
        made = read_model(folder)
        wet = np.where(made.position[:, 2] < 0.0, Wet.WET, Wet.DRY)
        thin = seconds(lambda: thinned(made, wet))
    print(f"{len(made.photo):,} images of COLMAP: read in {read:.2f} s, {read / bare:.0f} times numpy.fromfile,")
    print(f"    thinned in {thin:.2f} s, {thin / read:.1f} times the reading")
    work, (station, place) = method(), scene(CLOUD)
    plain = seconds(lambda: LENS.pixels(place[:, :2] / (place[:, 2:] - HEIGHT)))
    middle = station[:, :2].mean(axis=0)
    dense = np.column_stack([middle + (place[:, :2] - middle) / 40.0, place[:, 2]])  # neighbours share their photos
    for words, points in (("all over the block", place), ("side by side", dense)):
        full = seconds(lambda points=points: work("", points))
        print(f"{CLOUD:,} points {words}, {len(NAMES):,} photos: {CLOUD / full:,.0f} a second,")
        print(f"    {full / plain:,.0f} times a projection of them into one photo")


if __name__ == "__main__":
    main()
