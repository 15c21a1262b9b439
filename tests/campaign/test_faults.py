"""What can happen to a batch, made to happen: kill -9, full disks, unreadable decks, two batches at once."""

import errno
import json
import os
import random
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from campaign.batches import (
    ST_THOMAS,
    assert_whole,
    decks_in,
    expected,
    ledger_of,
    leftovers,
    musat,
    processes_in,
    start,
    summary_of,
    wait_for,
)
from musatpy.campaign.batch import run_batch
from musatpy.campaign.batch_jobs import BatchJob, JobState
from musatpy.campaign.local import last_words
from musatpy.campaign.locks import FolderLocks, LockedError
from musatpy.campaign.manifest import plan_of
from musatpy.campaign.worker import run_job
from musatpy.errors import MusatError

pytestmark = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")


def times_of(folder: Path) -> dict[str, int]:
    """Return when each result was written."""
    return {path.name: path.stat().st_mtime_ns for path in folder.iterdir() if path.suffix in (".lst", ".json")}


@pytest.mark.slow
def test_a_batch_killed_at_random_moments_is_resumed(tmp_path):
    moments = random.Random(1)
    decks = decks_in(tmp_path, small=5)
    for _ in range(3):
        batch = start("batch", ".", "-j", "2", "-q", cwd=tmp_path)
        time.sleep(moments.uniform(0.5, 2.0))
        batch.kill()
        batch.communicate()
        wait_for(lambda: not processes_in(tmp_path))  # the workers end by themselves
        assert_whole(tmp_path)
    done, before = {Path(job).name for job in ledger_of(tmp_path)}, times_of(tmp_path)
    assert run_batch(plan_of([tmp_path])).status == 0
    assert assert_whole(tmp_path) == {deck.stem for deck in decks}
    assert leftovers(tmp_path) == []
    assert {Path(job["deck"]).stem for job in summary_of(tmp_path)["jobs"] if job["kept"]} == done
    for name, when in times_of(tmp_path).items():  # what was finished was not written again
        assert Path(name).stem not in done or when == before[name]


@pytest.mark.slow
def test_two_batches_on_one_folder_and_the_lock_of_one_that_was_killed(tmp_path):
    decks_in(tmp_path, small=1, large=2)
    first = start("batch", ".", "-j", "1", cwd=tmp_path)
    lock = tmp_path / ".musat-batch.lock"
    wait_for(lambda: lock.exists() and lock.read_text())
    (tmp_path / "elsewhere.toml").write_text('out = "other"\n[[job]]\ndeck = "large0.crd"\nout = "."\n')
    for source in (tmp_path, tmp_path / "elsewhere.toml", tmp_path / "large1.crd"):
        with pytest.raises(LockedError, match=rf"another batch is at work here \(pid {first.pid} on "):
            run_batch(plan_of([source]))
    wait_for(lambda: ledger_of(tmp_path))
    first.kill()
    first.communicate()
    assert lock.exists()
    left = tmp_path / f".small0.lst.{first.pid}.{'0' * 16}"
    left.write_text("half a fi")  # as if it had been killed while it wrote
    with (tmp_path / ".musat-batch.jsonl").open("a") as ledger:
        ledger.write('{"job": "large')
    ran = musat("batch", ".", cwd=tmp_path)
    assert ran.returncode == 0
    assert f"took over the lock of a batch that did not end (pid {first.pid} on" in ran.stderr
    assert (leftovers(tmp_path), len(ledger_of(tmp_path)), len(assert_whole(tmp_path))) == ([], 3, 3)
    assert summary_of(tmp_path)["counts"]["kept"] >= 1
    assert run_batch(plan_of([tmp_path])).notes == ()  # nothing is left of either


@pytest.mark.slow
def test_a_batch_waits_for_the_workers_of_one_that_was_killed(tmp_path):
    lock = tmp_path / ".musat-batch.lock"
    code = (
        "import fcntl, sys, time; f = open(sys.argv[1], 'a'); fcntl.flock(f, fcntl.LOCK_EX); "
        "print(1, flush=True); time.sleep(1)"
    )
    with subprocess.Popen(["true"]) as gone:
        pass
    with subprocess.Popen([sys.executable, "-c", code, lock], stdout=subprocess.PIPE, text=True) as orphan:
        assert orphan.stdout and orphan.stdout.readline()
        lock.write_text(json.dumps({"pid": gone.pid, "host": socket.gethostname()}))
        with FolderLocks() as locks:
            locks.take(tmp_path)
            assert orphan.wait(5) == 0
            assert json.loads(lock.read_text())["pid"] == os.getpid()
            assert len(locks.taken_over) == 1
    assert not lock.exists()


