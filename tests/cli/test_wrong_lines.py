"""Command lines that are wrong, results that would go over what is read, links in a circle: all leave nothing."""

import re
import shutil
from pathlib import Path

import click
import pytest

from cli.commands import musat
from musatpy.cli.options import refuse_overwriting

FIXTURES = Path(__file__).parents[2] / "fixtures"
DECK, CAYMAN = FIXTURES / "st_thomas" / "st_thomas.crd", FIXTURES / "cayman" / "cayman_modified.crd"
SPEC = DECK.with_suffix(".toml")
MERGE, EXTRACT = f"merge {CAYMAN} {DECK}", f"extract {CAYMAN}"

EMPTY = [
    "batch ''", "batch . -o ''", "baseline save base ''", "baseline save '' .", "baseline check base -o ''",
    "diff '' job.crd",
]  # fmt: skip
WRONG = [  # words, message
    ("", "[OPTIONS] COMMAND [ARGS]"),
    ("nonsense", "No such command 'nonsense'"),
    ("run", "Missing argument 'DECK...'"),
    ("run --nonsense job.crd", "No such option"),
    ("run job.crd job.crd -o somewhere", "the results of job.crd and job.crd would both go to"),
    ("run job.json", "the results of job.json would overwrite the deck job.json"),
    ("run job.crd -o job.crd", "Directory 'job.crd' is a file"),
    ("run job.crd --formats nowhere", "Directory 'nowhere' does not exist"),
    ("run job.pun --punch restart", "would overwrite the deck job.pun"),
    ("run job.crd job.edited.crd --punch-edits", "would overwrite the deck job.edited.crd"),
    ("run job.crd --submerged job.json", "would overwrite job.json, which is read"),
    ("run job.crd --punch all", "'all' is not one of 'restart', 'result'"),
    ("run job.crd --punch-points all", "say what to punch: --punch restart or --punch result"),
    ("run job.crd --punch-family patb", "say what to punch: --punch restart or --punch result"),
    ("run job.crd --punch restart --punch-kind F", "the points of a restart are check points"),
    ("run job.crd --punch restart --no-punch-sigmas", "sigmas"),
    ("run job.crd --punch result --punch-family PATC", "no family 'PATC'; there are musat, job, bingo, giant"),
    ("run job.crd --crs EPSG:4267", "--crs goes with --gis"),
    *((f"run - {more}", "- with other decks, or with files besides the listing, needs -o")
      for more in ("--csv", "--gis", "--punch result", "--punch-edits", "job.crd")),
    ("run job.crd --set OP2.water_levl=ONE", "OP2 has no field 'water_levl'; did you mean water_level?"),
    ("check job.crd --set OP2.water_levl=ONE", "OP2 has no field 'water_levl'; did you mean water_level?"),
    ("batch job.crd --set OP2.water_levl=ONE", "OP2 has no field 'water_levl'; did you mean water_level?"),
    ("check", "Missing argument 'DECK...'"),
    ("simulate", "Missing argument 'SPEC'"),
    (f"simulate {SPEC} --seed -1", "'--seed'"),
    ("simulate job.crd", "the result would overwrite job.crd"),
    ("list", "Missing argument 'DECK...'"),
    ("list job.crd --few 0", "'--few'"),
    (f"merge {CAYMAN} -o out.crd", "a merged deck needs two decks at least"),
    (MERGE, "Missing option '-o'"),
    (f"merge {CAYMAN} job.crd -o job.crd", "the result would overwrite job.crd"),
    (f"{MERGE} -o out.crd --prefix E", "--prefix E: not DECK=TEXT"),
    (f"{MERGE} -o out.crd --prefix nothing=E", "--prefix: "),
    (f"{MERGE} -o out.crd --options-from nothing", "--options-from: "),
    (f"{EXTRACT} -o out.crd", "say which photos"),
    ("extract job.crd --photos 841 -o job.crd", "the result would overwrite job.crd"),
    (f"{EXTRACT} --photos 841 -o out.crd --height 3", "--height is for --by points"),
    (f"{EXTRACT} --box 1,2,3 -o out.crd", "--box 1,2,3: not four numbers W,S,E,N"),
    ("convert job.crd job.xyz", "give its family with --to"),
    ("convert job.crd .", "give its family with --to"),
    ("convert job.crd job.im --to nobody", "no family 'nobody'; there are musat, job, bingo, giant"),
    ("convert job.crd job.crd", "the result would overwrite"),
    ("convert job.crd job.im --deck job.crd", "FROM is a deck itself"),
    ("convert none.crd job.im", "does not exist"),
    ("card OPQ", "no card 'OPQ'; did you mean OPT?"),
    ("card OP2 water=ONE", "OP2 has no field 'water'; did you mean"),
    ("card OP2 water_level", "'water_level' is not FIELD=VALUE, such as water_level=ONE"),
    ("card OP2 water_level=one\u00e9", "is not A5 (up to 5 ASCII characters, no outer blanks); did you mean ONE?"),
    ("example caymann", "did you mean cayman?"),
    ("plot job.json --only nothing", "nothing"),
    *((words, "the name is empty") for words in EMPTY),
]  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder in which we are, with a deck under the names of results too."""
    monkeypatch.chdir(tmp_path)
    for name in ("job.crd", "job.json", "job.pun", "job.edited.crd"):
        shutil.copy(DECK, tmp_path / name)
    return tmp_path


@pytest.mark.parametrize(("words", "message"), WRONG)
def test_a_wrong_command_line_ends_with_2_and_leaves_nothing(folder, words, message):
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    result = musat(*(word.strip("'") for word in words.split(" ") if word))
    assert (result.exit_code, type(result.exception)) == (2, SystemExit)
    assert message in result.output
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


CIRCLES = [
    "run circle.crd", "convert circle.crd out.giant --to giant", "diff circle.lst circle.lst",
    "depth correct circle.csv -o out.csv --cameras circle.csv --angle 30",
]  # fmt: skip
MORE_CIRCLES = [
    "batch circle.crd", "baseline save b circle.crd", "simulate circle.toml", "waves circle.toml",
    "extract circle.crd --photos 1 -o out.crd", "merge circle.crd circle.crd -o out.crd", "list circle.crd",
    "sea fit circle.csv", "audit circle.lst",
]  # fmt: skip


@pytest.mark.parametrize(
    "words", [*CIRCLES, *(pytest.param(words, marks=pytest.mark.slow) for words in MORE_CIRCLES)]
)
def test_links_that_lead_in_a_circle_are_told(tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    for ending in ("toml", "crd", "csv", "lst"):
        (tmp_path / f"circle.{ending}").symlink_to(f"circle.{ending}")
    ran = musat(*words.split())
    assert ran.exit_code in (1, 2) and "unexpected" not in ran.stderr
    assert re.search("Too many levels of symbolic links|'circle.crd' does not exist", ran.stderr)


def test_a_result_behind_a_link_is_refused(tmp_path):
    (tmp_path / "in.csv").write_text("x")
    (tmp_path / "link.csv").symlink_to("in.csv")
    refuse_overwriting([tmp_path / "out.csv"], [tmp_path / "in.csv"])
    with pytest.raises(click.UsageError, match=r"the result would overwrite .*link\.csv, which is read"):
        refuse_overwriting([tmp_path / "link.csv"], [tmp_path / "in.csv"])
