"""A result never goes into a file that is read, and links that lead in a circle are a message like any other."""

from __future__ import annotations

import re

import click
import pytest

from cli.commands import musat
from musatpy.cli.options import refuse_overwriting

COMMANDS = [
    ["simulate", "circle.toml"],
    ["waves", "circle.toml"],
    ["convert", "circle.crd", "out.giant", "--to", "giant"],
    ["extract", "circle.crd", "--photos", "1", "-o", "out.crd"],
    ["merge", "circle.crd", "circle.crd", "-o", "out.crd"],
    ["list", "circle.crd"],
    ["depth", "correct", "circle.csv", "-o", "out.csv", "--cameras", "circle.csv", "--angle", "30"],
    ["sea", "fit", "circle.csv"],
    ["diff", "circle.lst", "circle.lst"],
    ["audit", "circle.lst"],
]


@pytest.mark.parametrize("arguments", COMMANDS, ids=lambda arguments: " ".join(arguments[:2]))
def test_links_that_lead_in_a_circle_are_told(tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    for ending in ("toml", "crd", "csv", "lst"):
        (tmp_path / f"circle.{ending}").symlink_to(f"circle.{ending}")
    ran = musat(*arguments)
    assert ran.exit_code in (1, 2) and "unexpected" not in ran.stderr
    assert re.search("Too many levels of symbolic links|'circle.crd' does not exist", ran.stderr)


def test_a_result_behind_a_link_is_refused(tmp_path):
    (tmp_path / "in.csv").write_text("x")
    (tmp_path / "link.csv").symlink_to("in.csv")
    refuse_overwriting([tmp_path / "out.csv"], [tmp_path / "in.csv"])
    with pytest.raises(click.UsageError, match=r"the result would overwrite .*link\.csv, which is read"):
        refuse_overwriting([tmp_path / "link.csv"], [tmp_path / "in.csv"])
