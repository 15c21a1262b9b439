"""Runs and the files they leave: whole or not at all, locked, examples copied."""

import json
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

import musatpy
from blocks import FIXTURES
from cli.commands import musat
from musatpy.campaign.locks import FolderLocks
from musatpy.errors import MusatError
from musatpy.examples import examples
from musatpy.files import is_alive, remove_leftovers, together, whole_file, whole_path, write_files
from musatpy.model import RecordContent, Refraction
from musatpy.runs import ExitStatus, check_outputs, output_paths, run_deck

DECK = FIXTURES / "st_thomas" / "st_thomas.crd"


@pytest.fixture
def deck(tmp_path):
    path = tmp_path / "job.crd"
    path.write_bytes(DECK.read_bytes())
    return path


def test_a_run_leaves_listing_and_record_beside_the_deck(deck):
    seen = []
    result = run_deck(deck, progress=seen.append)
    assert result.status is ExitStatus.DONE
    assert not result.problems
    assert sorted(os.listdir(deck.parent)) == ["job.crd", "job.json", "job.lst"]
    assert result.listing.read_text() == musatpy.listing(result.solution)
    assert json.loads(result.record.read_text())["solution"]["sigma0"] == result.solution.sigma0
    assert tuple(seen) == result.solution.iterations


def test_a_run_may_leave_no_record(deck):
    """That of an earlier run would not be that of the listing."""
    assert run_deck(deck).record is not None
    listing = (deck.parent / "job.lst").read_bytes()
    result = run_deck(deck, record=RecordContent.NONE)
    assert result.record is None and result.listing.read_bytes() == listing
    assert sorted(os.listdir(deck.parent)) == ["job.crd", "job.lst"]


def test_an_unusable_deck_leaves_what_was_there(deck):
    (deck.parent / "job.lst").write_text("of an earlier run")
    deck.write_bytes(deck.read_bytes().replace(b"END", b"EMD"))
    result = run_deck(deck)
    assert result.status is ExitStatus.UNUSABLE
    assert result.solution is result.listing is result.record is None
    assert result.problems
    assert sorted(os.listdir(deck.parent)) == ["job.crd", "job.lst"]
    assert (deck.parent / "job.lst").read_text() == "of an earlier run"


def test_what_the_adjustment_refuses_is_a_problem(deck, monkeypatch):
    problem = musatpy.errors.Problem(message="no datum")

    def refuse(block, progress, causes):
        raise musatpy.errors.AdjustmentError([problem])

    monkeypatch.setattr("musatpy.runs.adjust", refuse)
    result = run_deck(deck)
    assert (result.status, result.problems) == (ExitStatus.UNUSABLE, (problem,))
    assert os.listdir(deck.parent) == ["job.crd"]


@pytest.mark.parametrize("name", ["job.lst", "job.json"])
def test_results_never_overwrite_the_deck(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(DECK.read_bytes())
    with pytest.raises(MusatError, match="would overwrite"):
        run_deck(path)
    assert path.read_bytes() == DECK.read_bytes()


def test_results_of_two_decks_never_go_to_one_file(tmp_path):
    first, second = tmp_path / "a" / "job.crd", tmp_path / "b" / "job.crd"
    check_outputs([first, second])
    with pytest.raises(MusatError, match="would both go to"):
        check_outputs([first, second], tmp_path)
    with pytest.raises(MusatError, match="would both go to"):
        check_outputs([tmp_path / "job.crd", tmp_path / "job.dat"])


def test_names_with_points_keep_them():
    assert output_paths(Path("x/job.v2.crd")) == (Path("x/job.v2.lst"), Path("x/job.v2.json"))


def test_files_are_written_all_or_none(tmp_path):
    old, blocked = tmp_path / "a.lst", tmp_path / "file" / "b.json"
    old.write_text("old")
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(OSError):
        write_files({old: b"new", blocked: b"new"})
    assert old.read_text() == "old"
    assert sorted(os.listdir(tmp_path)) == ["a.lst", "file"]


def test_files_have_the_usual_permissions(tmp_path):
    (tmp_path / "plain").write_text("")
    write_files({tmp_path / "written": b""})
    assert (tmp_path / "written").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_public_names_do_what_the_command_does(deck):
    solution = musatpy.adjust(musatpy.read_deck(deck))
    assert isinstance(solution, musatpy.Solution)
    assert isinstance(solution.block, musatpy.Block)
    musatpy.write_deck(solution.block, deck.parent / "again.crd")
    assert (deck.parent / "again.crd").read_bytes() == deck.read_bytes()
    assert run_deck(deck).listing.read_text() == musatpy.listing(solution)
    assert sorted([*musatpy.__all__, "__version__"]) == dir(musatpy)
    assert repr(musatpy.verdict(solution)).startswith(f"Verdict({musatpy.verdict(solution).grade}")
    options = replace(solution.block.options, refraction=Refraction.NONE)
    assert musatpy.adjust(solution.block, options=options).block.options == options
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        musatpy.nothing  # noqa: B018


def test_every_example_is_of_files_that_are_there_and_of_commands():
    assert list(examples()) == ["st_thomas", "cayman", "lagoon", "uav_bay"]
    assert musat("example").stdout.startswith("st_thomas  three photos over a shore, eight points under water")
    for example in examples().values():
        assert all((FIXTURES / file).is_file() for file in example.files)
        assert len(example.contents()) == len(example.files)  # no two of one name
        assert all(command.startswith("musat ") for command in example.commands)


def test_an_example_is_the_fixture(tmp_path):
    ran = musat("example", "st_thomas", "-o", tmp_path / "job")
    assert ran.exit_code == 0
    assert f"  cd {tmp_path / 'job'}\n  musat check st_thomas.crd\n" in ran.stdout
    deck = FIXTURES / "st_thomas/st_thomas.crd"
    assert (tmp_path / "job/st_thomas.crd").read_bytes() == deck.read_bytes()
    assert not list((tmp_path / "job").glob("*.lst"))
    assert musat("example", "st_thomas", "-o", tmp_path / "job").exit_code == 0  # as it is already


def test_another_file_of_the_name_stays_and_a_name_with_blanks_can_be_copied(tmp_path):
    (tmp_path / "points.csv").write_text("mine")
    ran = musat("example", "lagoon", "-o", tmp_path)
    assert ran.exit_code == 1
    assert "points.csv exists already with other contents; nothing is written" in ran.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["points.csv"]
    assert (tmp_path / "points.csv").read_text() == "mine"
    assert f"cd '{tmp_path / 'a job'}'" in musat("example", "lagoon", "-o", tmp_path / "a job").stdout


@pytest.mark.parametrize(("name", "meant"), [("caymann", "did you mean cayman?"), ("xyz", "there are st_thomas, ")])
def test_a_wrong_name_is_a_wrong_command_line(name, meant, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran = musat("example", name)
    assert ran.exit_code == 2 and f"no example '{name}'; {meant}" in ran.stderr
    assert not list(tmp_path.iterdir())


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
    with FolderLocks() as locks, pytest.raises(OSError, match="may be removed"):
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
