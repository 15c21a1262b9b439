"""What a job reads besides its deck, files that are no decks, and terminals and signals that end."""

import json
import os
import shutil
import signal
import subprocess
from pathlib import Path

import pytest

from campaign.batches import (
    ROOT,
    command,
    decks_in,
    here,
    ledger_of,
    leftovers,
    musat,
    near,
    processes_in,
    start,
    summary_of,
    wait_for,
)
from musatpy.campaign.baseline_checks import changed_decks, check
from musatpy.campaign.baselines import BaselineError, accept, load_baseline, save
from musatpy.campaign.batch import Ledger, run_batch
from musatpy.campaign.batch_jobs import BatchJob, JobOptions, JobState
from musatpy.campaign.locks import FolderLocks, LockedError
from musatpy.campaign.manifest import decks_of, plan_of
from musatpy.campaign.worker import run_job
from musatpy.files import whole_file, write_files

UTM = ROOT / "fixtures" / "st_thomas_utm" / "st_thomas_utm.crd"


def deck_with_geoid(folder: Path) -> tuple[Path, Path]:
    """Return a deck whose answer has heights above a geoid, and the grid file; the grid has St. Thomas in it."""
    import numpy as np

    folder.mkdir(parents=True, exist_ok=True)
    grid = folder / "sea.gtx"
    header = np.array([15.0, -70.0, 1.0, 1.0], ">f8").tobytes() + np.array([11, 11], ">i4").tobytes()
    grid.write_bytes(header + np.full((11, 11), -12.5, ">f4").tobytes())
    cards = UTM.read_text().splitlines()
    name = os.path.relpath(grid)
    assert len(name) <= 57
    cards.insert(6, f"SYT OUT GEOID{name:<57}")
    deck = folder / "above.crd"
    deck.write_text("\n".join(cards) + "\n")
    return deck, grid


