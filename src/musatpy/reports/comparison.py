"""The printed comparison of two solutions: what is told of each, and what differs most first."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.comparison import Comparison, Differences
from musatpy.reports.encoding import Json, plain, rows
from musatpy.reports.table import Column, Table
from musatpy.units import ARC_SECOND, DEGREE

_LISTED = 20
_AXES = ("East", "North", "Up")
_ANGLES = ("X-Tilt", "Y-Tilt", "Heading")


def comparison_text(found: Comparison, listed: int = _LISTED) -> str:
    """Return the comparison as text, of stations and points the `listed` ones that differ most."""
    first, second = found.labels
    lines = [f"COMPARISON OF TWO SOLUTIONS: {first} AND {second}", ""]
    facts: Table[Comparison] = Table(
        (
            Column("", "A46", lambda c: [fact[0] for fact in c.facts]),
            Column(first[-20:], "A20", lambda c: [fact[1] for fact in c.facts]),
            Column(second[-20:], "A20", lambda c: [fact[2] for fact in c.facts]),
        )
    )
    lines += facts.text(found)
    title = f"{second} minus {first}, in sigmas of {second}: the largest of each row first"
    lines += ["", "", f"Exposure Stations: {title}", "", *_stations(found.stations, listed)]
    lines += ["", "", f"Ground Points: {title}", "", *_points(found.points, listed)]
    if len(found.waves.ids):
        lines += ["", "", f"Waves: {title}", "", *_waves(found.waves, listed)]
    if len(found.depths.ids):
        lines += ["", "", "Depths Of Submerged Points", "", *_depths(found)]
    if found.only_one:
        lines += ["", "", "In One Solution Only", "", *found.only_one]
    lines += ["", f"Largest difference: {found.largest:.3f} sigmas of {second}"]
    return "\n".join(lines) + "\n"


def comparison_record(found: Comparison) -> dict[str, Json]:
    """Return the comparison as dictionaries, lists, texts and numbers: metres, radians, sigmas of the second."""
    return {
        "labels": list(found.labels),
        "facts": [{"what": what, "first": first, "second": second} for what, first, second in found.facts],
        "stations": _rows("photo", found.stations),
        "points": _rows("point", found.points),
        "waves": _rows("wave", found.waves),
        "depths": rows(point=found.depths.ids, depth=found.depths.depth, sigma=found.depths.sigma),
        "only_one": list(found.only_one),
        "largest": plain(np.array([found.largest]))[0],
    }


def _rows(name: str, part: Differences) -> list[dict[str, Json]]:
    return rows(**{name: part.ids}, difference=part.difference, sigma=part.sigma, ratio=part.ratio)


def _stations(part: Differences, listed: int) -> list[str]:
    units = (1.0, 1.0, 1.0, ARC_SECOND, ARC_SECOND, ARC_SECOND)
    names = [f"{name}\nm" for name in _AXES] + [f"{name}\narc sec" for name in _ANGLES]
    return _table("Photo", part, names, units, listed)


def _points(part: Differences, listed: int) -> list[str]:
    return _table("Point", part, [f"{name}\nm" for name in _AXES], (1.0, 1.0, 1.0), listed)


def _waves(part: Differences, listed: int) -> list[str]:
    names = ["Height\nm", "Length\nm", "Azimuth\ndegrees", "Crest\nm"]
    return _table("Wave", part, names, (1.0, 1.0, DEGREE, 1.0), listed)


def _table(name: str, part: Differences, names: list[str], units: tuple[float, ...], listed: int) -> list[str]:
    def column(heading: str, edit: str, values: FloatArray) -> Column[Differences]:
        return Column(heading, edit, lambda source: values[:listed])

    differences = [column(h, "F9.3", part.difference[:, i] / units[i]) for i, h in enumerate(names)]
    ratios = [column(h.split("\n")[0] + "\nsigma", "F8.2", part.ratio[:, i]) for i, h in enumerate(names)]
    ids: Column[Differences] = Column(name, "A8", lambda source: source.ids[:listed])
    table = Table((ids, *differences, *ratios))
    left = [] if len(part.ids) <= listed else [f"and {len(part.ids) - listed} more that differ less"]
    return [*table.text(part), *left]


def _depths(found: Comparison) -> list[str]:
    depths = found.depths
    table: Table[Comparison] = Table(
        (
            Column("Point", "A8", lambda c: depths.ids),
            Column(f"{found.labels[0][-12:]}\nm", "F12.3", lambda c: depths.depth[:, 0]),
            Column(f"{found.labels[1][-12:]}\nm", "F12.3", lambda c: depths.depth[:, 1]),
            Column("Difference\nm", "F11.3", lambda c: depths.depth[:, 1] - depths.depth[:, 0]),
            Column("Sigma\nm", "F9.3", lambda c: depths.sigma),
        )
    )
    return table.text(found)
