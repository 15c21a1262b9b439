"""The answer in the words that the deck asks for: stations, attitudes, ground points; and what these words are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.reports.pages import Section, labelled, wrapped
from musatpy.reports.table import Report, worst_first
from musatpy.reports.wording import Columns, map_columns, of_job, place_columns, place_sigma_columns, turn_columns
from musatpy.statistics import Statistics, Words
from musatpy.units import AngleUnit

_UNITS = {
    AngleUnit.DMS: "degrees, minutes, seconds",
    AngleUnit.DEGREES: "degrees",
    AngleUnit.GONS: "gons",
    AngleUnit.RADIANS: "radians",
}


# What the map of the answer does at the stations: the record has it in words of its own.
MAP: Report[Statistics] = Report(title="Adjusted Exposure Stations: The Map There", columns=())


def systems(statistics: Statistics) -> list[Section]:
    """Return how the deck and the answer are stated; nothing for a job without such cards."""
    lines: list[str] = []
    for what, words in (("Input", statistics.given_words), ("Answer", statistics.answer_words)):
        if words is not None:
            lines += _lines(what, words)
    return [Section(title="Coordinate Systems", lines=lines)] if lines else []


def _lines(what: str, words: Words) -> list[str]:
    statement = words.statement
    texts = {
        f"{what}, coordinates": statement.system.text,
        f"{what}, attitudes": statement.attitudes_text,
        f"{what}, angles in": _UNITS[words.unit],
        f"{what}, sigmas": statement.sigmas_text,
    }
    return [line for label, text in texts.items() for line in wrapped([text], lead=labelled({label: ""})[0])]


def stations(statistics: Statistics, words: Words) -> list[Section]:
    """Return the adjusted positions, what the map does there, and the adjusted attitudes."""
    positions: Columns = (
        of_job("Photo", "A8", lambda s: s.block.photos.ids),
        of_job("Camera", "A6", lambda s: s.block.cameras.ids[s.block.photos.camera]),
        *place_columns(words, lambda s: _answer(s, "position"), 3),
        *place_sigma_columns(words, lambda s: s.answer_station_sigmas[:, :3]),
    )
    attitudes = turn_columns(
        words,
        lambda s: _answer(s, "angles"),
        lambda s: _answer(s, "matrix"),
        lambda s: s.answer_station_sigmas[:, 3:],
    )
    tables = [("Positions", positions), ("Attitudes", attitudes)]
    answer = statistics.answer
    if answer is not None and answer.factors is not None:
        tables.insert(1, ("The Map There", map_columns(words)))
    photos, sizes = len(statistics.block.photos.ids), np.linalg.norm(statistics.station_sigmas[:, :3], axis=1)
    sections: list[Section] = []
    for what, columns in tables:
        report: Report[Statistics] = Report(title=f"Adjusted Exposure Stations: {what}", columns=columns)
        section = report.section(statistics, new_page=not sections)
        worst = worst_first(sizes, lines=len(section.lines) // photos).tolist() if photos else ()
        sections.append(replace(section, worst=worst))
    notes = _notes(statistics, words)
    return [*sections, Section(title="Notes On The Stations", lines=notes)] if notes else sections


def _notes(statistics: Statistics, words: Words) -> list[str]:
    """Return what the columns of the stations cannot say."""
    answer, ids = statistics.answer, statistics.block.photos.ids
    if answer is None:
        return []
    lost = [
        f"{name}: first and third angle turn about one line; the first is set to zero, and they have no sigmas."
        for name in ids[answer.lost].tolist()
    ]
    far = [
        f"{name}: {words.statement.system.text} does not reach the station."
        for name in ids[answer.far_stations].tolist()
    ]
    return wrapped([f"Photo {text}" for text in (*lost, *far)])


def far_points(statistics: Statistics, words: Words) -> list[Section]:
    """Return the points that have a position, which the system of the answer does not reach."""
    answer = statistics.answer
    if answer is None or not answer.far_points.any():
        return []
    names = ", ".join(statistics.block.points.ids[answer.far_points].tolist())
    text = f"{words.statement.system.text} does not reach these points: {names}."
    return [Section(title="Points Without Coordinates In The System", lines=wrapped([text]))]


def _answer(statistics: Statistics, name: str) -> FloatArray:
    values: FloatArray = getattr(statistics.answer, name)
    return values
