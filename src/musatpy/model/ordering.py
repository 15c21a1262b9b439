"""A block in the order of its identifiers: the same rows in the same places, whatever the order of its cards."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from musatpy.arrays import BoolArray, IntArray
from musatpy.model.block import Block

Table = TypeVar("Table")

_NUMBER = re.compile(r"(\d+)")
_NAMED = ("cameras", "photos", "points", "waves")
# Tables by what their rows are ordered by: links first, then what parts rows of equal links.
_KEYS = {
    "distortion": ("camera", "kind", "values"),
    "fiducials": ("camera", "ids"),
    "lenses": ("camera",),
    "mark_distances": ("camera", "marks"),
    "reseau": ("camera", "ids"),
    "fiducial_measurements": ("photo", "ids", "xy"),
    "cross_measurements": ("photo", "ids", "xy"),
    "plates": ("photo", "point", "xy"),
    "control": ("point", "kind", "position"),
    "equal_elevations": ("group", "point"),
    "air_bases": ("photo",),
    "distances": ("point",),
    "height_differences": ("point",),
}


def taken(table: Table, rows: IntArray | BoolArray) -> Table:
    """Return some rows of a table whose attributes all have one row per entity, in the order of `rows`."""
    return replace(table, **{one.name: getattr(table, one.name)[rows] for one in fields(table)})  # type: ignore[type-var, arg-type]


def natural_key(name: str) -> tuple[tuple[str | int, ...], str]:
    """Return what identifiers are sorted by: their digits count as numbers (2 before 10), equal ones as text."""
    parts = _NUMBER.split(name)
    return tuple(int(part) if place % 2 else part for place, part in enumerate(parts)), name


def natural_order(ids: Iterable[str]) -> IntArray:
    """Return the rows of identifiers (n,) in their natural order."""
    names = list(ids)
    return np.array(sorted(range(len(names)), key=lambda row: natural_key(names[row])), dtype=np.int64)


def in_order_of_ids(block: Block) -> Block:
    """Return the block with cameras, photos, points, groups and waves in the natural order of their identifiers.

    Rows that link to them are ordered by these links: plate measurements by photo, then point. What a row says
    stays: an air base keeps its first and second photo.
    """
    orders = {name: natural_order(getattr(block, name).ids.tolist()) for name in _NAMED}
    groups = natural_order(block.equal_elevations.ids.tolist())
    ranks = {"camera": _ranks(orders["cameras"]), "photo": _ranks(orders["photos"])}
    ranks |= {"point": _ranks(orders["points"]), "group": _ranks(groups)}
    tables: dict[str, Any] = {name: taken(getattr(block, name), order) for name, order in orders.items()}
    tables["photos"] = replace(tables["photos"], camera=ranks["camera"][tables["photos"].camera])
    for name, keys in _KEYS.items():
        tables[name] = _ordered(getattr(block, name), keys, ranks)
    members = tables["equal_elevations"]
    tables["equal_elevations"] = replace(members, ids=members.ids[groups], sigma=members.sigma[groups])
    return replace(block, **tables)


def _ordered(table: Any, keys: tuple[str, ...], ranks: dict[str, IntArray]) -> Any:
    """Return a table with its links numbered anew, and its rows by the columns of `keys`."""
    links = {name: ranks[name][getattr(table, name)] for name in ranks if hasattr(table, name)}
    table = replace(table, **links)
    columns = [column for key in keys for column in _columns(getattr(table, key))]
    order = np.lexsort(columns[::-1])
    # the other columns of equal elevations are those of the groups
    names = list(links) if "group" in links else [one.name for one in fields(table)]
    return replace(table, **{name: getattr(table, name)[order] for name in names})


def _columns(values: Any) -> list[Any]:
    """Return the columns of values (n,) or (n, k) as numbers that sort as they do; texts in their natural order."""
    if values.dtype.kind == "U":
        names, numbers = np.unique(values, return_inverse=True)
        values = _ranks(natural_order(names.tolist()))[numbers].reshape(values.shape)
    return [values] if values.ndim == 1 else list(values.T)


def _ranks(order: IntArray) -> IntArray:
    """Return where each row comes in an order."""
    ranks = np.empty(len(order), dtype=np.int64)
    ranks[order] = np.arange(len(order))
    return ranks
