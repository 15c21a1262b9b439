"""Kernels are compiled anew when any source of theirs is another one."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import musatpy
from musatpy.compiling import sources

PACKAGE = Path(musatpy.__file__).parent
RAYS = """
from musatpy.adjustment.kernels.rays import directions
from musatpy.adjustment.kernels.points import Measured, Stations
import numpy as np
ones, one = np.ones((1, 2)), np.ones(1)
at = Measured(np.zeros(1, dtype=int), np.arange(2), np.zeros(1, dtype=int), ones, ones, np.zeros((1, 3)))
stations = Stations(np.zeros((1, 3)), np.eye(3)[None], np.eye(3)[None], ones, 100.0 * one, 0.0 * ones)
u = np.empty((1, 3))
directions(np.zeros(1, dtype=int), at, stations, u)
print(round(u[0, 2] / u[0, 0]), sum(directions.stats.cache_hits.values()))
"""


def test_all_sources_of_kernels_are_known() -> None:
    known = {str(source) for source in sources()}
    users = [
        path
        for path in PACKAGE.rglob("*.py")
        if "@compiled\n" in (text := path.read_text()) or "@inlined\n" in text
    ]
    assert users and {str(path) for path in users} <= known


@pytest.mark.slow
def test_a_source_that_is_another_one_is_seen_by_kernels_of_other_files(tmp_path: Path) -> None:
    """Else a newer version would go on with the pieces of the old one, and say nothing."""
    copy = shutil.copytree(PACKAGE, tmp_path / "musatpy", ignore=shutil.ignore_patterns("__pycache__"))

    def run() -> list[str]:
        environment = os.environ | {"PYTHONPATH": str(tmp_path)}
        environment.pop("NUMBA_CACHE_DIR", None)
        ran = subprocess.run(
            [sys.executable, "-c", RAYS], capture_output=True, text=True, env=environment, check=True
        )
        return ran.stdout.split()

    assert run() == ["-100", "0"]
    assert run() == ["-100", "1"]
    piece = copy / "refraction" / "compiled_flat.py"  # no part of these rays
    piece.write_text(piece.read_text() + "# another one\n")
    assert run() == ["-100", "0"]
    assert run() == ["-100", "1"]
