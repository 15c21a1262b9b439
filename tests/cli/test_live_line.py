"""The line on the terminal that says where a run is: what it shows, that it goes on, and that nothing stays."""

import re
import threading
from collections.abc import Iterator
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
    outer_pass=1,
    number=3,
    rotation=1e-4,
    rotation_photo=0,
    translation=12.5,
    translation_photo=0,
    sum_of_squares=1.0,
    damping=0.0,
)


class Clock:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class Phases:
    """A watcher that remembers."""

    def __init__(self) -> None:
        self.seen: list[str] = []

    def __call__(self, iteration: Iteration) -> None:
        self.seen.append("iteration")

    def phase(self, phase: Phase) -> None:
        self.seen.append(phase.name)


@pytest.fixture
def still(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A thread that keeps no time: the test says when the line is drawn."""
    monkeypatch.setattr(progress, "_REDRAWN", 1e6)
    monkeypatch.setenv("COLUMNS", "120")
    yield


def last(shown: str) -> str:
    return shown.split("\r")[-1].rstrip()


def test_it_waits_until_a_run_is_long_and_leaves_nothing(capsys: pytest.CaptureFixture[str], still: None) -> None:
    clock = Clock()
    with LiveLine("job.crd", clock) as line:
        line(STEP)
        clock.now += 0.4
        line.draw()
    assert capsys.readouterr().err == ""
    with LiveLine("job.crd", clock) as line:
        line.read(read_deck(DECK))
        clock.now += 5.0
        line(STEP)
        shown = capsys.readouterr().err
        assert shown == (
            "\rjob.crd: pass 1, iteration 3 of 20, largest movement 20.626 arc seconds, 12.5000 m "
            "(limits 0.1, 0.001), 0:05"
        )
    assert capsys.readouterr().err == "\r" + " " * (len(shown) - 1) + "\r"


def test_the_time_goes_on_whatever_the_run_does(capsys: pytest.CaptureFixture[str], still: None) -> None:
    clock = Clock()
    with LiveLine("job.crd", clock) as line:
        clock.now += 2.0
        line.phase(Phase(name="covariances"))
        clock.now += 65.0
        line.draw()
        assert last(capsys.readouterr().err) == "job.crd: covariances, 1:07"
        line.phase(Phase(name="listing: report", number=3, total=17))
        assert last(capsys.readouterr().err) == ""  # it is fresh
        clock.now += 0.2
        line.phase(Phase(name="listing: report", number=4, total=17))
        assert last(capsys.readouterr().err) == "job.crd: listing: report 4 of 17, 1:07"


def test_it_is_no_longer_than_the_terminal_is_wide(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, still: None
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    clock = Clock()
    with LiveLine("a/folder/with/a/long/name/job.crd", clock) as line:
        clock.now += 2.0
        line(STEP)
        shown = capsys.readouterr().err
        assert shown.startswith("\r...e/job.crd: pass 1, ") and shown.endswith(", 0:02")
        assert len(shown) == 40  # the return, and 39 characters


def test_a_thread_redraws_it_while_nothing_is_told(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "_REDRAWN", 0.001)
    drawn = threading.Event()
    clock = Clock()

    class Told(LiveLine):
        def draw(self) -> None:
            super().draw()
            if self._width:
                drawn.set()

    with Told("job.crd", clock):
        clock.now += 2.0
        assert drawn.wait(timeout=30.0)
    assert "\rjob.crd: reading, 0:02" in capsys.readouterr().err


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError])
def test_no_thread_is_left_behind(
    capsys: pytest.CaptureFixture[str], still: None, error: type[BaseException]
) -> None:
    before, clock = threading.active_count(), Clock()
    with pytest.raises(error), LiveLine("job.crd", clock) as line:
        clock.now += 2.0
        line.draw()
        raise error
    assert threading.active_count() == before
    assert capsys.readouterr().err.endswith(" \r")


def test_a_terminal_that_goes_away_ends_no_run(monkeypatch: pytest.MonkeyPatch, still: None) -> None:
    def gone(*_: object, **__: object) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(progress.click, "echo", gone)
    clock = Clock()
    with LiveLine("job.crd", clock) as line:
        clock.now += 2.0
        line.draw()
        clock.now += 2.0
        line.draw()


def test_a_run_tells_its_phases(tmp_path: Path) -> None:
    watcher = Phases()
    run_deck(DECK, tmp_path, progress=watcher)
    names = list(dict.fromkeys(re.sub(r"\d+", "n", name) for name in watcher.seen))
    assert names == [
        "reading",
        "first values",
        "first triangulation",
        "pass n, iteration",
        "iteration",
        "covariances",
        "statistics",
        "listing: report",
        "record",
    ]


@pytest.mark.slow
def test_a_search_tells_its_phases(tmp_path: Path) -> None:
    deck = tmp_path / "bad.crd"
    text = DECK.read_text()
    deck.write_text(text.replace("CTG 101     F    18 21  0.51663", "CTG 101     F    18 21  3.51663"))
    watcher = Phases()
    result = run_deck(deck, tmp_path, progress=watcher)
    assert result.solution is not None and result.solution.causes
    names = dict.fromkeys(watcher.seen)
    assert "search for blunders: round of snooping" in names
    assert "search for blunders: hypothesis" in names
    assert "search for causes: what competes" in names


def test_a_callback_of_iterations_alone_is_told_of_these(tmp_path: Path) -> None:
    seen: list[Iteration] = []
    result = run_deck(DECK, tmp_path, progress=seen.append)
    assert result.solution is not None
    assert seen == list(result.solution.iterations)
