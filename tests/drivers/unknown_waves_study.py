"""The study of waves as unknowns: writes the table and the picture of docs/waves_as_unknowns.md.

Run it after a change that moves numbers: some minutes. The picture needs the extra `plots`.
"""

import csv
import io
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from studies.strip import Strip
from studies.unknown_waves import Cell, Guess, Summary, cells, run, summary

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "docs" / "studies" / "waves_as_unknowns.csv"
PICTURE = ROOT / "docs" / "pictures" / "waves_as_unknowns.png"
SEEDS = range(6)
Results = list[tuple[Cell, Summary]]

_PARAMETERS = ("height", "length", "azimuth", "crest")
HEAD = (
    *("varied", "value"),
    *(f"{water}_{errors}" for water in ("level", "known", "unknown") for errors in ("plan", "height")),
    *("removed_percent", *(f"{what}_{name}" for what in ("kept", "inflation", "honesty") for name in _PARAMETERS)),
    *("honesty_heights", "failed", "runs"),
)


def result(cell: Cell) -> Summary:
    """Return the summary of one cell."""
    return summary(run(cell.strip, cell.guess, seed) for seed in SEEDS)


def results() -> Results:
    """Return all cells of the page."""
    every = cells(Strip(), Guess())
    with ProcessPoolExecutor(max_workers=2) as pool:
        return list(zip(every, pool.map(result, every), strict=True))


def row(cell: Cell, one: Summary) -> list[str]:
    """Return the row of one cell."""
    metres = [f"{value:.3f}" for pair in (one.level, one.known, one.unknown) for value in pair]
    kept = [f"{value:.2f}" for value in one.kept]
    inflation = [f"{value:.0f}" for value in one.inflation]
    honesty = [f"{value:.1f}" for value in one.parameter_honesty]
    last = [f"{one.height_honesty:.2f}", str(one.failed), str(one.runs)]
    head = [cell.varied, f"{cell.value:g}", *metres, f"{100.0 * one.removed[1]:.0f}"]
    return [*head, *kept, *inflation, *honesty, *last]


def table(found: Results) -> str:
    """Return the table as CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([HEAD, *(row(cell, one) for cell, one in found)])
    return text.getvalue()


def printed() -> dict[tuple[str, float], list[str]]:
    """Return the numbers of the table that stands in docs, by what is varied and its value."""
    with TABLE.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert tuple(head) == HEAD
    return {(cells[0], float(cells[1])): cells[2:] for cells in rows}


def made_up() -> Results:
    """Return results of no meaning, to draw a picture of."""
    some = np.array([0.05, 0.3])
    one = Summary(
        runs=6, failed=0, level=some, known=0.2 * some, unknown=0.3 * some, removed=np.ones(2),
        parameter_honesty=np.ones(4), height_honesty=1.0, kept=np.ones(4), inflation=np.ones(4), correlation=0.5,
    )  # fmt: skip
    return [(cell, one) for cell in cells(Strip(), Guess())]


if __name__ == "__main__":
    from studies.pictures import unknown_waves

    found = results()
    TABLE.write_text(table(found), encoding="utf-8")
    PICTURE.write_bytes(unknown_waves(found))
