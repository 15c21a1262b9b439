"""Baselines: saved, checked, accepted, listed."""

import json
import os
import re
import shutil
import subprocess
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from campaign.batches import ROOT, ST_THOMAS, decks_in, expected, musat, near
from cli import commands
from musatpy import __version__
from musatpy.campaign.baseline_checks import check
from musatpy.campaign.baselines import INDEX, BaselineError, accept, load_baseline, save
from musatpy.campaign.locks import FolderLocks, LockedError

cli = partial(commands.musat, "baseline")

WATER = (b"WTR 1.340000", b"WTR 1.339000")


def edit(deck: Path, old: bytes, new: bytes) -> None:
    text = deck.read_bytes()
    assert old in text
    deck.write_bytes(text.replace(old, new))


def tree(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module", autouse=True)
def in_this_process():
    with near():
        yield


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """A baseline of two decks, in a folder of its own beside theirs."""
    top = tmp_path_factory.mktemp("saved")
    decks_in(top / "decks" / "west", small=1)
    decks_in(top / "decks" / "east", small=1)
    taken = save(top / "base", [top / "decks" / side / "small0.crd" for side in ("west", "east")])
    assert (taken.new, taken.failed) == (("west/small0.crd", "east/small0.crd"), ())
    return top


@pytest.fixture
def top(saved, tmp_path):
    """A copy of it, elsewhere: nothing in a baseline is tied to a place."""
    return Path(shutil.copytree(saved, tmp_path / "copy"))


@pytest.mark.slow
def test_what_is_kept(saved):
    files = tree(saved / "base")
    assert set(files) == {
        INDEX, "rules.toml", "record_rules.toml",
        *(f"{side}/small0.{ending}" for side in ("west", "east") for ending in ("lst", "json")),
    }  # fmt: skip
    assert files["west/small0.lst"] == expected(ST_THOMAS)[".lst"]
    assert files["east/small0.json"] == expected(ST_THOMAS)[".json"]
    index = json.loads(files[INDEX])
    assert (index["decks_in"], index["formats"], index["records"]) == ("../decks", None, True)
    assert set(index["decks"]["east/small0.crd"]) == {"deck_sha256", "version", "status", "state", "sources"}


@pytest.mark.slow
def test_nothing_has_changed(top):
    before = tree(top / "base")
    result = cli("check", top / "base")
    assert result.exit_code == 0, result.output
    assert result.stdout.splitlines()[-1] == f"same: 2 identical; saved by musatpy {__version__}"
    assert tree(top / "base") == before
    assert "as saved" in cli("list", top / "base").stdout


@pytest.mark.slow
def test_a_change_is_shown_and_taken_over(top):
    west, base = top / "decks" / "west" / "small0.crd", top / "base"
    before = tree(base)
    edit(west, *WATER)
    result = cli("check", base, "--junit", top / "tests.xml", "-q", "--listed", 2)
    assert result.exit_code == 1
    assert "Refractive index of water" in result.stdout and "1.339000" in result.stdout
    assert result.stdout.splitlines()[-4:] == [
        "east/small0.crd  identical",
        "west/small0.crd  different  (the deck is not the one that was saved)",
        f"new results: {base}/.new; musat baseline accept takes them over",
        f"DIFFERENT: 1 identical, 1 different; saved by musatpy {__version__}",
    ]
    suite = ElementTree.parse(top / "tests.xml").getroot()
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("2", "1", "0")
    assert [test.find("failure") is not None for test in suite] == [False, True]
    assert {name: data for name, data in tree(base).items() if ".new" not in name} == before
    assert "changed" in cli("list", base).stdout
    short = cli("check", base, "--summary")
    assert short.exit_code == 1 and len(short.stdout.splitlines()) == 4
    row = r"west/small0.crd  different  \(the deck .*; small0.lst: \d+ number, .*; small0.json: \d+ number.*\)"
    assert re.fullmatch(row, short.stdout.splitlines()[1])

    result = cli("accept", base, west)
    assert result.exit_code == 0 and "west/small0.crd: changed\n" in result.stdout
    after = tree(base)
    assert {name for name in before if before[name] != after[name]} == {
        INDEX, "west/small0.lst", "west/small0.json",
    }  # fmt: skip
    summary = json.loads((base / ".new" / ".batch.json").read_text())
    assert summary["counts"]["kept"] == 1  # the results that the check showed, not those of another run
    assert accept(base).unchanged == ("east/small0.crd", "west/small0.crd")
    assert not (base / ".new").exists()


@pytest.mark.slow
def test_a_compilation_deck_is_compiled_on_the_run_of_its_triangulation(tmp_path):
    shutil.copytree(ROOT / "fixtures" / "cayman_as11", tmp_path / "as11")
    run = tmp_path / "strip.crd"
    run.write_bytes((ROOT / "fixtures" / "cayman" / "cayman_clean.crd").read_bytes())
    deck, base = tmp_path / "as11" / "cayman_as11.crd", tmp_path / "base"
    golden = deck.with_suffix(".lst").read_bytes()
    assert cli("save", base, deck, "--run", run, "-q").exit_code == 0
    assert (base / "as11" / "cayman_as11.lst").read_bytes() == golden
    assert json.loads((base / INDEX).read_text())["runs"] == {"as11/cayman_as11.crd": "strip.crd"}
    assert [one.state for one in check(base).decks] == ["identical"]

    run.write_bytes(run.read_bytes().replace(b"\n", b"\r\n"))  # a checkout by git
    assert [one.state for one in check(base).decks] == ["identical"]
    edit(run, *WATER)
    (one,) = check(base).decks
    assert one.notes == ("not the one that was saved: run/strip.crd",)
    assert any(not difference.same for difference in one.differences)
    assert accept(base).changed == ("as11/cayman_as11.crd",)
    assert check(base).same

    edit(run, b"END", b"EMD")
    (one,) = check(base).decks
    assert (one.state, one.outcome.unusable) == ("failed", True)
    assert one.outcome.problems[0].file == str(run)
    edit(deck, b"842843   842      843", b"842843   842      999")
    edit(run, b"EMD", b"END")
    assert accept(base, unusable=True).changed == ("as11/cayman_as11.crd",)
    messages = (base / "as11" / "cayman_as11.err").read_text()
    assert messages.startswith("unusable, exit status 1: 1 error\nas11/cayman_as11.crd:2 cols ")
    run.unlink()
    (one,) = check(base).decks
    assert one.outcome.message == f"{run}: No such file or directory"
    deck.unlink()
    assert accept(base).dropped == ("as11/cayman_as11.crd",) and "runs" not in json.loads(
        (base / INDEX).read_text()
    )


@pytest.mark.slow
def test_json_of_a_check(top):
    (top / "base" / "west" / "small0.lst").unlink()
    result = cli("check", top / "base", "west/small0", "--json", "-q", "-o", top / "work")
    assert result.exit_code == 1
    record = json.loads(result.stdout)
    (one,) = record["decks"]
    assert (record["same"], one["state"], one["deck"]) == (False, "different", "west/small0.crd")
    assert one["notes"] == [f"{top}/base/west/small0.lst is gone"]
    assert one["saved_sha256"] == one["sha256"] and one["differences"] == []
    assert not (top / "base" / ".new").exists() and (top / "work" / "west" / "small0.lst").exists()


@pytest.mark.slow
def test_rules_say_what_may_differ_and_which_never_matched(top):
    base = top / "base"
    edit(base / "west" / "small0.lst", b"musatpy version 0.", b"musatpy version 9.")
    assert [one.state for one in check(base).decks] == ["identical", "within the rules"]
    (base / "rules.toml").write_text('[[rule]]\nname = "nothing"\nsection = "Waves"\nskip = true\n')
    found = check(base, ["west/small0.crd"])
    assert [one.state for one in found.decks] == ["different"]
    assert found.unused_rules == ("rules.toml: nothing",)
    (top / "other.toml").write_text('[[rule]]\nname = "any"\nskip = true\n')
    found = check(base, ["west/small0.crd"], rules=top / "other.toml")  # in place of those of the baseline
    assert ([one.state for one in found.decks], found.unused_rules) == (["within the rules"], ())
    (top / "wrong.toml").write_text('[[rule]]\nname = "no"\n')
    result = cli("check", base, "--rules", top / "wrong.toml")
    assert result.exit_code == 2 and "wrong.toml" in result.stderr
    assert cli("check", top).exit_code == 2


@pytest.mark.slow
def test_the_rules_for_records_hold_between_machines(tmp_path):
    """OpenBLAS takes other kernels, which round otherwise in the last digits (other libraries ignore the name)."""
    deck = shutil.copy(ROOT / "fixtures" / "cayman" / "cayman_modified.crd", tmp_path)
    for core, verb, more in (("Prescott", "save", [deck]), ("Haswell", "check", [])):
        environment = {**os.environ, "OPENBLAS_CORETYPE": core}
        ran = musat("baseline", verb, tmp_path / "base", *more, "-q", env=environment)
        assert ran.returncode == 0, ran.stdout


@pytest.mark.slow
def test_a_baseline_without_decks_is_not_the_same(top):
    for side in ("west", "east"):
        (top / "decks" / side / "small0.crd").unlink()
    assert len(accept(top / "base").dropped) == 2
    result = cli("check", top / "base")
    assert result.exit_code == 2 and "has no deck any more; musat baseline save adds some" in result.stderr


@pytest.mark.slow
def test_decks_are_added_dropped_and_refused(top):
    base, decks = top / "base", top / "decks"
    shutil.copy(ST_THOMAS, decks / "new.crd")
    bad = shutil.copy(ROOT / "fixtures" / "bad_decks" / "many_errors.crd", decks / "bad.crd")
    result = cli("save", base, decks / "new.crd", bad)
    assert result.exit_code == 1  # one has no results
    assert "new.crd: new\n" in result.stdout
    assert "musat: bad.crd: not taken over; with --unusable that it cannot be used is\n" in result.stderr
    assert set(load_baseline(base).entries) == {"new.crd", "west/small0.crd", "east/small0.crd"}
    with pytest.raises(BaselineError, match="accept takes its new results over"):
        save(base, [decks / "new.crd"])
    with pytest.raises(BaselineError, match="is not below"):
        save(base, [ST_THOMAS])
    with pytest.raises(BaselineError, match="only decks are added"):
        save(base, [decks / "other.crd"], records=False)
    (decks / "new.crd").unlink()
    checked = check(base, ["new"])
    assert [one.state for one in checked.decks] == ["failed"] and not checked.same
    assert checked.decks[0].notes == ("the deck is gone; musat baseline accept drops it",)
    assert accept(base, ["new"]).dropped == ("new.crd",)
    assert not list(base.rglob("new.*")) and len(load_baseline(base).entries) == 2
    with pytest.raises(BaselineError, match=r"no such deck in the baseline: new; .* save adds others"):
        accept(base, ["new"])


@pytest.mark.slow
def test_a_baseline_beside_its_decks(tmp_path):
    decks = decks_in(tmp_path / "a", small=1)
    taken = save(tmp_path, decks, records=False, exact=True)
    assert set(tree(tmp_path)) == {INDEX, "a/small0.crd", "a/small0.lst"}
    assert taken.baseline.root == "."
    assert check(tmp_path).decks[0].state == "identical"
    with pytest.raises(BaselineError, match="no baseline here"):
        load_baseline(tmp_path / "a")


@pytest.mark.slow
def test_a_full_disk_leaves_a_baseline_as_it_was(top):
    base = top / "base"
    for side in ("west", "east"):
        edit(top / "decks" / side / "small0.crd", *WATER)
    assert not check(base, work=top / "work").same
    before = tree(base)
    ballast = top / "full"
    ballast.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=300k", "x", ballast], capture_output=True).returncode:
        pytest.skip("a small file system can be mounted by root only")
    try:
        shutil.copytree(base, ballast, dirs_exist_ok=True)
        with pytest.raises(OSError, match="No space left on device"):
            accept(ballast, work=top / "work")
        assert tree(ballast) == before
    finally:
        subprocess.run(["umount", ballast], check=True)


@pytest.fixture(scope="module")
def with_failure(tmp_path_factory):
    """A baseline of a good deck and one that cannot be used."""
    top = tmp_path_factory.mktemp("failing")
    decks_in(top / "decks", small=1)
    bad = shutil.copy(ROOT / "fixtures" / "bad_decks" / "many_errors.crd", top / "decks" / "bad.crd")
    assert save(top / "base", [top / "decks" / "small0.crd", bad], unusable=True).failed == ()
    return top


@pytest.fixture
def failing(with_failure, tmp_path):
    return Path(shutil.copytree(with_failure, tmp_path / "copy"))


@pytest.mark.slow
def test_a_deck_that_must_fail_with_its_messages(failing, monkeypatch):
    base = failing / "base"
    assert {path.name for path in base.iterdir()} == {
        INDEX, "rules.toml", "record_rules.toml", "small0.lst", "small0.json", "bad.err",
    }  # fmt: skip
    kept = (base / "bad.err").read_text()
    assert kept.startswith("unusable, exit status 1: ") and str(failing) not in kept
    assert "\nbad.crd:" in kept and "XYZ 123" in kept and "^^^" in kept
    assert load_baseline(base).entries["bad.crd"].status == 1
    monkeypatch.chdir(failing / "decks")  # the messages are those of any folder
    result = cli("check", "../base", "-q")
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", "")
    assert "  unusable" in cli("list", base).stdout.splitlines()[0]


@pytest.mark.slow
def test_other_messages_than_those_of_the_baseline(failing):
    base, bad = failing / "base", failing / "decks" / "bad.crd"
    edit(base / "bad.err", b"XYZ", b"XYW")  # as if the program had said something else
    result = cli("check", base, "bad", "--junit", failing / "tests.xml")
    assert result.exit_code == 1 and "XYW" in result.stdout and "bad.crd  different" in result.stdout
    assert (base / ".new" / "bad.err").exists()
    suite = ElementTree.parse(failing / "tests.xml").getroot()
    assert (suite.get("failures"), suite.get("errors")) == ("1", "0")
    (base / "message_rules.toml").write_text('[[rule]]\nname = "any"\nskip = true\n')
    assert [one.state for one in check(base, ["bad"]).decks] == ["within the rules"]
    (base / "message_rules.toml").unlink()
    bad.write_bytes(bad.read_bytes() + b"XYZ\n")
    result = cli("accept", base, "bad")  # it was unusable before: nothing is lost
    assert (result.exit_code, "bad.crd: changed" in result.stdout) == (0, True)
    assert check(base, ["bad"]).same


@pytest.mark.slow
def test_a_deck_changes_sides(failing):
    base, decks = failing / "base", failing / "decks"
    good, bad = (decks / "small0.crd").read_bytes(), (decks / "bad.crd").read_bytes()
    (decks / "small0.crd").write_bytes(bad)
    (decks / "bad.crd").write_bytes(good)
    found = {one.name: one for one in check(base).decks}
    assert (found["small0.crd"].state, found["bad.crd"].state) == ("failed", "different")
    assert "it can be used now: accepted" in found["bad.crd"].notes
    taken = accept(base)
    assert (taken.failed, taken.changed) == (("small0.crd",), ("bad.crd",))
    assert (base / "small0.lst").exists() and (base / "bad.lst").exists() and not (base / "bad.err").exists()
    assert accept(base, unusable=True).changed == ("small0.crd",)
    assert not list(base.glob("small0.[lj]*")) and (base / "small0.err").exists()
    assert check(base).same


@pytest.mark.slow
def test_only_what_a_deck_is_unusable_for_is_kept(failing):
    """A crash, a full disk or a deck that cannot be read is no result that could be expected."""
    base, bad = failing / "base", failing / "decks" / "bad.crd"
    bad.unlink()
    bad.mkdir()
    assert [one.state for one in check(base, ["bad"]).decks] == ["failed"]
    assert accept(base, ["bad"], unusable=True).failed == ("bad.crd",)
    assert (base / "bad.err").exists()


@pytest.mark.slow
def test_line_ends_of_git_are_no_change(top):
    """A checkout with `core.autocrlf`, of decks and baseline."""
    base = top / "base"
    for path in [*top.rglob("*.crd"), *base.rglob("*.*")]:
        if path.is_file():
            path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    result = cli("check", base)
    assert result.exit_code == 0, result.output
    assert result.stdout.splitlines()[-1] == f"same: 2 within the rules; saved by musatpy {__version__}"
    assert "as saved" in cli("list", base).stdout
    before = tree(base)
    taken = accept(base)
    assert (len(taken.unchanged), tree(base)) == (2, before)
    edit(top / "decks" / "west" / "small0.crd", *WATER)
    assert accept(base).changed == ("west/small0.crd",)
    assert check(base).same


@pytest.mark.slow
def test_what_a_baseline_says_of_a_run_is_no_news(tmp_path):
    """A deck that does not converge, as it was saved: all is well."""
    deck = tmp_path / "short.crd"
    deck.write_bytes(ST_THOMAS.read_bytes().replace(b"FULL      20  20", b"FULL       1   1"))
    assert "still moves" in cli("save", tmp_path / "base", deck, "-q").stderr
    for command in ("check", "accept"):
        result = cli(command, tmp_path / "base", "-q")
        assert (result.exit_code, result.output) == (0, "")
    before = tree(tmp_path / "base")
    result = cli("check", tmp_path / "base", "-o", tmp_path / "base")
    assert (result.exit_code, "would overwrite what the baseline keeps" in result.stderr) == (2, True)
    assert tree(tmp_path / "base") == before
    (tmp_path / "base" / "short.json").write_text("{")
    (found,) = check(tmp_path / "base").decks
    assert found.state == "different" and "short.json" in found.notes[0]
    assert check(tmp_path / "base").unused_rules == ()  # of records nothing was compared


ENTRY: dict[str, Any] = {"deck_sha256": "0", "version": "1", "status": 0, "state": "accepted"}
INDEX_OF_ONE: dict[str, Any] = {
    "schema_version": "1.0", "decks_in": "..", "records": True, "formats": None, "decks": {"a.crd": ENTRY},
}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"decks_in": 5}, "decks_in"), ({"more": 1}, "more"),
        ({"schema_version": "9.0"}, "schema 9.0 is not 1.0; another version"),
        ({"decks": {"a.crd": 1}}, "decks.a.crd: a table is expected"),
        ({"decks": {"../a.crd": ENTRY}}, "'../a.crd' is not the place of a deck"),
        ({"decks": {"a\\b.crd": ENTRY}}, "is not the place of a deck: it is not a plain name"),
        ({"runs": {"a.crd": "/b.crd"}}, "'/b.crd' is not the place of a deck"),
        ({"decks": {"a.crd": {"deck_sha256": "", "version": "1"}}}, "decks.a.crd.status: is missing"),
        ({"decks": {"a.crd": ENTRY | {"inputs": {"x": 3}}}}, "decks.a.crd.inputs.x: a text is expected"),
    ],
)  # fmt: skip
def test_an_index_that_was_spoilt(tmp_path, change, why):
    """Nothing is written where such an index says that decks are."""
    (tmp_path / INDEX).write_text(json.dumps(INDEX_OF_ONE))
    assert set(load_baseline(tmp_path).entries) == {"a.crd"}
    (tmp_path / INDEX).write_text(json.dumps(INDEX_OF_ONE | change))
    for command, status in (("check", 2), ("accept", 1), ("list", 1)):
        result = cli(command, tmp_path)
        assert (result.exit_code, result.stdout) == (status, "")
        assert why in result.stderr and "unexpected" not in result.stderr
    assert os.listdir(tmp_path) == [INDEX]


