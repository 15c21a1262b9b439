"""`--set` of the commands that run decks, and `musat card`."""

import json
import os
import shutil
from pathlib import Path

import pytest

from cli.commands import musat

DECK = Path(__file__).parents[2] / "fixtures/st_thomas/st_thomas.crd"
IIIA = ("--set", "OPT.program=IIIA", "--set", "OP2.water_level=ONE")


@pytest.fixture
def deck(tmp_path):
    return Path(shutil.copy(DECK, tmp_path / "job.crd"))


def by_cards(folder):
    """Return a deck that says the same itself."""
    lines = DECK.read_text().splitlines(keepends=True)
    lines[1] = lines[1].replace("IIA ", "IIIA")
    path = folder / "by_cards.crd"
    path.write_text("".join([*lines[:-1], f"{'OP2                ONE':<72}00000070\n", lines[-1]]))
    return path


@pytest.mark.slow
def test_a_run_with_settings_is_that_of_a_deck_that_says_so(deck, tmp_path):
    assert musat("run", deck, *IIIA).exit_code == 0
    same = by_cards(tmp_path)
    assert musat("run", same).exit_code == 0
    shown = deck.with_suffix(".lst").read_text().splitlines()
    (line,) = set(shown) - set(same.with_suffix(".lst").read_text().splitlines())
    assert line == f"{'Set for this run ':.<50} OPT.program=IIIA, OP2.water_level=ONE"
    assert shown.index("Options") < shown.index(line) < shown.index("Size Of The Job")
    with_settings, without = (json.loads(path.with_suffix(".json").read_text()) for path in (deck, same))
    assert with_settings.pop("settings") == ["OPT.program=IIIA", "OP2.water_level=ONE"]
    assert "settings" not in without and with_settings == without


@pytest.mark.slow
def test_how_far_causes_are_searched_is_said_where_it_is_not_usual(deck):
    said = []
    for options in (("--causes", "none", *IIIA), ("--causes", "usual", *IIIA)):
        assert musat("run", deck, *options, "--html").exit_code == 0
        said.append([deck.with_suffix(kind).read_text() for kind in (".lst", ".json", ".html")])
    (listing, record, page), usual = said
    assert json.loads(record)["settings"] == ["OPT.program=IIIA", "OP2.water_level=ONE", "causes=none"]
    assert f"{'Set for this run ':.<50} OPT.program=IIIA, OP2.water_level=ONE, causes=none" in listing
    assert "Set for this run: OPT.program=IIIA, OP2.water_level=ONE, causes=none." in page
    assert not any("causes=" in text for text in usual)


def test_many_settings_stay_on_the_paper(deck):
    settings = ["max_iterations=30", "max_passes=30", "rotation_limit=.2", "translation_limit=.002", "weights=FULL"]
    assert musat("run", deck, *(word for text in settings for word in ("--set", f"OPT.{text}"))).exit_code == 0
    lines = deck.with_suffix(".lst").read_text().splitlines()
    (first,) = (number for number, line in enumerate(lines) if line.startswith("Set for this run"))
    assert lines[first + 1].strip().startswith("OPT.") and max(map(len, lines)) <= 132


def test_a_punched_deck_says_what_was_set(deck):
    assert musat("run", deck, *IIIA, "--punch", "restart").exit_code == 0
    punched = deck.with_suffix(".pun").read_text().splitlines()
    assert punched[1].startswith("OPT IIIA") and punched[2][19:24] == "ONE  "


