"""From a spoilt deck to its listing, record and edited deck."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from blocks import FIXTURES
from json_schema import load_schema, violations
from musatpy import adjust, read_deck
from musatpy.cli.main import main
from musatpy.errors import AdjustmentError, Problem
from musatpy.model import ControlKind, Editing
from musatpy.runs import ExitStatus, run_deck
from record_rows import read_rows, with_columns

DECK = FIXTURES / "st_thomas" / "st_thomas.crd"
OPTION = "OP2                                            {}\n"
SPOILT = {33: ("1.2390000", "1.3390000"), 18: ("204", "205"), 19: ("205", "204"), 65: ("13.77679", "14.77679")}


def spoilt(folder: Path, editing: str) -> Path:
    """The St. Thomas deck with a wrong y, two names exchanged and a wrong control point."""
    lines = DECK.read_text().splitlines(keepends=True)
    for number, (good, bad) in SPOILT.items():
        assert good in lines[number - 1]
        lines[number - 1] = lines[number - 1].replace(good, bad)
    lines.insert(2, OPTION.format(editing))
    deck = folder / "job.crd"
    deck.write_text("".join(lines))
    return deck


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory):
    """The spoilt deck, edited: with CR LF, letters in the title, numbers as typed, no numbers of the sequence."""
    deck = spoilt(tmp_path_factory.mktemp("edited"), "EDIT")
    lines = deck.read_text().replace("USVI", "K\u00fcste").splitlines()
    lines = [line if number % 2 else line[:72].rstrip() for number, line in enumerate(lines)]
    data = "".join(f"{line}\r\n" for line in lines).replace("152.25000 ", "  152.25  ").encode("latin-1")
    deck.write_bytes(data)
    return run_deck(deck, punch_edits=True)


@pytest.mark.slow
def test_the_edited_deck_gives_the_same_solution(run) -> None:
    assert run.status is ExitStatus.DONE
    again, solution = adjust(read_deck(run.edited)), run.solution
    np.testing.assert_array_equal(again.stations.position, solution.stations.position)
    np.testing.assert_array_equal(again.points.position, solution.points.position)
    assert again.sigma0 == solution.sigma0
    assert again.block.options.editing is Editing.NONE


@pytest.mark.slow
def test_lines_that_are_not_edited_are_those_of_the_deck_byte_for_byte(run) -> None:
    """But for the option, which is gone."""
    before, after = (path.read_bytes().split(b"\n") for path in (run.edited.with_name("job.crd"), run.edited))
    assert before.pop(2).startswith(b"OP2")
    assert len(before) == len(after)
    changes = [(old[:72], new[:72]) for old, new in zip(before, after, strict=True) if old != new]
    assert [(old[4:17].split(), new[4:17].split()) for old, new in changes] == [
        ([b"21", b"205"], [b"21", b"204"]),
        ([b"21", b"204"], [b"21", b"205"]),
        ([b"22", b"205"], [b"22", b"205"]),
        ([b"103", b"F"], [b"103", b"V"]),
    ]
    assert [sum(a != b for a, b in zip(old, new, strict=False)) for old, new in changes] == [1, 1, 1, 1]


@pytest.mark.slow
def test_the_edited_deck_has_the_names_of_the_sound_one_and_its_control_no_more(run) -> None:
    edited, sound = read_deck(run.edited), read_deck(DECK)
    np.testing.assert_array_equal(edited.points.ids[edited.plates.point], sound.points.ids[sound.plates.point])
    kept_out = np.flatnonzero(edited.plates.triangulated != sound.plates.triangulated)
    assert [(edited.photos.ids[edited.plates.photo[row]], edited.points.ids[edited.plates.point[row]])
            for row in kept_out] == [("22", "205")]  # fmt: skip
    changed = np.flatnonzero(edited.control.kind != sound.control.kind)
    assert edited.points.ids[edited.control.point[changed]].tolist() == ["103"]
    assert edited.control.kind[changed].tolist() == [ControlKind.VERTICAL]


@pytest.mark.slow
def test_the_listing_and_the_record_name_every_finding(run) -> None:
    text, record = run.listing.read_text(), read_rows(run.record)
    assert list(violations(with_columns(record, load_schema()), load_schema(), load_schema())) == []
    assert record["options"]["editing"] == "EDIT"
    assert len(record["findings"]) == len(run.solution.findings) == 4
    for one in record["findings"]:
        line = next(line for line in text.splitlines() if line.startswith(one["blunder"]) and one["point"] in line)
        assert one["action"] in line
        assert one["note"] in text
    control = record["findings"][-1]
    assert control["unit"] == "m"
    assert control["size"][1] == pytest.approx(30.7, abs=0.5)  # a second of latitude, and the point's decimetres


@pytest.mark.slow
def test_list_edits_nothing_but_what_is_punched(tmp_path: Path) -> None:
    deck = spoilt(tmp_path, "LIST")
    text = deck.read_text().replace("14.77679", "13.77679")
    for good, bad in (("204       87.26", "205       87.26"), ("205       91.26", "204       91.26")):
        text = text.replace(bad, good)
    deck.write_text(text)
    result = CliRunner().invoke(main, ["run", str(deck), "--punch-edits"])
    assert "1 blunder found, edited deck" in result.stdout
    assert "Nothing of this was done" in deck.with_suffix(".lst").read_text()
    changed = read_deck(tmp_path / "job.edited.crd").plates.triangulated != read_deck(deck).plates.triangulated
    assert np.count_nonzero(changed) == 1


@pytest.mark.slow
def test_a_job_that_does_not_converge_with_its_blunders_has_them_in_its_listing(tmp_path: Path) -> None:
    deck = spoilt(tmp_path, "LIST")
    result = CliRunner().invoke(main, ["run", str(deck)])
    assert result.exit_code == ExitStatus.NOT_CONVERGED
    assert "4 blunders found" in result.stdout
    listed = [
        line for line in deck.with_suffix(".lst").read_text().splitlines() if line.startswith("misnamed image")
    ]
    assert {tuple(line.split()[2:4]) for line in listed} == {("21", "204"), ("21", "205")}


@pytest.mark.slow
def test_a_job_that_cannot_be_adjusted_with_its_blunders_has_them_told_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(block: object, progress: object, sea: object) -> None:
        raise AdjustmentError([Problem(message="photo 21 is free")])

    monkeypatch.setattr("musatpy.adjustment.adjust", fails)
    result = CliRunner().invoke(main, ["run", str(spoilt(tmp_path, "LIST"))])
    assert result.exit_code != 0
    assert "with its 4 blunders the job cannot be adjusted" in result.stderr
    assert "misnamed image 21 204: test value" in result.stderr
    assert "it is point 205" in result.stderr


def test_without_editing_there_is_nothing_to_punch(tmp_path: Path) -> None:
    deck = tmp_path / "job.crd"
    deck.write_bytes(DECK.read_bytes())
    result = CliRunner().invoke(main, ["run", str(deck), "--punch-edits"])
    assert result.exit_code == 0
    assert "no edited deck: the options do not ask for a search for blunders" in result.stderr
    assert not (tmp_path / "job.edited.crd").exists()
    assert "found" not in result.stdout
