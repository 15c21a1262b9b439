"""Loops are compiled anew when any source of theirs is another one."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import musatpy

PACKAGE = Path(musatpy.__file__).parent
ADDED = """
from musatpy.adjustment.compiled.points import LinearPoints, follow
import numpy as np
i, list_, table, stack = np.zeros(0, dtype=int), np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2, 3))
points = LinearPoints(stack, stack, table, stack, table, list_, list_)
follow(i, i, i, points, (0,), table, table)
print(sum(follow.stats.cache_hits.values()))
"""


@pytest.mark.slow
def test_a_source_that_is_another_one_is_seen_by_loops_of_other_files(tmp_path: Path) -> None:
    """Else a newer version would go on with the pieces of the old one, and say nothing."""
    copy = shutil.copytree(PACKAGE, tmp_path / "musatpy", ignore=shutil.ignore_patterns("__pycache__"))

    def run() -> str:
        environment = os.environ | {"PYTHONPATH": str(tmp_path)}
        environment.pop("NUMBA_CACHE_DIR", None)
        ran = subprocess.run(
            [sys.executable, "-c", ADDED], capture_output=True, text=True, env=environment, check=True
        )
        return ran.stdout.strip()

    assert run() == "0"
    assert run() == "1"
    piece = copy / "adjustment" / "compiled" / "loops.py"  # no part of these
    piece.write_text(piece.read_text() + "# another one\n")
    assert run() == "0"
    assert run() == "1"
