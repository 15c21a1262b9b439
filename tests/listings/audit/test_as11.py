"""Listings of compilations: their analysis is audited as that of control is."""

from __future__ import annotations

from pathlib import Path

from click.testing import CliRunner, Result

from musatpy.cli.main import main as musat
from stage_readings import DECK

LISTING = DECK.with_suffix(".lst")


def audited(path: Path) -> Result:
    return CliRunner().invoke(musat, ["audit", str(path)])


def test_the_listing_of_a_compilation_is_consistent_and_a_wrong_mean_is_not(tmp_path: Path) -> None:
    result = audited(LISTING)
    assert result.exit_code == 0 and "1 analysis" in result.output and "Repairs" not in result.output
    text = LISTING.read_text()
    (row,) = [line for line in text.splitlines() if line.startswith("Mean Value of Differences")]
    changed = tmp_path / "changed.lst"
    changed.write_text(text.replace(row, row.replace("-.0300", "-.0330")))
    assert audited(changed).exit_code == 1
