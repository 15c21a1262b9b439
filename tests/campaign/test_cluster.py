"""A batch by the workers of another engine: a scheduler and two workers of Dask, and executors of Python."""

import os
import re
import shutil
import signal
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Self

import pytest

from campaign.batches import ROOT, Here, assert_whole, decks_in, here, leftovers, near, start, summary_of, wait_for
from musatpy.campaign.batch import run_batch
from musatpy.campaign.batch_jobs import BatchJob, JobOptions, JobState
from musatpy.campaign.carried import cluster as workers_of
from musatpy.campaign.carried import delivered, parcel_of, run_parcel
from musatpy.campaign.manifest import plan_of
from musatpy.campaign.worker import run_job

pytestmark = pytest.mark.slow


def results(folder: Path) -> dict[str, bytes]:
    """Return what a batch left but its summary, which has times in it."""
    files = (path for path in folder.rglob("[!.]*") if path.is_file() and not path.name.startswith("musat-batch"))
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def told(folder: Path) -> list[dict]:
    """Return what the summary says of the jobs of a batch, but for times and their folder."""
    return [{**job, "seconds": None, "folder": None} for job in summary_of(folder)["jobs"]]


@near()
def test_jobs_that_are_carried_leave_and_say_what_those_of_this_machine_do(tmp_path):
    """Among them a deck that cannot be used, one that is not there, card formats, lists and polygons of points."""
    decks_in(tmp_path, small=1)
    shutil.copy(ROOT / "fixtures" / "bad_decks" / "many_errors.crd", tmp_path)
    formats = Path(shutil.copytree(ROOT / "card_formats" / "musat", tmp_path / "own"))
    wet, land = tmp_path / "wet.txt", tmp_path / "land.csv"
    wet.write_text("203\n206\n")
    land.write_text("-64.93 18.34\n-64.91 18.34\n-64.91 18.36\n-64.93 18.36\n")
    options = JobOptions(
        formats=formats, punch="result", punch_family="patb", punch_edits=True, submerged=wet, dry=land
    )
    sources = [tmp_path, tmp_path / "gone.crd"]
    for name, executor in (("local", None), ("carried", Here())):
        result = run_batch(plan_of(sources, tmp_path / name, options), executor=executor)
        states = {job.deck.stem: outcome.state for job, outcome in zip(result.jobs, result.outcomes, strict=True)}
        assert states == {"many_errors": JobState.UNUSABLE, "small0": JobState.ACCEPTED, "gone": JobState.UNUSABLE}
    assert results(tmp_path / "local") == results(tmp_path / "carried")
    assert len(results(tmp_path / "local")) >= 4
    assert "dry=land.csv (" in (tmp_path / "local/small0.lst").read_text()
    assert told(tmp_path / "local") == told(tmp_path / "carried")
    again = run_batch(plan_of(sources, tmp_path / "carried", options))  # by whom it was finished does not matter
    assert sum(outcome.kept for outcome in again.outcomes) == 1


def test_a_job_that_an_engine_loses_stops_no_other(tmp_path):
    decks_in(tmp_path, small=3)
    result = run_batch(plan_of([tmp_path]), executor=Here({"small1": RuntimeError("no worker left")}))
    assert [outcome.state for outcome in result.outcomes] == [
        JobState.ACCEPTED,
        JobState.CRASHED,
        JobState.ACCEPTED,
    ]
    assert result.outcomes[1].message == "its worker was lost: RuntimeError: no worker left"
    assert assert_whole(tmp_path) == {"small0", "small2"}


def test_any_executor_will_do(tmp_path):
    """That of Python is broken by a process that dies: every job ends all the same, and the next batch goes on."""
    decks_in(tmp_path, small=3)
    with ProcessPoolExecutor(1) as executor:
        executor.submit(os.getpid).result()
        for pid in list(executor._processes):
            os.kill(pid, signal.SIGKILL)
        states = {outcome.state for outcome in run_batch(plan_of([tmp_path]), executor=executor).outcomes}
    assert states == {JobState.CRASHED}
    with ProcessPoolExecutor(2) as executor:
        assert run_batch(plan_of([tmp_path]), executor=executor).status == 0
    assert assert_whole(tmp_path) == {"small0", "small1", "small2"}