def test_a_slip_in_a_setting_of_a_baseline_or_a_manifest_is_told(deck, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran = musat("baseline", "save", "kept", deck, "--set", "OP2.water_levl=ONE")
    assert (ran.exit_code, os.listdir(tmp_path)) == (1, ["job.crd"])
    assert "OP2 has no field 'water_levl'; did you mean water_level?" in ran.stderr
    (tmp_path / "two.toml").write_text('set = ["OPT.progam=IIIA"]\n[[job]]\ndeck = "job.crd"\n')
    ran = musat("batch", tmp_path / "two.toml")
    assert ran.exit_code == 1 and "two.toml:1: OPT has no field 'progam'; did you mean program?" in ran.stderr


@pytest.mark.slow
def test_a_batch_runs_again_what_is_set_otherwise(deck, tmp_path):
    def last(*options):
        ran = musat("batch", deck, "-o", tmp_path / "out", *options)
        assert ran.exit_code == 0
        return ran.stdout.splitlines()[-1]

    assert "kept" not in last(*IIIA)
    assert "1 kept from an earlier run" in last(*IIIA)
    assert "kept" not in last()
    record = json.loads((tmp_path / "out/job.json").read_text())
    assert "settings" not in record
    assert "kept" not in last(*IIIA)


@pytest.mark.slow
def test_a_manifest_sets_fields_of_all_jobs_or_of_one(deck, tmp_path):
    manifest = tmp_path / "two.toml"
    manifest.write_text(
        'set = ["OPT.program=IIIA", "OP2.water_level=ONE"]\n[[job]]\ndeck = "job.crd"\nout = "iiia"\n'
        '[[job]]\ndeck = "job.crd"\nout = "iia"\nset = []\n'
    )
    assert musat("batch", "-q", manifest, "-j", "1").exit_code == 0
    programs = {
        name: json.loads((tmp_path / name / "job.json").read_text())["options"]["program"]
        for name in ("iia", "iiia")
    }
    assert programs == {"iia": "IIA", "iiia": "IIIA"}
    ran = musat("batch", manifest, "--set", "OPT.program=IIIA")
    assert ran.exit_code == 2 and "the manifest itself says" in ran.stderr


@pytest.mark.slow
def test_a_baseline_keeps_its_settings_and_tries_others(deck, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert musat("baseline", "save", "kept", deck, *IIIA).exit_code == 0
    assert json.loads(Path("kept/baseline.json").read_text())["settings"] == [IIIA[1], IIIA[3]]
    assert musat("baseline", "check", "kept").exit_code == 0
    other = musat("baseline", "check", "kept", "--set", "OP2.water_level=KNOWN")
    assert other.exit_code == 1 and "A  kept/job.lst" in other.stdout
    accepted = musat("baseline", "accept", "kept")  # of a new run without: nothing has changed
    assert accepted.exit_code == 0 and "1 unchanged" in accepted.stdout
    again = musat("baseline", "save", "kept", deck, "--set", "OPT.program=IIA")
    assert again.exit_code == 1 and "only decks are added" in again.stderr
    spoiled = json.loads(Path("kept/baseline.json").read_text()) | {"settings": [1]}
    Path("kept/baseline.json").write_text(json.dumps(spoiled))
    assert "settings[1]: a text is expected" in musat("baseline", "check", "kept").stderr


def test_cards_are_listed_explained_and_made():
    listed = musat("card")
    assert listed.exit_code == 0 and "OP2  More options" in listed.stdout and "MDL  Stereomodel" in listed.stdout
    explained = musat("card", "op2")
    assert explained.exit_code == 0 and "  20-24   water_level          A5              KNOWN" in explained.stdout
    made = musat("card", "OP2", "water_level=ONE", "datum=FREE")
    assert (made.exit_code, made.stderr) == (0, "")
    assert made.stdout == "OP2                ONE                 FREE\n"
    assert musat("card", "MDL").exit_code == 0
    grid = musat("card", "GRD", "name=BAY", "spacing=-5")
    assert grid.exit_code == 1 and grid.stdout.startswith("GRD BAY")
    assert "GRD.spacing: not greater than zero" in grid.stderr


def test_a_wrong_card_is_printed_and_its_problems_stand_on_stderr():
    ran = musat("card", "WTR", "index=3")
    assert ran.exit_code == 1 and ran.stdout == "WTR 3.000000\n"
    assert ran.stderr.startswith("WTR:1 cols 5-12 WTR.index: a refractive index of 3 is not within 1.3 to 1.4")
    assert ran.stderr.splitlines()[-1].strip() == "^" * 8


def test_cards_of_a_family_of_ones_own_are_explained(tmp_path):
    own = tmp_path / "own"
    shutil.copytree(Path(__file__).parents[2] / "card_formats/musat", own)
    text = (own / "op2.toml").read_text()
    (own / "op2.toml").write_text(text.replace('name = "water_level"', 'name = "tide_unknowns"'))
    assert "tide_unknowns" in musat("card", "OP2", "--formats", own).stdout
    assert musat("check", DECK, "--formats", own, "--set", "OP2.tide_unknowns=KNOWN").exit_code == 0
