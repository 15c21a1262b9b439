"""Listings of compilations and of soundings: their samples are audited as those of the standard reports are."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from musatpy.cli.main import main as musat
from stage_readings import DECK, FIXTURES, SOUNDINGS

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


@pytest.mark.slow
def test_the_samples_of_soundings_are_audited_row_by_row(tmp_path: Path) -> None:
    runner = CliRunner()
    run = str(FIXTURES / "st_thomas/st_thomas.crd")
    assert runner.invoke(musat, ["run", "-q", run, "-o", str(tmp_path)]).exit_code == 0
    words = ["as11", "compare-soundings", str(tmp_path / "st_thomas.json"), str(DECK), str(SOUNDINGS)]
    assert runner.invoke(musat, [*words, "-o", str(tmp_path)]).exit_code == 0
    listing = tmp_path / "soundings.soundings.lst"
    assert audited(listing).exit_code == 0
    text = listing.read_text()
    (row,) = [line for line in text.splitlines() if line.startswith("5 to 10 m")]
    cells = row.split()
    listing.write_text(text.replace(row, row.replace(cells[5], f"{float(cells[5]) + 1.0:.3f}", 1)))
    result = audited(listing)
    assert result.exit_code == 1 and "soundings analysis: 5 to 10 m: sum and mean" in result.output
