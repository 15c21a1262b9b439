"""Records whose pictures tests look at, as tables."""

import copy
from functools import cache
from pathlib import Path
from typing import Any

from musatpy import adjust, read_deck
from musatpy.reports.record import record_of
from musatpy.simulation import simulate
from musatpy.simulation.simulation_spec import spec_from_table
from musatpy.statistics import Statistics

FIXTURES = Path(__file__).parents[2] / "fixtures"
_SPEC = {
    "seed": 5,
    "job": {"system": "LOCL", "centre": [5000.0, 7000.0]},
    "flight": {
        "strips": 2,
        "photos": 3,
        "height": 1500.0,
        "azimuth": 40.0,
        "reverse_alternate": True,
        "attitude_scatter": 0.5,
    },
    "terrain": {"level": 30.0, "relief": 10.0},
    "water": {"index_error": 0.003, "index_sigma": 0.004, "tide_sigma": 0.3, "level_error": 0.2},
    "shoal": [{"share": 0.6, "depth": [2.0, 15.0]}],
    "points": {"per_site": 2, "extra": [{"number": 20}]},
    "control": [
        {"kind": "full", "number": 6, "sigma": 0.05, "error": 0.05},
        {"kind": "check", "number": 3, "sigma": 0.05, "error": 0.05},
    ],
    "stations": {"position_error": 0.1, "position_sigma": 0.1},
    "measurement": {"noise": 5.0, "sigma": 5.0},
    "lens": {"parameter": [{"name": "K1", "sigma": 1e-9}, {"name": "P1", "sigma": 1e-8}]},
    "options": {"program": "IIIA", "water_level": "ONE", "water_index": "ADJUST"},
}


@cache
def _st_thomas() -> dict[str, Any]:
    return record_of(Statistics(adjust(read_deck(FIXTURES / "st_thomas/st_thomas.crd"))))


def st_thomas() -> dict[str, Any]:
    """Return the record of three photos in latitude and longitude, tables as columns, to be changed at will."""
    return copy.deepcopy(_st_thomas())


@cache
def _gnss_block() -> dict[str, Any]:
    return record_of(Statistics(adjust(simulate(spec_from_table(_SPEC)).block)))


def gnss_block() -> dict[str, Any]:
    """Return the record of two strips in a local system: observed stations, unknown level and index."""
    return copy.deepcopy(_gnss_block())
