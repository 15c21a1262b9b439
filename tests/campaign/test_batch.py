"""Batches: what is run, kept and told."""

import json
import os
import pty
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from campaign.batches import ROOT, ST_THOMAS, Here, assert_whole, command, decks_in, here, musat, near, summary_of
from cli import commands
from json_schema import BATCH_MANUAL, BATCH_SCHEMA, load_schema, violations, with_table
from musatpy.campaign.batch import Ledger, run_batch
from musatpy.campaign.batch_jobs import BatchJob, JobOptions, JobState
from musatpy.campaign.manifest import ManifestError, decks_of, plan_of
from musatpy.campaign.worker import run_job
from musatpy.errors import MusatError
from musatpy.runs import ExitStatus

SCHEMA = load_schema(BATCH_SCHEMA)
NOT_CONVERGED = (b"FULL      20  20", b"FULL       1   1")


@pytest.mark.slow
def test_a_folder_of_decks_and_its_summary(tmp_path):
    decks = decks_in(tmp_path, small=2)
    short = tmp_path / "short.crd"
    short.write_bytes(ST_THOMAS.read_bytes().replace(*NOT_CONVERGED))
    shutil.copy(ROOT / "fixtures" / "bad_decks" / "many_errors.crd", tmp_path)
    ran = musat("batch", ".", cwd=tmp_path)
    assert ran.returncode == ExitStatus.UNUSABLE
    summary = summary_of(tmp_path)
    assert list(violations(summary, SCHEMA, SCHEMA)) == []
    states = {Path(job["deck"]).stem: job["state"] for job in summary["jobs"]}
    assert states == {
        "many_errors": "unusable",
        "short": "not converged",
        **{deck.stem: "accepted" for deck in decks},
    }
    assert "still moves" in next(job["message"] for job in summary["jobs"] if job["state"] == "not converged")
    assert ran.stdout.splitlines()[-1] == (
        "4 jobs: 2 accepted, 1 not converged, 1 unusable; summary musat-batch.json"
    )
    assert "XYZ 123" in ran.stderr  # the bad card
    (tmp_path / "many_errors.crd").unlink()
    assert run_batch(plan_of([tmp_path])).status == ExitStatus.NOT_CONVERGED
    assert summary_of(tmp_path)["counts"]["kept"] == 3
    short.unlink()
    assert run_batch(plan_of([tmp_path])).status == ExitStatus.DONE


@pytest.mark.slow
def test_a_batch_leaves_what_runs_with_the_same_options_leave_and_keeps_it(tmp_path):
    options = ("--csv", "--plots", "--gis", "--crs", "EPSG:26720")
    (deck,) = decks_in(tmp_path / "decks", small=1)
    ran = here("batch", deck, "-o", "batch", *options, cwd=tmp_path)
    assert ran.exit_code == 0 and commands.musat("run", deck, "-o", tmp_path / "run", *options).exit_code == 0

    def left(folder):
        paths = (path.relative_to(tmp_path / folder) for path in (tmp_path / folder).rglob("*") if path.is_file())
        return sorted(str(path) for path in paths if not re.search("musat-batch", str(path)))

    files = left("run")
    assert left("batch") == files and {"small0.plan.svg", "small0.gpkg"} <= {*files}
    assert any(name.startswith("small0_tables/") for name in files)
    for name in files:
        if not name.endswith(".gpkg"):  # a database has a time
            assert (tmp_path / "batch" / name).read_bytes() == (tmp_path / "run" / name).read_bytes(), name
    assert "(1 kept" in here("batch", deck, "-o", "batch", *options, cwd=tmp_path).stdout
    (record,) = map(json.loads, (tmp_path / "batch/.musat-batch.jsonl").read_text().splitlines())
    assert {*files} == {*record["outcome"]["outputs"]}  # of which none may be gone
    refused = commands.musat("batch", deck, "-o", tmp_path / "batch", "--crs", "EPSG:26720")
    assert refused.exit_code == ExitStatus.USAGE and "--crs goes with --gis" in refused.stderr


