"""Commands whose memory is limited: a message and a status, at once, whatever the limit is."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
THOMAS = ROOT / "fixtures" / "st_thomas" / "st_thomas.crd"
TANK = ROOT / "fixtures" / "orientation" / "tank.crd"
MAIN = "from musatpy.cli.main import main; main()"
CPU = 20  # seconds, after which the system ends a process that asks for ever


def limited(megabytes: int, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (megabytes << 20, megabytes << 20))
        resource.setrlimit(resource.RLIMIT_CPU, (CPU, CPU))

    command = [sys.executable, "-c", MAIN, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, preexec_fn=limit)


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits of address space are those of Linux")
@pytest.mark.parametrize("megabytes", [140, 180, 230, 273])
@pytest.mark.parametrize("command", ["run", "orient", "check"])
def test_a_process_that_may_not_have_the_memory_says_so(tmp_path: Path, megabytes: int, command: str) -> None:
    """OpenBLAS asks for ever for what it does not get: each of the limits was met at another place of the start."""
    deck = TANK if command == "orient" else THOMAS
    ran = limited(megabytes, command, deck, *(() if command == "check" else ("-o", tmp_path)))
    assert ran.returncode == 1, (ran.returncode, ran.stderr)
    assert ran.stderr.splitlines()[-1] == f"musat: memory ran out: this process may have {megabytes} MB (ulimit -v)"
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits of address space are those of Linux")
def test_a_process_that_may_have_enough_runs(tmp_path: Path) -> None:
    ran = limited(600, "run", THOMAS, "-o", tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert (tmp_path / "st_thomas.lst").read_bytes() == THOMAS.with_suffix(".lst").read_bytes()
