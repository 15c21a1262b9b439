"""Files under temporary names: written through no link, mixed by no two processes, removed after killed ones."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from musatpy.campaign.locks import folder_locks
from musatpy.files import is_alive, remove_leftovers, together, whole_file, whole_path, write_files


def test_leftovers_of_a_process_that_nobody_waited_for(tmp_path):
    """An orphan stays a zombie where the first process of a container waits for none."""
    if not Path("/proc/self/stat").exists():
        pytest.skip("no table of processes to read states from")
    ended = subprocess.Popen([sys.executable, "-c", "pass"], stdout=subprocess.PIPE)
    assert ended.stdout and ended.stdout.read() == b""  # which it closes at its end
    os.waitid(os.P_PID, ended.pid, os.WEXITED | os.WNOWAIT)  # ended, and still to be waited for
    try:
        assert not is_alive(ended.pid)
        left, written = (tmp_path / f".a.lst.{pid}.{'0' * 16}" for pid in (ended.pid, os.getpid()))
        for path in (left, written):
            path.write_text("half a fi")
        remove_leftovers([tmp_path / "a.lst"])
        assert not left.exists()
        assert written.exists()
    finally:
        ended.wait()


def whole(path):
    with whole_file(path) as file:
        file.write(b"new")


def of_package(path):
    with whole_path(path) as temporary:
        temporary.write_bytes(b"new")


@pytest.mark.parametrize("write", [whole, of_package, lambda path: write_files({path: b"new"})])
def test_a_planted_link_is_not_written_through(tmp_path, monkeypatch, write):
    """Whoever may write to the folder, and has guessed what name comes next, has nothing of it."""
    (precious := tmp_path / "precious").write_text("of somebody")
    monkeypatch.setattr(os, "urandom", lambda count: bytes(count))
    target = tmp_path / "a.lst"
    target.with_name(f".a.lst.{os.getpid()}.{'0' * 16}").symlink_to(precious)
    with pytest.raises(FileExistsError, match=r"a\.lst"):
        write(target)
    assert precious.read_text() == "of somebody" and not target.exists()
    monkeypatch.undo()
    write(target)
    assert target.read_bytes() == b"new" and not target.is_symlink()


def test_a_lock_is_no_link(tmp_path):
    (precious := tmp_path / "precious").write_text("of somebody")
    (tmp_path / ".a.lst.lock").symlink_to(precious)
    with pytest.raises(OSError, match="lock"):
        write_files({tmp_path / "a.lst": b"1", tmp_path / "a.json": b"1"})
    (tmp_path / ".musat-batch.lock").symlink_to(precious)
    with folder_locks() as locks, pytest.raises(OSError, match="may be removed"):
        locks.take(tmp_path)
    assert precious.read_text() == "of somebody" and not (tmp_path / "a.lst").exists()


def test_a_lock_that_a_killed_process_left_is_removed(tmp_path):
    (lock := tmp_path / ".a.lst.lock").write_bytes(b"")
    remove_leftovers([tmp_path / "a.lst"])
    assert not lock.exists()
    with together():
        write_files({tmp_path / "a.lst": b"1", tmp_path / "a.json": b"1"})
        remove_leftovers([tmp_path / "a.lst"])
        assert lock.exists()  # it is held
    assert not lock.exists()


WRITER = """
import sys
import time
from pathlib import Path
from musatpy.files import together, write_files
folder, mark = Path(sys.argv[1]), sys.argv[2].encode()
for n in range(60):
    with together():
        write_files({folder / "a.lst": mark, folder / "a.json": mark})
        write_files({folder / "a.html": mark})
"""


@pytest.mark.slow
def test_two_processes_do_not_mix_their_files(tmp_path):
    """While nobody is at work, what stands there is of one of them."""
    writers = [subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path), mark]) for mark in "AB"]
    mixed = seen = 0
    while any(writer.poll() is None for writer in writers):
        with together():
            write_files({tmp_path / "a.lst": b"C", tmp_path / "a.json": b"C"})
            write_files({tmp_path / "a.html": b"C"})
            mixed += {(tmp_path / f"a.{ending}").read_bytes() for ending in ("lst", "json", "html")} != {b"C"}
            seen += 1
    assert [writer.returncode for writer in writers] == [0, 0]
    assert seen and not mixed
    names = ("a.html", "a.json", "a.lst")
    assert sorted(left.name for left in tmp_path.iterdir()) == list(names)
    assert len({(tmp_path / name).read_bytes() for name in names}) == 1


def test_who_waits_for_a_lock_has_that_of_the_file_there(tmp_path):
    """The lock is taken away while another process waits for it, which then makes a new one."""
    files = {tmp_path / "a.lst": b"1", tmp_path / "a.json": b"1"}
    with together():
        write_files(files)
        assert (tmp_path / ".a.lst.lock").exists()
        waiting = subprocess.Popen([sys.executable, "-c", WRITER.replace("60", "1"), str(tmp_path), "W"])
        time.sleep(0.5)
        assert waiting.poll() is None and (tmp_path / "a.json").read_bytes() == b"1"
    assert waiting.wait(60) == 0
    assert (tmp_path / "a.json").read_bytes() == b"W" and not (tmp_path / ".a.lst.lock").exists()
