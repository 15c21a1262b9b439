"""Messages with their cards, limits of inputs, and draws of chance."""

import math
import shutil
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from scipy.stats import kstest

from cli.commands import musat
from musatpy.draws import Draws
from musatpy.errors import NumericalError, Problem, numerics, of_each_kind, printable
from musatpy.interchange import xyz
from musatpy.model import Cause, CauseKind
from musatpy.pointfiles.columns import number
from musatpy.runs import ExitStatus, run_deck
from musatpy.specs import Reader, key, read_toml

ROOT = Path(__file__).parents[1]


def test_a_card_is_shown_with_ruler_and_carets():
    lines = Problem(message="wrong", file="a.crd", line=3, columns=(5, 7), text="TTL abc").render().splitlines()
    ruler = "    " + "".join(f"----+----{i}" for i in range(1, 9))
    assert lines == ["a.crd:3 cols 5-7: wrong", ruler, "    TTL abc", "        ^^^"]
    text = "X" * 5000  # a file without line ends is not shown whole
    lines = Problem(message="too long", columns=(81, 5000), text=text).render().splitlines()
    assert lines[2:] == ["    " + "X" * 120 + "...", "    " + " " * 80 + "^" * 40]
    assert len(Problem(message="far out", columns=(300, 310), text=text).render().splitlines()) == 3


@pytest.mark.slow
def test_what_is_quoted_is_cut_and_so_is_a_message_without_end():
    long, names = "x" * 90, ", ".join(map(str, range(1_000_000)))
    assert Problem(found=long, expected="F10.3").headline() == f"'{'x' * 80}...' is not F10.3"
    assert Problem(message=f"no column '{long}' beside 'y'").headline() == f"no column '{'x' * 80}...' beside 'y'"
    assert len(Problem(message=f"no column x among {names}", text=names).render()) < 3000
    plain = f"the deck's lines, {'of which there are many, ' * 5}are not 'TTL'"
    assert Problem(message=plain).headline() == plain


def test_the_size_of_a_cause_that_is_not_known_is_not_told():
    cause = Cause(kind=CauseKind.AIR_BASE, cards=("ABL",), photos=("1", "2"), unit="m", advice="read it again")
    unknown = str(replace(cause, size=(math.nan,)))
    assert "off by" not in unknown and "nan" not in unknown
    assert ", off by 1.250 m: read" in str(replace(cause, size=(1.25, math.nan)))


def test_control_characters_are_escaped_and_keep_their_columns_in_a_card():
    problem = Problem(message="wrong \x1b[2J", file="a", columns=(2, 2), text="A\x9bB")
    assert printable(problem.render()).splitlines()[::2] == [r"a col 2: wrong \x1b[2J", "    A?B"]
    assert printable("a\tb\nc\xe9 \x7f\x85\u202e\udc80") == "a\tb\nc\xe9 " + r"\x7f\x85\u202e\udc80"


def test_of_a_kind_a_hundred_are_printed_and_the_others_counted():
    """Names and numbers make no kind, fields do; a message of a million letters took the square of that."""
    problem = Problem(card="PLT", severity="warning")
    far = [replace(problem, message=f"point {name} is {n} m off") for n, name in enumerate("ab" * 75)]
    other = replace(problem, message="no sigma")
    shown = [one.headline() for one in of_each_kind([*far[:149], other, far[149]])]
    assert shown[:100] == [one.headline() for one in far[:100]]
    assert shown[100:] == [other.headline(), "PLT: warning: ... and 50 more of this kind"]
    unread = [
        replace(problem, field=field, found="x", expected="F10.3") for field in ("x", "y") for _ in range(100)
    ]
    unread.append(Problem(message=f"{'x' * 1_000_000} is no number"))
    assert list(of_each_kind(unread)) == unread


def test_of_a_kind_three_lines_are_printed_and_the_others_named():
    bad = [
        Problem(file="a.crd", line=line, card="PLT", field="x", found="z", expected="F12.7") for line in range(9)
    ]
    *shown, more = [one.headline() for one in of_each_kind(bad[:5] + bad[6:])]
    assert shown == [one.headline() for one in bad[:3]]
    assert more == "a.crd PLT.x: ... and 5 more of this kind, on lines 3-4, 6-8"
    *_, more = [one.headline() for one in of_each_kind(replace(bad[0], line=2 * n) for n in range(100))]
    first = ", ".join(str(2 * n) for n in range(3, 23))
    assert more.endswith(f"97 more of this kind, on lines {first}, ..., 198")


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
    assert any("worst at the start of the run: point 104 on photo 23" in message for message in messages)
    assert not any("SVD" in message for message in messages)


DEEP = "[" * 100_000


@dataclass(frozen=True)
class Spec:
    length: float = key(1.0)