@pytest.mark.slow
def test_rows_of_the_table_end_at_120_characters_and_say_the_first_error(tmp_path):
    long = tmp_path / f"{'very_' * 20}long.crd"
    long.write_bytes(ST_THOMAS.read_bytes().replace(*NOT_CONVERGED))
    for name in ("many_errors", "two_parts"):
        shutil.copy(ROOT / f"fixtures/bad_decks/{name}.crd", tmp_path)
    ran = here("batch", ".", cwd=tmp_path)
    lines = ran.stdout.splitlines()
    assert max(map(len, lines[:-1])) <= 120 and any(line.startswith("...") for line in lines)
    text = " ".join(ran.stdout.split())
    assert "21 errors, the first: many_errors.crd END: no END card" in text
    assert "1 error: two_parts.crd: the part of the block with photos 851, 852 has no horizontally" in text
    quiet = here("batch", "-q", ".", cwd=tmp_path).stderr
    assert "unusable" not in quiet and not re.search("^ ", quiet, re.MULTILINE)


@pytest.mark.slow
def test_warnings_of_jobs_that_are_kept_are_counted(tmp_path):
    shutil.copy(ROOT / "fixtures/verdict/iia_same_deck.crd", tmp_path)
    first, again = (here("batch", ".", cwd=tmp_path).stderr for _ in range(2))
    line = "musat: 1 warning of jobs that were kept from an earlier run; --warnings prints them"
    assert "CTX.z: warning" in first and "CTX.z: warning" not in again and line in again.splitlines()
    assert "CTX.z: warning" in here("batch", ".", "--warnings", cwd=tmp_path).stderr


@pytest.mark.slow
def test_doubtful_and_rejected_jobs(tmp_path):
    for name in ("control_in_feet", "cameras_underground"):
        shutil.copy(ROOT / f"fixtures/verdict/{name}.crd", tmp_path)
    ran = here("batch", ".", cwd=tmp_path)
    assert ran.exit_code == ExitStatus.REJECTED
    assert {Path(job["deck"]).stem: (job["state"], job["status"]) for job in summary_of(tmp_path)["jobs"]} == {
        "control_in_feet": ("doubtful", 0),
        "cameras_underground": ("rejected", 4),
    }
    for stream in (ran.stdout, ran.stderr):  # the table, and what is wrong
        assert "as if control were in feet" in stream and "the camera is below the ground" in stream
    (tmp_path / "cameras_underground.crd").unlink()
    assert here("batch", ".", cwd=tmp_path).exit_code == ExitStatus.DONE
    assert here("batch", ".", "--strict", cwd=tmp_path).exit_code == ExitStatus.REJECTED


def test_the_manual_has_the_schema_of_the_summary():
    """`python tests/json_schema.py` makes it anew."""
    text = BATCH_MANUAL.read_text()
    assert with_table(text, SCHEMA) == text


@pytest.mark.slow
@pytest.mark.parametrize(("content", "left"), [("tables", ["small0.json", "small0.lst"]), ("none", ["small0.lst"])])
def test_a_batch_writes_what_of_records_is_asked_for(tmp_path, content, left):
    decks_in(tmp_path, small=1)
    plan = plan_of([tmp_path], tmp_path / "out", JobOptions(record=content))
    (outcome,) = run_batch(plan, executor=Here()).outcomes
    assert sorted(outcome.outputs) == left
    assert [one.kept for one in run_batch(plan).outcomes] == [True]
    if content == "tables":
        assert json.loads((tmp_path / "out" / "small0.json").read_text())["content"] == "tables"


def test_a_content_that_there_is_not_is_refused(tmp_path):
    decks_in(tmp_path, small=1)
    with pytest.raises(MusatError, match="record is one of full, tables, none, not 'some'"):
        plan_of([tmp_path], tmp_path / "out", JobOptions(record="some"))


