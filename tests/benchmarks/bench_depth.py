"""The correction of apparent points against two peers in the same run.

The accurate peer looks for the true point of each apparent one by scipy's least squares over rays that are found by
bisection. The fast one is what is commonly done: every camera's own depth factor, and the mean of the depths, one
pass of numpy over pandas' arrays, without intersecting anything. Run as a script it also corrects a file of 5
million points with 50 photographs on two processes; run by pytest it asserts the ratios.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from depth.lagoon import by_photographs
from musatpy.correction.files import correct_table
from musatpy.correction.photographs import ByPhotographs
from musatpy.depth.cameras import CameraStations, read_cameras
from reference.rays import incidence_distance

INDEX = 1.34
CAMERA = (152.4, 228.6, 228.6)  # mm
HEIGHT, BASE, INTERVAL = 900.0, 270.0, 540.0  # 80 % forward, 60 % side overlap: 11 photographs a point
STRIPS, PHOTOS = 5, 10
FEW, SOME, MANY = 20, 200_000, 5_000_000


def survey(folder: Path, count: int) -> tuple[Path, Path]:
    """Write stations, and points of three decimals all over them, an eighth of them dry."""
    rng = np.random.default_rng(7)
    cameras = folder / "cameras.csv"
    with cameras.open("w") as file:
        file.write("name,x,y,z,tide,omega,phi,kappa\n")
        for strip in range(STRIPS):
            for photo in range(PHOTOS):
                x, y, z = np.array([photo * BASE, strip * INTERVAL, HEIGHT]) + rng.normal(0.0, 5.0, 3)
                omega, phi, kappa = rng.normal([0.0, 0.0, 180.0 * (strip % 2)], 1.0)
                tide = rng.normal(0.0, 0.1)
                file.write(f"{strip + 1}{photo + 1:02d},{x:.2f},{y:.2f},{z:.2f},{tide:.2f}")
                file.write(f",{omega:.3f},{phi:.3f},{kappa:.3f}\n")
    points = folder / "points.csv"
    with points.open("w") as file:
        file.write("id,x,y,z\n")
        for start in range(0, count, SOME):
            part = min(SOME, count - start)
            xyz = rng.uniform((0.0, 0.0, -14.0), ((PHOTOS - 1) * BASE, (STRIPS - 1) * INTERVAL, 2.0), (part, 3))
            rows = zip(range(start, start + part), *xyz.T.tolist(), strict=True)
            file.write("".join(f"{i},{x:.3f},{y:.3f},{z:.3f}\n" for i, x, y, z in rows))
    return cameras, points


def correction(path: Path) -> ByPhotographs:
    return by_photographs(read_cameras(path, camera=CAMERA), INDEX)


def by_means(cameras: CameraStations, points: Path, target: Path) -> None:
    """The fast peer, from file to file."""
    table = pd.read_csv(points)
    stations = cameras.stations
    for part in np.array_split(np.arange(len(table)), max(1, len(table) // 16384)):
        A = table.loc[part, ["x", "y", "z"]].to_numpy()
        seen = cameras.sees(A)
        gap = A[:, None] - stations.position
        square = (gap[..., 0] ** 2 + gap[..., 1] ** 2) / gap[..., 2] ** 2
        depth = (stations.level - A[:, 2:]) * np.sqrt(INDEX**2 + (INDEX**2 - 1.0) * square)
        with np.errstate(invalid="ignore", divide="ignore"):
            height = ((stations.level - depth) * seen).sum(axis=1) / seen.sum(axis=1)
        table.loc[part, "true_z"] = np.where(A[:, 2] < stations.level.mean(), height, np.nan)
    table.to_csv(target, index=False, float_format="%.4f")


def by_least_squares(cameras: CameraStations, A: np.ndarray) -> np.ndarray:
    """The accurate peer for one point: the true point whose rays meet in the apparent one."""
    position, level = cameras.stations.position, cameras.stations.level
    rows = np.flatnonzero(cameras.sees(A[None])[0])

    def meeting(G: np.ndarray) -> np.ndarray:
        normal, right = np.zeros((3, 3)), np.zeros(3)
        for row in rows:
            gap = G - position[row]
            D, H = float(np.hypot(*gap[:2])), position[row, 2] - level[row]
            reach = incidence_distance(H, level[row] - G[2], D, INDEX, 1e-7)
            u = np.array([*(gap[:2] / D * reach), -H])
            u = cameras.rotation[row] @ u
            w = cameras.rotation[row, 2] @ (A - position[row])
            # rows of x/z - u/w = 0, which is linear where the distance along the axis is taken as it is
            rows_of = (cameras.rotation[row, :2] - np.outer(u[:2] / u[2], cameras.rotation[row, 2])) / w
            across = rows_of.T @ rows_of
            normal, right = normal + across, right + across @ position[row]
        return np.linalg.solve(normal, right) - A

    start = A * [1.0, 1.0, 1.4]
    return least_squares(meeting, start, diff_step=1e-5, x_scale=[1.0, 1.0, 1.4], xtol=1e-12, ftol=1e-14).x


def seconds(function) -> float:
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def test_ratios_to_the_peers() -> None:
    """A file, on one process: at least 200 times the accurate peer, at most 9 times the time of the fast one."""
    with tempfile.TemporaryDirectory() as name:
        accurate, fast = ratios(Path(name))
    assert accurate >= 200.0
    assert fast <= 9.0


def ratios(folder: Path) -> tuple[float, float]:
    """Return how many times as fast as the accurate peer, and as slow as the fast one, the correction is."""
    stations, points = survey(folder, SOME)
    work = correction(stations)
    own = seconds(lambda: correct_table(points, folder / "own.csv", work))
    means = seconds(lambda: by_means(work.photographs.cameras, points, folder / "means.csv"))
    xyz = pd.read_csv(points)[["x", "y", "z"]].to_numpy()
    few = xyz[xyz[:, 2] < -1.0][:FEW]
    found: list[np.ndarray] = []
    slow = seconds(lambda: found.extend(by_least_squares(work.photographs.cameras, A) for A in few))
    true, _ = work.correction(few)
    # the peer's rays end at 1e-7 m, its derivatives are differences; the correction ends at 1e-6 m
    np.testing.assert_allclose(np.array(found), true.position, atol=1e-4)
    return (slow / FEW) / (own / SOME), own / means


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        accurate, fast = ratios(folder)
        print(
            f"file of {SOME:,} points, one process: {accurate:,.0f} times as fast as least squares point by point,"
        )
        print(f"    {fast:.1f} times the time of the mean of single cameras")
        stations, points = survey(folder, MANY)
        time_2 = seconds(lambda: correct_table(points, folder / "true.csv", correction(stations), jobs=2))
        largest = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
        print(f"file of {MANY:,} points, {STRIPS * PHOTOS} photographs, 2 processes: {time_2:.0f} s,")
        print(f"    largest process {largest / 1024:.0f} MB")


if __name__ == "__main__":
    main()
