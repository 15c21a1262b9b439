"""Positions in the output coordinate system of a record, where the deck asks for one (SYS cards)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.page.cells import angle_text, number_text
from musatpy.page.rendering import Head, PageTable
from musatpy.plots.tables import Tables, numbers, part, texts
from musatpy.reports.table import worst_first

_MAP = ("Convergence", "Scale along meridian", "Scale along parallel")
_KINDS = (("stations", "photo", "Adjusted Exposure Stations"), ("points", "point", "Adjusted Ground Points"))


def stated_tables(tables: Tables, listed: int) -> Iterator[PageTable]:
    """Yield stations and points in the output system, those with the largest sigmas where not all are listed."""
    answer = part(tables, "stated.answer")
    if not answer:
        return
    for name, noun, title in _KINDS:
        table = part(tables, f"stated.{name}")
        ids, position = _ids(tables, table, noun), numbers(table, "position", 3)
        if not len(ids):
            continue
        size = 6 if name == "stations" else 3
        sigma = np.sqrt(np.maximum(np.diagonal(numbers(table, "covariance", size, size), axis1=1, axis2=2), 0.0))
        most = listed if name == "stations" else 100
        rows = np.arange(len(ids)) if len(ids) <= most else worst_first(sigma[:, 2])[:most]
        on_map = any(value is not None for value in table.get("convergence", ()))
        title = f"{title}: In The Output System"
        yield PageTable(
            title=title,
            heads=[*_heads(noun, answer), *(Head(text=text) for text in _MAP if on_map)],
            rows=[
                [
                    *_cells(ids[n], position[n], sigma[n], answer["coordinate_units"]),
                    *(_map_cells(table["convergence"][n], table["scale"][n]) if on_map else ()),
                ]
                for n in rows.tolist()
            ],
            total=len(ids),
            note=f"{answer['text']}.",
            folded=True,
        )


def _ids(tables: Tables, table: Mapping[str, Any], noun: str) -> TextArray:
    """Return the ids of rows; those of compiled points stand with their models in another table."""
    if noun in table or not table:
        return texts(table, noun)
    points = part(tables, f"{noun}s")
    pairs = zip(points["model"], points[noun], strict=True)
    return np.array([f"{point} of model {model}" for model, point in pairs], dtype=np.str_)


def _map_cells(convergence: float | None, scale: Sequence[float] | None) -> list[str]:
    """Return what the map of the output system does at a station."""
    angle = "" if convergence is None else angle_text(convergence, 3)
    return [angle, *(number_text(value, 7) for value in scale or (None, None))]


def _heads(noun: str, answer: Mapping[str, Any]) -> list[Head]:
    names = list(zip(answer["coordinates"], answer["coordinate_units"], strict=True))
    heads = [Head(text=name.capitalize() if len(name) > 1 else name, unit=_unit(unit)) for name, unit in names]
    return [
        Head(text=noun.capitalize(), is_id=True, is_text=True),
        *heads,
        *(Head(text=f"Sigma {name}", unit="″" if unit == "rad" else unit) for name, unit in names),
    ]


def _unit(unit: str) -> str:
    return "° ′ ″" if unit == "rad" else unit


def _cells(name: Any, position: FloatArray, sigma: FloatArray, units: Sequence[str]) -> list[str]:
    cells = [str(name)]
    for value, unit in zip(position.tolist(), units, strict=True):
        cells.append(angle_text(value, 5) if unit == "rad" and np.isfinite(value) else number_text(value, 3))
    for value, unit in zip(sigma[:3].tolist(), units, strict=True):
        cells.append(number_text(np.degrees(value) * 3600.0, 5) if unit == "rad" else number_text(value, 3))
    return cells