@pytest.mark.slow
@near()
def test_another_geoid_model_is_another_job(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    deck, grid = deck_with_geoid(tmp_path)
    first = run_batch(plan_of([deck]))
    assert set(first.outcomes[0].inputs) == {"sea.gtx"}
    assert run_batch(plan_of([deck])).outcomes[0].kept
    saved = save(tmp_path / "base", [deck])
    assert set(saved.baseline.entries["above.crd"].inputs) == {"sea.gtx"}
    grid.write_bytes(grid.read_bytes()[:-4] + b"\0\0\0\0")  # a corner that no point of the job is near to
    assert not run_batch(plan_of([deck])).outcomes[0].kept
    assert changed_decks(load_baseline(tmp_path / "base")) == {"above.crd": "other inputs"}
    found = check(tmp_path / "base").decks[0]
    assert (found.state, found.notes) == ("different", ("not the one that was saved: sea.gtx",))
    accept(tmp_path / "base")
    assert check(tmp_path / "base").same


@pytest.mark.slow
def test_card_formats_that_are_edited_while_a_process_is_at_work(tmp_path):
    (deck,) = decks_in(tmp_path, small=1)
    formats = Path(shutil.copytree(ROOT / "card_formats" / "musat", tmp_path / "own"))
    job = BatchJob(deck=deck, options=JobOptions(formats=formats))
    assert run_job(job, lambda _: None).state is JobState.ACCEPTED
    with next(formats.glob("*.toml")).open("a") as stream:
        stream.write("# another remark\n")
    found = run_job(job, lambda _: None)  # by the formats that the process has read: nobody could say which
    assert (found.state, "card formats" in found.message) == (JobState.FAILED, True)


@pytest.mark.slow
@near()
def test_what_has_the_name_of_a_deck_and_is_none(tmp_path):
    (deck,) = decks_in(tmp_path, small=1)
    shutil.copy(deck, tmp_path / "._small0.crd")
    (tmp_path / "folder.crd").mkdir()
    (tmp_path / "dangling.crd").symlink_to("nothing")
    (tmp_path / "empty.crd").write_bytes(b"")
    (tmp_path / "noise.crd").write_bytes(bytes(range(256)) * 40)
    os.mkfifo(tmp_path / "pipe.crd")
    names = ["dangling.crd", "empty.crd", "folder.crd", "noise.crd", "pipe.crd", "small0.crd"]
    assert [path.name for path in decks_of(tmp_path)] == names
    assert [path.name for path in decks_of(tmp_path / "*.crd")] == names
    assert decks_of(tmp_path / "folder.crd") == [tmp_path / "folder.crd"]
    outcomes = run_batch(plan_of([tmp_path, tmp_path / "gone.crd"])).outcomes
    states = [JobState.UNUSABLE] * 4 + [JobState.FAILED, JobState.ACCEPTED, JobState.UNUSABLE]
    assert [one.state for one in outcomes] == states
    for number, said in ((0, "No such file or directory"), (2, "Is a directory"), (6, "No such file or directory")):
        assert said in str(outcomes[number].problems[0])


@pytest.mark.slow
@near()
def test_the_folder_of_a_deck_is_not_made_for_it(tmp_path):
    """A name that was mistyped leaves nothing; the job of a manifest says what is not there."""
    ran = here("batch", "mistyped/small0.crd", cwd=tmp_path)
    assert (ran.exit_code, ran.stderr) == (1, "musat: mistyped/: No such file or directory\n")
    (tmp_path / "m.toml").write_text('[[job]]\ndeck = ["mistyped/small0.crd", "m.toml/small0.crd"]\n')
    first, second = run_batch(plan_of([tmp_path / "m.toml"])).outcomes
    assert "No such file or directory" in str(first.problems[0])
    assert "Not a directory" in str(second.problems[0])
    assert sorted(os.listdir(tmp_path)) == ["m.batch.json", "m.toml"]


@pytest.mark.slow
def test_a_batch_goes_on_when_nobody_reads_what_it_says(tmp_path):
    decks_in(tmp_path, small=2)
    reading, writing = os.pipe()
    os.close(reading)
    subprocess.run(command("batch", ".", "-j", "1"), cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=writing)
    os.close(writing)
    assert summary_of(tmp_path)["counts"]["accepted"] == 2
    ran = musat("batch", ".", cwd=tmp_path, preexec_fn=lambda: os.close(2))
    assert (ran.returncode, "2 kept" in ran.stdout) == (0, True)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_that_end_a_program_end_a_batch_in_order(tmp_path, number):
    decks_in(tmp_path, small=1, large=6)
    batch = start("batch", ".", "-j", "1", cwd=tmp_path)
    wait_for(lambda: ledger_of(tmp_path))
    batch.send_signal(number)
    _, errors = batch.communicate(timeout=30)
    assert batch.returncode == 1
    assert "interrupted; what is finished is kept, and the same command goes on from there" in errors
    counts = summary_of(tmp_path)["counts"]
    assert counts["not run"] >= 1 and counts["accepted"] + counts["doubtful"] == len(ledger_of(tmp_path))
    assert (processes_in(tmp_path), leftovers(tmp_path)) == ([], [])


@pytest.mark.slow
@near()
def test_a_ledger_that_cannot_be_written_anew_is_still_read_and_added_to(tmp_path, monkeypatch):
    (deck,) = decks_in(tmp_path, small=1)
    (outcome,) = run_batch(plan_of([tmp_path])).outcomes
    ledger = tmp_path / ".musat-batch.jsonl"
    with ledger.open("a") as stream:
        stream.write('{"job": "torn')

    def full(files):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("musatpy.campaign.batch.write_files", full)
    again = Ledger(tmp_path)
    again.add(BatchJob(deck=deck), outcome)
    assert Ledger(tmp_path).finished(BatchJob(deck=deck)) is not None
    assert json.loads(ledger.read_text().splitlines()[-1])["job"] == "small0"


@pytest.mark.slow
@near()
def test_a_baseline_behind_a_link(tmp_path, monkeypatch):
    decks_in(tmp_path / "decks", small=1)
    (tmp_path / "far" / "base").mkdir(parents=True)
    (tmp_path / "link").symlink_to("far/base")
    monkeypatch.chdir(tmp_path)
    assert save(Path("link"), [Path("decks/small0.crd")]).failed == ()
    assert check(Path("link")).same


@pytest.mark.slow
@near()
def test_only_one_writes_to_a_baseline_at_a_time(tmp_path):
    (deck,) = decks_in(tmp_path, small=1)
    save(tmp_path, [deck])
    with FolderLocks() as locks:
        locks.take(tmp_path)  # as a batch on this folder, or another `accept` with its own work folder, does
        with pytest.raises(LockedError):
            accept(tmp_path, work=tmp_path / "elsewhere")
    (tmp_path / "base").mkdir()
    save(tmp_path / "base", [deck])
    index = tmp_path / "base" / "baseline.json"
    index.write_text(index.read_text().replace('"decks_in": ".."', '"decks_in": "../gone"'))
    with pytest.raises(BaselineError, match="folder of the decks is not there; nothing was dropped"):
        accept(tmp_path / "base")


@pytest.mark.slow
@near()
def test_a_baseline_that_cannot_be_written_to_cannot_be_checked(tmp_path):
    (deck,) = decks_in(tmp_path, small=1)
    save(tmp_path / "base", [deck])
    (tmp_path / "base" / ".new").write_text("in the way")
    assert here("baseline", "check", "base", cwd=tmp_path).exit_code == 2


def test_what_gets_its_name_is_on_the_disk(tmp_path, monkeypatch):
    """Else a file could be empty after a loss of power: names may reach the disk before what they name."""
    steps: list[tuple[str, int]] = []

    def noted(name, done):
        def step(what, *more):
            steps.append((name, os.stat(what).st_ino))
            return done(what, *more)

        return step

    for name in ("fsync", "replace"):
        monkeypatch.setattr(os, name, noted(name, getattr(os, name)))
    paths = [tmp_path / "a", tmp_path / "b"]
    write_files(dict.fromkeys(paths, b"all"))
    files = [path.stat().st_ino for path in paths]
    assert steps == [("fsync", one) for one in files] + [("replace", one) for one in files]
    steps.clear()
    with whole_file(tmp_path / "c") as stream:
        stream.write(b"all")
    assert steps == [(name, (tmp_path / "c").stat().st_ino) for name in ("fsync", "replace")]