@pytest.mark.slow
def test_a_killed_worker_costs_its_job_only(tmp_path, monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")  # which is not for workers
    decks_in(tmp_path, small=3, large=1)
    batch = start("batch", ".", "-j", "2", cwd=tmp_path)
    wait_for(lambda: len(processes_in(tmp_path, batch.pid)) == 2)
    time.sleep(random.Random(3).uniform(0.2, 0.8))
    victim = processes_in(tmp_path, batch.pid)[0]
    assert "OPENBLAS_NUM_THREADS=1" in Path(f"/proc/{victim}/environ").read_text().split("\0")
    os.kill(victim, signal.SIGKILL)
    _, errors = batch.communicate(timeout=60)
    assert batch.returncode == 1
    assert "crashed: its process was killed by SIGKILL (the system does so when memory runs out)" in errors
    counts = summary_of(tmp_path)["counts"]
    assert (counts["crashed"], counts["accepted"]) == (1, 3)
    assert len(assert_whole(tmp_path)) >= 3  # it may have been killed when its files were written
    assert leftovers(tmp_path) == []
    assert run_batch(plan_of([tmp_path])).status == 0
    assert summary_of(tmp_path)["counts"]["kept"] == 3


def test_of_what_a_process_said_the_line_that_tells_most():
    code = (
        "import os, signal, threading, time\n"
        "threading.Thread(target=time.sleep, args=(9,), daemon=True).start()\n"
        "os.kill(os.getpid(), signal.SIGSEGV)\n"
    )
    ran = subprocess.run([sys.executable, "-X", "faulthandler", "-c", code], capture_output=True, text=True)
    assert last_words(ran.stderr) == 'File "<string>", line 3 in <module>'
    ran = subprocess.run([sys.executable, "-c", "import nothing_so"], capture_output=True, text=True)
    assert last_words(f"{ran.stderr}\n") == "ModuleNotFoundError: No module named 'nothing_so'"
    assert last_words(" \n") == ""


def test_memory_that_runs_out_is_told_in_words(tmp_path, monkeypatch):
    (deck,) = decks_in(tmp_path, small=1)

    def refuse(*_, **__):
        raise MemoryError("Unable to allocate 7.00 MiB")

    monkeypatch.setattr("musatpy.campaign.worker.run_deck", refuse)
    outcome = run_job(BatchJob(deck=deck), lambda _: None)
    assert outcome.state is JobState.FAILED
    assert outcome.message == "memory ran out; fewer --jobs need less (Unable to allocate 7.00 MiB)"


ALMOST_NO_MEMORY = """
import resource, sys
from pathlib import Path
from musatpy.campaign.batch_jobs import BatchJob
from musatpy.campaign.worker import run_job
import numpy.linalg, scipy.linalg
size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() + 24 * 2**20
resource.setrlimit(resource.RLIMIT_AS, (size, size))
print(run_job(BatchJob(deck=Path(sys.argv[1])), lambda _: None).message)
"""


@pytest.mark.slow
def test_memory_that_the_system_refuses_ends_a_job(tmp_path):
    """Some versions of OpenBLAS ask for ever for what they are refused."""
    (deck,) = decks_in(tmp_path, small=1)
    ran = subprocess.run([sys.executable, "-c", ALMOST_NO_MEMORY, deck], capture_output=True, text=True, timeout=60)
    assert ran.stdout.strip() == "memory ran out; fewer --jobs need less", ran.stderr


@pytest.mark.slow
@pytest.mark.parametrize("allowed", [0, 1])
def test_threads_that_the_system_refuses(tmp_path, monkeypatch, allowed):
    decks_in(tmp_path, small=2)
    left, start_thread = iter(range(allowed)), threading.Thread.start

    def limited(thread):
        if next(left, None) is None:
            raise RuntimeError("can't start new thread")
        start_thread(thread)

    monkeypatch.setattr("musatpy.campaign.local.threading.Thread.start", limited)
    if allowed:
        assert run_batch(plan_of([tmp_path]), processes=2).status == 0
    else:
        with pytest.raises(MusatError, match="no job can be started, processes or memory are limited: can't"):
            run_batch(plan_of([tmp_path]), processes=2)


def test_processes_that_the_system_refuses(tmp_path, monkeypatch):
    decks_in(tmp_path, small=1)

    def refuse(*_, **__):
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    monkeypatch.setattr("musatpy.campaign.local.subprocess.Popen", refuse)
    (outcome,) = run_batch(plan_of([tmp_path])).outcomes
    assert outcome.state is JobState.FAILED
    assert outcome.message == "no process can be started: Too many open files; fewer --jobs need less"


@pytest.mark.slow
def test_a_folder_that_cannot_be_written_to_says_what_to_do(tmp_path):
    (deck,) = decks_in(tmp_path, small=1)
    ran = musat("batch", deck, "-o", deck / "out")
    assert ran.returncode == 1
    said = "Not a directory; --out, or out in a manifest, takes results elsewhere"
    assert ran.stderr == f"musat: {deck}/out: {said}\n"
    (tmp_path / ".musat-batch.lock").mkdir()  # as if it were another user's, which root may open
    ran = musat("batch", deck)
    said = "Is a directory; where no batch is at work it may be removed"
    assert (ran.returncode, ran.stderr) == (1, f"musat: {tmp_path}/.musat-batch.lock: {said}\n")


@pytest.mark.slow
@pytest.mark.parametrize("gap", [0.0, 0.1])
def test_an_impatient_user_and_a_worker_that_is_stopped(tmp_path, gap):
    """Ctrl-C again while the batch ends is the same wish; a process that does not listen is killed all the same."""
    decks_in(tmp_path, small=0, large=2)
    batch = start("batch", ".", "-j", "2", cwd=tmp_path)
    wait_for(lambda: len(processes_in(tmp_path, batch.pid)) == 2)
    os.kill(processes_in(tmp_path, batch.pid)[0], signal.SIGSTOP)
    for _ in range(2):
        batch.send_signal(signal.SIGINT)
        time.sleep(gap)
    table, errors = batch.communicate(timeout=30)
    assert "interrupted; what is finished is kept, and the same command goes on from there" in errors
    assert (batch.returncode, "Aborted" in errors, "summary musat-batch.json" in table) == (1, False, True)
    assert (processes_in(tmp_path), leftovers(tmp_path)) == ([], [])


@pytest.fixture
def small_disk(tmp_path):
    """A disk of 400 kB, on which the results of two small decks have room."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=400k", "tmpfs", place], capture_output=True)
    if mounted.returncode != 0:
        pytest.skip("a small file system can be mounted by root only")
    yield place
    subprocess.run(["umount", place], check=True)


@pytest.mark.slow
def test_a_full_disk(small_disk, tmp_path):
    decks = decks_in(tmp_path / "decks", small=5)
    ran = musat("batch", tmp_path / "decks", "-o", small_disk, "-j", "2")
    assert ran.returncode == 1
    assert "No space left on device" in ran.stderr
    written = assert_whole(small_disk)
    assert 1 <= len(written) < len(decks)
    assert leftovers(small_disk) == []
    subprocess.run(["mount", "-o", "remount,size=8m", small_disk], check=True)
    before = times_of(small_disk)
    done = {Path(job).name for job in ledger_of(small_disk)}
    assert run_batch(plan_of([tmp_path / "decks"], small_disk)).status == 0
    assert assert_whole(small_disk) == {deck.stem for deck in decks}
    assert summary_of(small_disk)["counts"]["kept"] == len(done)
    assert all(when == before[name] for name, when in times_of(small_disk).items() if Path(name).stem in done)


@pytest.mark.slow
def test_a_full_disk_fails_only_what_goes_there(small_disk, tmp_path):
    decks_in(tmp_path, small=2)
    for name in ("small0.lst", "small0.json"):
        (small_disk / name).write_text("of an earlier run")
    (small_disk / "ballast").write_bytes(bytes(300_000))
    (tmp_path / "jobs.toml").write_text(
        'out = "state"\n[[job]]\ndeck = "small0.crd"\nout = "disk"\n[[job]]\ndeck = "small1.crd"\nout = "here"\n'
    )
    assert run_batch(plan_of([tmp_path / "jobs.toml"]), processes=1).status == 1
    jobs = json.loads((tmp_path / "state" / "jobs.batch.json").read_text())["jobs"]
    assert [job["state"] for job in jobs] == ["failed", "accepted"]
    assert jobs[0]["message"].endswith(": No space left on device")
    assert sorted(os.listdir(small_disk)) == ["ballast", "small0.json", "small0.lst"]
    assert (small_disk / "small0.lst").read_text() == "of an earlier run"


@pytest.mark.slow
def test_files_that_may_not_grow(tmp_path):
    """The same without a disk of its own: the records are larger than a file may be."""
    decks_in(tmp_path, small=2)
    listing, record = (len(expected(ST_THOMAS)[suffix]) for suffix in (".lst", ".json"))
    limit = (listing + record) // 2  # bytes
    assert listing < limit < record

    def small_files():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    uncached = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}  # Python would keep half a compiled module
    ran = musat("batch", ".", "-q", cwd=tmp_path, preexec_fn=small_files, env=uncached)
    assert ran.returncode == 1
    said = ran.stderr.splitlines()
    assert len(said) == 2 and all(line.endswith(": File too large") for line in said)
    assert (assert_whole(tmp_path), leftovers(tmp_path)) == (set(), [])
