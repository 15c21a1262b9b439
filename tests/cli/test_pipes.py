"""Decks from the standard input, results to the standard output, and what a shell completes."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cli.commands import musat

ROOT = Path(__file__).parents[2]
DECK = ROOT / "fixtures/st_thomas/st_thomas.crd"
DATA = DECK.read_bytes()


def test_a_deck_from_stdin_is_run_to_stdout(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran = musat("run", "-", input=DATA)
    assert ran.exit_code == 0
    assert ran.stdout == DECK.with_suffix(".lst").read_text()
    assert ran.stderr == "-: ACCEPTED, sigma0 0.9361, 10 iterations, water passes: 4, listing -\n"
    assert not list(tmp_path.iterdir())


def test_with_a_folder_it_has_files_named_stdin(tmp_path):
    ran = musat("run", "-", "-o", tmp_path, "--punch", "restart", input=DATA)
    assert ran.exit_code == 0 and ran.stderr == ""
    assert ran.stdout.startswith("-: ACCEPTED") and "stdin.lst" in ran.stdout
    assert sorted(path.name for path in tmp_path.iterdir()) == ["stdin.json", "stdin.lst", "stdin.pun"]
    assert (tmp_path / "stdin.lst").read_bytes() == DECK.with_suffix(".lst").read_bytes()


def test_problems_of_a_deck_from_stdin_name_it_so():
    ran = musat("run", "-", input=DATA.replace(b"-45.1870000", b"-45.l870000"))
    assert ran.exit_code == 1 and ran.stdout == ""
    assert "\n-:41 cols 22-33 PLT.x: '-45.l870000' is not F12.7\n" in ran.stderr
    assert ran.stderr.endswith("musat: -: not run, 1 error\n")
    assert musat("run", "-", input=b"").exit_code == 1


@pytest.mark.parametrize("more", [["--csv"], ["--gis"], ["--punch", "result"], ["--punch-edits"], [str(DECK)]])
def test_what_stdout_cannot_hold_needs_a_folder(more):
    ran = musat("run", "-", *more, input=DATA)
    assert ran.exit_code == 2 and "- with other decks, or with files besides the listing, needs -o" in ran.stderr


def test_a_quiet_run_of_stdin_is_its_listing_alone():
    ran = musat("run", "-q", "-", input=DATA)
    assert (ran.exit_code, ran.stderr) == (0, "") and ran.stdout.startswith("MUSATPY")


def test_decks_are_checked_and_listed_from_stdin(tmp_path):
    checked = musat("check", "-", input=DATA)
    assert checked.stdout == "-: 0 errors, 0 warnings; 3 photos, 22 points, 48 plate measurements\n"
    listed, named = musat("list", "-", input=DATA), musat("list", DECK)
    both = ([line for line in one.stdout.splitlines() if "PAGE" not in line] for one in (listed, named))
    assert next(both) == next(both)


def test_edited_decks_go_to_stdout_and_reports_to_stderr(tmp_path):
    part = tmp_path / "part.crd"
    written = musat("extract", DECK, "--photos", "21-22", "-o", part)
    streamed = musat("extract", DECK, "--photos", "21-22", "-o", "-")
    assert streamed.exit_code == written.exit_code == 0
    assert streamed.stdout == part.read_text()
    assert streamed.stderr.replace("-: 2 photos", f"{part}: 2 photos") == written.stdout
    third = tmp_path / "third.crd"
    musat("extract", DECK, "--photos", "23", "-o", third)
    merged = musat("merge", part, third, "-o", "-")
    assert merged.exit_code == 0 and merged.stdout.startswith("TTL") and merged.stdout.endswith("\n")
    assert "3 photos" in musat("check", "-", input=merged.stdout.encode()).stdout


def completed(*words):
    """Return what the shell would offer for the last of some words."""
    environment = {**os.environ, "COMP_WORDS": " ".join(["musat", *words]), "COMP_CWORD": str(len(words))}
    environment["_MUSAT_COMPLETE"] = "bash_complete"
    code = "from musatpy.cli.main import main; main(prog_name='musat')"
    ran = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=60)
    return [line.partition(",")[2] for line in ran.stdout.splitlines()]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (["ex"], ["example", "explain", "extract"]),
        (["run", "--st"], ["--strict"]),
        (["card", "o"], ["OPT", "OP2", "ORI"]),
        (["card", "OP2", "water_"], ["water_level=", "water_tilt=", "water_index="]),
        (["card", "OP2", "water_tilt="], ["water_tilt=KNOWN", "water_tilt=ADJUST"]),
        (["card", "MDL", "mod"], ["model=", "mode="]),
        (["example", "c"], ["cayman"]),
    ],
)
def test_a_shell_completes_commands_cards_and_fields(words, offered):
    assert completed(*words) == offered


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_the_line_of_the_manual_defines_a_completion():
    code = "from musatpy.cli.main import main; main(prog_name='musat')"
    environment = {**os.environ, "_MUSAT_COMPLETE": "bash_source"}
    script = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=60
    )
    ran = subprocess.run(["bash", "-c", f"{script.stdout}\ncomplete -p musat"], capture_output=True, text=True)
    assert ran.returncode == 0 and "musat" in ran.stdout
