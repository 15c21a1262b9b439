"""Kinds of observations that most jobs are without: by how much adjusted values differ from observed ones."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model import ObservationKind
from musatpy.reports.control import FAILS
from musatpy.reports.editing import along_axes
from musatpy.reports.fields import ENU, Field, Rows, identity
from musatpy.reports.pages import Section
from musatpy.reports.table import Report, filled
from musatpy.statistics import Statistics

Table = Rows[Statistics, Statistics]
_K = ObservationKind


def _antenna_times(statistics: Statistics) -> FloatArray:
    times = statistics.block.exposure_times
    time = np.full(statistics.block.photos.count, np.nan)
    time[times.photo] = times.time
    return time[statistics.block.antenna_positions.photo]


def _antenna_difference(statistics: Statistics) -> FloatArray:
    not_adjusted = np.full((statistics.block.antenna_positions.count, 3), np.nan)
    return statistics.solution.measured.get(_K.ANTENNA, not_adjusted).reshape(not_adjusted.shape)


ANTENNAS = Table(
    "antenna_positions", "one row per antenna position", (
        identity("photo", lambda s: s.block.photos.ids[s.block.antenna_positions.photo]),
        Field("line", "string", "flight line, empty for none", "block.antenna_positions.line", "Line", "A4",
              is_id=True),
        Field("time", "number?", "of the exposure", _antenna_times, "Time\ns", "F12.3", unit="s"),
        Field("difference", "3 number?", f"adjusted minus observed, {ENU}", _antenna_difference,
              along_axes()),
        Field("sigma", "3 number", f"of the deck, {ENU}", "block.antenna_positions.sigma",
              along_axes("Sigma ", edit="F8.3")),
        Field("given_correlation", "3 number?", "of the deck: east and north, east and up, north and up",
              "block.antenna_positions.correlation", seldom=True),
        Field("test", "3 number?", f"test values of the components, {ENU}, as `normal_test` of the observations: "
              "with a covariance, of the principal axes nearest to these",
              lambda s: s.of_table(_K.ANTENNA, "normal_tests"),
              along_axes("Test\n", edit="F6.1", unit="")),
    ),
)  # fmt: skip
_ANTENNAS: Report[Statistics] = Report(
    "Antenna Positions: Adjusted Minus Observed",
    ANTENNAS,
    ("photo line time difference sigma test", FAILS),
    worst=lambda t: np.nan_to_num(np.abs(t["test"]), nan=-1.0).max(axis=1),
)


def _about(name: str) -> tuple[str, ...]:
    return tuple(f"{name} {axis}\narc sec" for axis in "xyz")


INERTIAL = Table(
    "inertial_attitudes", "one row per attitude of an inertial unit", (
        identity("photo", lambda s: s.block.photos.ids[s.block.inertial_attitudes.photo]),
        Field("given", "3 number", "angles of the deck, by its INO card", "block.inertial_attitudes.angles",
              tuple(f"Angle {number}\ndegrees" for number in (1, 2, 3)), "F11.5"),
        Field("given_sigma", "3 number", "of the deck, about the axes of the body",
              "block.inertial_attitudes.sigma", _about("Sigma"), "F8.1"),
        Field("residual", "3 number?", "rotation from the observed to the adjusted body, about its axes",
              lambda s: s.of_table(_K.INERTIAL_ATTITUDE, "observed.residual"), _about("Resid."), "F9.1"),
        Field("test", "3 number?", "test values, as `normal_test` of the observations",
              lambda s: s.of_table(_K.INERTIAL_ATTITUDE, "normal_tests"),
              tuple(f"Test\n{axis}" for axis in "xyz"), "F7.2"),
    ),
)  # fmt: skip
_ATTITUDES: Report[Statistics] = Report(
    "Inertial Attitudes: Adjusted Minus Observed, About The Axes Of The Body",
    INERTIAL,
    "photo given given_sigma residual test",
    worst=lambda t: np.nan_to_num(np.abs(t["test"]), nan=-1.0).max(axis=1),
)
STATED = (_ANTENNAS, _ATTITUDES)
RECORD = (ANTENNAS, INERTIAL)


def sections(statistics: Statistics) -> list[Section]:
    """Return the tables of those that a job has."""
    return filled(STATED, statistics)
