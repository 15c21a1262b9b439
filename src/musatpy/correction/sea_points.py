"""Points corrected by their sea: through an estimated surface of the water, or by errors at control points.

A point that cannot be corrected keeps its apparent place, has no true place, and has a reason, in any format.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import ClassVar

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.correction.layers import BARE, NAMED, CorrectedPoints, correct_layers, kind_of, read_heights
from musatpy.errors import CollocationError, Problem, ProblemsError, SeaError
from musatpy.files import whole_file
from musatpy.geometry.crs import MapPlan, system_of
from musatpy.geometry.projected import Projected, crs_of
from musatpy.geometry.systems import System
from musatpy.interchange.any_file import RASTERS, write_layers
from musatpy.interchange.layers import LOCAL, Grid, placed
from musatpy.pointfiles.columns import AXES, Wanted, place_columns
from musatpy.pointfiles.las_files import SUFFIXES, coordinates, rewritten
from musatpy.pointfiles.point_tables import ENCODING, quoted, read_chunks
from musatpy.records.json_files import read_record
from musatpy.records.run_tables import SYSTEM, level_positions
from musatpy.records.tables import flags, numbers
from musatpy.refraction.apparent import Fault
from musatpy.sea.interpolation.interpolate import Interpolation
from musatpy.sea.stereo import through
from musatpy.sea.stereo.point_records import ID, SIGMA, SIGMA_COLUMNS, PointPrecision, is_wanted
from musatpy.sea.stereo.surface_points import FittedSurface

Outcome = tuple[FloatArray, IntArray, Sequence[FloatArray]]  # true places, faults, and other columns
Progress = Callable[[int], None]  # told how much more of a file is done
_TRUE = ("true_x", "true_y", "true_z")
_SIGMAS = dict.fromkeys(("sigma_east", "sigma_north", "sigma_height"), "of the true place, m")
_NO_CONTROL = 11
_PART = 16384  # points at a time


@dataclass(frozen=True, kw_only=True, eq=False)
class SeaCorrection:
    """What corrects points of a system, and how many have come of it by their reasons; '' of those corrected.

    `added`: columns, and what they are.
    """

    system: System
    counts: Counter[str] = field(default_factory=Counter)
    error: ClassVar[type[ProblemsError]] = SeaError
    added: ClassVar[Mapping[str, str]] = {}
    inputs: ClassVar[tuple[str, ...]] = ()  # columns of sigmas that a table may have

    @property
    def reasons(self) -> Mapping[int, str]:
        """Why points are not corrected."""
        return through.REASONS

    @property
    def columns(self) -> list[str]:
        """What a table gets."""
        return [*_TRUE, *self.added]

    def __call__(
        self, points: FloatArray, covariance: FloatArray | None = None, why: Mapping[int, str] | None = None
    ) -> tuple[CorrectedPoints, list[str]]:
        """Return what comes of any points (n, 3), and the reasons of those lost; `why` rows are NaN."""
        n = len(points)
        covariance = np.full((n, 3, 3), np.nan) if covariance is None else covariance
        true, fault = np.full((n, 3), np.nan), np.full(n, Fault.NOT_FINITE, dtype=np.int64)
        columns = {name: np.full(n, np.nan) for name in self.added if name != "reason"}
        known = np.flatnonzero(np.isfinite(points).all(axis=1))
        for rows in np.array_split(known, -(-len(known) // _PART)) if len(known) else ():
            true[rows], fault[rows], values = self.corrected(points[rows], covariance[rows])
            for column, part in zip(columns.values(), values, strict=True):
                column[rows] = part
        reasons = [self.reasons[number] for number in fault.tolist()]
        for row, reason in (why or {}).items():
            reasons[row] = reason
        self.counts.update(reasons)
        return CorrectedPoints(true=true, fault=fault, columns=columns), reasons

    def corrected(self, points: FloatArray, covariance: FloatArray) -> Outcome:
        """Return true places, faults and the columns of finite points (n, 3), covariance (n, 3, 3) m2 or NaN."""
        raise NotImplementedError

    def require_need(self, source: Path) -> None:
        """Raise the error of the correction where something was given that no point of a file needs."""

    def texts(self, points: CorrectedPoints, reasons: Sequence[str]) -> Iterator[list[str]]:
        """Yield what a table gets of each point."""
        forms = {name: f"%.{places}f" for name, places in zip(_TRUE, self.system.decimals, strict=True)}
        values = dict(zip(_TRUE, points.true.T, strict=True)) | dict(points.columns)
        texts = {
            name: ["" if np.isnan(value) else forms.get(name, "%.4f") % value for value in column.tolist()]
            for name, column in values.items()
        }
        texts["reason"] = [quoted(reason) for reason in reasons]
        return map(list, zip(*(texts[name] for name in self.columns), strict=True))

    def lines(self) -> list[str]:
        """Return what has come of the points in words."""
        lines = [f"{self.counts.total()} points, {self.counts['']} corrected"]
        return lines + [f"{count} not: {reason}" for reason, count in self.counts.items() if reason]


@dataclass(frozen=True, kw_only=True, eq=False)
class ThroughSurface(SeaCorrection):
    """Apparent points of a pair of stations (2, 3) seen through a surface, on a map or in local coordinates."""

    fitted: FittedSurface
    stations: FloatArray
    index: float
    precision: PointPrecision
    source: str  # file of the stations
    map: Projected | None = None
    lacking: list[int] = field(default_factory=list)  # points without sigmas of their own
    added: ClassVar[Mapping[str, str]] = {
        "depth": "below the level of the water, m",
        "parallax": "in air, made by the waves, m",
        "reason": "0 corrected, else why not",
        **_SIGMAS,
        "sigma_surface": "part of it by the surface, m",
    }
    inputs = SIGMA

    def require_need(self, source: Path) -> None:
        """Raise `SeaError` where sigmas were given besides those of all points."""
        if self.precision.is_known and self.lacking and not any(self.lacking):
            message = "its points have sigmas, and sigmas are given too: no point is without its own"
            raise SeaError([Problem(file=str(source), message=message)])

    def corrected(self, points: FloatArray, covariance: FloatArray) -> Outcome:
        """Return true places, faults, depths, parallaxes and sigmas; without a covariance by the precision."""
        plan = None if self.map is None else MapPlan(system=self.system, map=self.map)
        apparent = points if plan is None else plan.places(points)
        unknown = np.isnan(covariance[:, 0, 0])
        self.lacking.append(int(np.count_nonzero(unknown)))
        given = self.precision.covariance(apparent[unknown], plan)
        covariance[unknown] = np.nan if given is None else given
        try:
            seen = through.correct(self.fitted, self.stations, apparent, covariance, self.index, plan)
        except ValueError as error:
            raise SeaError([Problem(file=self.source, message=str(error))]) from error
        true, good = seen.position.copy(), seen.fault == Fault.NONE
        if plan is not None:
            true[good] = plan.coordinates(true[good])
        values = (self.fitted.level - seen.position[:, 2], seen.parallax, *seen.sigma.T, seen.surface_sigma)
        return true, seen.fault.astype(np.int64), values


@dataclass(frozen=True, kw_only=True, eq=False)
class ByControl(SeaCorrection):
    """Heights less the errors that are interpolated between control points, on the map of a plan if any."""

    interpolation: Interpolation
    plan: MapPlan | None = None
    squares: list[float] = field(default_factory=list)  # m2, sums of corrections
    error = CollocationError
    added: ClassVar[Mapping[str, str]] = {
        "correction": "of the height, m",
        "reason": "0 corrected, else why not",
        "sigma_height": _SIGMAS["sigma_height"],
    }

    @property
    def reasons(self) -> Mapping[int, str]:
        """Why points are not corrected."""
        return {**through.REASONS, _NO_CONTROL: f"no control within {self.interpolation.reach:.1f} m"}

    def corrected(self, points: FloatArray, covariance: FloatArray) -> Outcome:
        """Return true places, faults, corrections of heights and their sigmas."""
        places = points if self.plan is None else self.plan.places(points)
        predicted = self.interpolation.uncertain.predict(places[:, :2])
        far = predicted.distance > self.interpolation.reach
        values = np.stack([-predicted.value, self.interpolation.sigma(predicted)])
        values[:, far] = np.nan
        self.squares.append(float(np.nansum(np.square(values[0]))))
        true = points + np.outer(values[0], [0.0, 0.0, 1.0])
        true[far] = np.nan
        return true, np.where(far, _NO_CONTROL, Fault.NONE), list(values)

    def lines(self) -> list[str]:
        """Return what has come of the points in words."""
        first, *more = super().lines()
        size = (sum(self.squares) / max(self.counts[""], 1)) ** 0.5
        return [f"{first}, by {size:.3f} m RMS", *more]


def correct_by_sea(
    source: Path,
    target: Path,
    correction: SeaCorrection,
    *,
    columns: Sequence[str] = AXES,
    only: Sequence[str] = (),
    crs: str | None = None,
    layer: str = "",
    band: str = "",
    progress: Progress | None = None,
) -> None:
    """Correct the points of a file, and write them in the format that the target's suffix says.

    `only`: patterns of the ids of a table or a record; others as `correct_file` has them. The record of a run is
    written as a table. Raises the error of the correction for what cannot be read, `InterchangeError`,
    `SystemsError` and `OSError`; then nothing is written.
    """
    kind = kind_of(source, target)
    if source.suffix.lower() == ".json":
        _correct_record(source, target, correction, only)
    elif kind == SUFFIXES:
        _correct_cloud(source, target, correction, progress)
    elif kind in (NAMED, BARE):
        _correct_table(source, target, correction, columns, only, progress)
    else:
        _correct_layers(source, target, correction, columns, crs, layer, band)


def _correct_table(
    source: Path,
    target: Path,
    correction: SeaCorrection,
    columns: Sequence[str],
    only: Sequence[str],
    progress: Progress | None,
) -> None:
    places = place_columns(columns, correction.system.units)
    wanted = Wanted(
        columns=(*((ID,) if only else ()), *places, *(SIGMA_COLUMNS if correction.inputs else ())),
        together=(SIGMA,) if correction.inputs else (),
        bare=tuple(columns),
        added=tuple(correction.columns),
    )
    tables = read_chunks(source, wanted, correction.error)
    first = next(tables)
    with whole_file(target) as out:
        out.write(first.layout.header_with(correction.columns).encode(**ENCODING))
        for table in chain([first], tables):
            names = table.texts("id") if only else [""] * len(table.rows)
            kept = [row for row, name in enumerate(names) if is_wanted(name, only)]
            if kept:
                given = table.numbers(*(place.name for place in places))[kept]
                covariance = np.square(table.numbers(*SIGMA)[kept])[:, :, None] * np.eye(3)
                points, reasons = correction(given, covariance)
                rows = [table.rows[row] for row in kept]
                out.write(table.layout.rows_with(rows, correction.texts(points, reasons)).encode(**ENCODING))
            if progress:
                progress(table.size)
        correction.require_need(source)


def _correct_cloud(source: Path, target: Path, correction: SeaCorrection, progress: Progress | None) -> None:
    added = {f"apparent_{axis}": ("f8", "before the correction") for axis in AXES}
    added |= {name: ("u1" if name == "reason" else "f4", what) for name, what in correction.added.items()}
    with rewritten(source, target, added) as (chunks, write):
        for given in chunks:
            apparent = coordinates(given)
            points, _ = correction(apparent)
            place = np.where(points.good[:, None], points.true, apparent)
            values = {**dict(zip(AXES, place.T, strict=True)), **points.columns, "reason": points.fault}
            write(given, values | {f"apparent_{axis}": given[axis] for axis in AXES})
            if progress:
                progress(len(given))


def _correct_record(source: Path, target: Path, correction: SeaCorrection, only: Sequence[str]) -> None:
    """Write a table of the points of a record; where only heights are corrected, of those under water."""
    system, record = correction.system, read_record(source, (*SYSTEM, "points"))
    table = record["points"]
    kept = [row for row, name in enumerate(table["point"]) if is_wanted(name, only)]
    position, covariance = numbers(table, "position", 3)[kept], None
    known = np.isfinite(position).all(axis=1)
    position[known] = system.coordinates(level_positions(record, position[known]))
    why = {
        row: f"not determined: {table['reason'][kept[row]] or 'no position'}"
        for row in np.flatnonzero(~known).tolist()
    }
    apparent = position.copy()
    if correction.inputs:
        covariance = numbers(table, "covariance", 3, 3)[kept]
    else:
        dry = np.flatnonzero(known & ~flags(table, "bathymetric")[kept])
        apparent[dry] = np.nan
        why |= dict.fromkeys(dry.tolist(), "not under water")
    texts = correction.texts(*correction(apparent, covariance, why))
    correction.require_need(source)
    lines = [",".join(["id", *AXES, *correction.columns])]
    for row, place, values in zip(kept, position.tolist(), texts, strict=True):
        given = ["" if np.isnan(v) else f"{v:.{d}f}" for v, d in zip(place, system.decimals, strict=True)]
        lines.append(",".join([quoted(table["point"][row]), *given, *values]))
    with whole_file(target) as out:
        out.write("".join(f"{line}\n" for line in lines).encode(**ENCODING))


def _correct_layers(
    source: Path,
    target: Path,
    correction: SeaCorrection,
    columns: Sequence[str],
    crs: str | None,
    layer: str,
    band: str,
) -> None:
    """Correct what is read whole; a raster becomes one of the true places of its posts, or their points."""
    ellipsoid = correction.system.ellipsoid
    stand_in = crs_of(crs or LOCAL) if crs or ellipsoid is None else None
    layers, stated = read_heights(source, stand_in, layer, columns, band)
    if ellipsoid is not None and stated is not None and not crs:
        correction = replace(correction, system=system_of(stated.to_wkt(), ellipsoid))
    layers = {name: replace(part, crs=placed(stand_in) or stated) for name, part in layers.items()}
    grid = next(iter(layers.values()))
    if isinstance(grid, Grid) and target.suffix.lower() in RASTERS:
        (heights,) = grid.bands.values()
        points, _ = correction(np.column_stack([grid.posts.places(0, grid.shape[0]), heights.ravel()]))
        values = {"apparent": heights, **dict(zip(_TRUE, points.true.T, strict=True)), **points.columns}
        values["reason"] = points.fault.astype(float)
        bands = {name: np.reshape(band, heights.shape) for name, band in values.items()}
        units = dict.fromkeys(("apparent", *points.columns), "m")
        write_layers(target, {"grid": replace(grid, bands=bands, units=units)})
        return
    numbered = target.suffix.lower() in (*SUFFIXES, *BARE)
    write_layers(
        target, correct_layers(layers, lambda xyz: correction(xyz)[0], correction.reasons, numbered=numbered)
    )
