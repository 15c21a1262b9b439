"""Adjusted exposure stations with their sigmas."""

from __future__ import annotations

import numpy as np

from musatpy.reports import stated
from musatpy.reports.fields import ENU, POSITION_UNIT, Field, Rows, same
from musatpy.reports.headings import ATTITUDE_SIGMAS, ATTITUDES_AS_ANGLES, along_axes, position
from musatpy.reports.pages import Section
from musatpy.reports.table import Report
from musatpy.statistics import Statistics

STATIONS = Rows[Statistics, Statistics](
    "stations",
    "one row per photo",
    same,
    (
        Field("photo", "string", "photo id", lambda s: s.block.photos.ids, heading="Photo", edit="A8", is_id=True),
        Field("camera", "string", "camera id", lambda s: s.block.cameras.ids[s.block.photos.camera],
              heading="Camera", edit="A6"),
        Field("position", "3 number", "adjusted", lambda s: s.solution.stations.position, POSITION_UNIT,
              heading=position(3)),
        Field("position_sigma", "3 number?", f"a posteriori, {ENU}", lambda s: s.station_sigmas[:, :3], "m",
              heading=along_axes("Sigma ")),
        Field("attitude", "3 number", "adjusted", lambda s: s.solution.stations.attitude, "rad",
              heading=ATTITUDES_AS_ANGLES, edit="S14.3"),
        Field("attitude_sigma", "3 number?", "a posteriori", lambda s: s.station_sigmas[:, 3:], "rad",
              heading=ATTITUDE_SIGMAS, edit="F9.2"),
        Field("covariance", "6x6 number?", "a posteriori, of east, north, up, X-tilt, Y-tilt, heading",
              lambda s: s.solution.stations.covariance, "m2, m rad, rad2"),
        Field("given_position", "3 number", "of the deck", lambda s: s.block.photos.position, POSITION_UNIT),
        Field("given_position_sigma", "3 number?", f"of the deck, {ENU}; null where not observed",
              lambda s: s.block.photos.position_sigma, "m"),
        Field("given_attitude", "3 number", "of the deck", lambda s: s.block.photos.attitude, "rad"),
        Field("given_attitude_sigma", "3 number?", "of the deck; null where not observed",
              lambda s: s.block.photos.attitude_sigma, "rad"),
        Field("tide", "number?", "height of the water surface at the exposure", lambda s: s.block.photos.tide, "m"),
        Field("tide_sigma", "number?", "of the tide", lambda s: s.block.photos.tide_sigma, "m"),
        Field("tide_group", "string", "group of photos with a common correction of their tides",
              lambda s: s.block.photos.tide_group),
        Field("tide_day", "string", "day of the exposure", lambda s: s.block.photos.tide_day),
        Field("time", "number?", "of the exposure, on one clock for all photos", lambda s: s.block.photos.time,
              "s"),
    ),
)  # fmt: skip
POSITIONS: Report[Statistics] = Report(
    title="Adjusted Exposure Stations: Positions",
    table=STATIONS,
    columns=("photo", "camera", "position", "position_sigma"),
    worst=lambda t: np.linalg.norm(t["position_sigma"], axis=1),
)
ATTITUDES: Report[Statistics] = Report(
    title="Adjusted Exposure Stations: Attitudes",
    table=STATIONS,
    columns=("photo", "attitude", "attitude_sigma"),
    worst=lambda t: np.linalg.norm(t["attitude_sigma"], axis=1),
)
STATED = (POSITIONS, stated.MAP, ATTITUDES)


def sections(statistics: Statistics) -> list[Section]:
    """Return the adjusted positions and the adjusted attitudes."""
    if statistics.answer_words is not None:
        return stated.stations(statistics, statistics.answer_words)
    return [POSITIONS.section(statistics, new_page=True), ATTITUDES.section(statistics)]
