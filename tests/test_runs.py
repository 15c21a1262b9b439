"""The pipeline: what files a run leaves, under which status, and that a failure leaves none."""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path

import pytest

import musatpy
from musatpy.errors import MusatError
from musatpy.files import write_files
from musatpy.formats.musat import deck_bytes, read_deck
from musatpy.model import RecordContent
from musatpy.runs import ExitStatus, check_outputs, output_paths, run_deck

DECK = Path(__file__).parents[1] / "fixtures" / "st_thomas" / "st_thomas.crd"


@pytest.fixture
def deck(tmp_path):
    path = tmp_path / "job.crd"
    path.write_bytes(DECK.read_bytes())
    return path


def with_options(path, **options):
    """Rewrite a deck with other options."""
    block = read_deck(path)
    path.write_bytes(deck_bytes(dataclasses.replace(block, options=dataclasses.replace(block.options, **options))))


def test_a_run_leaves_listing_and_record_beside_the_deck(deck):
    seen = []
    result = run_deck(deck, progress=seen.append)
    assert result.status is ExitStatus.DONE
    assert not result.problems
    assert sorted(os.listdir(deck.parent)) == ["job.crd", "job.json", "job.lst"]
    assert result.listing.read_text() == musatpy.listing(result.solution)
    assert json.loads(result.record.read_text())["solution"]["sigma0"] == result.solution.sigma0
    assert tuple(seen) == result.solution.iterations


def test_a_run_leaves_its_files_in_another_folder_that_it_makes(deck, tmp_path):
    result = run_deck(deck, tmp_path / "new" / "results")
    assert result.listing == tmp_path / "new" / "results" / "job.lst"
    assert sorted(os.listdir(tmp_path / "new" / "results")) == ["job.json", "job.lst"]
    assert sorted(os.listdir(deck.parent)) == ["job.crd", "new"]


def test_a_second_run_leaves_the_same_bytes(deck):
    def files():
        result = run_deck(deck)
        return result.listing.read_bytes(), result.record.read_bytes()

    assert files() == files()


def test_a_run_that_does_not_converge_is_listed(deck):
    with_options(deck, max_iterations=1, max_passes=1)
    result = run_deck(deck)
    assert result.status is ExitStatus.NOT_CONVERGED
    assert f"NOT CONVERGED: {result.solution.reason[:40]}" in result.listing.read_text()
    assert json.loads(result.record.read_text())["solution"]["converged"] is False


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


def test_a_missing_deck_is_a_problem(tmp_path):
    result = run_deck(tmp_path / "no.crd")
    assert result.status is ExitStatus.UNUSABLE
    assert [problem.file for problem in result.problems] == [str(tmp_path / "no.crd")]


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
    assert set(musatpy.__all__) <= set(dir(musatpy))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        musatpy.nothing  # noqa: B018
