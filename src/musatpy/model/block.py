"""The block: everything that a deck says, and nothing else; and the same in the order of its identifiers.

Its tables are here too: cameras, exposure stations, ground points, what was measured on the plates, what is known
besides; those of the water and of the reduction stand apart.
"""

from __future__ import annotations

import re
import typing
from collections.abc import Iterable
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from functools import lru_cache, partial
from types import MappingProxyType, UnionType
from typing import Any

import numpy as np

import musatpy
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.model.correlations import LEAST_EIGENVALUE, correlations_of, smallest_eigenvalues
from musatpy.model.kinds import TablesOfKinds, with_tables_from_outside
from musatpy.model.options import EllipsoidSpec, Options, OrientationSpec, SystemSpec
from musatpy.model.reduction import (
    ComparatorSpec,
    CrossMeasurements,
    Lenses,
    MarkDistances,
    Plates,
    ReductionOptions,
    ReseauCrosses,
)
from musatpy.model.tables import POSITION_UNIT, Table, columns, empty, parts_of, per_row, renumbered, taken
from musatpy.model.water import Water, WaveOrigin, Waves

_TITLE = 80  # characters of a title that are shown
FOCAL_LENGTHS = (85.0, 88.5, 100.0, 115.0, 152.5, 210.0, 305.0, 610.0)  # mm, of aerial cameras
_ONE_TYPE = 0.02  # relative difference of focal lengths of one type of camera


