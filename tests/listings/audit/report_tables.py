"""Where the fixtures of the legacy listings, the scanned report and its list of misprints are."""

import csv
from pathlib import Path

import pytest

from musatpy.listings.audit.against import numbers_of

FIXTURES = Path(__file__).resolve().parents[3] / "fixtures"
LEGACY = FIXTURES / "legacy"
SHARED = Path(__file__).resolve().parents[4] / "shared"


def table(number: int) -> Path:
    """Return the legacy listing of Table 6-`number`."""
    return LEGACY / f"etl0306_table_6_{number}.lst"


def scan() -> Path:
    """Return the scanned report, or skip the test where the data folder is not beside the repository."""
    return _shared("papers/etl0306_lambert_1983.txt")


def inconsistencies() -> list[tuple[str, str]]:
    """Return table and item of every known inconsistency of the report, or skip the test."""
    with open(_shared("tables/etl0306/inconsistencies.csv"), newline="", encoding="utf-8") as file:
        return [(row["table"], row["item"]) for row in csv.DictReader(file)]


def _shared(name: str) -> Path:
    path = SHARED / name
    if not path.exists():
        pytest.skip(f"no shared/{name} beside the repository")
    return path


def statistics_of(listing):
    """Return what can be compared of a listing, wherever it stands."""
    return {key: cell._replace(line=0) for key, cell in numbers_of(listing)[0].items()}
