"""The ten-photo `musat run` from the shell, as a ratio to importing what it stands on: at most 2.5.

`python tests/benchmarks/bench_startup.py` prints the ratio; `pytest tests/benchmarks/bench_startup.py` asserts it.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

DECK = Path(__file__).parents[2] / "fixtures" / "cayman" / "cayman_modified.crd"
MUSAT = Path(sys.executable).with_name("musat")
LIMIT = 2.5
REPETITIONS = 11


def wall_time(command: list[str]) -> float:
    """Return the seconds that a command takes."""
    start = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def measure(repetitions: int = REPETITIONS) -> tuple[float, float]:
    """Return the median seconds of the run and of the imports, taken in turn so that both see the same machine."""
    with tempfile.TemporaryDirectory() as folder:
        run = [str(MUSAT), "run", str(DECK), "-o", folder]
        imports = [sys.executable, "-c", "import numpy, scipy.linalg, pyproj"]
        wall_time(run), wall_time(imports)  # byte code and file caches
        pairs = [(wall_time(run), wall_time(imports)) for _ in range(repetitions)]
    runs, bare = zip(*pairs, strict=True)
    return statistics.median(runs), statistics.median(bare)


def test_startup_ratio():
    run, imports = measure()
    assert run <= LIMIT * imports, f"{run:.3f} s is {run / imports:.2f} times {imports:.3f} s"


if __name__ == "__main__":
    seconds, reference = measure()
    print(f"musat run {seconds:.3f} s, imports {reference:.3f} s, ratio {seconds / reference:.2f} (limit {LIMIT})")
