"""`musat diff`: what it prints, its files, its exit statuses."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import pytest

from cli.commands import musat

diff = partial(musat, "diff")

GOLDEN = Path(__file__).parents[2] / "fixtures" / "st_thomas" / "st_thomas.lst"
TEXT = GOLDEN.read_text(encoding="utf-8")


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
    assert ran.exit_code == 0
    assert ran.stdout.splitlines()[-1].startswith("same: ")
    assert diff("-q", "a.lst", GOLDEN).stdout == ""


def test_differences_are_printed_and_end_with_1(files):
    ran = diff("a.lst", "b.lst")
    assert ran.exit_code == 1
    lines = ran.stdout.splitlines()
    assert lines[:2] == ["A  a.lst", "B  b.lst"]
    row = next(line for line in lines if line.startswith("  203 "))
    assert row.split()[:8] == ["203", "Elevation", "-5.134", "-5.136", "-0.002", "m", "-2", "exact"]
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


def test_junit_has_a_test_for_each_section(files):
    ran = diff("a.lst", "b.lst", "--junit", "out/diff.xml", "-q")
    assert ran.exit_code == 1
    suite = ElementTree.parse("out/diff.xml").getroot()
    tests = {test.get("name"): test for test in suite}
    assert suite.get("tests") == str(len(tests)) and suite.get("failures") == "2"
    failure = tests["Adjusted Ground Points"].find("failure")
    assert "203, Elevation: A -5.134, B -5.136, difference -0.002 m [exact]" in failure.text
    assert tests["Solution Summary"].find("failure") is None


def test_junit_holds_any_text(files):
    Path("x.lst").write_text("a \x01\x02 1.5 <&>\n", encoding="utf-8")
    Path("y.lst").write_text("a \x01\x02 1.6 <&>\n", encoding="utf-8")
    assert diff("x.lst", "y.lst", "--junit", "d.xml").exit_code == 1
    assert ElementTree.parse("d.xml").getroot().get("failures") == "1"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("a.lst", "missing.lst"), "missing.lst: No such file"),
        (("a.lst", "."), "Is a directory"),
        (("a.lst", "empty.lst"), "empty.lst: is empty"),
        (("binary.lst", "a.lst"), "binary.lst: is not a text file"),
        (("bad.json", "bad.json"), "bad.json:1: is not JSON"),
        (("a.lst", "list.json"), "list.json: is no record"),
        (("a.lst", "b.lst", "--rules", "bad.toml"), "bad.toml:2 rule 1.absolut: is not a key of a rule"),
        (("a.lst", "b.lst", "--rules", "missing.toml"), "missing.toml: No such file"),
    ],
)
def test_what_cannot_be_compared_ends_with_2(files, arguments, message):
    Path("empty.lst").write_text("")
    Path("binary.lst").write_bytes(b"PK\0\1")
    Path("bad.json").write_text("{")
    Path("list.json").write_text("[1]")
    Path("bad.toml").write_text("[[rule]]\nabsolut = 1\nskip = true\n")
    ran = diff(*arguments, "--junit", "d.xml")
    assert (ran.exit_code, ran.stdout) == (2, "")
    assert message in ran.stderr
    assert "Traceback" not in ran.stderr
    suite = ElementTree.parse("d.xml").getroot()
    assert suite.get("errors") == "1" and message in suite.find("testcase/error").text


def test_junit_that_cannot_be_written_ends_with_2(files):
    ran = diff("a.lst", "b.lst", "--junit", "a.lst/d.xml")
    assert ran.exit_code == 2 and "Traceback" not in ran.stderr


def test_an_error_of_the_program_is_no_difference(files, monkeypatch):
    def fail(*arguments):
        raise ZeroDivisionError("no")

    monkeypatch.setattr("musatpy.listings.compare_bytes", fail)
    assert diff("a.lst", "b.lst").exit_code == 2
