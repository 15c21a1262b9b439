"""A block in the order of its identifiers: the same rows in the same places, whatever the order of its cards."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from musatpy.arrays import IntArray
from musatpy.model.block import Block, with_tables
from musatpy.model.tables import Table, columns, renumbered

_NUMBER = re.compile(r"(\d+)")


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
    tables = block.tables()
    orders = {
        name: natural_order(getattr(table, column).tolist())
        for name, table in tables.items()
        for column, about in columns(type(table)).items()
        if about.identity
    }
    ranks = {name: _ranks(order) for name, order in orders.items()}
    return with_tables(block, {name: _ordered(table, orders.get(name), ranks) for name, table in tables.items()})


def _ordered(table: Table, order: IntArray | None, ranks: dict[str, IntArray]) -> Table:
    """Return a table with its links numbered anew, its rows in an order, or by their links and what sorts them."""
    table = renumbered(table, ranks)
    about = columns(type(table))
    rows: dict[str, list[str]] = {}
    for name, column in about.items():
        rows.setdefault(column.rows, []).append(name)
    for kind, names in rows.items():
        if kind or order is None:
            keys = [name for name in names if about[name].link or about[name].sort]
            sorting = [column for name in keys for column in _columns(getattr(table, name))]
            order = np.lexsort(sorting[::-1])
        table = replace(table, **{name: getattr(table, name)[order] for name in names})
    return table


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
