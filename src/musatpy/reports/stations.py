"""Adjusted exposure stations with their sigmas."""

from __future__ import annotations

import numpy as np

from musatpy.reports import result_record, stated
from musatpy.reports.columns import attitude_columns, attitude_sigma_columns, metric_columns, position_columns
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Report, key, worst_first
from musatpy.statistics import Statistics
from musatpy.units import ARC_SECOND

POSITIONS: Report[Statistics] = Report(
    title="Adjusted Exposure Stations: Positions",
    table=result_record.STATIONS,
    columns=(
        key("Photo", "A8", "photo"),
        Column("Camera", "A6", shows="camera"),
        position_columns("position", 3),
        metric_columns("position_sigma", "Sigma "),
    ),
)
ATTITUDES: Report[Statistics] = Report(
    title="Adjusted Exposure Stations: Attitudes",
    table=result_record.STATIONS,
    columns=(
        key("Photo", "A8", "photo"),
        *attitude_columns("attitude", 3),
        *attitude_sigma_columns("attitude_sigma"),
    ),
)
STATED = (POSITIONS, stated.MAP, ATTITUDES)


def sections(statistics: Statistics) -> list[Section]:
    """Return the adjusted positions and the adjusted attitudes."""
    if statistics.answer_words is not None:
        return stated.stations(statistics, statistics.answer_words)
    sigmas = statistics.station_sigmas
    near, steady = np.linalg.norm(sigmas[:, :3], axis=1), np.linalg.norm(sigmas[:, 3:], axis=1) / ARC_SECOND
    return [
        POSITIONS.section(statistics, worst=worst_first(near).tolist(), new_page=True),
        ATTITUDES.section(statistics, worst=worst_first(steady).tolist()),
    ]
