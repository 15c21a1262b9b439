"""Blocks of 10 to 20,000 photos: programs IIA and IIIA beside the bundle adjustment of pycolmap, on one network.

    python tests/benchmarks/bench_blocks.py [--rounds N] [--kind KIND] [--only "NAME;..."] [photos ...]

Every adjustment runs in a process of its own, by turns, N rounds (3 where not given), and says the least of its
times in the process (three runs up to 1,000 photos, else one); the table has the least and the median of the
rounds, CPU seconds beside them, and how many of the cores other processes kept busy. The kernels of numba have been
loaded before, by a small block. All have the same images, starts and fixed control, and must come to one minimum,
which one function takes from the stations and points of each. pycolmap (the `benchmark` extra) has its intrinsics
fixed, no robust loss, as many threads as it likes, the solver that is its best here (SPARSE_SCHUR) and the
tolerance of Ceres; tuned it has next to no damping at the start. Its time is that of build and solution; its
covariances, up to 1,000 photos, are those of the stations alone, where ours are those of points too, with
redundancy numbers.

KIND is the network: `usual`, `corners` (four control points only), `gruber` (points at the positions of von Gruber
only), `dense` (200 images on a photo) or `seed` (another one). The targets are those of `TARGETS`.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

if not any(word.startswith("pycolmap") for word in sys.argv):
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line has it: the threads are our own

import numpy as np

THREADS = "OPENBLAS_NUM_THREADS"
SIZES = (10, 100, 1000, 5000)
WET, FEW_WET = "20 % submerged", "10 % submerged"
NAMES = (
    "pycolmap",
    "pycolmap tuned",
    "IIIA",
    "IIIA, numpy",
    "IIA",
    "IIA, numpy",
    f"IIIA, {FEW_WET}",
    f"IIIA, {WET}",
    f"IIA, {FEW_WET}",
    f"IIA WATPT, {FEW_WET}",
)
KINDS: dict[str, dict[str, Any]] = {
    "usual": {},
    "corners": {"corners": True},
    "gruber": {"gruber": True},
    "dense": {"images": 200},
    "seed": {"seed": 7},
}
SAME = 1e-5  # relative difference of the weighted squares at the minimum: what the limits of the steps leave
CERES_TOLERANCE = 1e-6  # relative change of the cost at which Ceres stops, unless it is told another
OFTEN, ROUNDS = 1000, 3  # photos up to which a process adjusts three times
TICKS = float(os.sysconf("SC_CLK_TCK")) if hasattr(os, "sysconf") else np.nan

Rows = dict[str, dict[str, Any]]
# Of the rows of one size: what is compared, and at most how much of it; sizes that it is wanted at.
TARGETS: tuple[tuple[str, Callable[[Rows], float], float, tuple[int, ...]], ...] = (
    ("IIIA of pycolmap", lambda of: of["IIIA"]["time"] / of["pycolmap"]["time"], 1 / 4, (1000,)),
    ("IIIA of pycolmap", lambda of: of["IIIA"]["time"] / of["pycolmap"]["time"], 1 / 5, (5000, 20000)),
    ("IIIA of tuned", lambda of: of["IIIA"]["time"] / of["pycolmap tuned"]["time"], 1 / 3, (1000, 5000, 20000)),
    ("IIIA, numpy of pycolmap", lambda of: of["IIIA, numpy"]["time"] / of["pycolmap"]["time"], 2.0, (1000,)),
    ("IIA of IIIA", lambda of: of["IIA"]["time"] / of["IIIA"]["time"], 1.5, (1000, 5000)),
    ("IIA of IIIA, numpy", lambda of: of["IIA, numpy"]["time"] / of["IIIA, numpy"]["time"], 2.5, (1000,)),
    ("IIIA wet of dry", lambda of: of[f"IIIA, {FEW_WET}"]["time"] / of["IIIA"]["time"], 1.6, (1000,)),
    ("IIA wet of dry", lambda of: of[f"IIA, {FEW_WET}"]["time"] / of["IIA"]["time"], 2.0, (1000,)),
    ("IIA WATPT of dry", lambda of: of[f"IIA WATPT, {FEW_WET}"]["time"] / of["IIA"]["time"], 3.0, (1000,)),
    (
        "covariances of IIIA of those of pycolmap's stations",
        lambda of: of["IIIA"]["covariances"] / of["pycolmap"]["covariances"],
        1 / 10,
        (1000,),
    ),
    ("GB without covariances", lambda of: of["IIIA"]["peak_gb"], 1.1, (5000,)),
)


def run(name: str, photos: int, kind: str) -> dict[str, Any]:
    """Adjust one block in this process, and return the quickest of its runs."""
    from large_blocks import make_block

    program, _, rest = name.partition(", ")
    os.environ["MUSAT_KERNELS"] = "numpy" if rest == "numpy" else "numba"
    submerged = {WET: 0.2, FEW_WET: 0.1}.get(rest, 0.0)
    block = make_block(photos, submerged=submerged, **KINDS[kind])
    runs = []
    for _ in range(3 if photos <= OFTEN else 1):
        busy, wall = _busy(), time.perf_counter()
        one = (
            _pycolmap(block, tuned=name.endswith("tuned")) if name.startswith("pycolmap") else _ours(block, program)
        )
        one["others"] = (_busy() - busy) / (time.perf_counter() - wall)
        runs.append(one)
    images = len(block.plates.photo)
    return {"name": name, "photos": photos, "images": images, **min(runs, key=lambda one: one["time"])}


def _busy() -> float:
    """Return the CPU seconds that processes other than this one have taken since the start; NaN where unknown."""
    stat = Path("/proc/stat")
    if not stat.exists():
        return np.nan
    user, nice, system = (float(text) / TICKS for text in stat.read_text().split()[1:4])
    return user + nice + system - time.process_time()


def _peak() -> float:
    """Return the most memory of this process so far, in GB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


