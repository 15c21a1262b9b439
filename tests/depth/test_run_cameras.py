"""Stations of a correction from the record of a run."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from depth.lagoon import FOLDER as LAGOON
from musatpy.cli.main import main
from musatpy.depth.run_cameras import read_run
from musatpy.errors import DepthError
from musatpy.model import CoordinateSystem, Plane
from musatpy.reports.record import record_text
from sample_solutions import sample_solution


@pytest.fixture
def record(tmp_path: Path) -> dict[str, Any]:
    """A run whose stations are those of the lagoon, as its JSON record says it."""
    return {
        "program": {"name": "musatpy"},
        "solution": {"converged": True},
        "options": {"system": "LOCL"},
        "stated": None,
        "cameras": [{"camera": "RC8", "focal_length": 152.4, "format_size": [228.6, 228.6]}],
        "stations": [
            {
                "photo": row["name"],
                "camera": "RC8",
                "position": [float(row[axis]) for axis in "xyz"],
                "attitude": np.radians([float(row[a]) for a in ("omega", "phi", "kappa")]).tolist(),
            }
            for row in stations()
        ],
        "adjusted_water": {"tide": [float(row["tide"]) for row in stations()], "tilt": [0.0, 0.0], "index": 1.3398},
    }


def stations() -> list[dict[str, str]]:
    with (LAGOON / "cameras.csv").open(newline="") as file:
        return list(csv.DictReader(file))
