"""Loops are compiled anew when any source of theirs is another one."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import musatpy

PACKAGE = Path(musatpy.__file__).parent
PAIRS = """
from musatpy.adjustment.compiled.elimination import Pairs, find_pairs
import numpy as np
pairs = Pairs(np.zeros(2, dtype=int), np.zeros(3, dtype=np.int32))
find_pairs(np.array([0, 2]), np.array([0, 1]), np.array([0, 2, 3]), np.array([0, 1, 1]), pairs)
print(pairs.slot.tolist(), sum(find_pairs.stats.cache_hits.values()))
"""


@pytest.mark.slow
def test_a_source_that_is_another_one_is_seen_by_loops_of_other_files(tmp_path: Path) -> None:
    """Else a newer version would go on with the pieces of the old one, and say nothing."""
    copy = shutil.copytree(PACKAGE, tmp_path / "musatpy", ignore=shutil.ignore_patterns("__pycache__"))

    def run() -> str:
        environment = os.environ | {"PYTHONPATH": str(tmp_path)}
        environment.pop("NUMBA_CACHE_DIR", None)
        ran = subprocess.run(
            [sys.executable, "-c", PAIRS], capture_output=True, text=True, env=environment, check=True
        )
        return ran.stdout.strip()

    assert run() == "[0, 1, 2] 0"
    assert run() == "[0, 1, 2] 1"
    piece = copy / "adjustment" / "compiled" / "rays.py"  # no part of these pairs
    piece.write_text(piece.read_text() + "# another one\n")
    assert run() == "[0, 1, 2] 0"
    assert run() == "[0, 1, 2] 1"