@pytest.mark.slow
@near()
def test_what_is_finished_depends_on_deck_options_and_results(tmp_path, monkeypatch):
    (deck,) = decks_in(tmp_path, small=1)
    formats = Path(shutil.copytree(ROOT / "card_formats" / "musat", tmp_path / "cards"))
    plan = plan_of([tmp_path], tmp_path / "out", JobOptions(formats=formats))
    assert [one.kept for one in run_batch(plan).outcomes] == [False]

    def finished(**options) -> bool:
        job = BatchJob(deck=deck, out=tmp_path / "out", options=JobOptions(**{"formats": formats, **options}))
        return Ledger(tmp_path / "out").finished(job) is not None

    assert finished()
    assert not finished(carriage_control=True)
    assert not finished(formats=None)
    for path, other in (
        (deck, deck.read_bytes() + b"\n"),
        (tmp_path / "out" / "small0.lst", b"edited"),
        (formats / "att.toml", b"# another card format"),  # the content counts, not the name of the folder
    ):
        was = path.read_bytes()
        path.write_bytes(other)
        assert not finished()
        path.write_bytes(was)
        assert finished()
    (tmp_path / "out" / "small0.json").rename(tmp_path / "moved")
    assert not finished()
    (tmp_path / "moved").rename(tmp_path / "out" / "small0.json")
    monkeypatch.setattr("musatpy.__version__", "99.0")
    assert not finished()
    monkeypatch.undo()
    again = run_batch(plan), run_batch(plan, again=True)
    assert [result.outcomes[0].kept for result in again] == [True, False]
    (tmp_path / "out").rename(tmp_path / "elsewhere")  # results may move, with what is known of them
    moved = plan_of([tmp_path], tmp_path / "elsewhere", JobOptions(formats=formats))
    assert [one.kept for one in run_batch(moved).outcomes] == [True]


@pytest.mark.slow
def test_a_manifest_and_what_its_jobs_leave(tmp_path):
    decks_in(tmp_path / "west", small=2)
    decks_in(tmp_path / "east", small=1)
    manifest = tmp_path / "jobs.toml"
    manifest.write_text(
        'out = "results"\ncarriage_control = true\n'
        '[[job]]\ndeck = "west/*.crd"\n'
        '[[job]]\ndeck = ["east"]\nout = "results/east"\npunch = "result"\ncarriage_control = false\n'
    )
    ran = commands.musat("batch", manifest, "-j", "1")
    assert ran.exit_code == 0, ran.output
    found = {str(path.relative_to(tmp_path / "results")) for path in (tmp_path / "results").rglob("[!.]*.*")}
    assert found == {
        "small0.lst", "small0.json", "small1.lst", "small1.json", "jobs.batch.json",
        "east/small0.lst", "east/small0.json", "east/small0.pun",
    }  # fmt: skip
    assert (tmp_path / "results" / "small0.lst").read_text()[0] == "1"
    assert assert_whole(tmp_path / "results" / "east") == {"small0"}
    summary = json.loads((tmp_path / "results" / "jobs.batch.json").read_text())
    assert list(violations(summary, SCHEMA, SCHEMA)) == []
    assert summary["jobs"][2]["options"] == {"punch": "result"}
    assert set(summary["jobs"][2]["outputs"]) == {"small0.lst", "small0.json", "small0.pun"}


def test_everything_wrong_with_a_manifest_is_told(tmp_path):
    manifest = tmp_path / "jobs.toml"
    manifest.write_text(
        'refraction = "NONE"\n[[job]]\ndeck = "none*.crd"\n[[job]]\ndeck = 3\npunch_edits = "yes"\n'
        '[[job]]\ndeck = "a.crd"\npunch = "restart"\npunch_kind = "F"\n'
        '[[job]]\ndeck = "a.crd"\npunch_points = "all"\n'
        '[[job]]\ndeck = "a\\u0000.crd"\nout = "\\u0000"\npunch = "all"\n'
    )
    with pytest.raises(ManifestError) as caught:
        plan_of([manifest])
    told = [problem.headline() for problem in caught.value.problems]
    assert told[0].startswith(f"{manifest}:1 refraction: is no key here; there are formats,")
    assert told[1:] == [
        f"{manifest}:2 job 1: {tmp_path}/none*.crd: no file has this name",
        f"{manifest}:5 job 2.deck: is a deck, a folder or a glob, or a list of them",
        f"{manifest}:6 job 2.punch_edits: true or false is expected, not 'yes'",
        f"{manifest}:7 job 3: the points of a restart are check points, or it would not be the same job",
        f"{manifest}:11 job 4: punch_points: say what to punch: punch = restart or result",
        f"{manifest}:14 job 5: punch is one of restart, result, not 'all'",
        f"{manifest}:15 job 5.deck: has a null character, which no name has",
        f"{manifest}:16 job 5.out: has a null character, which no name has",
    ]
    ran = commands.musat("batch", manifest)
    assert (ran.exit_code, ran.stderr.count("\n")) == (1, 9)
    manifest.write_text("[[job]\n")
    with pytest.raises(ManifestError, match=r"jobs\.toml: .*line 1"):
        plan_of([manifest])
    manifest.write_text("")
    with pytest.raises(ManifestError, match=r"at least one table \[\[job\]\]"):
        plan_of([manifest])