def other_focal_length(focal: float, ratio: float, same: float) -> float:
    """Return the focal length (mm) of another type of camera that makes everything `ratio` times as wide, else 0.

    `focal` is the one given; ratios that differ from 1 by less than `same` are those of the camera itself.
    """
    if not abs(ratio - 1.0) > same:
        return 0.0
    others = (other for other in FOCAL_LENGTHS if abs(focal / ratio / other - 1.0) < max(_ONE_TYPE, 0.5 * same))
    return min(others, key=lambda other: abs(focal / ratio / other - 1.0), default=0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Cameras(Table):
    """c cameras; plate millimetres. The image vector is (x - xp, y - yp, -f)."""

    ids: TextArray = per_row(identity=True, key=True)  # (c,)
    focal_length: FloatArray = per_row(unit="mm")  # (c,)
    principal_point: FloatArray = per_row(2, unit="mm")  # (c, 2)
    format_size: FloatArray = per_row(2, unit="mm")  # (c, 2) NaN where not given


@dataclass(frozen=True, kw_only=True, eq=False)
class Distortion(Table):
    """d records of lens distortion, in the order of the deck, each of one kind and with three values.

    Kinds: `RADL` coefficients k1, k2, k3 of the odd radial polynomial, `DCEN` decentring p1, p2, p3, `TABL` one
    calibrated radius (mm) and its distortion (mm), the third value NaN.
    """

    camera: IntArray = per_row(link="cameras")  # (d,) link to Cameras
    kind: TextArray = per_row(sort=True)  # (d,)
    values: FloatArray = per_row(3, sort=True)  # (d, 3), NaN where not given


@dataclass(frozen=True, kw_only=True, eq=False)
class Fiducials(Table):
    """q calibrated fiducial marks of cameras, millimetres."""

    camera: IntArray = per_row(link="cameras", key=True)  # (q,) link to Cameras
    ids: TextArray = per_row(key=True, sort=True)  # (q,)
    xy: FloatArray = per_row(2, unit="mm")  # (q, 2)
    sigma: FloatArray = per_row(2, unit="mm")  # (q, 2) NaN where not given


@dataclass(frozen=True, kw_only=True, eq=False)
class Photos(Table):
    """n photos, in the order of their station cards.

    Positions stand in the coordinate system of the job (`CoordinateSystem`): geographic ones are latitude and
    longitude in radians and ellipsoidal height in metres. Sigmas of positions are along east, north, up (X, Y, Z in
    local jobs), in metres, whatever the system. Attitudes are X-tilt, Y-tilt, heading (omega, phi, kappa), rad, in
    the local vertical frame of the given position. A sigma that is NaN means: not observed, approximate only.
    Positions and attitudes are NaN where initial values are to be computed and no card gives any.
    The tide is the height of the water surface at the exposure (ellipsoidal height, or Z in local jobs).
    """

    ids: TextArray = per_row(identity=True, key=True)  # (n,)
    camera: IntArray = per_row(link="cameras", role="stations")  # (n,) link to Cameras
    position: FloatArray = per_row(3, role="stations", unit=POSITION_UNIT)  # (n, 3) in the job's system
    position_sigma: FloatArray = per_row(  # (n, 3) east north up
        3, role="stations", noun="standard deviations of the position", unit="m", blank=np.nan
    )
    attitude: FloatArray = per_row(3, role="attitudes", unit="rad")  # (n, 3)
    attitude_sigma: FloatArray = per_row(  # (n, 3)
        3, role="attitudes", noun="standard deviations of the attitude", unit="rad", blank=np.nan
    )
    tide: FloatArray = per_row(role="tides", blank=np.nan, unit="m")  # (n,) NaN where not given
    tide_sigma: FloatArray = per_row(role="tides", blank=np.nan, unit="m")  # (n,) NaN where not given
    tide_group: TextArray = per_row(role="tides", blank="")  # (n,) photos with a common correction; empty: none
    tide_day: TextArray = per_row(role="tides", blank="")  # (n,) day of the exposure; empty: not given
    time: FloatArray = per_row(role="tides", blank=np.nan, unit="s")  # (n,) of the exposure, on one clock


@dataclass(frozen=True, kw_only=True, eq=False)
class Points(Table):
    """p points, in the order of their first appearance in the deck (plate cards before control cards)."""

    ids: TextArray = per_row(identity=True)  # (p,)
    bathymetric: BoolArray = per_row(codes={"": False, "B": True}, noun="submerged flag", blank=False)  # (p,)
    # (p,) for certain, though the point may lie below the water: behind a dike, in a polder or a sump
    dry: BoolArray = per_row(codes={"": False, "D": True}, noun="flag of certainly dry points", blank=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.bathymetric & self.dry).any():
            raise ValueError("points that are submerged and dry")

    @property
    def letters(self) -> TextArray:
        """(p,) the flags as cards have them: B submerged, D dry for certain, blank neither."""
        return np.where(self.bathymetric, "B", np.where(self.dry, "D", ""))


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateMeasurements(Table):
    """m plate measurements, in the order of the deck."""

    photo: IntArray = per_row(link="photos", key=True)  # (m,) link to Photos
    point: IntArray = per_row(link="points", key=True)  # (m,) link to Points
    xy: FloatArray = per_row(2, sort=True, unit="mm")  # (m, 2)
    sigma: FloatArray = per_row(2, noun="standard deviations", unit="mm", blank=np.nan)  # (m, 2) NaN: the job's
    triangulated: BoolArray = per_row(codes={"": True, "N": False}, blank=True)  # (m,) False: kept out

    def first_readings(self) -> BoolArray:
        """Return (m,) True for the first measurement of each point on a photo: raw plates may have several."""
        first = np.zeros(len(self.photo), dtype=bool)
        first[np.unique(np.stack([self.photo, self.point]), axis=1, return_index=True)[1]] = True
        return first


@dataclass(frozen=True, kw_only=True, eq=False)
class FiducialMeasurements(Table, noun="fiducial mark"):
    """r measured fiducial marks, in the order of the deck, in the measuring system of the plate."""

    photo: IntArray = per_row(link="photos", key=True)  # (r,) link to Photos
    ids: TextArray = per_row(key=True, sort=True)  # (r,) id of the mark on the camera
    xy: FloatArray = per_row(2, sort=True, unit="mm")  # (r, 2)
    sigma: FloatArray = per_row(2, unit="mm")  # (r, 2) NaN where not given


class ControlKind(IntEnum):
    """Which components of a control point are known to the adjustment."""

    FULL = 0
    HORIZONTAL = 1
    VERTICAL = 2
    CHECK = 3  # none: compared with the result only


def known_of_kinds(kinds: IntArray) -> BoolArray:
    """Return (k, 3) which components east, north, up of control points are known by their kinds (k,)."""
    plan, up = (np.isin(kinds, (kind, ControlKind.FULL)) for kind in (ControlKind.HORIZONTAL, ControlKind.VERTICAL))
    return np.stack([plan, plan, up], axis=-1)


_LETTERS = {
    "": ControlKind.CHECK,
    "F": ControlKind.FULL,
    "H": ControlKind.HORIZONTAL,
    "V": ControlKind.VERTICAL,
    "C": ControlKind.CHECK,
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Control(Table, noun="control point"):
    """k control points.

    Positions stand in the coordinate system of the job (see `Photos`), NaN in components that the card leaves
    blank; sigmas are along east, north, up (X, Y, Z in local jobs), metres. A `fixed` point holds its known
    components without error, whatever its sigmas. A card of covariances gives sigmas and correlations.
    """

    point: IntArray = per_row(link="points", key=True)  # (k,) link to Points
    position: FloatArray = per_row(3, sort=True, role="control", unit=POSITION_UNIT)  # (k, 3) in the job's system
    kind: IntArray = per_row(sort=True, role="control", codes=_LETTERS)  # (k,) ControlKind
    fixed: BoolArray = per_row(role="control", codes={"": False, "X": True}, noun="fixed flag", blank=False)  # (k,)
    sigma: FloatArray = per_row(  # (k, 3) east north up, or NaN
        3, noun="standard deviations", unit="m", blank=np.nan
    )
    correlation: FloatArray = per_row(  # (k, 3) east north, east up, north up; NaN without a card of covariances
        3, role="control_covariances", noun="correlations", blank=np.nan
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        known = self.correlation[self.correlated]
        if len(known) and (smallest_eigenvalues(known) < LEAST_EIGENVALUE).any():
            raise ValueError("correlations of control that make no positive definite matrix")

    @property
    def known(self) -> BoolArray:
        """(k, 3) True where the east, north, up component enters the adjustment."""
        return known_of_kinds(self.kind)

    @property
    def correlated(self) -> BoolArray:
        """(k,) True where correlations count: not of what is fixed, nor where the height alone is known."""
        given = np.isfinite(self.correlation).all(axis=1) & np.isfinite(self.sigma).all(axis=1)
        return np.asarray(given & ~self.fixed & (self.kind != ControlKind.VERTICAL))

    @property
    def covariance(self) -> FloatArray:
        """(k, 3, 3) m2, of east, north, up; zero for a sigma that is not given."""
        sigma, known = np.nan_to_num(self.sigma), self.correlated
        R = correlations_of(np.where(known[:, None], self.correlation, 0.0)) if known.any() else np.eye(3)
        return sigma[:, :, None] * sigma[:, None, :] * R


@dataclass(frozen=True, kw_only=True, eq=False)
class EqualElevations(Table):
    """g groups of points that share one unknown level (a shore line, a lake), and their members."""

    ids: TextArray = per_row(identity=True)  # (g,)
    sigma: FloatArray = per_row(unit="m")  # (g,) of each point about the level
    group: IntArray = per_row(link="equal_elevations", rows="members")  # (e,) link to ids
    point: IntArray = per_row(link="points", rows="members")  # (e,) link to Points

    def with_members(self, stays: BoolArray) -> EqualElevations:
        """Return the groups with some of their members (e,), without the groups that have none left."""
        group, point = self.group[stays], self.point[stays]
        used = np.isin(np.arange(len(self.ids)), group)
        number = np.cumsum(used) - 1
        return EqualElevations(ids=self.ids[used], sigma=self.sigma[used], group=number[group], point=point)


@dataclass(frozen=True, kw_only=True, eq=False)
class AirBases(Table):
    """b known distances between two exposure stations."""

    photo: IntArray = per_row(2, link="photos")  # (b, 2) links to Photos
    length: FloatArray = per_row(unit="m")  # (b,)
    sigma: FloatArray = per_row(unit="m")  # (b,)


@dataclass(frozen=True, kw_only=True, eq=False)
class Distances(Table):
    """d measured distances between two ground points, along the straight line (IIIA)."""

    point: IntArray = per_row(2, link="points")  # (d, 2) links to Points
    length: FloatArray = per_row(unit="m")  # (d,)
    sigma: FloatArray = per_row(unit="m")  # (d,)


@dataclass(frozen=True, kw_only=True, eq=False)
class HeightDifferences(Table):
    """d measured height differences between two ground points, the second minus the first (IIIA)."""

    point: IntArray = per_row(2, link="points")  # (d, 2) links to Points
    difference: FloatArray = per_row(unit="m")  # (d,)
    sigma: FloatArray = per_row(unit="m")  # (d,)


@dataclass(frozen=True, kw_only=True, eq=False)
@with_tables_from_outside
class Block(TablesOfKinds):
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
    return with_rows(block, {"cameras": np.isin(np.arange(block.cameras.count), block.photos.camera)})


def with_rows(block: Block, stays: dict[str, BoolArray]) -> Block:
    """Return the block with the rows of tables, by name, that stay, and those of others that need no other rows.

    They link to rows that stay alone, and are named by those that have to (`used_by`).
    """
    numbers, tables = {name: np.cumsum(rows) - 1 for name, rows in stays.items()}, block.tables()
    for name, table in tables.items():
        links = [stays[to][rows] for to in stays for rows in table.links_to(to).values()]
        kept = [rows.all(axis=tuple(range(1, rows.ndim))) for rows in links]
        kept += [stays[name]] if name in stays else []
        if kept and isinstance(table, EqualElevations):
            table = table.with_members(np.all(kept, axis=0))
        elif kept:
            table = taken(table, np.all(kept, axis=0))
        tables[name] = renumbered(table, numbers)
    for name, table in tables.items():
        for column, about in columns(type(table)).items():
            if about.used_by:
                other, _, names = about.used_by.partition(".")
                tables[name] = taken(table, np.isin(getattr(table, column), getattr(tables[other], names)))
    return with_tables(block, tables)


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
    return parts_of(values)


def _ranks(order: IntArray) -> IntArray:
    """Return where each row comes in an order."""
    ranks = np.empty(len(order), dtype=np.int64)
    ranks[order] = np.arange(len(order))
    return ranks
