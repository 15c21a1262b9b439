"""Large blocks must list fast: 100,000 plate measurements, echoed and with residuals."""

from __future__ import annotations

import dataclasses
import time

import numpy as np

from musatpy.model import PlateResiduals
from musatpy.reports.listing import listing
from musatpy.reports.record import dumps, record
from sample_solutions import sample_solution

MEASUREMENTS = 100_000


def large_solution():
    solution = sample_solution()
    rng = np.random.default_rng(5)
    photo = np.sort(rng.integers(0, 10, MEASUREMENTS))
    point = rng.integers(0, 98, MEASUREMENTS)
    triangulated = rng.random(MEASUREMENTS) < 0.95
    plates = dataclasses.replace(
        solution.block.plates,
        photo=photo,
        point=point,
        xy=rng.uniform(-110.0, 110.0, (MEASUREMENTS, 2)),
        sigma=np.full((MEASUREMENTS, 2), 0.01),
        triangulated=triangulated,
    )
    residuals = PlateResiduals(
        residual=rng.normal(0.0, 0.01, (MEASUREMENTS, 2)),
        triangulated=triangulated,
        correction=rng.normal(0.0, 0.05, (MEASUREMENTS, 2)),
    )
    return dataclasses.replace(solution, block=dataclasses.replace(solution.block, plates=plates), plates=residuals)


def test_listing_of_a_large_block():
    solution = large_solution()
    start = time.process_time()
    text = listing(solution)
    listed = time.process_time()
    dumps(record(solution))
    recorded = time.process_time()
    print(f"\n{text.count(chr(10))} lines: listing {listed - start:.2f} s, record {recorded - listed:.2f} s")
    assert text.count("\n") > 2 * MEASUREMENTS
    # "A few seconds" on a plain machine, with as much again for a slow one.
    assert listed - start < 8.0
    assert recorded - listed < 8.0
