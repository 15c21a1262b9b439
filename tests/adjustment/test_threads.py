"""Pieces of work on threads."""

import multiprocessing
import os
import threading
import time

import pytest

from musatpy.adjustment import kernels
from musatpy.adjustment.kernels import side_by_side

MANY = 10**6  # rays


@pytest.fixture(autouse=True)
def cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 3)


def test_results_come_in_the_order_of_the_pieces() -> None:
    def work(piece: int) -> int:
        time.sleep(0.001 * (piece % 3))
        return -piece

    assert list(side_by_side(work, range(20), MANY)) == [-piece for piece in range(20)]


def test_threads_are_those_of_the_call_before_and_little_work_takes_none() -> None:
    def names(rays: int) -> set[str]:
        return set(side_by_side(lambda _: threading.current_thread().name, range(40), rays))

    assert names(kernels._FEWEST - 1) == {threading.current_thread().name}
    assert len(names(MANY) | names(MANY)) <= 3


def test_a_piece_may_share_its_work_which_its_own_thread_does() -> None:
    def work(piece: int) -> set[str]:
        return {threading.current_thread().name, *side_by_side(inner, range(4), MANY)}

    def inner(_: int) -> str:
        return threading.current_thread().name

    assert all(len(names) == 1 for names in side_by_side(work, range(12), MANY))


def test_what_a_piece_raises_is_raised_when_nothing_runs_any_more() -> None:
    running: set[int] = set()

    def work(piece: int) -> None:
        if piece == 1:
            raise ValueError(piece)
        running.add(piece)
        time.sleep(0.02)
        running.remove(piece)

    with pytest.raises(ValueError, match="1"):
        list(side_by_side(work, range(20), MANY))
    assert not running


def test_few_pieces_are_worked_at_ahead() -> None:
    begun: list[int] = []
    results = iter(side_by_side(begun.append, range(30), MANY))
    for _ in range(2):
        next(results)
    time.sleep(0.05)
    assert len(begun) <= 7


def _sum() -> int:
    return sum(side_by_side(abs, range(10), MANY))


@pytest.mark.filterwarnings("ignore:.*multi-threaded:DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own() -> None:
    assert _sum() == 45
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply_async(_sum).get(timeout=20) == 45
