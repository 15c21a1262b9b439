"""Adjusted exposure stations and ground points with their sigmas, and why others took no part."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from musatpy.model import PointStatus
from musatpy.model.tables import POSITION_UNIT
from musatpy.reports import stated
from musatpy.reports.editing import ATTITUDE_SIGMAS, ATTITUDES_AS_ANGLES, along_axes, position
from musatpy.reports.fields import ENU, Field, Rows, flag, identity
from musatpy.reports.pages import Section, wrapped
from musatpy.reports.table import Report, worst_first
from musatpy.reports.values import names
from musatpy.statistics import Statistics, Words

_COVARIANCE = "a posteriori, of east, north, up, X-tilt, Y-tilt, heading"
STATIONS = Rows[Statistics, Statistics](
    "stations", "one row per photo", (
        identity("photo", "block.photos.ids"),
        Field("camera", "string", "camera id", lambda s: s.block.cameras.ids[s.block.photos.camera], "Camera",
              "A6"),
        Field("position", "3 number", "adjusted", "solution.stations.position", position(3), unit=POSITION_UNIT),
        Field("position_sigma", "3 number?", f"a posteriori, {ENU}", lambda s: s.station_sigmas[:, :3],
              along_axes("Sigma ")),
        Field("attitude", "3 number", "adjusted", "solution.stations.attitude", ATTITUDES_AS_ANGLES, "S14.3"),
        Field("attitude_sigma", "3 number?", "a posteriori", lambda s: s.station_sigmas[:, 3:], ATTITUDE_SIGMAS,
              "F9.2"),
        Field("rotation", "3x3 number", "adjusted: matrix from east, north, up at the station (X, Y, Z in local "
              "jobs) to the axes of the photo", "station_rotations"),
        Field("covariance", "6x6 number?", _COVARIANCE,
              "solution.stations.covariance", unit="m2, m rad, rad2"),
    ),
)  # fmt: skip


def _photos(pairs: str, statistics: Statistics) -> Any:
    return statistics.block.photos.ids[getattr(statistics.solution, pairs).photo]


PAIRS = Rows[Statistics, Statistics](
    "station_pairs", "one row per pair of photos that share a point",
    of=lambda s: None if s.solution.pairs is None else s, fields=(
        Field("photos", "2 string", "photo ids", partial(_photos, "pairs")),
        Field("covariance", "6x6 number?", f"{_COVARIANCE} of the first with those of the second",
              "solution.pairs.covariance", unit="m2, m rad, rad2"),
    ),
)  # fmt: skip
LEVEL_PAIRS = Rows[Statistics, Statistics](
    "level_pairs",
    "levels that photos have of their own as unknowns: one row per pair of photos that share a point, and of each "
    "alone; empty where there are none", of=lambda s: None if s.solution.level_pairs is None else s, fields=(
        Field("photos", "2 string", "photo ids", partial(_photos, "level_pairs")),
        Field("of_first", "6 number?", f"{_COVARIANCE} of the first with the level of the second",
              "solution.level_pairs.of_first", unit="m2, m rad"),
        Field("of_second", "6 number?", "of the first's level with those of the second",
              "solution.level_pairs.of_second", unit="m2, m rad"),
        Field("level", "number?", "of both levels", "solution.level_pairs.level", unit="m2"),
    ),
)  # fmt: skip


POSITIONS = Report(
    "Adjusted Exposure Stations: Positions",
    STATIONS,
    "photo camera position position_sigma",
    worst=lambda t: np.linalg.norm(t["position_sigma"], axis=1),
)
ATTITUDES = Report(
    "Adjusted Exposure Stations: Attitudes",
    STATIONS,
    "photo attitude attitude_sigma",
    worst=lambda t: np.linalg.norm(t["attitude_sigma"], axis=1),
)


POINTS = Rows[Statistics, Statistics](
    "points", "one row per ground point", (
        identity("point", "block.points.ids"),
        flag("bathymetric", "submerged", "Bath", "B", "block.points.bathymetric"),
        Field("dry", "boolean", "flagged as dry for certain", "block.points.dry", "Dry", "A3",
              words={True: "D", False: ""}, when=lambda t: bool(t["dry"].any())),
        Field("status", "string", "what became of it", lambda s: names(PointStatus, s.solution.points.status),
              "Status", "A14", choices=("triangulated", "intersected", "not_determined"),
              words={"not_determined": "not determined"}),
        Field("reason", "string?", "why it has no position, or took no part",
              lambda s: [s.solution.points.reasons.get(row) for row in range(len(s.block.points.ids))], "Reason",
              "A80", words={None: "no reason given"}),
        Field("rays", "integer", "plate measurements used for the position", "solution.points.rays", "Rays", "I4"),
        Field("position", "3 number?", "adjusted", "solution.points.position", position(3), unit=POSITION_UNIT),
        Field("sigma", "3 number?", f"a posteriori, {ENU}", "point_sigmas", along_axes("Sigma ")),
        Field("covariance", "3x3 number?", "a posteriori, of east, north, up", "solution.points.covariance",
              unit="m2"),
    ),
)  # fmt: skip
GROUND_POINTS = Report(
    "Adjusted Ground Points",
    POINTS,
    "point bathymetric dry status rays position sigma",
    which=lambda t: np.flatnonzero(t["status"] != "not_determined"),
    worst=lambda t: np.linalg.norm(t["sigma"], axis=1),
)
NO_PART = Report(
    "Points That Took No Part, Or Have No Position",
    POINTS,
    "point status reason",
    layout="texts",
    which=lambda t: np.flatnonzero(t["status"] != "triangulated"),
)


def in_words(said: stated.Said) -> tuple[list[Report[Any]], Report[Any]]:
    """Return the tables of the stations and that of the points as an answer is stated, of `answered` tables."""
    of_stations = stated.with_answer(STATIONS, stated.STATIONS)
    of_points = stated.with_answer(POINTS, stated.POINTS)
    places = stated.place_columns(said, "position", 3)
    sigmas = stated.place_sigma_columns(said, "position_sigma")
    stations = [replace(POSITIONS, table=of_stations, columns=("photo", "camera", *places, *sigmas))]
    if columns := stated.map_columns(said):
        stations.append(replace(POSITIONS, title=stated.MAP.title, table=of_stations, columns=columns))
    stations.append(replace(POSITIONS, title=ATTITUDES.title, table=of_stations, columns=stated.turn_columns(said)))
    points = ("point bathymetric dry status rays", *places, *stated.place_sigma_columns(said, "sigma"))
    return stations, replace(GROUND_POINTS, table=of_points, columns=points)


def _stated(statistics: Statistics, words: Words) -> list[Section]:
    """Return stations and points in the words of the answer, and what these cannot say."""
    content: dict[str, Any] = {table.name: table.raw(statistics) for table in (STATIONS, POINTS)}
    content["stated"] = {table.name: table.raw(statistics) for table in (stated.STATIONS, stated.POINTS)}
    content = stated.answered(content, "stations", "points")
    stations, points = in_words(stated.said_of(words))
    sections: list[Section] = []
    for report in stations:
        values = report.read(content, "")
        section = report.section(values, new_page=not sections)
        lines = len(section.lines) // max(values.count, 1)  # of a photo
        worst = worst_first(np.linalg.norm(values["position_sigma"], axis=1), lines=lines).tolist()
        sections.append(replace(section, worst=worst))
    sections += stated.notes(statistics, words)
    sections.append(points.section(points.read(content, ""), new_page=True))
    return [*sections, *stated.far_points(statistics, words)]


STATED = (POSITIONS, stated.MAP, ATTITUDES, GROUND_POINTS, NO_PART)


def sections(statistics: Statistics) -> list[Section]:
    """Return the adjusted stations, the points that have a position, and the reasons of those that have none."""
    words = statistics.answer_words
    if words is None:
        tables = (POSITIONS, True), (ATTITUDES, False), (GROUND_POINTS, True)
        sections = [report.section(statistics, new_page=new_page) for report, new_page in tables]
    else:
        sections = _stated(statistics, words)
    _, *rows = NO_PART.cells(statistics)
    lines = [line for point, status, why in rows for line in wrapped([why], lead=f"{point:<8.8}  {status:<14}  ")]
    return [*sections, Section(title=NO_PART.title, lines=lines, worst=range(len(lines)))] if lines else sections
