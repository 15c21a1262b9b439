"""What unknown cameras and shifts of lines cost: a block adjusted with eight parameters of its camera and antenna
positions with shifts of 20 lines, beside the same block without, by numpy and by compiled loops.

    python tests/benchmarks/bench_lenses.py [photos]

By turns in one process and on one thread; the table has the least CPU seconds of some repeats, and their ratio.
Target: 1.5 by numpy.
"""

from __future__ import annotations

import os
import sys
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from benchmarks.large_blocks import simulated
from musatpy.adjustment import adjust, kernels
from musatpy.model import AntennaLines, AntennaPositions, Block, LensUnknowns

PHOTOS, IMAGES, LINES, REPEATS = 1000, 60, 20, 4
UNKNOWN = ("F", "XP", "YP", "K1", "K2", "K3", "P1", "P2")
SCALE, K1, PRINCIPAL_POINT = 1.0002, 2e-8, (0.02, -0.015)  # of the true camera
SHIFT, SIGMA = 0.3, 0.05  # m, of antennas


def blocks(photos: int) -> tuple[Block, Block]:
    """Return a block with observed antennas, and the same with unknown shifts of these and an unknown camera."""
    block, truth = simulated(photos, images=IMAGES, seed=2)
    rng, free, none = np.random.default_rng(1), np.full((LINES, 3), np.nan), np.zeros(LINES, dtype=bool)
    line = np.arange(photos) * LINES // photos
    names = np.array([f"L{number}" for number in range(LINES)])
    antennas = AntennaPositions(
        photo=np.arange(photos),
        line=names[line],
        position=truth.station + rng.normal(0.0, SIGMA, (photos, 3)),
        sigma=np.full((photos, 3), SIGMA),
        correlation=np.full((photos, 3), np.nan),
    )
    held = AntennaLines(line=names, shift_sigma=free, shift_free=none, drift_sigma=free, drift_free=none)
    block = replace(block, antenna_positions=antennas, antenna_lines=held)
    off, xy, unknown = rng.normal(0.0, SHIFT, (LINES, 3)), block.plates.xy, np.full(len(UNKNOWN), np.nan)
    bent = xy * (SCALE + K1 * np.sum(xy**2, axis=1, keepdims=True)) + np.array(PRINCIPAL_POINT)
    return block, replace(
        block,
        plates=replace(block.plates, xy=bent),
        antenna_positions=replace(antennas, position=antennas.position + off[line]),
        antenna_lines=replace(held, shift_free=~none),
        lens_unknowns=LensUnknowns(camera=np.zeros(len(UNKNOWN)), parameter=UNKNOWN, value=unknown, sigma=unknown),
    )


def main(photos: int) -> None:
    """Print the table."""
    os.cpu_count = lambda: 1  # kernels ask for threads
    both = blocks(photos)
    print(
        "| by | images | iterations without | with | CPU s without | with | ratio |\n|---|---|---|---|---|---|---|"
    )
    for name in (kernels.NUMPY, kernels.NUMBA):
        os.environ[kernels.VARIABLE] = name
        least, iterations = [np.inf, np.inf], [0, 0]
        for _ in range(REPEATS):
            for which, block in enumerate(both):
                start = time.process_time()
                solution = adjust(block)
                least[which] = min(least[which], time.process_time() - start)
                iterations[which] = len(solution.iterations)
                assert solution.converged
        cells = [len(both[0].plates.photo), *iterations, *(f"{seconds:.2f}" for seconds in least)]
        print(f"| {name} | {' | '.join(map(str, cells))} | {least[1] / least[0]:.2f} |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if sys.argv[1:] else PHOTOS)
