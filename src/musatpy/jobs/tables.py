"""Rows of the tables of a block: taken out, put one below the other, and numbered anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from musatpy.arrays import BoolArray, IntArray
from musatpy.model import Block, EqualElevations
from musatpy.model.ordering import taken

Table = TypeVar("Table")

# Tables that link to points, in the order in which a deck names these.
POINT_TABLES = ("plates", "control", "equal_elevations", "distances", "height_differences")

# Tables that say what belongs to cameras.
CAMERA_TABLES = ("distortion", "fiducials", "lenses", "mark_distances", "reseau")


def stacked(tables: Sequence[Table]) -> Table:
    """Return the rows of tables of one kind, one table below the other."""
    names = [one.name for one in fields(tables[0])]  # type: ignore[arg-type]
    columns = {name: np.concatenate([getattr(table, name) for table in tables]) for name in names}
    return replace(tables[0], **columns)  # type: ignore[type-var]


def members(groups: EqualElevations, stays: BoolArray) -> EqualElevations:
    """Return the groups with some of their members (e,), without the groups that have none left."""
    group, point = groups.group[stays], groups.point[stays]
    used = np.isin(np.arange(len(groups.ids)), group)
    return EqualElevations(ids=groups.ids[used], sigma=groups.sigma[used], group=_numbers(used)[group], point=point)


def without_unused_cameras(block: Block) -> Block:
    """Return the block without cameras that took none of its photos, and what belongs to them."""
    used = np.isin(np.arange(len(block.cameras.ids)), block.photos.camera)
    number = _numbers(used)
    tables: dict[str, Any] = {}
    for name in ("photos", *CAMERA_TABLES):
        table = getattr(block, name)
        table = taken(table, used[table.camera])
        tables[name] = replace(table, camera=number[table.camera])
    return replace(block, cameras=taken(block.cameras, used), **tables)


def first_readings(block: Block) -> BoolArray:
    """Return (m,) True for the first plate measurement of each point on a photo: raw plates may have several."""
    plates = block.plates
    first = np.zeros(len(plates.photo), dtype=bool)
    first[np.unique(np.stack([plates.photo, plates.point]), axis=1, return_index=True)[1]] = True
    return first


def in_order(block: Block) -> Block:
    """Return the block with its points as a deck has them: those that a card names, as they first appear."""
    links = np.concatenate([getattr(block, name).point.reshape(-1) for name in POINT_TABLES])
    order = np.array(list(dict.fromkeys(links.tolist())), dtype=int)
    number = np.full(len(block.points.ids), -1)
    number[order] = np.arange(len(order))
    tables = {name: getattr(block, name) for name in POINT_TABLES}
    tables = {name: replace(table, point=number[table.point]) for name, table in tables.items()}
    return replace(block, points=taken(block.points, order), **tables)


def _numbers(stays: BoolArray) -> IntArray:
    """Return new numbers of rows, meaningful for those that stay."""
    return np.cumsum(stays) - 1