@pytest.mark.parametrize(
    ("text", "value"),
    [("1e308", math.inf), ("-1e16", -math.inf), ("1e-320", 0.0), ("1e15", 1e15), ("-2.5", -2.5), ("1e-12", 1e-12)],
)
def test_numbers_of_files_are_within_reach(text: str, value: float) -> None:
    assert number(text) == value


@pytest.mark.parametrize("value", [10**400, 1e16, -1e308])
def test_numbers_of_specs_are_within_reach(value: float) -> None:
    reader = Reader("s.toml")
    assert reader.table(Spec, {"length": value}, "") is None
    (problem,) = reader.problems
    assert "is beyond 1e+15" in str(problem) and len(str(problem)) < 80


@pytest.mark.parametrize("text", [f"a = {DEEP}", "a = " + "1" * 5000, "a = "])
def test_toml_that_cannot_be_read_is_a_value_error(tmp_path: Path, text: str) -> None:
    (path := tmp_path / "a.toml").write_text(text)
    with pytest.raises(ValueError, match=r"nested too deep|Exceeds the limit|Invalid value"):
        read_toml(path)


@pytest.mark.parametrize(
    "command",
    [
        "simulate {}", "waves {}", "batch {}", "diff --rules {} {lst} {lst}", "check --formats {folder} {crd}",
        "convert --formats {folder} {crd} x",
    ],
)  # fmt: skip
def test_deep_nesting_is_a_problem_of_the_file(tmp_path: Path, command: str) -> None:
    (path := tmp_path / "deep.toml").write_text(f"a = {DEEP}")
    thomas = ROOT / "fixtures/st_thomas/st_thomas"
    words = command.format(path, lst=f"{thomas}.lst", crd=f"{thomas}.crd", folder=tmp_path).split()
    ran = musat(*words)
    assert ran.exit_code in (1, 2) and "nested too deep" in ran.stderr and "unexpected" not in ran.stderr


@pytest.mark.parametrize("text", ["a.b." * 10_000 + "c = 1", "b = 1.5\n[" + "'a' . " * 20_000 + "c]"])
def test_a_key_of_many_parts_is_refused_before_it_is_taken_apart(tmp_path: Path, text: str) -> None:
    """Its parser keeps all beginnings of a key: those of 20,000 parts take 1.6 GB."""
    (path := tmp_path / "a.toml").write_text(text)
    line = text.count("\n") + 1
    with pytest.raises(ValueError, match=rf"nested too deep: a key of more than 100 parts \(at line {line}\)"):
        read_toml(path)
    path.write_text("a" + ".a" * 99 + " = [" + "1.5, 2.5, " * 500 + "]")
    assert read_toml(path)["a"]["a"]


def test_a_head_of_brackets_takes_no_time(tmp_path: Path) -> None:
    (path := tmp_path / "a.csv").write_text("x,y,z," + "[" * 200_000 + "\n1,2,3,4\n")
    start = time.process_time()
    assert len(xyz.read(path).xyz) == 1
    assert time.process_time() - start < 2.0  # half an hour where all are tried against all
    path.write_text("x,y,z,depth [m]\n1,2,3,4\n")
    assert xyz.read(path).columns["depth"].unit == "m"


def test_a_field_of_any_size_is_a_problem_of_its_line(tmp_path: Path) -> None:
    points = tmp_path / "points.csv"
    points.write_text("id,x,y,z\nA,1,2," + "9" * 200_000 + "\n")
    ran = musat("sea", "fit", points, "--sigma", "1,1,1")
    assert ran.exit_code == 1 and f"{points}:2" in ran.stderr


def test_streams_are_fixed():
    """The odd multiples of 2^-53 that PCG64 seeded with (1, crc32 of the name) gives: a change breaks old decks."""
    ticks = Draws(1).uniform("noise", 3) * 2.0**53
    assert [int(tick) for tick in ticks] == [523372235525975, 1260930369451103, 75577409678649]
    assert all(tick == int(tick) and int(tick) % 2 for tick in ticks)


def test_streams_go_on_and_do_not_depend_on_each_other():
    together, apart = Draws(3), Draws(3)
    apart.uniform("other", 5)
    first = [*apart.uniform("noise", 2), *apart.uniform("noise", 2)]
    np.testing.assert_array_equal(together.uniform("noise", 4), first)
    assert together.uniform("other", 1) != together.uniform("another", 1)


def test_normal_deviates_are_normal():
    assert kstest(Draws(2).normal("noise", 20000), "norm").pvalue > 0.01  # a fixed sample: it passes or never does


def test_draws_have_their_shapes():
    rows = Draws(4).pick("rows", 50, 20)
    assert len(set(rows.tolist())) == 20 and np.all(np.diff(rows) > 0) and rows.max() < 50
    for shape in ((0,), (2, 3)):
        signs = Draws(5).signs("signs", *shape)
        assert signs.shape == shape and np.all(np.abs(signs) == 1.0)
