"""How a problem is shown."""

import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

from musatpy.errors import NumericalError, Problem, numerics, of_each_kind, printable
from musatpy.model import Cause, CauseKind
from musatpy.runs import ExitStatus, run_deck

ROOT = Path(__file__).parents[1]


def test_a_card_is_shown_with_ruler_and_carets():
    lines = Problem(message="wrong", file="a.crd", line=3, columns=(5, 7), text="TTL abc").render().splitlines()
    assert lines[0] == "a.crd:3 cols 5-7: wrong"
    assert lines[1] == "    " + "".join(f"----+----{i}" for i in range(1, 9))
    assert lines[2:] == ["    TTL abc", "        ^^^"]


def test_a_file_without_line_ends_is_not_shown_whole():
    text = "X" * 5000
    lines = Problem(message="too long", columns=(81, 5000), text=text).render().splitlines()
    assert lines[2] == "    " + "X" * 120 + "..."
    assert lines[3] == "    " + " " * 80 + "^" * 40
    assert len(Problem(message="far out", columns=(300, 310), text=text).render().splitlines()) == 3


def test_what_is_quoted_is_cut_and_so_is_a_message_without_end():
    long, names = "x" * 90, ", ".join(map(str, range(1_000_000)))
    assert Problem(found=long, expected="F10.3").headline() == f"'{'x' * 80}...' is not F10.3"
    assert Problem(message=f"no column '{long}' beside 'y'").headline() == f"no column '{'x' * 80}...' beside 'y'"
    assert len(Problem(message=f"no column x among {names}", text=names).render()) < 3000
    plain = f"the deck's lines, {'of which there are many, ' * 5}are not 'TTL'"
    assert Problem(message=plain).headline() == plain


def test_the_size_of_a_cause_that_is_not_known_is_not_told():
    cause = Cause(kind=CauseKind.AIR_BASE, cards=("ABL",), photos=("1", "2"), unit="m", advice="read it again")
    assert "off by" not in str(replace(cause, size=(math.nan,))) and "nan" not in str(
        replace(cause, size=(math.nan,))
    )
    assert ", off by 1.250 m: read" in str(replace(cause, size=(1.25, math.nan)))


def test_control_characters_are_escaped_and_keep_their_columns_in_a_card():
    problem = Problem(message="wrong \x1b[2J", file="a", columns=(2, 2), text="A\x9bB")
    assert printable(problem.render()).splitlines()[::2] == [r"a col 2: wrong \x1b[2J", "    A?B"]
    assert printable("a\tb\nc\xe9 \x7f\x85\u202e\udc80") == "a\tb\nc\xe9 " + r"\x7f\x85\u202e\udc80"


def test_of_a_kind_a_hundred_are_printed_and_the_others_counted():
    far = [
        Problem(message=f"point {name} is {n} m off", card="PLT", severity="warning")
        for n, name in enumerate("ab" * 75)
    ]
    other = Problem(message="no sigma", card="PLT", severity="warning")
    shown = [one.headline() for one in of_each_kind([*far[:149], other, far[149]])]
    assert shown[:100] == [one.headline() for one in far[:100]]
    assert shown[100:] == [other.headline(), "PLT: warning: ... and 50 more of this kind"]


def test_problems_of_other_fields_are_of_another_kind():
    unread = [
        Problem(card="PLT", field=field, found="x", expected="F10.3") for field in ("x", "y") for _ in range(100)
    ]
    assert list(of_each_kind(unread)) == unread


@pytest.mark.parametrize(
    "failure",
    [
        lambda: np.linalg.inv(np.zeros((2, 2))),
        lambda: scipy.linalg.cho_factor(np.full((2, 2), np.nan)),
        lambda: math.exp(1e9),
    ],
)
def test_what_linear_algebra_refuses_has_a_name(failure):
    with pytest.raises(NumericalError) as caught, numerics("the adjustment"):
        failure()
    assert str(caught.value).startswith("the adjustment cannot be computed: points or stations have run away")


def test_a_mistake_of_the_program_is_not_called_numerical():
    with pytest.raises(ValueError, match="broadcast"), numerics("the adjustment"):
        np.zeros(2) + np.zeros(3)


def test_a_run_that_linear_algebra_refuses_names_photos_and_points(tmp_path, monkeypatch):
    def refuse(*_):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr("musatpy.adjustment.musat2a.adjust", refuse)
    deck = Path(shutil.copy(ROOT / "fixtures/verdict/edit_point_206_420m.crd", tmp_path / "job.crd"))
    deck.write_bytes(deck.read_bytes().replace(b"EDIT", b"    "))
    result = run_deck(deck)
    assert result.status == ExitStatus.UNUSABLE
    messages = [problem.headline() for problem in result.problems]
    assert messages[0].startswith("the adjustment cannot be computed")
    assert any("most at odds: point 104 on photo 23" in message for message in messages)
    assert not any("SVD" in message for message in messages)


def test_kinds_of_long_messages_are_told_apart_at_once() -> None:
    """A message of a million letters: its kind took the square of that."""
    far = Problem(message=f"{'x' * 1_000_000} is no number")
    assert list(of_each_kind([far])) == [far]
