"""Spoilt inputs end in an answer or a message: three hundred of those that `fuzz_inputs` makes by the thousand."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.fuzz_inputs import fuzz


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(7, 13))
def test_spoilt_inputs_end_in_an_answer_or_a_message(seed: int) -> None:
    tally = fuzz(50, seed, tell=lambda text: None)
    assert tally.failures == []
    assert tally.statuses[0] > 5 and tally.statuses[1] > 5  # some are harmless, some are not


@pytest.mark.slow
def test_a_case_that_hangs_outside_python_is_ended() -> None:
    """Such as OpenBLAS asking for memory: no handler of a signal is called there, the system ends the process."""
    code = "from drivers.fuzzing import cpu_limit\nwith cpu_limit(1.0):\n    sum(range(10**11))"
    ran = subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parent, timeout=200, check=False)
    assert ran.returncode == -signal.SIGXCPU
