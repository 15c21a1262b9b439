"""Keypunch slips: one digit of a deck is another one. What becomes of the run, and of its points.

`python -m drivers.slips [COUNT] [SEED]` prints the table of both decks.
"""

import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from musatpy import adjust
from musatpy.errors import ProblemsError
from musatpy.formats.musat import check_deck
from musatpy.model import Block, Cause, Grade, Solution
from musatpy.statistics import Statistics, metric_differences

FIXTURES = Path(__file__).parents[2] / "fixtures"
DECKS = {"st_thomas": FIXTURES / "st_thomas/st_thomas.crd", "cayman": FIXTURES / "cayman/cayman_clean.crd"}
_DATA = (b"CAM", b"WTR", b"STA", b"STX", b"ATT", b"TID", b"PLT", b"CTG", b"CTX", b"EQL")
_COLUMNS = range(4, 72)
FAR = 5.0  # sigmas
THREE = 3  # causes that a reader looks at
UNUSABLE = "unusable"  # the check, or the adjustment, says so


@dataclass(frozen=True, kw_only=True)
class Slip:
    """A slip, and what became of the run."""

    line: int  # from 1
    column: int
    card: str  # as it should be
    wrong: str  # as it was punched
    grade: str  # or UNUSABLE
    sigma0: float = np.nan
    beyond: bool = False  # sigma0 is above its 95 % limit
    moved: dict[str, float] = field(default_factory=dict)  # points beyond FAR sigmas, well checked
    farthest: float = 0.0  # m
    reasons: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    causes: tuple[Cause, ...] = ()

    @property
    def named(self) -> bool:
        """True where the wrong card is among the first causes."""
        return any(_blames(cause, self.card, self.wrong) for cause in self.causes[:THREE])

    @property
    def quiet(self) -> bool:
        """True where nothing is said of it."""
        return self.grade == Grade.ACCEPTED


def slips(deck: Path, count: int, seed: int) -> list[Slip]:
    """Return the runs of `count` decks with one wrong digit each."""
    lines = deck.read_bytes().split(b"\n")
    clean = adjust(_block(b"\n".join(lines)))
    rng = np.random.default_rng(seed)
    places = [
        (n, column)
        for n, line in enumerate(lines)
        if line[:3] in _DATA
        for column in _COLUMNS
        if line[column : column + 1].isdigit()
    ]
    return [_slip(lines, clean, *places[k], rng) for k in rng.choice(len(places), count, replace=False)]


def _slip(lines: list[bytes], clean: Solution, n: int, column: int, rng: np.random.Generator) -> Slip:
    digit = int(lines[n][column : column + 1])
    other = (digit + int(rng.integers(1, 10))) % 10
    wrong = lines[n][:column] + str(other).encode() + lines[n][column + 1 :]
    what = {"line": n + 1, "column": column + 1, "card": lines[n].decode(), "wrong": wrong.decode()}
    try:
        block = _block(b"\n".join([*lines[:n], wrong, *lines[n + 1 :]]))
        statistics = Statistics(adjust(block))
    except ProblemsError:
        return Slip(grade=UNUSABLE, **what)
    verdict, test = statistics.verdict, statistics.sigma0
    moved, farthest = _moved(clean, statistics)
    return Slip(
        **what,
        grade=verdict.grade,
        sigma0=statistics.solution.sigma0,
        beyond=test is not None and test.factor > test.high,
        moved=moved,
        farthest=farthest,
        reasons=tuple(reason.text for reason in verdict.reasons),
        notes=verdict.notes,
        causes=statistics.solution.causes,
    )


def _moved(clean: Solution, statistics: Statistics) -> tuple[dict[str, float], float]:
    """Return the points that moved by more than `FAR` of their sigmas, but those weakly checked; and how far."""
    block, solution = statistics.block, statistics.solution
    number = {name: row for row, name in enumerate(clean.block.points.ids.tolist())}
    rows = np.array([row for row, name in enumerate(block.points.ids.tolist()) if name in number], dtype=int)
    there = np.array([number[block.points.ids[row]] for row in rows], dtype=int)
    shift = metric_differences(clean.block, clean.points.position[there], solution.points.position[rows])
    sigma = statistics.point_sigmas[rows]
    with np.errstate(invalid="ignore", divide="ignore"):
        size = np.abs(shift / sigma).max(axis=1)
        far = (size > FAR) & ~statistics.hidden.weak[rows]
    names = block.points.ids[rows[far]].tolist()
    return dict(zip(names, size[far].tolist(), strict=True)), float(np.nanmax(np.linalg.norm(shift, axis=1)))


def _blames(cause: Cause, as_it_was: str, wrong: str) -> bool:
    """Return whether a cause names a card, as it was or as it reads now."""
    lines, card = (as_it_was, wrong), wrong[:3]
    if card not in cause.cards:
        return False
    if card in ("CAM", "WTR"):
        return True
    photos = {line[4:12].strip() for line in lines}
    if card in ("STA", "STX", "ATT", "TID"):
        return bool(photos & set(cause.photos))
    points = {line[13:21].strip() for line in lines} if card == "PLT" else photos
    if card == "EQL":
        points = {word for line in lines for word in line[4:72].split()}
    return bool(points & set(cause.points)) and (
        card != "PLT" or not cause.photos or bool(photos & set(cause.photos))
    )


def _block(cards: bytes) -> Block:
    block, problems = check_deck(cards)
    if block is None:
        raise ProblemsError(problems)
    return block


def main() -> None:
    """Print what became of the slips of both decks."""
    count, seed = (int(text) for text in (*sys.argv[1:], "300", "1")[:2])
    for name, deck in DECKS.items():
        runs = slips(deck, count, seed)
        grades = Counter(str(run.grade) for run in runs)
        silent = [run for run in runs if run.quiet and run.beyond and not run.notes]
        moved = [run for run in runs if run.quiet and run.moved]
        told = [run for run in runs if run.grade not in (Grade.ACCEPTED, UNUSABLE)]
        named = sum(run.named for run in told)
        print(f"{name}: {dict(grades)}; quiet: with a failed test {len(silent)}, with moved points {len(moved)}")
        print(f"  wrong card among the first {THREE} causes: {named} of {len(told)}")
        for run in moved:
            print(f"  {run.line}:{run.column} {run.card.strip()} -> {run.wrong.strip()}: {run.moved}")
        for run in told:
            if not run.named:
                first = [(str(cause.kind), cause.photos, cause.points) for cause in run.causes[:THREE]]
                print(f"  not named: {run.card[:60].strip()} -> {run.wrong[:60].strip()}: {run.grade} {first}")


if __name__ == "__main__":
    main()
