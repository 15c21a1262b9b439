"""Runs of decks of the fixtures, with their listings and records: each is made once for all tests."""

import json
from functools import cache
from pathlib import Path
from typing import NamedTuple

from musatpy import adjust, listing, read_deck
from musatpy.model import Solution
from musatpy.reports import record
from record_rows import with_columns, with_rows

FIXTURES = Path(__file__).parents[2] / "fixtures"
ST_THOMAS, RAW, SEA = "st_thomas/st_thomas.crd", "st_thomas_raw/st_thomas_raw.crd", "waves/unknown.crd"


class Run(NamedTuple):
    """A solution, its listing, and its record as JSON."""

    solution: Solution
    listing: str
    record: str


def printed(solution: Solution) -> Run:
    """Return a solution with what is written of it."""
    return Run(solution, listing(solution), record.dumps(record.record(solution)))


@cache
def run_of(deck: str) -> Run:
    """Return the run of a deck of the fixtures."""
    return printed(adjust(read_deck(FIXTURES / deck)))


def entry_of(content, path):
    for key in path:
        content = content[key]
    return content


def moved(text, path, step):
    """Return a record with a number of it changed."""
    content = with_rows(json.loads(text))
    *above, last = path
    entry = entry_of(content, above)
    entry[last] = (entry[last] or 0.0) + step
    return json.dumps(with_columns(content))


def edited(text, change):
    content = with_rows(json.loads(text))
    change(content)
    return json.dumps(with_columns(content))
