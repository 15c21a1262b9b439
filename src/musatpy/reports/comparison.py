"""The printed comparison of two solutions: what is told of each, and what differs most first."""

from __future__ import annotations

from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.comparison import Comparison, Differences
from musatpy.reports.fields import Field, unrecorded
from musatpy.reports.table import Table
from musatpy.reports.values import Json, plain, rows

_LISTED = 20
_AXES = ("East", "North", "Up")
_ANGLES = ("X-Tilt", "Y-Tilt", "Heading")


def comparison_text(comparison: Comparison, listed: int = _LISTED) -> str:
    """Return the comparison as text, of stations and points the `listed` ones that differ most."""
    first, second = comparison.labels
    lines = [f"COMPARISON OF TWO SOLUTIONS: {first} AND {second}", ""]
    facts: Table[Comparison] = Table(
        (
            unrecorded("", "A46", lambda c: [fact[0] for fact in c.facts]),
            unrecorded(first[-20:], "A20", lambda c: [fact[1] for fact in c.facts]),
            unrecorded(second[-20:], "A20", lambda c: [fact[2] for fact in c.facts]),
        )
    )
    lines += facts.text(comparison)
    title = f"{second} minus {first}, in sigmas of {second}: the largest of each row first"
    lines += ["", "", f"Exposure Stations: {title}", "", *_stations(comparison.stations, listed)]
    lines += ["", "", f"Ground Points: {title}", "", *_points(comparison.points, listed)]
    if len(comparison.waves.ids):
        lines += ["", "", f"Waves: {title}", "", *_waves(comparison.waves, listed)]
    if len(comparison.depths.ids):
        lines += ["", "", "Depths Of Submerged Points", "", *_depths(comparison)]
    if comparison.only_one:
        lines += ["", "", "In One Solution Only", "", *comparison.only_one]
    lines += ["", f"Largest difference: {comparison.largest:.3f} sigmas of {second}"]
    return "\n".join(lines) + "\n"


def comparison_record(comparison: Comparison) -> dict[str, Json]:
    """Return the comparison as dictionaries, lists, texts and numbers: metres, radians, sigmas of the second."""
    return {
        "labels": list(comparison.labels),
        "facts": [{"what": what, "first": first, "second": second} for what, first, second in comparison.facts],
        "stations": _rows("photo", comparison.stations),
        "points": _rows("point", comparison.points),
        "waves": _rows("wave", comparison.waves),
        "depths": rows(point=comparison.depths.ids, depth=comparison.depths.depth, sigma=comparison.depths.sigma),
        "only_one": list(comparison.only_one),
        "largest": plain(np.array([comparison.largest]))[0],
    }


def _rows(name: str, part: Differences) -> list[dict[str, Json]]:
    return rows(**{name: part.ids}, difference=part.difference, sigma=part.sigma, ratio=part.ratio)


def _stations(part: Differences, listed: int) -> list[str]:
    names = [f"{name}\nm" for name in _AXES] + [f"{name}\narc sec" for name in _ANGLES]
    return _table("Photo", part, names, listed)


def _points(part: Differences, listed: int) -> list[str]:
    return _table("Point", part, [f"{name}\nm" for name in _AXES], listed)


def _waves(part: Differences, listed: int) -> list[str]:
    names = ["Height\nm", "Length\nm", "Azimuth\ndegrees", "Crest\nm"]
    return _table("Wave", part, names, listed)


def _table(name: str, part: Differences, names: list[str], listed: int) -> list[str]:
    def column(heading: str, edit: str, values: FloatArray) -> Field[Differences]:
        return unrecorded(heading, edit, lambda source: values[:listed])

    differences = [column(h, "F9.3", part.difference[:, i]) for i, h in enumerate(names)]
    ratios = [column(h.split("\n")[0] + "\nsigma", "F8.2", part.ratio[:, i]) for i, h in enumerate(names)]
    ids: Field[Differences] = unrecorded(name, "A8", lambda source: source.ids[:listed])
    table: Table[Any] = Table((ids, *differences, *ratios))
    left = [] if len(part.ids) <= listed else [f"and {len(part.ids) - listed} more that differ less"]
    return [*table.text(part), *left]


def _depths(comparison: Comparison) -> list[str]:
    depths = comparison.depths
    table: Table[Comparison] = Table(
        (
            unrecorded("Point", "A8", lambda c: depths.ids),
            unrecorded(f"{comparison.labels[0][-12:]}\nm", "F12.3", lambda c: depths.depth[:, 0]),
            unrecorded(f"{comparison.labels[1][-12:]}\nm", "F12.3", lambda c: depths.depth[:, 1]),
            unrecorded("Difference\nm", "F11.3", lambda c: depths.depth[:, 1] - depths.depth[:, 0]),
            unrecorded("Sigma\nm", "F9.3", lambda c: depths.sigma),
        )
    )
    return table.text(comparison)
