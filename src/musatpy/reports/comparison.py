"""The printed comparison of two solutions: what is told of each, and what differs most first."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from musatpy.comparison import ComparedRows, ComparedRuns
from musatpy.reports.table import sheet
from musatpy.reports.values import Json, plain, rows

_LISTED = 20
_AXES = ("East\nm", "North\nm", "Up\nm")
_ANGLES = ("X-Tilt\narc sec", "Y-Tilt\narc sec", "Heading\narc sec")
_WAVE = ("Height\nm", "Length\nm", "Azimuth\ndegrees", "Crest\nm")


def comparison_text(comparison: ComparedRuns, listed: int = _LISTED) -> str:
    """Return the comparison as text, of stations and points the `listed` ones that differ most."""
    first, second = comparison.labels
    lines = [f"COMPARISON OF TWO SOLUTIONS: {first} AND {second}", ""]
    what, *values = zip(*comparison.facts, strict=True)
    lines += sheet(("", "A46", what), *zip((first[-20:], second[-20:]), ("A20", "A20"), values, strict=True)).text()
    title = f"{second} minus {first}, in sigmas of {second}: the largest of each row first"
    parts = (
        ("Exposure Stations", "Photo", comparison.stations, (*_AXES, *_ANGLES)),
        ("Ground Points", "Point", comparison.points, _AXES),
        ("Waves", "Wave", comparison.waves, _WAVE),
    )
    for section, name, part, headings in parts:
        if name != "Wave" or len(part.ids):
            lines += ["", "", f"{section}: {title}", "", *_table(name, part, headings, listed)]
    if len(comparison.parameters.owner):
        lines += ["", "", f"Adjusted Parameters: {title}", "", *_parameters(comparison, listed)]
    if len(comparison.depths.ids):
        lines += ["", "", "Depths Of Submerged Points", "", *_depths(comparison)]
    if comparison.only_one:
        lines += ["", "", "In One Solution Only", "", *comparison.only_one]
    lines += ["", f"Largest difference: {comparison.largest:.3f} sigmas of {second}"]
    return "\n".join(lines) + "\n"


def comparison_record(comparison: ComparedRuns) -> dict[str, Json]:
    """Return the comparison as dictionaries, lists, texts and numbers: metres, radians, sigmas of the second."""
    part = comparison.parameters
    return {
        "labels": list(comparison.labels),
        "facts": [{"what": what, "first": first, "second": second} for what, first, second in comparison.facts],
        "stations": _rows("photo", comparison.stations),
        "points": _rows("point", comparison.points),
        "waves": _rows("wave", comparison.waves),
        "depths": rows(point=comparison.depths.ids, depth=comparison.depths.depth, sigma=comparison.depths.sigma),
        "parameters": rows(
            **{"kind": part.kind, "of": part.owner, "parameter": part.parameter, "unit": part.unit},
            **{"value": part.value, "sigma": part.sigma, "ratio": part.ratio},
        ),
        "only_one": list(comparison.only_one),
        "largest": plain(np.array([comparison.largest]))[0],
    }


def _rows(name: str, part: ComparedRows) -> list[dict[str, Json]]:
    return rows(**{name: part.ids}, difference=part.difference, sigma=part.sigma, ratio=part.ratio)


def _table(name: str, part: ComparedRows, names: Sequence[str], listed: int) -> list[str]:
    table = sheet(
        (name, "A8", part.ids[:listed]),
        (names, "F9.3", part.difference[:listed]),
        ([heading.split("\n")[0] + "\nsigma" for heading in names], "F8.2", part.ratio[:listed]),
    )
    left = [] if len(part.ids) <= listed else [f"and {len(part.ids) - listed} more that differ less"]
    return [*table.text(), *left]


def _depths(comparison: ComparedRuns) -> list[str]:
    depths = comparison.depths
    first, second = comparison.labels
    return sheet(
        ("Point", "A8", depths.ids),
        (f"{first[-12:]}\nm", "F12.3", depths.depth[:, 0]),
        (f"{second[-12:]}\nm", "F12.3", depths.depth[:, 1]),
        ("Difference\nm", "F11.3", depths.depth[:, 1] - depths.depth[:, 0]),
        ("Sigma\nm", "F9.3", depths.sigma),
    ).text()


def _parameters(comparison: ComparedRuns, listed: int) -> list[str]:
    part = comparison.parameters
    first, second = comparison.labels
    table = sheet(
        ("Kind", "A10", part.kind[:listed]),
        ("Of", "A8", part.owner[:listed]),
        ("Param.", "A7", part.parameter[:listed]),
        ("Unit", "A5", part.unit[:listed]),
        (first[-14:], "E16.8", part.value[:listed, 0]),
        (second[-14:], "E16.8", part.value[:listed, 1]),
        ("Difference", "E10.2", part.value[:listed, 1] - part.value[:listed, 0]),
        ("Sigma", "E10.2", part.sigma[:listed]),
        ("Difference\nsigma", "F10.2", part.ratio[:listed]),
    )
    return table.text()
