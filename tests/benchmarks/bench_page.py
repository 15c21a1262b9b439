"""The page of simulated blocks: CPU seconds of `run --html` beyond those of `run`, of `report`, and their ratios.

    python tests/benchmarks/bench_page.py [photos ...]

Every command is a process of its own, by turns; ratios are those of one turn, of which the least is shown. Blocks
are dry, and with 30 % of the points submerged.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

SIZES = (300, 1000)
SUBMERGED = (0.0, 0.3)
REPETITIONS = 3


def cpu_seconds(*arguments: str | Path) -> float:
    """Return the CPU seconds (user and system) of a command of musat."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, "-m", "musatpy", *map(str, arguments)], check=True, env={**os.environ, "COLUMNS": "80"}
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def turn(deck: Path, folder: Path) -> tuple[float, float, float]:
    """Return the seconds of a run, of its page beside it, and of the page of its record."""
    run = cpu_seconds("run", "-q", deck, "-o", folder)
    both = cpu_seconds("run", "-q", "--html", deck, "-o", folder)
    report = cpu_seconds("report", "-q", folder / f"{deck.stem}.json", "-o", folder / "other.html")
    return run, both - run, report


def main(sizes: list[int]) -> None:
    """Print a table of the blocks."""
    from large_blocks import make_block

    from musatpy.formats.musat import deck_bytes

    print("| photos | submerged | run, s | page with the run, s | ratio | report, s | ratio | page, MB |")
    print("|---|---|---|---|---|---|---|---|")
    for photos in sizes:
        for share in SUBMERGED:
            with tempfile.TemporaryDirectory() as name:
                folder = Path(name)
                deck = folder / "block.crd"
                deck.write_bytes(deck_bytes(make_block(photos, submerged=share)))
                turn(deck, folder)  # kernels are compiled and cached
                turns = [turn(deck, folder) for _ in range(REPETITIONS)]
                size = (folder / "block.html").stat().st_size / 1e6
            run, page, report = (min(seconds) for seconds in zip(*turns, strict=True))
            beside, alone = min(p / r for r, p, _ in turns), min(other / r for r, _, other in turns)
            print(
                f"| {photos:,} | {share:.0%} | {run:.2f} | {page:.2f} | {beside:.2f} | {report:.2f} | {alone:.2f} "
                f"| {size:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main([int(size) for size in sys.argv[1:]] or list(SIZES))
