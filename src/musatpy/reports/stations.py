"""Adjusted exposure stations with their sigmas."""

from __future__ import annotations

import numpy as np

from musatpy.reports import stated
from musatpy.reports.columns import (
    attitude_columns,
    attitude_sigma_columns,
    camera_column,
    metric_columns,
    position_columns,
)
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Table, worst_first
from musatpy.statistics import Statistics
from musatpy.units import ARC_SECOND

_PHOTO: Column[Statistics] = Column("Photo", "A8", lambda s: s.block.photos.ids)


def sections(statistics: Statistics) -> list[Section]:
    """Return the adjusted positions and the adjusted attitudes."""
    if statistics.answer_words is not None:
        return stated.stations(statistics, statistics.answer_words)
    positions = Table(
        (
            _PHOTO,
            camera_column(lambda s: s.block.photos.camera),
            *position_columns(statistics.block, lambda s: s.solution.stations.position, 3),
            *metric_columns(statistics.block, lambda s: s.station_sigmas[:, :3], sigma=True),
        )
    )
    attitudes = Table(
        (
            _PHOTO,
            *attitude_columns(lambda s: s.solution.stations.attitude, 3),
            *attitude_sigma_columns(lambda s: s.station_sigmas[:, 3:]),
        )
    )
    return [
        Section(
            title="Adjusted Exposure Stations: Positions",
            head=positions.head(),
            lines=positions.lines(statistics),
            worst=worst_first(np.linalg.norm(statistics.station_sigmas[:, :3], axis=1)).tolist(),
            new_page=True,
        ),
        Section(
            title="Adjusted Exposure Stations: Attitudes",
            head=attitudes.head(),
            lines=attitudes.lines(statistics),
            worst=worst_first(np.linalg.norm(statistics.station_sigmas[:, 3:], axis=1) / ARC_SECOND).tolist(),
        ),
    ]
