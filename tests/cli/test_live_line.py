"""The line on the terminal that says where a run is: what it shows, that it goes on, and that nothing stays."""

import re
import threading
from pathlib import Path

import pytest

from musatpy import read_deck
from musatpy.cli import progress
from musatpy.cli.progress import LiveLine
from musatpy.model import Iteration
from musatpy.model.progress import Phase
from musatpy.runs import run_deck

DECK = Path(__file__).parents[2] / "fixtures" / "st_thomas" / "st_thomas.crd"
STEP = Iteration(
    outer_pass=1, number=3, rotation=1e-4, rotation_photo=0, translation=12.5, translation_photo=0,
    sum_of_squares=1.0, damping=0.0,
)  # fmt: skip


class Clock:
    """A clock that a test sets."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


class Phases(list[str]):
    """A watcher that remembers the names of phases."""

    def __call__(self, iteration: Iteration) -> None:
        self.append("iteration")

    def phase(self, phase: Phase) -> None:
        self.append(phase.name)


@pytest.fixture
def line(monkeypatch):
    """Return a line with a clock of its own, which a thread does not draw: the test says when."""
    monkeypatch.setattr(progress, "_REDRAWN", 1e6)
    monkeypatch.setenv("COLUMNS", "120")
    return LiveLine("a/folder/with/a/long/name/job.crd", Clock())


def last(capsys) -> str:
    return capsys.readouterr().err.split("\r")[-1].rstrip().rpartition("/")[2]


def test_it_waits_until_a_run_is_long_goes_on_with_the_time_and_leaves_nothing(capsys, line):
    with line:
        line(STEP)
        line._clock.now += 0.4
        line.draw()
        assert capsys.readouterr().err == ""
        line.read(read_deck(DECK))
        line._clock.now += 4.6
        line(STEP)
        movement = "largest movement 20.626 arc seconds (limit 0.1), 12.5000 m (limit 0.001)"
        assert last(capsys) == f"job.crd: pass 1, iteration 3 of 20, {movement}, 0:05"
        line._clock.now += 62.0
        line.draw()
        assert last(capsys).endswith(", 1:07")
        line.phase(Phase(name="listing: report", number=3, total=17))
        assert last(capsys) == ""  # it is fresh
        line._clock.now += 0.2
        line.phase(Phase(name="listing: report", number=4, total=17))
        assert last(capsys) == "job.crd: listing: report 4 of 17, 1:07"
    assert re.fullmatch(r"\r +\r", capsys.readouterr().err)


def test_it_is_no_longer_than_the_terminal_is_wide(capsys, monkeypatch, line):
    monkeypatch.setenv("COLUMNS", "40")
    with line:
        line._clock.now += 2.0
        line(STEP)
        shown = capsys.readouterr().err
        assert shown.startswith("\r...e/job.crd: pass 1, ") and shown.endswith(", 0:02")
        assert len(shown) == 40  # the return, and 39 characters


def test_a_thread_redraws_it_while_nothing_is_told(capsys, monkeypatch):
    monkeypatch.setattr(progress, "_REDRAWN", 0.001)
    drawn, clock = threading.Event(), Clock()
    monkeypatch.setattr(progress.click, "echo", lambda text, **_: (print(text), drawn.set()))
    with LiveLine("job.crd", clock):
        clock.now += 2.0
        assert drawn.wait(timeout=30.0)
    assert "\rjob.crd: reading, 0:02" in capsys.readouterr().out


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError])
def test_no_thread_is_left_behind_where_a_run_fails_or_the_terminal_goes_away(monkeypatch, line, error):
    def gone(*_: object, **__: object) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(progress.click, "echo", gone)
    before = threading.active_count()
    with pytest.raises(error, match="of the run"), line:
        for _ in range(2):
            line._clock.now += 2.0
            line.draw()
        raise error("of the run")
    assert threading.active_count() == before


def test_a_run_tells_its_phases_or_its_iterations_alone(tmp_path):
    watcher, iterations = Phases(), []
    run_deck(DECK, tmp_path, progress=watcher)
    assert list(dict.fromkeys(re.sub(r"\d+", "n", name) for name in watcher)) == [
        "reading", "first values", "first triangulation", "pass n, iteration", "iteration", "covariances",
        "statistics", "listing: report", "record",
    ]  # fmt: skip
    result = run_deck(DECK, tmp_path, progress=iterations.append)
    assert result.solution is not None and iterations == list(result.solution.iterations)


@pytest.mark.slow
def test_a_search_tells_its_phases(tmp_path):
    deck, watcher = tmp_path / "bad.crd", Phases()
    text = DECK.read_text()
    deck.write_text(text.replace("CTG 101     F    18 21  0.51663", "CTG 101     F    18 21  3.51663"))
    result = run_deck(deck, tmp_path, progress=watcher)
    assert result.solution is not None and result.solution.causes
    search = ("blunders: round of snooping", "blunders: hypothesis", "causes: what competes")
    assert {f"search for {phase}" for phase in search} <= {*watcher}
