"""The builder of blocks of the tests, over the tables of `musat simulate`, and strips that several of them share.

`simulation(seed, job={...}, flight={...}, ...)` traces every image exactly, not by the formulas of the adjustment.
A test whose images must come from still another formulation takes `reference.networks`, `reference.waves` or
`reference.wave_scenes`; the largest blocks are those of `benchmarks.large_blocks`.
"""

from pathlib import Path
from typing import Any

import numpy as np

from altered import altered, put, with_options
from musatpy import read_deck
from musatpy.adjustment import adjust
from musatpy.model import Block, Solution
from musatpy.simulation import Simulation, simulate, spec_from_table

FIXTURES = Path(__file__).parents[1] / "fixtures"


def converged(block: Block, **options: Any) -> Solution:
    """The solution of a block with other options, which has converged."""
    solution = adjust(with_options(block, **options) if options else block)
    assert solution.converged, solution.reason
    return solution


def simulation(seed: int, **tables: Any) -> Simulation:
    """The simulation of a specification, about 18 N, 65 W unless its job says something else."""
    return simulate(spec_from_table({"seed": seed, "job": {"centre": [18.0, -65.0]}, **tables}))


def with_wet_land(block: Block, rng: np.random.Generator, number: int) -> Block:
    """The block with so many points on land flagged as submerged besides."""
    land = np.flatnonzero(~block.points.bathymetric)
    return altered(block, points={"bathymetric": put(rng.choice(land, size=number, replace=False), True)})


def shore(seed: int) -> Block:
    """A strip with points about its water lines, a tide for each photo, and up to five land points flagged wet."""
    rng = np.random.default_rng(seed)
    block = simulation(
        seed,
        terrain={"level": 12.0, "relief": 5.0},
        flight={
            "photos": int(rng.integers(3, 7)),
            "height": float(rng.choice([1000.0, 2000.0, 3000.0])),
            "forward_overlap": float(rng.choice([0.6, 0.75])),
        },
        water={"tide_scatter": float(rng.choice([0.05, 0.2, 0.4]))},
        shoal=[{"share": 0.5, "depth": [0.0, float(rng.choice([0.5, 1.5, 6.0]))]}],
        points={"extra": [{"number": int(rng.integers(10, 40))}]},
        control=[
            {"kind": "full", "number": 6, "sigma": 0.05, "error": 0.05},
            {"kind": "vertical", "number": 2, "sigma": 0.05, "error": 0.05, "bathymetric": True},
        ],
        stations={"position_error": 20.0, "attitude_error": 0.3},
        options={"refraction": "RIGOROUS"},
    ).block
    return with_wet_land(block, rng, int(rng.integers(0, 6)))


def st_thomas(seed: int) -> Block:
    """The strip of the fixtures with up to seven land points flagged wet."""
    rng = np.random.default_rng(seed)
    block = read_deck(FIXTURES / "st_thomas" / "st_thomas.crd")
    return with_wet_land(block, rng, int(rng.integers(1, 8)))


def deep(seed: int) -> Block:
    """A strip like that of the Cayman Islands, half of its points to a third of the flying height under water."""
    height = float(np.random.default_rng(seed).choice([1500.0, 3000.0, 6100.0]))
    return simulation(
        seed,
        job={"centre": [19.36, -81.29]},
        terrain={"level": 14.0, "relief": 6.0, "wavelength": 2500.0},
        flight={
            "photos": 10,
            "height": height,
            "forward_overlap": 0.6,
            "station_scatter": [60.0, 60.0, 30.0],
            "attitude_scatter": [0.6, 0.6, 1.0],
        },
        water={"level": 5.6, "tide_trend": 0.02},
        shoal=[{"share": 0.5, "depth": [0.5, height / 3.0]}],
        points={"scatter": 0.1, "extra": [{"number": 40}]},
        control=[
            {"kind": "horizontal", "number": 7, "sigma": 0.1, "error": 0.1},
            {"kind": "vertical", "number": 20, "sigma": 0.1, "error": 0.1},
        ],
        stations={"position_error": 20.0, "attitude_error": 0.3},
        options={"refraction": "WATPT"},
    ).block


def held_cameras(seed: int, height: float = 600.0) -> Block:
    """A strip of IIIA with stations observed to a tenth of a millimetre over deep water, without control."""
    return simulation(
        seed,
        flight={"photos": 4, "height": height},
        water={"tide_scatter": 0.2},
        shoal=[{"share": 0.9, "depth": [0.5, height / 3.0]}],
        points={"extra": [{"number": 40}]},
        stations={
            "position_error": 0.05,
            "attitude_error": 0.005,
            "position_sigma": 0.0001,
            "attitude_sigma": 0.01,
        },
        options={"program": "IIIA"},
    ).block


def shallow(seed: int) -> Block:
    """Three photos, some points less than a metre under water, and an unknown refractive index."""
    return simulation(
        seed,
        flight={"photos": 3, "height": 3000.0},
        water={"tide_scatter": 0.1},
        shoal=[{"share": 0.3, "depth": [0.1, 1.0]}],
        control=[{"kind": "full", "number": 6, "sigma": 0.1, "error": 0.1}],
        stations={"position_error": 5.0, "attitude_error": 0.1},
        options={"program": "IIIA", "water_index": "ADJUST"},
    ).block


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
