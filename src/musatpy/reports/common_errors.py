"""Errors common to all: tests of the parameters that are held, and what errors of them move."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.probability import FAMILY_RISK
from musatpy.reports.editing import number_text
from musatpy.reports.fields import Field, FieldGroup, Rows
from musatpy.reports.pages import Section
from musatpy.reports.table import Report
from musatpy.statistics import Statistics
from musatpy.statistics.quality import BETA, CommonErrors
from musatpy.statistics.verdict import COMMON_ERRORS

_errors = attrgetter("common_errors")
MOVED = ("station", "point", "depth")  # what an error moves


def _moved_names(statistics: Statistics, kind: int) -> list[str]:
    """Return which station, point or depth every parameter moves most; empty where nothing has a sigma."""
    ids = statistics.block.photos.ids if kind == 0 else statistics.block.points.ids
    rows: IntArray = _errors(statistics).held.moved[:, kind]
    return [str(ids[row]) if row >= 0 else "" for row in rows.tolist()]


def _moves(kind: int) -> tuple[Field[Statistics], ...]:
    """Return what the record says of the worst station, point or depth."""
    noun, head = MOVED[kind], MOVED[kind].capitalize()

    def by(errors: Callable[[CommonErrors], FloatArray], part: int) -> Callable[[Statistics], FloatArray]:
        return lambda s: _errors(s).moved_by(errors(_errors(s)))[part][:, kind]

    reference, smallest = (lambda e: e.held.reference), (lambda e: e.smallest)
    return (
        Field(noun, "string", f"{noun} that moves most in its sigmas", lambda s: _moved_names(s, kind), head, "A8"),
        Field(f"{noun}_shift", "number?", "by the reference error", by(reference, 0), f"{head}\nm", "F8.3"),
        Field(f"{noun}_sigmas", "number?", "the same in sigmas", by(reference, 1), f"{head}\nsigmas", "F6.1"),
        Field(f"{noun}_hidden", "number?", "by the smallest error found", by(smallest, 0), "\nm", "F8.3"),
        Field(f"{noun}_hidden_sigmas", "number?", "the same in sigmas", by(smallest, 1), "\nsigmas", "F6.1"),
    )  # fmt: skip


PARAMETERS = Rows[Statistics, Statistics](
    "parameters", "one row per parameter that is held", (
        Field("parameter", "string", "name", "common_errors.held.names", "Parameter", "A29", is_id=True),
        Field("unit", "enum", "of its errors", "common_errors.held.units", "Unit", "A4", choices=("mm", "m", "")),
        Field("tested", "boolean", "residuals show an error that may be", "common_errors.tested", "", "A7",
              words={True: "", False: "no test"}),
        Field("test", "number?", "test value", "common_errors.test", "Test\nvalue", "F7.2"),
        Field("estimated", "number?", "error, given minus true", "common_errors.estimated"),
        Field("smallest", "number?", "error found with a power of 0.80", "common_errors.smallest",
              "Smallest\nfound", "F9.4"),
        Field("reference", "number", "error by which movements are stated", "common_errors.held.reference",
              "Reference\nerror", "F9.4"),
        Field("believed", "number", "largest error that anybody would believe", "common_errors.held.limit"),
        *_moves(0),
        *_moves(1),
        *_moves(2),
    ),
)  # fmt: skip
_ERRORS = FieldGroup[Statistics, Statistics](
    "common_errors",
    "parameters that are held and common to many observations; null where the run did not converge",
    of=lambda s: None if s.common_errors is None else s, fields=(
        Field("limit", "number", "of the test values", "common_errors.limit"),
        Field("adjusted", "integer", "left out as they are adjusted", "common_errors.held.adjusted"),
        Field("considered", "integer", "left out as they are considered", "common_errors.held.known_with_sigma"),
        PARAMETERS,
    ),
    optional=True,
)  # fmt: skip


TESTS = Report(
    COMMON_ERRORS,
    PARAMETERS,
    (
        "parameter unit test tested smallest reference",
        *(f"{noun}_{what}" for noun in MOVED for what in ("shift", "sigmas")),
    ),
)
HIDDEN = Report(
    f"{COMMON_ERRORS}: What Moves Most, By The Smallest Error Found",
    PARAMETERS,
    ("parameter", *(f"{noun}{what}" for noun in MOVED for what in ("", "_hidden", "_hidden_sigmas"))),
    which=lambda t: np.flatnonzero(t["tested"]),
)
RECORD, STATED = (_ERRORS,), (TESTS, HIDDEN)


def sections(statistics: Statistics) -> list[Section]:
    """Return both tables; nothing for a solution that says nothing of them."""
    errors = statistics.common_errors
    if errors is None:
        return []
    tested = int(errors.tested.sum())
    note = (
        "Parameters that are held, and common to many observations. An error of one moves stations, points and "
        "depths, those most in their sigmas by the figures above where it is as large as the reference error. "
        f"The limit of the {tested} test values is {number_text('F6.2', errors.limit)} (risk of all together "
        f"{number_text('F6.3', FAMILY_RISK)}); the smallest error found is that with a probability of "
        f"{number_text('F5.2', BETA)}. No test: no error that anybody would believe shows in the residuals."
    )
    left = [
        f"{count} {what}"
        for count, what in ((errors.held.adjusted, "adjusted"), (errors.held.known_with_sigma, "considered"))
        if count
    ]
    if left:
        note += f" Left out, as their errors are in the sigmas: {' and '.join(left)}."
    elif not len(errors.test):
        return []
    return [TESTS.section(statistics, note, new_page=True), *([HIDDEN.section(statistics)] if tested else [])]
