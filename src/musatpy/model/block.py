"""The block: everything that a deck says, and nothing else."""

from __future__ import annotations

import typing
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache, partial
from types import MappingProxyType, UnionType
from typing import Any

import numpy as np

import musatpy
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.model.control import AirBases, Control, Distances, EqualElevations, HeightDifferences
from musatpy.model.options import EllipsoidSpec, Options, SystemSpec
from musatpy.model.orientation import OrientationSpec
from musatpy.model.photos import (
    Cameras,
    Distortion,
    FiducialMeasurements,
    Fiducials,
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
from musatpy.model.tables import Table, empty, renumbered, taken
from musatpy.model.water import Water
from musatpy.model.waves import WaveOrigin, Waves

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
