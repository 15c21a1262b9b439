"""Analyses of stations, ground points and check points: read, and do the statistics of each column agree?

Statistics of one sample of N differences d say about one another, roundings included:

    m = S / N,   D^2 = N / (N - 1) (R^2 - m^2),   |m| <= R <= |X|,   N R^2 >= X^2 + (S - X)^2 / (N - 1)

with sum S, mean m, RMS R, standard deviation from the mean D and the signed difference X of the largest magnitude.
The last one holds because the N - 1 others have the sum S - X (Cauchy and Schwarz). Numbers are intervals (low,
high): what rounds to the printed one.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from musatpy.listings.audit import report
from musatpy.listings.audit.cells import Kind, read_cells
from musatpy.listings.audit.scan import Excerpt, Notes, rows_of, says
from musatpy.listings.lines import PrintedLine

Interval = tuple[float, float]
_SLACK = 1e-9  # relative: a number exactly between two prints may have gone either way
_STEPS = 60  # of the search for the smallest sum of squares, which halves its error in each
SIZE, MAXIMUM_ID = "size", "maximum at"
# Statistic -> its label. The row of the id is looked for first: its label contains that of another.
LABELS = {
    MAXIMUM_ID: "|".join(
        f"{what} with {most} Difference" for what in ("Camera", "Point") for most in ("Max", "Maximum")
    ),
    SIZE: "Sample Size",
    "sum": "Sum of Differences",
    "mean": "Mean Value of Differences",
    "rms": "RMS of Differences",
    "deviation": "Standard Deviation from Mean",
    "maximum": "Maximum Difference",
}
# Statistic -> what messages call it.
STATISTICS = {"sum": "sum", "mean": "mean", "rms": "RMS", "deviation": "standard deviation", "maximum": "maximum"}
_GEOGRAPHIC = (("Latitude", "arcsec"), ("Longitude", "arcsec"), ("Elevation", "m"))
_ATTITUDE = (("X-Tilt", "arcsec"), ("Y-Tilt", "arcsec"), ("Heading", "arcsec"))
_METRIC = re.compile(r"\b(East|North|Up|Elev|X|Y|Z)\b\.?\s*\(M\)", re.I)
_FULL = {"Elev": "Elevation"}


def read_analysis(excerpt: Excerpt, notes: Notes) -> report.StandardReport | None:
    """Return the analysis below a title (ETL-0306, Tables 6-1 to 6-3 and 6-5 to 6-7).

    None where no row of one is there, or neither the title nor the headings tell the names of its columns.
    """
    rows = rows_of(excerpt, LABELS, notes)
    columns = _components(excerpt)
    if not rows or columns is None:
        if rows:
            wanted = "Latitude, Longitude, Elevation or X, Y, Z or East, North, Up (M)"
            notes.lost(excerpt.lines[0], f"no row '{wanted}' is legible below")
        return None
    cells: dict[tuple[str, str], report.PrintedNumber] = {}
    for statistic in (SIZE, *STATISTICS, MAXIMUM_ID):
        filled = [column for column in columns if _is_printed(statistic, column[0], cells)]
        if statistic not in rows or not filled:
            continue
        line, text = rows[statistic]
        by_unit: dict[str, Kind] = {"arcsec": "angle", "m": "number"}
        own: dict[str, Kind] = {SIZE: "count", MAXIMUM_ID: "id"}
        kinds = [own.get(statistic, by_unit[unit]) for _, unit in filled]
        texts = notes.cells(line, text, kinds, statistic, None if statistic in own else _places(rows, kinds))
        for (name, unit), cell in zip(filled, texts, strict=False):
            if statistic == SIZE:
                cells[name, SIZE] = report.PrintedNumber(int(cell), 0.0, cell, line.number)
            elif statistic == MAXIMUM_ID:
                cells[name, MAXIMUM_ID] = report.printed_id(cell, line.number)
            else:
                cells[name, statistic] = report.printed(cell, line.number, unit)
    order = [name for name, _ in columns]
    cells = dict(sorted(cells.items(), key=lambda cell: order.index(cell[0][0])))
    return report.StandardReport(
        name=f"{excerpt.kind} analysis", refracted=excerpt.refracted, line=excerpt.lines[0].number, cells=cells
    )


def _components(excerpt: Excerpt) -> Sequence[tuple[str, str]] | None:
    """Return name and unit of each column; None where neither the title nor the headings tell."""
    if excerpt.kind == "station attitude":
        return _ATTITUDE
    if says(excerpt, "Degrees Minutes"):
        return _GEOGRAPHIC
    for line in excerpt.lines:
        if {"latitude", "longitude"} <= set(re.findall(r"[a-z]+", line.text.lower())):
            return _GEOGRAPHIC
        headings = [match.capitalize() for match in _METRIC.findall(line.text)]
        if len(headings) == 3:
            return [(_FULL.get(name, name), "m") for name in headings]
    return None


def _is_printed(statistic: str, name: str, cells: Mapping[tuple[str, str], report.PrintedNumber]) -> bool:
    """Tell whether a column has a statistic.

    A sample of none has none, one of one no deviation, and a maximum that prints as zero no id.
    """
    size, maximum = cells.get((name, SIZE)), cells.get((name, "maximum"))
    least = {SIZE: 0, "deviation": 2}.get(statistic, 1)
    return (not size or size.value >= least) and (statistic != MAXIMUM_ID or not maximum or maximum.value != 0.0)


def _places(rows: dict[str, tuple[PrintedLine, str]], kinds: list[Kind]) -> list[int | None]:
    """Return how many decimals the cells of each column have, by most of the rows."""
    columns: list[Counter[int]] = [Counter() for _ in kinds]
    for _, text in (rows[statistic] for statistic in STATISTICS if statistic in rows):
        reading = read_cells(text, kinds)
        for column, cell in zip(columns, reading.texts if reading else (), strict=False):
            column[len(cell.partition(".")[2])] += 1
    return [column.most_common(1)[0][0] if column else None for column in columns]


def check_analysis(analysis: report.StandardReport) -> Iterator[report.Misprint]:
    """Yield what contradicts in an analysis: within each column, and between the sizes of their samples."""
    for name in analysis.items:
        cells = {what: analysis.cells[name, what] for what in STATISTICS if (name, what) in analysis.cells}
        for what, cell in cells.items():
            parts = cell.text.split()
            if len(parts) == 3 and (int(parts[1]) >= 60 or float(parts[2]) >= 60.0):
                suspects = (report.Suspect(STATISTICS[what], cell.line, cell.text),)
                yield report.Misprint(
                    cell.line, analysis.title, name, "no angle in degrees, minutes, seconds", suspects
                )
        if (name, SIZE) in analysis.cells:
            yield from _column(analysis, name, analysis.cells[name, SIZE], cells)
    # Of all stations, of latitude and longitude of points.
    alike = [] if analysis.name.startswith("check") else analysis.items[: 3 if "station" in analysis.name else 2]
    sizes = [analysis.cells[name, SIZE] for name in alike if (name, SIZE) in analysis.cells]
    if len({size.value for size in sizes}) > 1:
        message = f"samples of {', '.join(size.text for size in sizes)} that should be of one size"
        yield report.Misprint(sizes[0].line, analysis.title, ", ".join(alike), message)


def _column(
    analysis: report.StandardReport,
    name: str,
    size: report.PrintedNumber,
    cells: Mapping[str, report.PrintedNumber],
) -> Iterator[report.Misprint]:
    """Yield the contradiction within one column, with every cell that alone could be the cause."""
    N, bounds = int(size.value), {what: (cell.low, cell.high) for what, cell in cells.items()}
    if not N or consistent(N, bounds):
        return
    suspects = []
    for what, cell in cells.items():
        if consistent(N, {key: value for key, value in bounds.items() if key != what}):
            within = implied(N, what, bounds)
            expected = report.range_like(*within, cell.text) if within and math.isfinite(within[1]) else ""
            suspects.append(report.Suspect(STATISTICS[what], cell.line, cell.text, expected))
    for other in sizes_implied(bounds):
        if consistent(other, bounds) and (other > 1 or "deviation" not in bounds):
            suspects.append(report.Suspect("sample size", size.line, size.text, str(other)))
    line = suspects[0].line if suspects else size.line
    yield report.Misprint(line, analysis.title, name, _contradiction(N, bounds), tuple(suspects))


def _contradiction(N: int, bounds: Mapping[str, Interval]) -> str:
    """Return what the smallest contradicting group of statistics is."""
    groups = (("sum", "mean"), ("rms", "mean", "deviation"), ("sum", "rms", "deviation"), ("rms", "maximum"))
    contradicting = (
        group for group in groups if not consistent(N, {what: bounds[what] for what in group if what in bounds})
    )
    *names, last = (STATISTICS[what] for what in next(contradicting, tuple(bounds)))
    return f"{', '.join(names)} and {last} contradict one another"


def consistent(N: int, cells: Mapping[str, Interval]) -> bool:
    """Tell whether some sample of N has statistics within all `cells`: sum, mean, rms, deviation, maximum."""
    m = _mean(N, cells)
    if m is None or cells.get("deviation", (0.0, 0.0))[1] < 0.0:
        return False
    R = _rms(N, m, cells)
    if R is None:
        return False
    if "maximum" not in cells:
        return True
    low, high = cells["maximum"]
    if max(abs(low), abs(high)) * (1.0 + _SLACK) < max(R[0], _smallest(m)):
        return False
    return _least_squares(N, m, (low, high)) <= N * R[1] ** 2 * (1.0 + _SLACK) + _SLACK**2


def implied(N: int, name: str, cells: Mapping[str, Interval]) -> Interval | None:
    """Return within what the statistic `name` must lie by the others; None where they do not tell."""
    others = {key: value for key, value in cells.items() if key != name}
    m = _mean(N, others)
    if m is None:
        return None
    if name in ("sum", "mean"):
        times = N if name == "sum" else 1
        return None if math.isinf(m[1]) else (m[0] * times, m[1] * times)
    R = _rms(N, m, others)
    if name == "rms":
        return R if "deviation" in others else None
    if name != "deviation" or R is None or math.isinf(R[1]):
        return None
    k = N / (N - 1)
    squares = k * (R[0] ** 2 - _largest(m) ** 2), k * (R[1] ** 2 - _smallest(m) ** 2)
    return math.sqrt(max(squares[0], 0.0)), math.sqrt(max(squares[1], 0.0))


def sizes_implied(cells: Mapping[str, Interval]) -> range:
    """Return the sizes N that sum and mean allow; none where the mean may be zero, or too many."""
    if "sum" not in cells or "mean" not in cells or _smallest(cells["mean"]) == 0.0:
        return range(0)
    S, m = cells["sum"], cells["mean"]
    if (S[0] + S[1]) * (m[0] + m[1]) <= 0.0:
        return range(0)
    low, high = _smallest(S) / _largest(m), _largest(S) / _smallest(m)
    return range(max(1, math.ceil(low)), math.floor(high) + 1) if high - low < 3.0 else range(0)


def _mean(N: int, cells: Mapping[str, Interval]) -> Interval | None:
    """Return the mean by sum and mean, everything where both are missing, None where they contradict."""
    low, high = cells.get("mean", (-math.inf, math.inf))
    if "sum" in cells:
        low, high = max(low, cells["sum"][0] / N), min(high, cells["sum"][1] / N)
    return _not_empty(low, high)


def _rms(N: int, m: Interval, cells: Mapping[str, Interval]) -> Interval | None:
    """Return the RMS by itself, by the deviation, and as no smaller than the mean; None where they contradict."""
    low, high = cells.get("rms", (0.0, math.inf))
    low = max(low, 0.0, _smallest(m))
    if "deviation" in cells and N > 1:
        D = cells["deviation"]
        low = max(low, math.sqrt(_smallest(m) ** 2 + (N - 1) / N * max(D[0], 0.0) ** 2))
        high = min(high, math.sqrt(_largest(m) ** 2 + (N - 1) / N * D[1] ** 2))
    elif N == 1:
        high = min(high, _largest(m))
    return _not_empty(low, high)


def _least_squares(N: int, m: Interval, X: Interval) -> float:
    """Return the smallest sum of squares of N numbers, one of them in X and their mean in m.

    Convex in both: each in turn goes where it is best, which converges in a box.
    """
    if N == 1:
        return _smallest((max(X[0], m[0]), min(X[1], m[1]))) ** 2 if X[0] <= m[1] and m[0] <= X[1] else math.inf
    x = _nearest(X, 0.0)
    mean = _nearest(m, x / N)
    for _ in range(_STEPS):
        x = _nearest(X, mean)
        mean = _nearest(m, x / N)
    return x**2 + (N * mean - x) ** 2 / (N - 1)


def _not_empty(low: float, high: float) -> Interval | None:
    if low > high + _SLACK * max(abs(low), abs(high)):
        return None
    return min(low, high), max(low, high)


def _nearest(interval: Interval, value: float) -> float:
    return min(max(value, interval[0]), interval[1])


def _smallest(interval: Interval) -> float:
    return abs(_nearest(interval, 0.0))


def _largest(interval: Interval) -> float:
    return max(abs(interval[0]), abs(interval[1]))
