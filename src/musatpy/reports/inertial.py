"""Attitudes of an inertial unit: what was observed, and by how much the adjusted attitudes of the body differ."""

from __future__ import annotations

import numpy as np

from musatpy.model import ObservationKind
from musatpy.reports.fields import Field, Rows, identity
from musatpy.reports.pages import Section
from musatpy.reports.table import Report, filled
from musatpy.statistics import Statistics

_KIND = ObservationKind.INERTIAL_ATTITUDE


def _about(name: str) -> tuple[str, ...]:
    return tuple(f"{name} {axis}\narc sec" for axis in "xyz")


INERTIAL = Rows[Statistics, Statistics](
    "inertial_attitudes", "one row per attitude of an inertial unit", (
        identity("photo", lambda s: s.block.photos.ids[s.block.inertial_attitudes.photo]),
        Field("given", "3 number", "angles of the deck, by its INO card", "block.inertial_attitudes.angles",
              tuple(f"Angle {number}\ndegrees" for number in (1, 2, 3)), "F11.5"),
        Field("given_sigma", "3 number", "of the deck, about the axes of the body",
              "block.inertial_attitudes.sigma", _about("Sigma"), "F8.1"),
        Field("residual", "3 number?", "rotation from the observed to the adjusted body, about its axes",
              lambda s: s.of_table(_KIND, "observed.residual"), _about("Resid."), "F9.1"),
        Field("test", "3 number?", "test values, as `normal_test` of the observations",
              lambda s: s.of_table(_KIND, "normal_tests"), tuple(f"Test\n{axis}" for axis in "xyz"), "F7.2"),
    ),
)  # fmt: skip
REPORT: Report[Statistics] = Report(
    "Inertial Attitudes: Adjusted Minus Observed, About The Axes Of The Body",
    INERTIAL,
    "photo given given_sigma residual test",
    worst=lambda t: np.nan_to_num(np.abs(t["test"]), nan=-1.0).max(axis=1),
)
RECORD, STATED = (INERTIAL,), (REPORT,)


def sections(statistics: Statistics) -> list[Section]:
    """Return the inertial attitudes, nothing without any."""
    return filled(STATED, statistics)
