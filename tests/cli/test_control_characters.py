"""What stands in a file never commands a terminal: it is printed as an escape, whatever command prints it."""

from __future__ import annotations

import json
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
    for word in ("Refractive index", "106            .018      -.037"):
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
