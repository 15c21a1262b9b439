"""Gross errors put into blocks, for tests and benchmarks of the search for them."""

import numpy as np

from altered import altered
from musatpy.model import Block

SMALLEST, LARGEST = 0.05, 10.0  # mm on the plate


def with_plate_blunders(block: Block, share: float, rng: np.random.Generator) -> tuple[Block, np.ndarray]:
    """Return the block with a share of its images wrong in x or y, and their errors (m, 2) mm.

    Sizes are spread evenly in the logarithm: as many of 50 to 500 um as of 1 to 10 mm.
    """
    m = len(block.plates.photo)
    hit = rng.choice(m, round(share * m), replace=False)
    size = np.exp(rng.uniform(np.log(SMALLEST), np.log(LARGEST), len(hit))) * rng.choice([-1.0, 1.0], len(hit))
    error = np.zeros((m, 2))
    error[hit, rng.integers(0, 2, len(hit))] = size
    return altered(block, plates={"xy": block.plates.xy + error}), error
