"""Writes the table and the picture of the study of heights by collocation: `python -m drivers.collocation_tables`.

Takes minutes.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

from studies.collocation import Case, Outcome, SeaState, cases, study

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "docs" / "studies" / "collocation.csv"
PICTURE = ROOT / "docs" / "pictures" / "collocation_study.png"
HEAD = (
    "sea,varied,control,period,noise,spacing_in_half_waves,before,after,sigma,validated,"
    "removed_percent,by_gaussian_percent,by_theory_percent,function"
)


def key(varied: str, case: Case) -> str:
    """Return the cells of a row that say which case it is, and of which series."""
    return f"{case.state},{varied},{case.number},{case.period:g},{case.noise:g}"


def row(varied: str, outcome: Outcome) -> str:
    """Return the row of an outcome."""
    numbers = (outcome.before, outcome.after, outcome.sigma, outcome.validated)
    parts = (outcome.removed, outcome.removed_by_gaussian, outcome.removed_by_theory)
    cells = [
        f"{2.0 * outcome.spacing / outcome.wave_length:.2f}",
        *(f"{number:.3f}" for number in numbers),
        *(f"{round(100.0 * part)}" for part in parts),
        outcome.found.best.family,
    ]
    return ",".join([key(varied, outcome.case), *cells])


def table(outcomes: Mapping[tuple[SeaState, str], Sequence[Outcome]]) -> str:
    """Return the table as CSV."""
    rows = (row(varied, outcome) for (_, varied), series in outcomes.items() for outcome in series)
    return "\n".join([HEAD, *rows]) + "\n"


def printed() -> dict[str, str]:
    """Return the rows of the table that stands in docs by their `key`."""
    rows = TABLE.read_text(encoding="utf-8").splitlines()[1:]
    return {",".join(line.split(",")[:5]): line for line in rows}


def main() -> None:
    from studies.pictures import collocation_picture

    outcomes = study()
    TABLE.write_text(table(outcomes), encoding="utf-8")
    rows = [(str(state), *(outcomes[state, name] for name in cases(state))) for state in SeaState]
    PICTURE.write_bytes(collocation_picture(rows))


if __name__ == "__main__":
    main()
