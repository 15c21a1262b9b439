"""What stands in a file never commands a terminal: it is printed as an escape, whatever command prints it."""

from __future__ import annotations

import json
import warnings
from functools import partial
from pathlib import Path

import pytest
from click.testing import Result

from cli import commands

ROOT = Path(__file__).parents[2]
GOLDEN = ROOT / "fixtures" / "st_thomas" / "st_thomas.lst"
HOSTILE = "\x1b]0;x\x07\x9b2J\u202e"  # title of the window, clear the screen, write from right to left
musat = partial(commands.musat, color=True, env={"NO_COLOR": "1"})
ESCAPED = r"\x1b]0;x\x07\x9b2J\u202e"
OWN_OUTPUT = {"messages.py", "live.py", "live_line.py", "run.py", "options.py"}  # `printable`, lines written anew


@pytest.fixture
def hostile(tmp_path) -> Path:
    path = tmp_path / "hostile.lst"
    text = GOLDEN.read_text(encoding="utf-8")
    for word in ("Refractive index", "106            .018      -.037", "Mean Value of Differences "):
        assert word in text
        text = text.replace(word, f"{word}{HOSTILE}")
    path.write_text(text, encoding="utf-8")
    return path


def clean(ran: Result) -> str:
    """Return what was printed; nothing of it is a control character."""
    text = ran.stdout + ran.stderr
    assert text and text.replace("\n", "").replace("\f", "").isprintable()
    return text


def test_a_diff_escapes_what_the_listings_say(hostile):
    ran = musat("diff", GOLDEN, hostile)
    assert ran.exit_code == 1 and r"\x1b" in clean(ran)


def test_an_audit_escapes_what_the_listing_says(hostile):
    ran = musat("audit", hostile)
    assert ran.exit_code and ESCAPED in clean(ran)


def test_names_of_soundings_are_escaped_in_their_listing(tmp_path):
    fixture = ROOT / "fixtures" / "st_thomas_as11"
    head, *lines = (fixture / "soundings.csv").read_text().splitlines()
    cells = [line.split(",") for line in lines]
    for number, cell in enumerate(cells):
        cell[0] = f'"S{HOSTILE}\n{number}"'
        cell[3] = f"{float(cell[3]) + 25.0 * (number % 20 == 3)}"  # blunders are named
    rows = [",".join(cell) for cell in cells]
    text = "\n".join([head, *rows, ""])
    (tmp_path / "hostile.csv").write_text(text, encoding="utf-8")
    assert musat("run", "-q", ROOT / "fixtures/st_thomas/st_thomas.crd", "-o", tmp_path).exit_code == 0
    run, deck = tmp_path / "st_thomas.json", fixture / "st_thomas_as11.crd"
    clean(musat("as11", "compare-soundings", run, deck, tmp_path / "hostile.csv", "-o", tmp_path))
    listing = (tmp_path / "hostile.soundings.lst").read_text(encoding="utf-8")
    assert ESCAPED in listing and listing.replace("\n", "").replace("\f", "").isprintable()


@pytest.mark.slow
def test_a_letter_that_no_font_has_is_no_matter_of_the_user(tmp_path):
    deck = (ROOT / "fixtures/st_thomas/st_thomas.crd").read_text()
    (tmp_path / "deck.crd").write_text(deck)
    assert musat("run", "-q", tmp_path / "deck.crd").exit_code == 0
    record = (tmp_path / "deck.json").read_text(encoding="utf-8").replace('"21"', '"\u6c34"')
    (tmp_path / "deck.json").write_text(record, encoding="utf-8")
    for command in ("report", "plot"):
        with warnings.catch_warnings(record=True) as told:
            assert musat(command, tmp_path / "deck.json").exit_code == 0
        assert not [str(warning.message) for warning in told if "Glyph" in str(warning.message)]


def test_rules_are_escaped(hostile, tmp_path):
    rules = tmp_path / "rules.toml"
    rules.write_text(f'[[rule]]\nname = {json.dumps(HOSTILE)}\nsection = "none"\nskip = true\n')
    assert ESCAPED in clean(musat("diff", GOLDEN, hostile, "--rules", rules))


def test_problems_are_escaped_and_carets_stand_below_their_columns(tmp_path):
    cameras = tmp_path / "cameras.csv"
    cameras.write_text(f"name,x,y,z,tide\nA,0,{HOSTILE},300,0\n")
    ran = musat("depth", "table", "--cameras", cameras)
    assert ran.exit_code == 1 and ESCAPED in clean(ran)


def test_no_command_prints_past_the_messages():
    direct = {path.name for path in (ROOT / "src/musatpy/cli").glob("*.py") if "click.echo(" in path.read_text()}
    assert direct <= OWN_OUTPUT
