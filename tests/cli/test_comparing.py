"""`musat diff` and `musat audit`: statuses, what is printed, and files that cannot be compared."""

import json
import re
import subprocess
import sys
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import pytest

from cli.commands import musat

diff = partial(musat, "diff")

GOLDEN = Path(__file__).parents[2] / "fixtures" / "st_thomas" / "st_thomas.lst"
TEXT = GOLDEN.read_text(encoding="utf-8")
HEIGHT = ["203", "Elevation", "-5.134", "-5.136", "-0.002", "m", "-2", "exact"]  # the row of the one that differs
FIXTURES = Path(__file__).parents[2] / "fixtures"
THOMAS = FIXTURES / "st_thomas" / "st_thomas.crd"
LEGACY, MODIFIED = FIXTURES / "legacy", FIXTURES / "cayman" / "cayman_modified.lst"


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Return a folder with `a.lst` and `b.lst`, which differ in the height of point 203 and have a row more."""
    monkeypatch.chdir(tmp_path)
    Path("a.lst").write_text(TEXT, encoding="utf-8")
    other = TEXT.replace("-5.134        .168", "-5.136        .168")
    line = "203            .208       .136      38.7       .492\n"
    Path("b.lst").write_text(other.replace(line, line + line.replace("203", "777")), encoding="utf-8")
    return tmp_path


def test_same_files_end_with_0(files):
    ran = diff("a.lst", GOLDEN)
    assert (ran.exit_code, ran.stdout.splitlines()[-1][:6]) == (0, "same: ")
    assert diff("-q", "a.lst", GOLDEN).stdout == ""


def test_differences_are_printed_and_end_with_1(files):
    ran = diff("a.lst", "b.lst")
    assert ran.exit_code == 1
    lines = ran.stdout.splitlines()
    assert lines[:2] == ["A  a.lst", "B  b.lst"]
    row = next(line for line in lines if line.startswith("  203 "))
    assert row.split()[:8] == HEIGHT
    assert any(line.split()[:1] == ["777"] for line in lines)
    assert lines[-1].startswith("different: 1 only in B, 1 number; ")
    assert "\x1b" not in ran.stdout
    assert diff("-q", "a.lst", "b.lst").stdout == lines[-1] + "\n"


def test_colours_are_for_terminals(files):
    ran = diff("a.lst", "b.lst", color=True)
    assert "\x1b[31m" in ran.stdout and "\x1b[32m" in ran.stdout
    assert "\x1b" not in diff("a.lst", "b.lst", color=True, env={"NO_COLOR": "1"}).stdout
    assert "\x1b" in diff("a.lst", "b.lst", color=True, env={"NO_COLOR": ""}).stdout


def test_one_of_the_two_may_come_from_a_pipe(files):
    ran = diff("a.lst", "-", input=Path("b.lst").read_bytes())
    assert ran.exit_code == 1
    assert ran.stdout == diff("a.lst", "b.lst").stdout.replace("B  b.lst", "B  -")
    assert diff("-", "a.lst", input=TEXT.encode()).exit_code == 0
    both = diff("-", "-", input=TEXT.encode())
    assert both.exit_code == 2 and "-: can be one of the two only" in both.stderr


def test_all_that_cannot_be_read_is_said_at_once(files):
    Path("bad.toml").write_text("[[rule]]\nabsolut = 1\nskip = true\n")
    ran = diff("no.lst", "none.lst", "--rules", "bad.toml")
    assert ran.exit_code == 2
    assert [line.split(": ")[0] for line in ran.stderr.splitlines()] == [
        "no.lst", "none.lst", "bad.toml:2 rule 1.absolut",
    ]  # fmt: skip


def test_rules_are_applied_and_reported(files):
    Path("rules.toml").write_text(
        "[[rule]]\nname = 'heights'\ncolumn = 'Elev'\nabsolute = 0.002\n"
        "[[rule]]\nname = 'new points'\nid = '777'\nonly = 'B'\n"
        "[[rule]]\nname = 'typo'\nsection = 'Ajusted'\nskip = true\n"
    )
    ran = diff("a.lst", "b.lst", "--rules", "rules.toml")
    assert ran.exit_code == 0
    assert "rule never matched: typo" in ran.stdout
    assert "1 difference within the rules" in ran.stdout
    assert "-0.002 m: 203, Elevation" in ran.stdout


def test_few_rows_are_listed(files):
    Path("c.lst").write_text(TEXT.replace(".5", ".6"), encoding="utf-8")
    ran = diff("a.lst", "c.lst", "--listed", "2")
    assert ran.exit_code == 1 and "  and " in ran.stdout and " more" in ran.stdout
    assert len(ran.stdout.splitlines()) < len(diff("a.lst", "c.lst").stdout.splitlines())


def test_json_has_every_difference(files):
    ran = diff("a.lst", "b.lst", "--json")
    found = json.loads(ran.stdout)
    assert ran.exit_code == 1
    assert (found["same"], found["a"], found["b"]) == (False, "a.lst", "b.lst")
    (number,) = [one for one in found["findings"] if one["kind"] == "number"]
    assert (number["a"], number["b"], number["difference"], number["unit"]) == ("-5.134", "-5.136", "-0.002", "m")
    assert number["page_a"] == TEXT[: TEXT.index("-5.134  ")].count("\f") + 1
    assert number["line_b"] == number["line_a"] + 1


def test_junit_has_a_test_for_each_section_and_holds_any_text(files):
    ran = diff("a.lst", "b.lst", "--junit", "out/diff.xml", "-q")
    assert ran.exit_code == 1
    suite = ElementTree.parse("out/diff.xml").getroot()
    tests = {test.get("name"): test for test in suite}
    assert suite.get("tests") == str(len(tests)) and suite.get("failures") == "2"
    failure = tests["Adjusted Ground Points"].find("failure")
    row = next(line for line in failure.text.splitlines() if line.startswith("  203 "))
    assert row.split()[:8] == HEIGHT
    assert tests["Solution Summary"].find("failure") is None
    Path("x.lst").write_text("a \x01\x02 1.5 <&>\n", encoding="utf-8")
    Path("y.lst").write_text("a \x01\x02 1.6 <&>\n", encoding="utf-8")
    assert diff("x.lst", "y.lst", "--junit", "d.xml").exit_code == 1
    assert ElementTree.parse("d.xml").getroot().get("failures") == "1"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("a.lst", "."), "Is a directory"),
        (("a.lst", "empty.lst"), "empty.lst: is empty"),
        (("binary.lst", "a.lst"), "binary.lst: is not a text file"),
        (("bad.json", "bad.json"), "bad.json:1: is not JSON"),
        (("a.lst", "list.json"), "list.json: is not the record of a run"),
        ((THOMAS, "a.lst"), "st_thomas.crd: is a deck, no listing"),
        (("a.lst", "record.lst"), "record.lst: is JSON, whose name would end in .json, no listing"),
        ((THOMAS.with_name("README.md"), "a.lst"), "and a.lst have no row in common"),
    ],
)
def test_what_cannot_be_compared_ends_with_2(files, arguments, message):
    Path("empty.lst").write_text("")
    Path("binary.lst").write_bytes(b"PK\0\1")
    Path("bad.json").write_text("{")
    Path("list.json").write_text("[1]")
    Path("record.lst").write_text('{"schema_version": "3.0"}')
    ran = diff(*arguments, "--junit", "d.xml")
    assert (ran.exit_code, ran.stdout) == (2, "")
    assert message in ran.stderr and ran.stderr.count("\n") == 1
    suite = ElementTree.parse("d.xml").getroot()
    assert suite.get("errors") == "1" and message in suite.find("testcase/error").text


@pytest.fixture
def records(tmp_path, monkeypatch):
    """Return a folder with `a.json` of a run, and `b.json`, whose numbers were rounded otherwise."""
    monkeypatch.chdir(tmp_path)
    assert musat("run", "-q", THOMAS, "-o", ".").exit_code == 0
    text = Path("st_thomas.json").read_text(encoding="utf-8")
    Path("a.json").write_text(text, encoding="utf-8")
    rounded = re.sub(r"\d\.\d{9,}(?=[,\]\s}])", lambda match: str(float(match[0]) * (1.0 + 1e-13)), text)
    Path("b.json").write_text(rounded, encoding="utf-8")
    return json.loads(text)


def test_of_two_records_their_rounding_is_no_difference(records):
    ran = diff("a.json", "b.json")
    assert ran.exit_code == 0 and re.search(r"same: .* [\d,]+ differences within the rules\n$", ran.stdout)
    assert "never matched" not in ran.stdout
    assert diff("a.json", "b.json", "--rounding", "0").exit_code == 1
    assert diff("a.json", "b.json", "--rounding", "1e-15").exit_code == 1
    assert diff("a.json", "b.json", "--rounding", "-1").exit_code == 2
    Path("exact.toml").write_text("[[rule]]\nexact = true\n")
    assert diff("a.json", "b.json", "--rules", "exact.toml").exit_code == 1


@pytest.mark.parametrize(
    ("table", "field", "change", "status"),
    [
        ("points", "position", 2e-13, 0),  # rad of a latitude: a micrometre
        ("points", "position", 2e-12, 1),
        ("stations", "attitude", 1e-5, 1),
        ("plates", "residual", 1e-8, 1),
    ],
)
def test_what_is_more_than_rounding_is_a_difference(records, table, field, change, status):
    row = records[table][0] if isinstance(records[table], list) else records[table]
    values = row[field]
    while isinstance(values[0], list):
        values = values[0]
    values[0] += change
    Path("b.json").write_text(json.dumps(records), encoding="utf-8")
    assert diff("a.json", "b.json").exit_code == status


def test_a_report_that_cannot_be_written_and_an_error_of_the_program_are_no_difference(files, monkeypatch):
    ran = diff("a.lst", "b.lst", "--junit", "a.lst/d.xml")
    assert ran.exit_code == 2 and "unexpected" not in ran.stderr

    def fail(*arguments, **options):
        raise ZeroDivisionError("no")

    monkeypatch.setattr("musatpy.listings.compare_bytes", fail)
    monkeypatch.setattr("musatpy.listings.audit.reading.audit", fail)
    for command in (("diff", "a.lst", "b.lst"), ("audit", MODIFIED)):
        ran = musat(*command)
        assert ran.exit_code == 2 and "unexpected ZeroDivisionError" in ran.stderr


def test_a_listing_that_is_consistent_ends_with_0_one_that_is_not_with_1():
    result = musat("audit", MODIFIED)
    assert (result.exit_code, result.stdout.splitlines()[-1]) == (0, "consistent")
    result = musat("audit", LEGACY / "etl0306_table_6_6.lst")
    assert (result.exit_code, result.stdout.splitlines()[-1]) == (1, "inconsistent")
    assert "    mean -0 1 4.483, expected -0 1 8.483 (line 11)" in result.stdout.splitlines()


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
    ("old", "new", "status", "messages"),
    [
        (".830", "#??", 2, ["is not the 3 cells of 'rms'", "as far as it can be read"]),
        (" .830", " \u2022830", 0, [":12: point read as bullet: '\u2022830' read as '.830'\n"]),
    ],
)
def test_a_row_is_repaired_or_cannot_be_read(tmp_path, old, new, status, messages):
    text = (LEGACY / "etl0306_table_6_1.lst").read_text().replace(old, new)
    (path := tmp_path / "x.lst").write_text(text, encoding="utf-8")
    result = musat("audit", path)
    assert result.exit_code == status and all(message in result.stdout for message in messages)


@pytest.mark.parametrize("kind", ["empty", "deck", "record", "binary"])
def test_a_file_of_another_kind_ends_with_2_as_listing_and_as_newer_run(kind, tmp_path):
    content = {
        "empty": b"",
        "deck": (FIXTURES / "cayman" / "cayman_modified.crd").read_bytes(),
        "record": b'{"schema_version": "1.4", "options": {}}',
        "binary": bytes(range(256)) * 20,
    }[kind]
    message = {"empty": "x.lst: is empty", "binary": "x.lst: is not a text file"}.get(kind, "no analysis")
    (path := tmp_path / "x.lst").write_bytes(content)
    for result in (musat("audit", path), musat("audit", MODIFIED, "--against", path)):
        assert result.exit_code == 2 and message in result.stderr and result.exception.__class__ is SystemExit


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_not_taken_for_an_inconsistent_listing():
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "musatpy", "audit", str(MODIFIED)]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
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
    assert f"{path}:1: a row of {len(row.expandtabs())} characters: no listing has any" in result.stdout
