"""`musat run` of simulated blocks, phase by phase: CPU seconds and peak memory from the deck to the record.

    python tests/benchmarks/bench_phases.py [photos ...]

Every run is in a process of its own, as is what it is measured by: reading the deck and adjusting it, alone.
Kernels are loaded before, by a small block. Targets: a run of 1,000 photos in no more than 2.2 times the CPU
seconds of reading and adjusting, 5,000 photos within 0.9 GB, a record of six times the bytes of the deck.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line has it: the threads are our own

SIZES = (300, 1000, 5000)
PHASES = ("reading", "adjustment", "covariances", "statistics", "listing", "record", "all")
REPETITIONS = 3


class Phases:
    """Takes the CPU seconds and the peak memory as each phase of a run begins."""

    def __init__(self) -> None:
        self.marks: list[tuple[str, float, float]] = []

    def __call__(self, iteration: Any) -> None:
        """Take no note of iterations."""

    def phase(self, phase: Any) -> None:
        """Take note of a phase."""
        name = {"reading": "reading", "covariances": "covariances", "statistics": "statistics"}.get(phase.name)
        if name is None:
            name = "record" if phase.name == "record" else "listing" if self.is_reporting else "adjustment"
        self.mark(name)

    @property
    def is_reporting(self) -> bool:
        """True once the adjustment is done."""
        return any(name == "statistics" for name, *_ in self.marks)

    def mark(self, name: str) -> None:
        """Begin a phase."""
        self.marks.append((name, time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6))

    def table(self) -> dict[str, Any]:
        """Return the seconds of each phase, and the peak (GB) at its end."""
        found: dict[str, Any] = {}
        for (name, start, _), (_, end, peak) in zip(self.marks, self.marks[1:], strict=False):
            found[name] = (found.get(name, (0.0, 0.0))[0] + end - start, peak)
        found["all"] = (self.marks[-1][1] - self.marks[0][1], self.marks[-1][2])
        return found


def measured(deck: Path, alone: bool) -> dict[str, Any]:
    """Run a deck in this process, or only read and adjust it."""
    from large_blocks import make_block

    from musatpy import adjust, read_deck
    from musatpy.runs import run_deck

    adjust(make_block(210))  # kernels
    phases = Phases()
    if alone:
        phases.mark("reading")
        block = read_deck(deck)
        phases.mark("adjustment")
        adjust(block)
    else:
        result = run_deck(deck, progress=phases)
        assert result.solution is not None and result.solution.converged
    phases.mark("end")
    return phases.table()


def in_a_process(deck: Path, alone: bool) -> dict[str, Any]:
    """Return what `measured` does, of a process of its own."""
    command = [sys.executable, __file__, "alone" if alone else "run", str(deck)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return dict(json.loads(done.stdout.splitlines()[-1]))


def best(deck: Path, alone: bool) -> dict[str, Any]:
    """Return the run of the fewest CPU seconds."""
    runs = [in_a_process(deck, alone) for _ in range(REPETITIONS)]
    return min(runs, key=lambda run: run["all"][0])


def row(photos: int, folder: Path) -> str:
    """Return the row of a block in a table of Markdown."""
    from large_blocks import make_block

    from musatpy import write_deck

    deck = folder / f"block{photos}.crd"
    write_deck(make_block(photos), deck)
    run, alone = best(deck, False), best(deck, True)
    sizes = [deck.with_suffix(ending).stat().st_size for ending in (".crd", ".lst", ".json")]
    cells = [f"{photos:,}", *(f"{size / 1e6:.1f}" for size in sizes), f"{sizes[2] / sizes[0]:.1f}"]
    cells += [f"{run[phase][0]:.2f}" for phase in PHASES if phase in run]
    cells += [f"{run['all'][0] / alone['all'][0]:.2f}", f"{run['covariances'][1]:.2f}", f"{run['all'][1]:.2f}"]
    return f"| {' | '.join(cells)} |"


def main(sizes: list[int]) -> None:
    """Print the table."""
    heads = ["photos", "deck, MB", "listing, MB", "record, MB", "record / deck"]
    heads += [f"{phase}, s" for phase in PHASES]
    heads += ["of reading and adjusting", "peak before printing, GB", "peak, GB"]
    print(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|")
    with tempfile.TemporaryDirectory() as folder:
        for photos in sizes:
            print(row(photos, Path(folder)), flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] in (["run"], ["alone"]):
        print(json.dumps(measured(Path(sys.argv[2]), sys.argv[1] == "alone")))
    else:
        main([int(argument) for argument in sys.argv[1:]] or list(SIZES))