@pytest.mark.parametrize("content", [b"", b"{", b"null", b"<<<<<<< HEAD\n{}\n", b"\xff\xfe", b"[" * 100_000])
def test_an_index_that_is_none(tmp_path, content):
    (tmp_path / INDEX).write_bytes(content)
    result = cli("check", tmp_path)
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert "restore it (git checkout), or save the baseline anew" in result.stderr


def test_two_checks_at_once(top):
    with FolderLocks() as locks:
        locks.take(top / "base" / ".new")
        with FolderLocks() as others, pytest.raises(LockedError, match=f"pid {os.getpid()} on"):
            others.take(top / "base" / ".new")
        result = cli("check", top / "base")
        assert result.exit_code == 2 and "another batch is at work here" in result.stderr


@pytest.mark.slow
def test_a_deck_that_the_baseline_does_not_have_is_named(top):
    shutil.copy(ST_THOMAS, top / "decks" / "west" / "new.crd")
    shutil.copy(ST_THOMAS, top / "decks" / "west" / "small0.edited.crd")  # punched
    result = cli("check", top / "base", "--junit", top / "tests.xml", "-q")
    assert result.exit_code == 1
    assert result.stdout.splitlines()[-2:] == [
        "west/new.crd     not in the baseline  (musat baseline save adds it)",
        f"DIFFERENT: 2 identical, 1 not in the baseline; saved by musatpy {__version__}",
    ]
    assert ElementTree.parse(top / "tests.xml").getroot().get("failures") == "1"
    assert not (top / "base" / ".new").exists()  # nothing is to be accepted
    assert check(top / "base", ["west/small0"]).same  # the others were not asked for


@pytest.mark.slow
def test_rules_for_records(top, tmp_path):
    kept = top / "base" / "west" / "small0.json"
    edit(kept, b'"sigma0": 0', b'"sigma0": 9')
    rules = tmp_path / "record.toml"
    rules.write_text('[[rule]]\nname = "lenient"\nsection = "."\nabsolute = 10\n')
    assert cli("check", top / "base", "west/small0", "-q").exit_code == 1
    assert cli("check", top / "base", "west/small0", "-q", "--record-rules", rules).exit_code == 0
    save(tmp_path / "own", [top / "decks" / "west" / "small0.crd"], record_rules=rules)
    assert (tmp_path / "own" / "record_rules.toml").read_bytes() == rules.read_bytes()
    with pytest.raises(BaselineError, match="rules for records go with records"):
        save(tmp_path / "lst", [ST_THOMAS], record_rules=rules, records=False)


def test_a_deck_whose_name_other_systems_read_as_a_path_is_refused(tmp_path):
    deck = Path(shutil.copy(ST_THOMAS, tmp_path / "a:b.crd"))
    with pytest.raises(BaselineError, match=r"a:b\.crd: its name in the baseline is not a plain name"):
        save(tmp_path / "base", [deck])