def test_what_changes_on_the_way_has_no_results(tmp_path, monkeypatch):
    (deck,) = decks_in(tmp_path, small=1)
    job = BatchJob(deck=deck)
    parcel = parcel_of(job)
    outcome, files = run_parcel(parcel)
    assert outcome.state is JobState.ACCEPTED
    deck.write_bytes(deck.read_bytes() + b"\n")
    late = delivered(job, outcome, files)
    assert (late.state, late.message) == (JobState.FAILED, f"{deck}: the deck was changed while it was run")
    assert (late.outputs, os.listdir(tmp_path)) == ({}, ["small0.crd"])
    for changed in ("musatpy.__version__", "musatpy.campaign.batch_jobs.sources_sha256"):
        with monkeypatch.context() as patch:
            patch.setattr(changed, "99.0" if changed.endswith("__") else lambda: "other" * 10)
            other, files = run_parcel(parcel)
        assert (other.state, files) == (JobState.FAILED, {})
        assert re.match(r"its worker has version (99\.0 \(|0.* \(other).* of the program, not ", other.message)


def test_a_disk_that_is_full_fails_a_job_that_was_carried(tmp_path, monkeypatch):
    (deck,) = decks_in(tmp_path, small=1)
    outcome, files = run_parcel(parcel_of(BatchJob(deck=deck)))
    (tmp_path / "small0.json").mkdir()
    failed = delivered(BatchJob(deck=deck), outcome, files)
    assert (failed.state, failed.message) == (JobState.FAILED, f"{tmp_path / 'small0.json'}: Is a directory")
    assert run_job(BatchJob(deck=deck)).message == failed.message  # as a job of this machine says it


def test_a_cluster_that_does_not_answer(tmp_path, monkeypatch):
    monkeypatch.setattr("musatpy.campaign.carried._PATIENCE", 1)
    from cli.commands import musat

    decks_in(tmp_path, small=1)
    for address in ("tcp://127.0.0.1:9", "nowhere"):
        ran = musat("batch", tmp_path, "--cluster", address)
        assert (ran.exit_code, f"{address}: no scheduler can be reached" in ran.stderr) == (1, True)
    ran = musat("batch", tmp_path, "--cluster", "tcp://127.0.0.1:9", "-j", "2")
    assert (ran.exit_code, "-j counts jobs on this machine" in ran.stderr) == (2, True)


def test_the_program_is_known_by_its_sources(tmp_path):
    """A copy with one changed title is another program, of the same version; a finished job is run again by it."""
    shutil.copytree(ROOT / "src", tmp_path / "src")
    shutil.copytree(ROOT / "card_formats", tmp_path / "card_formats")
    says = [sys.executable, "-c", "from musatpy.campaign.batch_jobs import program; print(program())"]

    def said(folder: Path) -> str:
        return subprocess.check_output(says, text=True, env=os.environ | {"PYTHONPATH": str(folder / "src")})

    assert said(tmp_path) == said(ROOT)
    deck = decks_in(tmp_path / "decks", small=1)[0]
    batch = [sys.executable, "-m", "musatpy", "batch", str(deck), "-q"]
    for changes, kept in ((False, 0), (False, 1), (True, 0)):
        if changes:
            title = tmp_path / "card_formats" / "musat" / "wtr.toml"
            title.write_text(title.read_text().replace("title = ", "title = 'Other' # ", 1))
            assert said(tmp_path) != said(ROOT)
        environment = os.environ | {"PYTHONPATH": str(tmp_path / "src"), "OPENBLAS_NUM_THREADS": "1"}
        subprocess.run(batch, check=True, env=environment, cwd=tmp_path)
        assert summary_of(deck.parent)["counts"]["kept"] == kept


class Cluster:
    """A scheduler and its workers in a `with` statement, each a process of its own that can be killed."""

    def __init__(self, folder: Path, workers: int) -> None:
        folder.mkdir()
        self.folder = folder
        self.processes: list[subprocess.Popen[str]] = []
        scheduler = self.start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        log = folder / "0.log"
        wait_for(lambda: re.search(r"Scheduler at:\s+(tcp://\S+)", log.read_text()), 60)
        self.address = re.search(r"Scheduler at:\s+(tcp://\S+)", log.read_text())[1]
        assert scheduler.poll() is None
        self.workers = self.add_workers(workers)

    def add_workers(self, number: int) -> list[subprocess.Popen[str]]:
        """Start workers without a nanny, which would start another one for each that is killed."""
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard")
        started = [self.start("worker", self.address, *options) for _ in range(number)]
        for n in range(1, number + 1):
            wait_for(lambda n=n: "Registered to:" in (self.folder / f"{n}.log").read_text(), 60)
        return started

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        place = self.folder / f"{len(self.processes)}"  # where the workers see nothing of the batch
        place.mkdir()
        environment = {**os.environ, "DASK_TEMPORARY_DIRECTORY": str(place), "OPENBLAS_NUM_THREADS": "1"}
        with place.with_suffix(".log").open("w") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "distributed.cli.dask_" + arguments[0], *arguments[1:]],
                cwd=place, stdout=log, stderr=log, env=environment,
            )  # fmt: skip
        self.processes.append(process)
        return process

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.processes:
            process.kill()
            process.wait()


