"""The search for causes is bound by counted work: it never keeps a result back, and says where it stopped."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from altered import added, altered
from blocks import FIXTURES
from drivers.causes_study import strip
from musatpy import adjust
from musatpy.blunders.causes import first_look
from musatpy.cli.main import main
from musatpy.model import CauseKind, CauseSearch

FINDS = FIXTURES / "verdict"


def test_no_causes_are_looked_for_where_none_are_asked_for(tmp_path: Path) -> None:
    deck = tmp_path / "job.crd"
    deck.write_bytes((FINDS / "control_in_feet.crd").read_bytes())
    result = CliRunner().invoke(main, ["run", "--causes", "none", str(deck)])
    assert "possible cause" not in result.stderr
    assert "Likely Causes" not in deck.with_suffix(".lst").read_text()


@pytest.mark.slow
def test_a_search_without_effort_names_what_the_linear_model_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """And how far the focal length is off, to 1 %: the observed stations hold it."""
    monkeypatch.setattr("musatpy.blunders.search.LEAST", 0.0)
    monkeypatch.setattr("musatpy.blunders.search._AROUND", -1000)
    block = strip(10, observed=True)
    solution = adjust(altered(block, cameras={"focal_length": lambda f: 1.02 * f}))
    assert any(text.startswith("search stopped") for text in solution.warnings)
    cause = solution.causes[0]
    assert cause.kind is CauseKind.FOCAL_LENGTH
    assert cause.size[0] == pytest.approx(0.02 * block.cameras.focal_length[0], rel=0.02)
    assert first_look(solution, None) == solution.causes


@pytest.mark.slow
def test_all_looks_farther_and_says_nothing_of_it_where_the_end_is_reached() -> None:
    block = strip(6)
    wrong = altered(block, control={"position": added(0, [0.0, 0.0, 10.0])})
    usual, every = (adjust(wrong, causes=causes) for causes in (CauseSearch.USUAL, CauseSearch.ALL))
    assert usual.causes == every.causes
    assert not any(text.startswith("search stopped") for text in (*usual.warnings, *every.warnings))