def _ours(block: Any, name: str) -> dict[str, Any]:
    from large_blocks import make_block

    from musatpy.adjustment import adjust, result
    from musatpy.model import Program, Refraction

    program, _, watpt = name.partition(" ")
    refraction = Refraction.WATPT if watpt else Refraction.RIGOROUS
    chosen = {"program": Program(program), "refraction": refraction}
    spent: dict[str, float] = {}
    whole = result.solution

    def timed(**arguments: Any) -> Any:
        spent["peak_gb"] = _peak()
        start, cpu = time.perf_counter(), time.process_time()
        solution = whole(**arguments)
        spent["covariances"], spent["covariances_cpu"] = time.perf_counter() - start, time.process_time() - cpu
        return solution

    small = make_block(30, submerged=0.2)
    adjust(replace(small, options=replace(small.options, **chosen)))  # kernels are loaded
    result.solution = timed
    start, cpu = time.perf_counter(), time.process_time()
    solution = adjust(replace(block, options=replace(block.options, **chosen)))
    total, cpu = time.perf_counter() - start, time.process_time() - cpu
    result.solution = whole
    assert solution.converged, solution.reason
    from musatpy.geometry.collinearity import attitude_matrix

    squares = _squares(
        block, solution.stations.position, attitude_matrix(solution.stations.attitude), solution.points.position
    )
    return {
        "time": total - spent["covariances"],
        "cpu": cpu - spent["covariances_cpu"],
        "iterations": len(solution.iterations),
        "squares": squares,
        "whole_gb": _peak(),
        **spent,
    }


def _pycolmap(block: Any, tuned: bool) -> dict[str, Any]:
    import pycolmap

    from musatpy.geometry.collinearity import attitude_matrix
    from musatpy.model import Program

    # the first positions of the points are those of the program: intersections are no part of the comparison
    first = _first_points(replace(block, options=replace(block.options, program=Program.IIIA)))
    start, cpu = time.perf_counter(), time.process_time()
    sigma = block.options.plate_sigma
    f = float(block.cameras.focal_length[0]) / sigma
    reconstruction = pycolmap.Reconstruction()
    camera = pycolmap.Camera(camera_id=1, model="PINHOLE", width=1, height=1, params=[f, f, 0.0, 0.0])
    reconstruction.add_camera_with_trivial_rig(camera)
    plates, photos = block.plates, block.photos
    turn = np.diag([1.0, -1.0, -1.0])
    M = turn @ attitude_matrix(photos.attitude)
    order = np.argsort(plates.photo, kind="stable")
    cut = np.searchsorted(plates.photo[order], np.arange(len(photos.ids) + 1))
    pixels = plates.xy * np.array([1.0, -1.0]) / sigma
    config = pycolmap.BundleAdjustmentConfig()
    ids = [reconstruction.add_point3D(X, pycolmap.Track()) for X in first]
    for photo in range(len(photos.ids)):
        rows = order[cut[photo] : cut[photo + 1]]
        image = pycolmap.Image(name=str(photo), keypoints=pixels[rows], camera_id=1, image_id=photo + 1)
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(M[photo]), -M[photo] @ photos.position[photo])
        reconstruction.add_image_with_trivial_frame(image, pose)
        for number, point in enumerate(plates.point[rows].tolist()):
            reconstruction.add_observation(ids[point], pycolmap.TrackElement(photo + 1, number))
        config.add_image(photo + 1)
    config.set_constant_cam_intrinsics(1)
    for point in block.control.point.tolist():
        config.add_constant_point(ids[point])
    options = pycolmap.BundleAdjustmentOptions(
        refine_focal_length=False, refine_extra_params=False, print_summary=False
    )
    solver = options.ceres.solver_options
    options.ceres.auto_select_solver_type = False  # from 1,000 photos on it would iterate, for longer
    solver.linear_solver_type = type(solver.linear_solver_type).SPARSE_SCHUR
    solver.function_tolerance = CERES_TOLERANCE
    if tuned:
        solver.initial_trust_region_radius = 1e12
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, reconstruction)
    summary = adjuster.solve()
    total, cpu = time.perf_counter() - start, time.process_time() - cpu
    spent: dict[str, float] = {"peak_gb": _peak()}
    if len(photos.ids) <= OFTEN and not tuned:
        begin, begin_cpu = time.perf_counter(), time.process_time()
        wanted = pycolmap.BACovarianceOptions(params=pycolmap.BACovarianceOptionsParams.POSES)
        assert pycolmap.estimate_ba_covariance(wanted, reconstruction, adjuster) is not None
        spent["covariances"] = time.perf_counter() - begin
        spent["covariances_cpu"], spent["whole_gb"] = time.process_time() - begin_cpu, _peak()
    poses = [reconstruction.images[photo + 1].cam_from_world() for photo in range(len(photos.ids))]
    R = np.array([pose.rotation.matrix() for pose in poses])
    t = np.array([pose.translation for pose in poses])
    points = np.array([reconstruction.points3D[i].xyz for i in ids])
    return {
        "cpu": cpu,
        "time": total,
        **spent,
        "iterations": summary.ceres_summary.num_successful_steps + summary.ceres_summary.num_unsuccessful_steps,
        "squares": _squares(block, -np.einsum("nji,nj->ni", R, t), turn @ R, points),
    }


