"""Statistics against the tables they are of, where a listing has both: ours does, Tables 6-1 to 6-9 do not."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.listings.audit.analysis_checks import NAMES
from musatpy.listings.audit.analysis_tables import MAXIMUM_ID, SIZE
from musatpy.listings.audit.columns import Cells, number
from musatpy.listings.audit.headings import Title
from musatpy.listings.audit.job_options import INITIAL
from musatpy.listings.audit.misprints import Misprint, Suspect, range_like
from musatpy.listings.audit.plate_tables import AXES, GROUPS
from musatpy.listings.audit.quantities import within_half_circle
from musatpy.listings.audit.structures import Analysis, Component, Listing, PlateTable, Printed, Table
from musatpy.units import MICROMETRE

_GROUPS = {"triangulated": "trig", "not triangulated": "nontrig", "all": "all"}
_ALONG = {"Latitude": "North", "Longitude": "East", "Elevation": "Up"}  # columns of the control residuals
_OVERFLOW = re.compile(r"^\*{2,}$", re.M)  # one star is a mark
_LARGE = 3.0  # sigmas: beyond, a residual is starred
_ROUNDING = 1e-9


class Discrepancy(NamedTuple):
    """One difference of a sample, or one number of a table, with half the roundings that went into it."""

    value: float
    half: float


Sample = Mapping[str, Discrepancy]  # by id


class Squares(NamedTuple):
    """Squared residuals: how many there are, and their sum (um^2)."""

    number: int
    total: float


@dataclass(frozen=True, eq=False)
class _Residuals:
    """The residuals of plate measurements along an axis."""

    table: Table
    axis: str

    @cached_property
    def cells(self) -> Cells:
        """The residual of each row."""
        return self._cells(f"Resid. {self.axis}")

    @cached_property
    def sigmas(self) -> Cells:
        """The sigma of each row."""
        return self._cells(f"Sigma {self.axis}")

    @cached_property
    def is_whole(self) -> bool:
        """True where each row tells its photo, its kind and its residual."""
        return _whole(self.table, "Photo", "Trig", f"Resid. {self.axis}")

    @cached_property
    def squares(self) -> dict[tuple[str, str], Squares]:
        """The squares of each frame and kind."""
        photos = self.table.columns["Photo"]
        frames = {photo: n for n, photo in enumerate(dict.fromkeys(photos))}
        frame = np.array([frames[photo] for photo in photos], dtype=int)
        is_nontrig = np.array([kind == "N" for kind in self.table.columns["Trig"]], dtype=bool)
        values, _ = self.cells.numbers
        squares: dict[tuple[str, str], Squares] = {}
        for group, is_of_group in (("trig", ~is_nontrig), ("nontrig", is_nontrig), ("all", True)):
            rows = np.flatnonzero(np.isfinite(values) & is_of_group)
            counts = np.bincount(frame[rows], minlength=len(frames)).tolist()
            sums = np.bincount(frame[rows], values[rows] ** 2, len(frames)).tolist()
            squares |= {(photo, group): Squares(counts[n], sums[n]) for photo, n in frames.items()}
        return squares

    @cached_property
    def half(self) -> float:
        """The largest rounding of a residual, um."""
        _, halves = self.cells.numbers
        return float(np.max(halves[np.isfinite(halves)], initial=0.0))

    def _cells(self, heading: str) -> Cells:
        return self.table.columns.get(heading) or Cells([""] * len(self.table.lines))


def check_against_tables(listing: Listing) -> Iterator[Misprint]:
    """Yield statistics that are not those of the tables."""
    for analysis in listing.analyses:
        for component in analysis.components:
            sample = _sample(listing, analysis, component)
            if sample is not None:
                yield from _statistics(analysis, component, sample)
    printed_residuals = listing.table(Title.RESIDUALS)
    if printed_residuals is not None:
        residuals = [_Residuals(printed_residuals, axis) for axis in AXES]
        for table in listing.plates:
            yield from _plates(table, residuals)
        yield from _job(listing, residuals)
        yield from _large(printed_residuals, residuals)
    yield from _depths(listing)
    yield from _submerged_heights(listing)


def _column(table: Table | None, key: str, heading: str, ids: Set[str] | None = None) -> dict[str, Discrepancy]:
    """Return the numbers of a column by the ids of another, of all `ids`; empty where not both are whole."""
    if table is None or not _whole(table, key, heading):
        return {}
    values, halves = table.columns[heading].numbers
    rows = np.flatnonzero(np.isfinite(values)).tolist()
    names = table.columns[key].texts
    return {
        names[n]: Discrepancy(value, half)
        for n, value, half in zip(rows, values[rows].tolist(), halves[rows].tolist(), strict=True)
        if ids is None or names[n] in ids
    }


def _whole(table: Table, *headings: str) -> bool:
    """Tell whether a table has columns in which every cell is legible, and none has overflown."""
    if not set(headings) <= set(table.headings) - table.illegible:
        return False
    columns = (table.columns[heading] for heading in headings)
    return not any(column.decimals is None and _OVERFLOW.search("\n".join(column)) for column in columns)


def _sample(listing: Listing, analysis: Analysis, component: Component) -> Sample | None:
    """Return the differences that a column of an analysis is of; None where the listing does not show them."""
    name = component.name
    if listing.stated:
        return None
    if analysis.kind == "check point":
        return _column(listing.table(Title.CHECKS), "Point", name) or None
    if analysis.kind == "ground point":
        residuals = listing.table(Title.CONTROL)
        used = _column(residuals, "Point", _ALONG.get(name, name))
        if name not in _ALONG:
            return used or None
        adjusted, given = listing.table(Title.POINTS), listing.table(Title.GIVEN_CONTROL)
        return _differences(adjusted, given, "Point", component, set(used))
    if not listing.options.get(INITIAL, "").startswith("GIVEN"):
        return None
    is_position = analysis.kind == "station position"
    titles = (Title.POSITIONS, Title.INITIAL_POSITIONS) if is_position else (Title.ATTITUDES, Title.GIVEN_ATTITUDES)
    adjusted, given = (listing.table(title) for title in titles)
    return _differences(adjusted, given, "Photo", component, None)


def _differences(
    adjusted: Table | None, given: Table | None, key: str, component: Component, used: set[str] | None
) -> Sample | None:
    """Return adjusted minus given of the ids that both have, angles brought within half a circle."""
    before = _column(given, key, component.name)
    common = before.keys() if used is None else before.keys() & used
    after = _column(adjusted, key, component.name, common)
    sample = {}
    for name in (name for name in before if name in after):
        value = after[name].value - before[name].value
        if component.unit == "arcsec":
            value = within_half_circle(value)
        sample[name] = Discrepancy(value, after[name].half + before[name].half)
    return sample or None


def _statistics(analysis: Analysis, component: Component, sample: Sample) -> Iterator[Misprint]:
    N = len(sample)
    if component.size != N:
        line = analysis.lines.get(SIZE, analysis.line)
        message = f"a sample of {component.size}, the tables have {N} differences"
        yield Misprint(line, analysis.name, component.name, message)
        return
    half = max(difference.half for difference in sample.values())
    for name, value in _computed(sample).items():
        cell = component.statistics.get(name)
        # The error of a mean, RMS or deviation is at most that of a difference; the deviation's divisor is N - 1.
        reach = half * (N if name == "sum" else math.sqrt(N / (N - 1)) if name == "deviation" else 1.0)
        values = _largest(sample) if name == "maximum" else [value]
        if cell is not None and all(abs(cell.value - x) > cell.half + reach + _ROUNDING for x in values):
            suspect = Suspect.of(NAMES[name], cell, range_like(value - reach, value + reach, cell))
            message = "is not that of the tables"
            yield Misprint(cell.line, analysis.name, component.name, message, (suspect,))
    yield from _maximum_id(analysis, component, sample)


def _computed(sample: Sample) -> dict[str, float]:
    """Return the statistics of a sample, as docs/reports.md defines them."""
    d = [difference.value for difference in sample.values()]
    N, mean = len(d), math.fsum(d) / len(d)
    statistics = {
        "sum": math.fsum(d),
        "mean": mean,
        "rms": math.sqrt(math.fsum(value**2 for value in d) / N),
        "maximum": max(d, key=abs),
    }
    if N > 1:
        statistics["deviation"] = math.sqrt(math.fsum((value - mean) ** 2 for value in d) / (N - 1))
    return statistics


def _largest(sample: Sample) -> list[float]:
    """Return the differences each of which may be the largest, as far as they are printed: of either sign."""
    least = max(abs(difference.value) - difference.half for difference in sample.values())
    return [d.value for d in sample.values() if abs(d.value) + d.half >= least]


def _maximum_id(analysis: Analysis, component: Component, sample: Sample) -> Iterator[Misprint]:
    name = component.maximum_id
    if not name:
        return
    largest = max(sample, key=lambda point: abs(sample[point].value))
    named = sample.get(name)
    if named is None or abs(named.value) + named.half < abs(sample[largest].value) - sample[largest].half:
        message = f"the maximum is said to be at {name}, by the tables at {largest}"
        yield Misprint(analysis.lines[MAXIMUM_ID], analysis.name, component.name, message)


def _plates(table: PlateTable, residuals: Sequence[_Residuals]) -> Iterator[Misprint]:
    """Yield RMS of frames that are not those of the residuals."""
    for along in residuals:
        if not along.is_whole:
            return
        for group in GROUPS:
            for frame, cell in table.rms.get((group, along.axis), {}).items():
                squares = along.squares.get((frame, group), Squares(0, 0.0))
                item = f"{group}, {along.axis}"
                yield from _rms(table.name, f"frame {frame}", item, cell, squares, along.half, MICROMETRE)


def _job(listing: Listing, residuals: Sequence[_Residuals]) -> Iterator[Misprint]:
    """Yield numbers and RMS (um) of all residuals of a kind that are not those of the residuals."""
    table = listing.table(Title.JOB)
    for along in residuals:
        if table is None or not along.is_whole:
            return
        column = f"RMS {along.axis}"
        for line, cells in table.rows():
            points = cells.get("Points", "")
            group, item = _GROUPS.get(points, ""), f"{points} points"
            by_frame = [squares for (_, kind), squares in along.squares.items() if kind == group]
            squares = Squares(sum(frame.number for frame in by_frame), math.fsum(frame.total for frame in by_frame))
            count, cell = (number(cells.get(name, ""), line) for name in ("Number", column))
            if group and along.axis == AXES[0] and count is not None and count.value != squares.number:
                message = f"a number of {count.text}, the table of residuals has {squares.number}"
                yield Misprint(line, table.name, item, message)
            if group and cell is not None:
                yield from _rms(table.name, item, column, cell, squares, along.half, 1.0)


def _rms(
    table: str, item: str, what: str, cell: Printed, squares: Squares, half: float, scale: float
) -> Iterator[Misprint]:
    """Yield an RMS that is not that of residuals: their squares and rounding in um, `scale` the unit of the RMS."""
    value, reach = math.sqrt(squares.total / max(squares.number, 1)) * scale, half * scale
    if abs(cell.value - value) > cell.half + reach + _ROUNDING:
        suspect = Suspect.of(what, cell, range_like(max(value - reach, 0.0), value + reach, cell))
        yield Misprint(cell.line, table, item, "is not the RMS of the residuals", (suspect,))


def _large(table: Table, residuals: Sequence[_Residuals]) -> Iterator[Misprint]:
    """Yield residuals beyond three sigmas without a star, and stars of smaller ones."""
    if not {"Photo", "Point", "Large"} <= set(table.headings):
        return
    photos, points, marks = (table.columns[name] for name in ("Photo", "Point", "Large"))
    low, high = (np.max(ratios, axis=0) for ratios in zip(*map(_ratios, residuals), strict=True))
    starred = np.array([mark == "*" for mark in marks], dtype=bool)
    for row in np.flatnonzero(np.where(starred, high < _LARGE, low > _LARGE)).tolist():
        line = table.lines[row]
        if line not in table.illegible_cells:
            message = "starred, though within three sigmas" if starred[row] else "beyond three sigmas, not starred"
            yield Misprint(line, table.name, f"photo {photos[row]}, point {points[row]}", message)


def _ratios(residuals: _Residuals) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and largest |residual| / sigma (n,) that print as residuals and sigmas do."""
    size, half = residuals.cells.numbers
    sigma, half_sigma = residuals.sigmas.numbers
    size = np.abs(size)
    is_bounded = np.isfinite(size) & (sigma > half_sigma)
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = (size - half) / (sigma + half_sigma), (size + half) / (sigma - half_sigma)
    beyond = np.where(residuals.cells.is_blank, 0.0, math.inf)  # what is no number may be any
    return np.where(is_bounded, low, 0.0), np.where(is_bounded, high, beyond)


