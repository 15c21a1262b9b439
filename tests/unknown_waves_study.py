"""The study of waves as unknowns: writes the tables and the picture of docs/waves_as_unknowns.md.

Run it after a change that moves numbers: some minutes. The picture needs the extra `plots`.
"""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from studies.strip import Strip
from studies.unknown_waves import Cell, Guess, Summary, cells, run, summary

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "waves_as_unknowns.md"
PICTURE = ROOT / "docs" / "pictures" / "waves_as_unknowns.png"
BEGIN, END = "<!-- made by tests/unknown_waves_study.py -->", "<!-- end -->"
SEEDS = range(6)
Results = list[tuple[Cell, Summary]]

_HEAD = (
    "| varied | value | level: plan | height | known: plan | height | unknown: plan | height | removed "
    "| sigmas kept | inflation | honesty | heights | failed |"
)


def result(cell: Cell) -> Summary:
    """Return the summary of one cell."""
    return summary(run(cell.strip, cell.guess, seed) for seed in SEEDS)


def results() -> Results:
    """Return all cells of the page."""
    every = cells(Strip(), Guess())
    with ProcessPoolExecutor(max_workers=2) as pool:
        return list(zip(every, pool.map(result, every), strict=True))


def lines(found: Results) -> Iterable[str]:
    """Yield the lines of the table."""
    yield _HEAD
    yield "|---|" + "---:|" * (_HEAD.count("|") - 2)
    for cell, one in found:
        metres = [f"{value:.3f}" for pair in (one.level, one.known, one.unknown) for value in pair]
        four = [
            " ".join(f"{value:.2f}" for value in one.kept),
            " ".join(f"{value:.0f}" for value in one.inflation),
            " ".join(f"{value:.1f}" for value in one.parameter_honesty),
        ]
        last = [f"{one.height_honesty:.2f}", f"{one.failed} of {one.runs}"]
        row = [cell.varied, f"{cell.value:g}", *metres, f"{100.0 * one.removed[1]:.0f} %", *four, *last]
        yield f"| {' | '.join(row)} |"


def with_table(text: str, found: Results) -> str:
    """Return the text of the page with its table made anew."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    table = "\n".join(lines(found))
    return f"{before}{BEGIN}\n\n{table}\n\n{END}{after}"


def rows_of(text: str) -> dict[tuple[str, float], list[str]]:
    """Return the cells of the table that stands on the page, by what is varied and its value."""
    table = text.partition(BEGIN)[2].partition(END)[0].strip().splitlines()[2:]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table]
    return {(row[0], float(row[1])): row[2:] for row in rows}


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
    PAGE.write_text(with_table(PAGE.read_text(), found))
    PICTURE.write_bytes(unknown_waves(found))