def test_the_folder_of_a_manifest_is_no_glob(tmp_path):
    decks = decks_in(tmp_path / "jobs[1]", small=2)
    manifest = tmp_path / "jobs[1]" / "m.toml"
    for sources in ('"*.crd"', '"."', f'["{decks[0].name}", "{decks[1]}"]'):
        manifest.write_text(f"[[job]]\ndeck = {sources}\n")
        assert [job.deck for job in plan_of([manifest]).jobs] == decks
    manifest.write_text('[[job]]\ndeck = "gone.crd"\n')  # a job, which says that it is not there
    assert [job.deck.name for job in plan_of([manifest]).jobs] == ["gone.crd"]


def test_results_that_would_go_over_something_are_refused(tmp_path):
    decks_in(tmp_path / "a", small=1)
    decks_in(tmp_path / "b", small=1)
    with pytest.raises(MusatError, match="would both go to"):
        plan_of([tmp_path / "a", tmp_path / "b"], tmp_path / "out")
    twice = plan_of([tmp_path / "a", tmp_path / "a" / "small0.crd"])
    assert len(twice.jobs) == 1
    shutil.copy(ST_THOMAS, tmp_path / "a" / "musat-batch.crd")
    with pytest.raises(MusatError, match="and the summary would both go to"):
        plan_of([tmp_path / "a"])
    (tmp_path / "empty").mkdir()
    ran = commands.musat("batch", tmp_path / "empty")
    assert ran.exit_code == 2 and "no decks (*.crd) in this folder" in ran.stderr
    (tmp_path / "m.toml").write_text('[[job]]\ndeck = "a/small0.crd"\n')
    ran = commands.musat("batch", tmp_path / "m.toml", "-o", "x")
    assert ran.exit_code == 2 and "the manifest itself says" in ran.stderr


def test_punched_decks_are_no_decks_of_their_folder(tmp_path):
    (deck,) = decks_in(tmp_path, small=1)
    shutil.copy(deck, tmp_path / "small0.edited.crd")
    shutil.copy(deck, tmp_path / "other.edited.crd")
    assert [path.name for path in decks_of(tmp_path)] == ["other.edited.crd", "small0.crd"]
    assert len(decks_of(tmp_path / "*.crd")) == 3


def test_a_deck_that_is_edited_while_it_runs_has_no_results(tmp_path):
    (deck,) = decks_in(tmp_path, small=1)

    def edit(message):
        if "photos" in message:
            deck.write_bytes(deck.read_bytes() + b"\n")

    outcome = run_job(BatchJob(deck=deck), edit)
    assert (outcome.state, outcome.message) == (JobState.FAILED, f"{deck}: the deck was changed while it was run")


@pytest.mark.slow
@near()
def test_an_output_folder_that_cannot_be_made_fails_its_jobs_only(tmp_path):
    decks_in(tmp_path, small=2)
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "m.toml").write_text(
        '[[job]]\ndeck = "small0.crd"\nout = "file/out"\n[[job]]\ndeck = "small1.crd"\n'
    )
    result = run_batch(plan_of([tmp_path / "m.toml"]))
    assert [one.state for one in result.outcomes] == [JobState.FAILED, JobState.ACCEPTED]
    said = "file/out: Not a directory; --out, or out in a manifest, takes results elsewhere"
    assert result.outcomes[0].message.endswith(said)


@pytest.mark.slow
def test_a_terminal_shows_a_bar_and_the_jobs_at_work(tmp_path):
    decks_in(tmp_path, small=0, large=1)
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        command("batch", ".", "-j", "1"), cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=theirs,
        env={**os.environ, "COLUMNS": "100"},
    ) as batch:  # fmt: skip
        os.close(theirs)
        shown = b""
        while True:
            try:
                shown += os.read(ours, 4096)
            except OSError:  # the other end is closed
                break
    os.close(ours)
    assert batch.returncode == 0
    text = shown.decode()
    assert "[............" in text and "] 0 of 1 job, 0:00" in text
    assert re.search(r"\n  large0\.crd: 10 photos, 98 points, (adjusting|pass \d, iteration \d+), \d:\d\d\r", text)
    assert "[1/1] large0.crd: doubtful, 10 photos, 98 points, sigma0 1.0110, " in text
    assert text.rindex("\x1b[J") > text.rindex("] 0 of 1 job")  # the block is taken away in the end
