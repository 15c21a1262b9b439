"""Compiled kernels beside their numpy twins, function by function, on a simulated block with every tenth point wet.

    python tests/benchmarks/bench_kernels.py [photos]

By turns in one process and on one thread; the table has the least CPU seconds of some repeats, and their ratio.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from benchmarks.large_blocks import make_block
from musatpy.adjustment import ground, kernels
from musatpy.adjustment.collinear import Simultaneous
from musatpy.adjustment.iteration import State
from musatpy.adjustment.job import prepared
from musatpy.adjustment.musat2a import GeodeticRestraint
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import factorised
from musatpy.model import Options, Program

PHOTOS, SUBMERGED, REPEATS = 300, 0.1, 5
BOTH = (kernels.NUMPY, kernels.NUMBA)

Work = dict[str, Callable[[], object]]


def scene(photos: int) -> tuple[Network, State, Options]:
    """Return a network with its submerged rays refracted, its first state with points at rest, and its options."""
    block = make_block(photos, submerged=SUBMERGED, program=Program.IIA)
    job, state = prepared(block, None)
    network = job.network
    network = network.with_plates(network.xy, np.asarray(job.bathymetric[network.point]))
    return network, ground.settle(network, state), block.options


def work(network: Network, state: State, options: Options) -> Work:
    """Return what is measured, by name; which kernels it takes is asked as it is made."""
    simultaneous = Simultaneous(network=replace(network), options=options)
    triangulation = GeodeticRestraint(network=replace(network), options=options)
    line = simultaneous.linearise(simultaneous.with_squares(state))
    step = np.full(len(line.rhs), 1e-7)
    matrix = replace(line.matrix, pattern=replace(line.matrix.pattern))  # which keeps what has been chosen for it
    factor = factorised(matrix)
    assert factor is not None

    def follow() -> None:
        out = state.ground.copy()
        for one in line.context:
            one.move(network, state, step, out)

    return {
        "collinear points eliminated, into the normal equations": lambda: simultaneous.linearise(state),
        "points after a step of the stations": follow,
        "weighted squares of the images": lambda: simultaneous.with_squares(state),
        "conditions of IIA into the normal equations": lambda: triangulation.linearise(state),
        "points of IIA to their best": lambda: ground.settle(network, state),
        "normal matrix factorised": lambda: factorised(matrix),
        "its selected inverse": factor.cofactors,
        "its solution": lambda: factor.solve(line.rhs),
        "first positions: nearest to the rays": lambda: ground.start_ground(network, state),
        "the same, and rays that are parallel": lambda: ground.start_ground(
            network, state, np.zeros(network.points, dtype=bool)
        ),
        "points on level ground": lambda: ground.level_start(network, state),
    }


def seconds(function: Callable[[], object]) -> float:
    """Return the CPU seconds of one call."""
    start = time.process_time()
    function()
    return time.process_time() - start


def main(photos: int) -> None:
    """Measure all, and print the table."""
    kernels._MOST = 1
    network, state, options = scene(photos)
    least: dict[str, dict[str, float]] = {}
    of_kind: dict[str, Work] = {}
    for kind in BOTH:
        os.environ[kernels.VARIABLE] = kind
        of_kind[kind] = work(network, state, options)
    for _ in range(REPEATS):
        for kind in BOTH:
            os.environ[kernels.VARIABLE] = kind
            for name, function in of_kind[kind].items():
                of_name = least.setdefault(name, dict.fromkeys(BOTH, np.inf))
                of_name[kind] = min(of_name[kind], seconds(function))
    print(f"{photos} photos, {len(network.photo)} images, {network.refracted.sum()} of them of submerged points")
    print(f"{'CPU ms':<58}{'numpy':>10}{'numba':>10}{'ratio':>8}")
    for name, of in least.items():
        plain, compiled = (1e3 * of[kind] for kind in BOTH)
        print(f"{name:<58}{plain:10.2f}{compiled:10.2f}{plain / compiled:8.1f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else PHOTOS)