def _first_points(block: Any) -> np.ndarray:
    from musatpy.adjustment import ground
    from musatpy.adjustment.job import prepared

    job, state = prepared(block, None)
    return np.asarray(job.network.frame.system(ground.level_start(job.network, state).ground))


def _squares(block: Any, camera: np.ndarray, M: np.ndarray, points: np.ndarray) -> float:
    """Return the weighted squares of the images of stations and points; straight rays."""
    import musatpy.geometry.collinearity as collinearity

    plates = block.plates
    f = np.full(len(plates.photo), float(block.cameras.focal_length[0]))
    xy = collinearity.image(points[plates.point] - camera[plates.photo], M[plates.photo], f, np.zeros(2))
    return float(np.sum(np.square((xy - plates.xy) / block.options.plate_sigma)))


def main(sizes: list[int], names: list[str], rounds: int, kind: str) -> int:
    """Run all by turns, print the table, and say which target was missed."""
    head = "photos  images  program                    seconds   median    CPU s  others  iterations  covariances"
    print(f"{head}      and CPU  peak GB  with cov  of pycolmap")
    failed = 0
    for photos in sizes:
        found: dict[str, list[dict[str, Any]]] = {}
        for _ in range(rounds):
            for name in names:
                command = [sys.executable, __file__, "--one", name, "--kind", kind, str(photos)]
                free = {word: text for word, text in os.environ.items() if word != THREADS}
                peer = name.startswith("pycolmap")
                done = subprocess.run(command, capture_output=True, text=True, env=free if peer else None)
                if done.returncode:
                    print(f"{photos:6d}  {name}: failed\n{done.stderr[-2000:]}")
                    continue
                found.setdefault(name, []).append(json.loads(done.stdout.splitlines()[-1]))
        best = {name: min(runs, key=lambda one: one["time"]) for name, runs in found.items()}
        for name, one in best.items():
            one["cpu"] = min(run["cpu"] for run in found[name])
            one["median"] = float(np.median([run["time"] for run in found[name]]))
            for key in ("covariances", "covariances_cpu"):
                one[key] = min(run.get(key, np.nan) for run in found[name])
            print(_line(one, best.get("pycolmap")), flush=True)
        failed += _judged(photos, best)
    return 1 if failed else 0


def _line(one: dict[str, Any], peer: dict[str, Any] | None) -> str:
    ratio = one["time"] / peer["time"] if peer else np.nan
    covariances, whole = one["covariances"], one.get("whole_gb", np.nan)
    return (
        f"{one['photos']:6d}  {one['images']:6d}  {one['name']:<25}  {one['time']:7.3f}  {one['median']:7.3f}"
        f"  {one['cpu']:7.3f}  {one['others']:6.2f}  {one['iterations']:10d}  {covariances:11.3f}"
        f"  {one['covariances_cpu']:11.3f}  {one['peak_gb']:7.2f}  {whole:8.2f}  {ratio:11.3f}"
    )


def _judged(photos: int, best: Rows) -> int:
    """Print what was wanted of a size and what was measured; return how many have missed the minimum."""
    peer, missed = best.get("pycolmap"), 0
    for name, one in best.items():
        if peer and "submerged" not in name and abs(one["squares"] / peer["squares"] - 1.0) > SAME:
            print(f"{name}, {photos} photos: {one['squares']:.4f} weighted squares, pycolmap {peer['squares']:.4f}")
            missed += 1
    for text, measure, limit, of_sizes in TARGETS:
        if photos in of_sizes:
            try:
                value = measure(best)
            except KeyError:  # not run
                continue
            met = "met   " if value <= limit else "MISSED"
            print(f"{met}  {photos} photos, {text}: {value:.3f}, wanted {limit:.3f}")
    return missed


if __name__ == "__main__":
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("photos", nargs="*", type=int, default=list(SIZES))
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--kind", choices=list(KINDS), default="usual")
    parser.add_argument("--only", default=";".join(NAMES), help="names, with semicolons between")
    parser.add_argument("--one")
    given = parser.parse_args()
    if given.one:
        print(json.dumps(run(given.one, given.photos[0], given.kind)))
    else:
        raise SystemExit(main(given.photos, given.only.split(";"), given.rounds, given.kind))