def test_a_cluster_of_which_a_worker_is_killed(tmp_path):
    decks_in(tmp_path / "decks", small=6)
    assert here("batch", "decks", "-o", "local", "-q", cwd=tmp_path).exit_code == 0
    with Cluster(tmp_path / "cluster", workers=2) as cluster:
        batch = start("batch", "decks", "-o", "far", "--cluster", cluster.address, cwd=tmp_path)
        ledger = tmp_path / "far" / ".musat-batch.jsonl"
        wait_for(lambda: ledger.exists() and len(ledger.read_text().splitlines()) >= 2, 60)
        cluster.workers[0].kill()
        table, errors = batch.communicate(timeout=120)
    assert batch.returncode == 0, errors
    assert table.splitlines()[-1] == "6 jobs: 6 accepted; summary far/musat-batch.json"
    ended = [line for line in errors.splitlines() if line.startswith("[")]
    assert sorted(re.search(r"small\d+", line)[0] for line in ended) == sorted(f"small{n}" for n in range(6))
    assert len(ledger.read_text().splitlines()) == 6  # each once
    assert results(tmp_path / "far") == results(tmp_path / "local")
    assert told(tmp_path / "far") == told(tmp_path / "local")
    assert leftovers(tmp_path / "far") == []


def test_a_batch_of_a_cluster_that_is_interrupted_goes_on(tmp_path):
    decks_in(tmp_path / "decks", small=6)
    with Cluster(tmp_path / "cluster", workers=1) as cluster:
        command = ("batch", "decks", "-o", "far", "--cluster", cluster.address)
        batch = start(*command, cwd=tmp_path)
        ledger = tmp_path / "far" / ".musat-batch.jsonl"
        wait_for(lambda: ledger.exists() and ledger.read_text(), 60)
        batch.send_signal(signal.SIGINT)
        _, errors = batch.communicate(timeout=30)
        assert (batch.returncode, "interrupted; what is finished is kept" in errors) == (1, True)
        finished = len(ledger.read_text().splitlines())
        assert summary_of(tmp_path / "far")["counts"]["not run"] == 6 - finished
        assert here(*command, cwd=tmp_path).exit_code == 0
    assert summary_of(tmp_path / "far")["counts"]["kept"] == finished
    assert assert_whole(tmp_path / "far") == {f"small{n}" for n in range(6)}


def test_a_cluster_without_workers_says_so(tmp_path):
    decks_in(tmp_path / "decks", small=1)
    with Cluster(tmp_path / "cluster", workers=0) as cluster:
        batch = start("batch", "decks", "-o", "far", "-q", "--cluster", cluster.address, cwd=tmp_path)
        said = batch.stderr.readline()
        assert f"{cluster.address}: the scheduler has no workers yet" in said
        assert batch.poll() is None  # one may come
        batch.send_signal(signal.SIGINT)
        batch.communicate(timeout=60)
    assert batch.returncode == 1


def test_a_cluster_whose_workers_die_on_loading(tmp_path, monkeypatch):
    """Each takes the job, and its end with it: when none is left, the job ends too."""
    decks_in(tmp_path / "decks", small=1)
    broken = tmp_path / "broken" / "musatpy"
    broken.mkdir(parents=True)
    (broken / "__init__.py").write_text("import os\nos._exit(1)\n")
    with Cluster(tmp_path / "cluster", workers=0) as cluster:
        with monkeypatch.context() as patch:
            patch.setenv("PYTHONPATH", str(broken.parent))
            cluster.add_workers(2)
        monkeypatch.setattr("musatpy.campaign.carried._PATIENCE", 5)
        with workers_of(cluster.address) as executor:
            (outcome,) = run_batch(plan_of([tmp_path / "decks"]), executor=executor).outcomes
    assert outcome.state is JobState.CRASHED
    assert outcome.message == "its worker was lost: all workers were lost, and none came in 5 s: their logs say why"


def test_a_cluster_whose_scheduler_is_lost(tmp_path):
    decks_in(tmp_path / "decks", small=6)
    with Cluster(tmp_path / "cluster", workers=1) as cluster:
        batch = start("batch", "decks", "-o", "far", "--cluster", cluster.address, cwd=tmp_path)
        ledger = tmp_path / "far" / ".musat-batch.jsonl"
        wait_for(lambda: ledger.exists() and ledger.read_text(), 60)
        cluster.processes[0].kill()
        _, errors = batch.communicate(timeout=60)
    counts = summary_of(tmp_path / "far")["counts"]
    assert (batch.returncode, "its worker was lost: " in errors, "Traceback" in errors) == (1, True, False)
    assert counts["accepted"] == len(ledger.read_text().splitlines())
    assert counts["accepted"] + counts["crashed"] == 6
