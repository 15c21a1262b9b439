"""Temporary files that killed processes leave."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from musatpy.files import is_alive, remove_leftovers


def test_leftovers_of_a_process_that_nobody_waited_for(tmp_path):
    """An orphan stays a zombie where the first process of a container waits for none."""
    if not Path("/proc/self/stat").exists():
        pytest.skip("no table of processes to read states from")
    ended = subprocess.Popen([sys.executable, "-c", "pass"], stdout=subprocess.PIPE)
    assert ended.stdout and ended.stdout.read() == b""  # which it closes at its end
    os.waitid(os.P_PID, ended.pid, os.WEXITED | os.WNOWAIT)  # ended, and still to be waited for
    try:
        assert not is_alive(ended.pid)
        left, written = tmp_path / f".a.lst.{ended.pid}", tmp_path / f".a.lst.{os.getpid()}"
        for path in (left, written):
            path.write_text("half a fi")
        remove_leftovers([tmp_path / "a.lst"])
        assert not left.exists()
        assert written.exists()
    finally:
        ended.wait()
