"""Writes the tables of docs/heights_by_collocation.md and its picture: `python tests/collocation_tables.py`.

A table stands below its mark, up to the next empty line. Takes minutes.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from studies.collocation import Case, Outcome, SeaState, cases, study

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "heights_by_collocation.md"
PICTURE = ROOT / "docs" / "pictures" / "collocation_study.png"
HEAD = (
    "| control | period | noise | spacing / half wave | before | after | sigma told | validated | removed "
    "| Gaussian alone | theory | function |",
    "|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---|",
)


def key(case: Case) -> str:
    """Return the cells of a row that say which case it is."""
    return f"| {case.number} | {case.period:g} | {case.noise:g} |"


def row(one: Outcome) -> str:
    """Return the row of an outcome."""
    numbers = (one.before, one.after, one.sigma, one.validated)
    parts = (one.removed, one.removed_by_gaussian, one.removed_by_theory)
    cells = [
        f"{2.0 * one.spacing / one.wave_length:.2f}",
        *(f"{number:.3f}" for number in numbers),
        *(f"{round(100.0 * part)} %" for part in parts),
        one.found.best.family,
    ]
    return f"{key(one.case)} {' | '.join(cells)} |"


def mark(state: SeaState, name: str) -> str:
    """Return the mark above a table."""
    return f"<!-- {state}: {name} -->"


def with_table(page: str, state: SeaState, name: str, outcomes: Sequence[Outcome]) -> str:
    """Return the page with one table renewed."""
    table = "\n".join([*HEAD, *map(row, outcomes)])
    pattern = re.escape(mark(state, name)) + r"\n(?:.+\n)*"
    assert re.search(pattern, page), mark(state, name)
    return re.sub(pattern, f"{mark(state, name)}\n{table}\n", page)


def printed(page: str, state: SeaState, name: str) -> dict[str, str]:
    """Return the rows of a table of the page by their `key`."""
    rows = page.split(mark(state, name) + "\n")[1].split("\n\n")[0].splitlines()[2:]
    return {"|".join(line.split("|")[:4]) + "|": line for line in rows}


def main() -> None:
    from studies.pictures import collocation_picture

    found, page = study(), PAGE.read_text(encoding="utf-8")
    for (state, name), outcomes in found.items():
        page = with_table(page, state, name, outcomes)
    PAGE.write_text(page, encoding="utf-8")
    rows = [(str(state), *(found[state, name] for name in cases(state))) for state in SeaState]
    PICTURE.write_bytes(collocation_picture(rows))


if __name__ == "__main__":
    main()
