"""`musat audit`: what it prints, its JSON, and its exit statuses."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from cli.commands import musat

FIXTURES = Path(__file__).parents[2] / "fixtures"
LEGACY = FIXTURES / "legacy"
MODIFIED = FIXTURES / "cayman" / "cayman_modified.lst"


def test_a_consistent_listing_ends_with_0():
    result = musat("audit", MODIFIED)
    assert result.exit_code == 0 and result.stdout.splitlines()[-1] == "consistent"


def test_an_inconsistent_listing_ends_with_1():
    result = musat("audit", LEGACY / "etl0306_table_6_6.lst")
    assert result.exit_code == 1
    assert "    mean -0 1 4.483, expected -0 1 8.483 (line 11)" in result.stdout.splitlines()
    assert result.stdout.splitlines()[-1] == "inconsistent"


def test_json_says_the_same():
    result = musat("audit", LEGACY / "etl0306_table_6_5.lst", "--json", "--against", MODIFIED)
    found = json.loads(result.stdout)
    assert result.exit_code == 1 and found["consistent"] is False
    (one,) = found["contradictions"]
    assert one["suspects"] == [{"item": "mean", "line": 11, "found": "-0 0 .100", "expected": "-0 0 .010"}]
    assert {"size", "sum", "maximum at"} <= {pair["statistic"] for pair in found["compared"]}
    said = ["listing", "consistent", "repairs", "unreadable", "contradictions"]
    beside = ["compared", "only_listing", "only_new", "several"]
    assert list(found) == said + beside
    assert list(json.loads(musat("audit", MODIFIED, "--json").stdout)) == said


def test_rows_beside_a_newer_run_are_limited():
    result = musat("audit", MODIFIED, "--against", MODIFIED, "--listed", "2")
    assert result.exit_code == 0
    assert "0 differ by more than their rounding (*)" in result.stdout
    assert "... and 19 that differ less" in result.stdout.splitlines()


@pytest.mark.parametrize(
    ("content", "status", "said"),
    [(None, 2, "No such file"), (b"no listing\n", 2, "no analysis"), (b"\xff\xfe\x00", 2, "no analysis")],
)
def test_what_is_no_listing_ends_with_2(content, status, said, tmp_path):
    path = tmp_path / "x.lst"
    if content is not None:
        path.write_bytes(content)
    result = musat("audit", path)
    assert result.exit_code == status and said in result.stderr and "Traceback" not in result.output


def test_a_folder_ends_with_2(tmp_path):
    assert musat("audit", tmp_path).exit_code == 2


def test_a_newer_run_that_cannot_be_read_ends_with_2(tmp_path):
    (path := tmp_path / "new.json").write_text("{")
    result = musat("audit", MODIFIED, "--against", path)
    assert result.exit_code == 2 and "is no JSON" in result.stderr


def test_a_row_that_cannot_be_read_ends_with_2(tmp_path):
    text = (LEGACY / "etl0306_table_6_1.lst").read_text().replace(".830", "#??")
    (path := tmp_path / "x.lst").write_text(text)
    result = musat("audit", path)
    assert result.exit_code == 2
    assert "is not the 3 cells of 'rms'" in result.stdout and "as far as it can be read" in result.stdout


def test_repairs_are_reported(tmp_path):
    text = (LEGACY / "etl0306_table_6_1.lst").read_text().replace(" .830", " \u2022830")
    (path := tmp_path / "x.lst").write_text(text, encoding="utf-8")
    result = musat("audit", path)
    assert result.exit_code == 0
    assert f"{path}:12: point read as bullet: '\u2022830' read as '.830'" in result.stdout.splitlines()


@pytest.mark.parametrize("kind", ["empty", "deck", "record", "binary"])
def test_a_file_of_another_kind_ends_with_2_as_listing_and_as_newer_run(kind, tmp_path):
    content = {
        "empty": b"",
        "deck": (FIXTURES / "cayman" / "cayman_modified.crd").read_bytes(),
        "record": b'{"schema_version": "1.4", "options": {}}',
        "binary": bytes(range(256)) * 20,
    }[kind]
    (path := tmp_path / "x.lst").write_bytes(content)
    for result in (musat("audit", path), musat("audit", MODIFIED, "--against", path)):
        assert result.exit_code == 2 and "no analysis" in result.stderr and result.exception.__class__ is SystemExit


def test_two_runs_beside_a_listing_say_what_is_left_out(tmp_path):
    standard = FIXTURES / "cayman" / "cayman_standard.lst"
    (both := tmp_path / "both.lst").write_text(standard.read_text() + "\f" + MODIFIED.read_text())
    result = musat("audit", LEGACY / "etl0306_table_6_7.lst", "--against", both)
    assert result.exit_code == 0 and "21 compared, " in result.stdout
    assert result.stdout.splitlines()[-1].endswith("in one of them, with different numbers: not compared")
    assert musat("audit", both).stdout.splitlines()[-1] == "consistent"


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_not_taken_for_an_inconsistent_listing():
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "musatpy", "audit", str(MODIFIED)],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2 and done.stderr == "musat: system: No space left on device\n"


@pytest.mark.parametrize(
    "row",
    [
        " " * 1_000_000 + "7", "1" + " " * 1_000_000 + "1", "1\t" + " " * 1_000_000 + "\t2", "1" * 1_000_000,
        "x" + "." * 1_000_000 + "y1", "\u2022" * 1_000_000 + "RMS 1", "x" + "-" * 1_000_000 + "y1",
    ],
    ids=range(7),
)  # fmt: skip
def test_a_row_of_a_million_characters_is_reported_and_the_rest_is_read(tmp_path, row):
    """Each of them kept a pattern busy for hours."""
    lines = MODIFIED.read_text(encoding="utf-8").split("\n")
    place = next(n for n, line in enumerate(lines) if line.startswith("Plate Residuals")) + 6
    path = tmp_path / "wide.lst"
    path.write_text("\n".join([row, *lines[:place], row, *lines[place:]]), encoding="utf-8")
    result = musat("audit", path)
    assert result.exit_code == 2
    assert f"{path}:1: a row of {len(row)} characters: no listing has any" in result.stdout


@pytest.mark.parametrize("row", [" " * 9900 + "7", "x" + "." * 9900 + "y1", "\u2022" * 9900 + "RMS 1", "1" * 9900])
def test_wide_rows_take_no_longer_than_narrow_ones(tmp_path, row):
    """Half a megabyte of rows that patterns were tried on at each of their characters."""
    path = tmp_path / "wide.lst"
    path.write_text(f"{MODIFIED.read_text(encoding='utf-8')}\n" + f"{row}\n" * 50, encoding="utf-8")
    assert musat("audit", path).exit_code in (0, 2)
