"""Decks and other inputs that are wrong by chance, by the thousand, in processes with limits of CPU and memory.

`python -m drivers.fuzzing decks|inputs [COUNT] [FIRST SEED] [PROCESSES]` runs so many and prints every fault, and
the counts. A process that the system ends, because code outside Python hangs, is a fault of its case.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path

TESTS = Path(__file__).parents[1]
_AT_ONCE = 25  # cases of a process
_MEMORY = 3 << 30  # bytes of address space: what takes more is a fault


@contextmanager
def cpu_limit(seconds: float) -> Iterator[None]:
    """Let the system end this process after so much CPU in the block, whatever it is at."""
    soft, hard = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (int(time.process_time() + seconds) + 1, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_CPU, (soft, hard))


def _cases(kind: str, first: int, count: int) -> None:
    """Run cases, and print a line of JSON before each (its number) and after (status, CPU, faults)."""
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    if kind == "inputs":
        from drivers.fuzz_inputs import fuzz

        begun = partial(print, flush=True)
        tally = fuzz(count, first, tell=lambda text: None, begun=lambda case: begun(json.dumps({"at": case})))
        faults = [f"{target} {seed}: {what}" for target, seed, what in tally.failures]
        statuses = {str(status): number for status, number in tally.statuses.items()}
        begun(json.dumps({"statuses": statuses, "seconds": tally.slowest, "faults": faults}))
        return
    from drivers.mutated_decks import CPU, run

    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + count):
            print(json.dumps({"at": seed}), flush=True)
            one = run(seed, Path(folder))
            slow = [f"{one.seconds:.1f} s of CPU"] if one.seconds > CPU else []
            faults = [f"{one.deck} {seed} {one.mutations} {one.grade}: {what}" for what in (*one.faults, *slow)]
            result = {
                "statuses": {f"{one.status} {one.grade}".strip(): 1},
                "seconds": one.seconds,
                "faults": faults,
            }
            print(json.dumps(result), flush=True)


def _process(kind: str, first: int, count: int) -> tuple[Counter[str], float, list[str]]:
    """Return statuses, most CPU and faults of cases run in a process."""
    command = [sys.executable, "-m", "drivers.fuzzing", "--cases", kind, str(first), str(count)]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    ran = subprocess.run(command, capture_output=True, text=True, env=environment, check=False, cwd=TESTS)
    lines = ran.stdout.splitlines()
    rows = [json.loads(line) for line in lines if line.startswith("{")]
    done = [row for row in rows if "faults" in row]
    statuses = Counter[str]()
    for row in done:
        statuses.update(row["statuses"])
    faults = [what for row in done for what in row["faults"]]
    faults += [f"a library says {line.strip()}" for line in lines if not line.startswith("{")]
    if ran.returncode:
        at = rows[-1].get("at", first) if rows else first
        statuses["ended"] += 1
        faults.append(f"{kind} {at}: its process ended with {ran.returncode}: {ran.stderr.strip()[-300:]}")
    return statuses, max((row["seconds"] for row in done), default=0.0), faults


def main() -> None:
    """Print what became of the cases."""
    kind, given = sys.argv[1], [int(text) for text in sys.argv[2:]]
    count, first, processes = (*given, *(300, 0, 2)[len(given) :])
    parts = range(0, count, _AT_ONCE)
    # inputs are known by the seed of their process, and counted in it
    seeds = [first + (part // _AT_ONCE if kind == "inputs" else part) for part in parts]
    statuses, slowest, faults = Counter[str](), 0.0, 0
    with ThreadPoolExecutor(processes) as pool:
        for found, seconds, told in pool.map(partial(_process, kind), seeds, [_AT_ONCE] * len(seeds)):
            statuses += found
            slowest = max(slowest, seconds)
            faults += len(told)
            for what in told:
                print(what, flush=True)
    print(f"{sum(statuses.values())} {kind}: {dict(statuses)}, most CPU {slowest:.1f} s, faults {faults}")


if __name__ == "__main__":
    if sys.argv[1] == "--cases":
        _cases(sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
    else:
        main()
