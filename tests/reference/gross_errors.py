"""Gross errors put into blocks, for tests and benchmarks of the search for them."""

import numpy as np

from altered import added, altered, put
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


def with_names(block: Block, names: dict[int, int]) -> Block:
    """Return the block with the images `names` (row -> point) named anew."""
    return altered(block, plates={"point": put(list(names), list(names.values()))})


def with_exchanged(block: Block, first: int, second: int) -> Block:
    """Return the block with the names of two images exchanged."""
    point = block.plates.point
    return with_names(block, {first: int(point[second]), second: int(point[first])})


def with_control(block: Block, row: int, error: tuple[float, float, float]) -> Block:
    """Return the block with a control point off by `error` m (local jobs)."""
    return altered(block, control={"position": added(row, error)})


def with_tides(block: Block, photos: np.ndarray | slice, error: float) -> Block:
    """Return the block with the tides of some photos off by `error` m."""
    return altered(block, photos={"tide": added(photos, error)})


def with_flags(block: Block, points: np.ndarray, submerged: bool) -> Block:
    """Return the block with some points flagged as submerged, or as dry."""
    return altered(block, points={"bathymetric": put(points, submerged)})
