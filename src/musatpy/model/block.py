"""The block: everything that a deck says, and nothing else; and the same in the order of its identifiers."""

from __future__ import annotations

import re
import typing
from collections.abc import Iterable
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache, partial
from types import MappingProxyType, UnionType
from typing import Any

import numpy as np

import musatpy
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model.options import EllipsoidSpec, Options, OrientationSpec, SystemSpec
from musatpy.model.photos import (
    AirBases,
    Cameras,
    Control,
    Distances,
    Distortion,
    EqualElevations,
    FiducialMeasurements,
    Fiducials,
    HeightDifferences,
    Photos,
    PlateMeasurements,
    Points,
)
from musatpy.model.reduction import (
    ComparatorSpec,
    CrossMeasurements,
    Lenses,
    MarkDistances,
    Plates,
    ReductionOptions,
    ReseauCrosses,
)
from musatpy.model.tables import Table, columns, empty, renumbered, taken
from musatpy.model.water import Water, WaveOrigin, Waves

_TITLE = 80  # characters of a title that are shown


@dataclass(frozen=True, kw_only=True, eq=False)
class Block:
    """One job. Raises `ValueError` where a link points outside its table."""

    titles: tuple[str, ...]
    options: Options
    ellipsoid: EllipsoidSpec | None = None  # None in local jobs
    water: Water | None = None  # None: no water card
    cameras: Cameras
    distortion: Distortion = field(default_factory=partial(empty, Distortion))
    fiducials: Fiducials = field(default_factory=partial(empty, Fiducials))
    photos: Photos
    fiducial_measurements: FiducialMeasurements = field(default_factory=partial(empty, FiducialMeasurements))
    points: Points
    plates: PlateMeasurements = field(default_factory=partial(empty, PlateMeasurements))
    control: Control = field(default_factory=partial(empty, Control))
    equal_elevations: EqualElevations = field(default_factory=partial(empty, EqualElevations))
    air_bases: AirBases = field(default_factory=partial(empty, AirBases))
    distances: Distances = field(default_factory=partial(empty, Distances))
    height_differences: HeightDifferences = field(default_factory=partial(empty, HeightDifferences))
    reduction: ReductionOptions | None = None  # None: no card, the plate coordinates are refined
    comparator: ComparatorSpec | None = None
    orientation: OrientationSpec | None = None  # None: no card
    lenses: Lenses = field(default_factory=partial(empty, Lenses))
    mark_distances: MarkDistances = field(default_factory=partial(empty, MarkDistances))
    reseau: ReseauCrosses = field(default_factory=partial(empty, ReseauCrosses))
    cross_measurements: CrossMeasurements = field(default_factory=partial(empty, CrossMeasurements))
    waves: Waves = field(default_factory=partial(empty, Waves))
    wave_origin: WaveOrigin | None = None  # None: no card
    given_in: SystemSpec | None = None  # how the deck states all this; None: as it stands here
    stated_in: SystemSpec | None = None  # how the answer is stated; None: as the deck is
    settings: tuple[str, ...] = ()  # what was set for a run: `OP2.water_level=ONE` of its cards, `causes=all`

    @property
    def answer_in(self) -> SystemSpec | None:
        """How the answer is stated; None: in the system of the options."""
        return self.stated_in or self.given_in

    def __post_init__(self) -> None:
        tables = self.tables()
        sizes = {name: table.count for name, table in tables.items()}
        for table in tables.values():
            table.check_links(sizes)

    def __repr__(self) -> str:
        """Return the first title, the main options, and how many rows each table has that has any."""
        options, title = self.options, self.titles[0][:_TITLE] if self.titles else ""
        sizes = [f"{name}={table.count}" for name, table in self.tables().items() if table.count]
        return f"Block({', '.join([repr(title), options.program, options.system, options.refraction, *sizes])})"

    def _repr_html_(self) -> str:
        """Return what a notebook shows of it."""
        return musatpy.to_html(self)

    def tables(self) -> dict[str, Table]:
        """Return the tables by their names."""
        values = {part.name: getattr(self, part.name) for part in fields(self)}
        return {name: value for name, value in values.items() if isinstance(value, Table)}

    @property
    def plate_sigmas(self) -> FloatArray:
        """(m, 2) mm, a priori: of the card, or the job's where it gives none, times the submerged factor."""
        sigma = np.where(np.isnan(self.plates.sigma), self.options.plate_sigma, self.plates.sigma)
        submerged = self.points.bathymetric[self.plates.point]
        return np.where(submerged[:, None], self.options.submerged_factor, 1.0) * sigma

    @property
    def raw(self) -> bool:
        """True where the plate coordinates are comparator readings, which have to be reduced."""
        return self.reduction is not None and self.reduction.plates is Plates.RAW


@lru_cache(maxsize=1)
def parts_of_block() -> MappingProxyType[str, type[Any]]:
    """Return the dataclasses that a block is made of, tables and others, by their names in it."""
    parts = {}
    for name, hint in typing.get_type_hints(Block).items():
        kind = typing.get_args(hint)[0] if isinstance(hint, UnionType) else hint
        if hasattr(kind, "__dataclass_fields__") and kind is not SystemSpec:
            parts[name] = kind
    return MappingProxyType(parts)


def linking(block: Block, name: str) -> dict[str, Table]:
    """Return the tables with a link to the table `name`, in the order of the block."""
    return {of: table for of, table in block.tables().items() if table.links_to(name)}


def in_order(block: Block) -> Block:
    """Return the block with its points as a deck has them: those that a card names, as they first appear."""
    tables = linking(block, "points")
    columns = [column for table in tables.values() for column in table.links_to("points").values()]
    links = np.concatenate([column.reshape(-1) for column in columns])
    first = np.full(len(block.points.ids), len(links))
    first[links[::-1]] = np.arange(len(links))[::-1]
    order = np.argsort(first, kind="stable")[: np.count_nonzero(first < len(links))]
    number = np.full(len(block.points.ids), -1)
    number[order] = np.arange(len(order))
    return with_tables(
        block,
        {name: renumbered(table, {"points": number}) for name, table in tables.items()}
        | {"points": taken(block.points, order)},
    )


def without_unused_cameras(block: Block) -> Block:
    """Return the block without cameras that took none of its photos, and what belongs to them."""
    used: BoolArray = np.isin(np.arange(len(block.cameras.ids)), block.photos.camera)
    number: IntArray = np.cumsum(used) - 1
    tables = {
        name: renumbered(taken(table, used[table.links_to("cameras")["camera"]]), {"cameras": number})
        for name, table in linking(block, "cameras").items()
    }
    return with_tables(block, tables | {"cameras": taken(block.cameras, used)})


def with_tables(block: Block, tables: dict[str, Table]) -> Block:
    """Return the block with some of its tables, by name, replaced."""
    return replace(block, **typing.cast(dict[str, Any], tables))


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