def _depths(listing: Listing) -> Iterator[Misprint]:
    """Yield predicted points that were not moved down by as much as their depths say."""
    depths = listing.table(Title.DEPTHS)
    straight = _column(depths, "Point", "Depth, no refr.")
    predicted = _column(depths, "Point", "Depth, predicted")
    for table in listing.submerged:
        for point in table.points:
            cells = [(point.xyz.get(("none", a)), point.xyz.get(("predicted", a))) for a in "XYZ"]
            pairs = [(a, b) for a, b in cells if a and b]
            if len(pairs) < 3 or point.name not in straight or point.name not in predicted:
                continue
            moved = math.dist([a.value for a, _ in pairs], [b.value for _, b in pairs])
            by_depth = abs(predicted[point.name].value - straight[point.name].value)
            # The roundings of the six coordinates, all in one direction, and of the two depths.
            half = math.sqrt(3.0) * (pairs[0][0].half + pairs[0][1].half) + 2.0 * predicted[point.name].half
            if abs(moved - by_depth) > half:
                message = f"predicted {moved:.1f} m from the position without refraction, by the depths "
                message += f"{by_depth:.1f} m"
                yield Misprint(pairs[0][0].line, table.name, f"point {point.name}", message)


def _submerged_heights(listing: Listing) -> Iterator[Misprint]:
    """Yield submerged points whose height is not the water level less the depth."""
    depths = listing.table(Title.DEPTHS)
    names = ("Water level", "Depth, refraction", "Height")
    level, depth, height = (_column(depths, "Point", name) for name in names)
    for point in height.keys() & level.keys() & depth.keys():
        cells = level[point], depth[point], height[point]
        by_depth = level[point].value - depth[point].value
        if depths is not None and abs(by_depth - height[point].value) > sum(cell.half for cell in cells):
            points, heights = depths.columns["Point"], depths.columns["Height"]
            text = next(
                text for name, text in zip(points[::-1], heights[::-1], strict=True) if name == point and text
            )
            message = f"height {text}, by water level and depth {by_depth:.3f}"
            yield Misprint(depths.lines[points.index(point)], depths.name, f"point {point}", message)
