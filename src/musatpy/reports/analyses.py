"""What MUSAT printed of stations, control and plates (ETL-0306, Tables 6-1 to 6-8), a column for each of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from musatpy.model import Block, Refraction
from musatpy.reports.editing import edited, prints_as_zero
from musatpy.reports.fields import Each, Field, FieldGroup, Rows, identity, unrecorded, within
from musatpy.reports.pages import Section
from musatpy.reports.table import Report
from musatpy.reports.values import Values
from musatpy.statistics import PLATE_KINDS, Analysis, DifferenceStatistics, Statistics
from musatpy.units import MICROMETRE

EDITS = {"rad": "S16.3", "m": "F16.2"}
_HEADINGS = {"Elevation": "Elev. (M)"} | {name: f"{name} (M)" for name in ("X", "Y", "Z", "East", "North", "Up")}
ROWS = (  # with their fields in the record
    ("Sum of Differences", "sum"),
    ("Mean Value of Differences", "mean"),
    ("RMS of Differences", "rms"),
    ("Standard Deviation from Mean", "deviation"),
    ("Maximum Difference", "maximum"),
)
_LABEL_WIDTH, _CELL_WIDTH = 36, 18
_ACROSS = 10  # frames on the width of the paper
_RMS = "F9.3"  # mm, of the plates

Component = tuple[str, str, DifferenceStatistics]


def differences(unit: str, of: str = "photo or point") -> tuple[Field[DifferenceStatistics], ...]:
    """Return the statistics of differences in a unit, the largest with the name of what it is of."""
    return (
        Field("size", "integer", "sample size N", heading="Size", edit="I7"),
        Field("sum", "number", "sum of differences", "", f"Sum\n{unit}", "F11.3", unit=unit),
        Field("mean", "number?", "sum / N", "", f"Mean\n{unit}", "F9.3", unit=unit),
        Field("rms", "number?", "root of the sum of squares / N", "", f"RMS\n{unit}", "F9.3", unit=unit),
        Field("deviation", "number?", "standard deviation from the mean, N - 1", "", f"Deviation\n{unit}", "F9.3",
              unit=unit),
        Field("maximum", "number?", "signed difference of the largest magnitude", "", f"Maximum\n{unit}", "F9.3",
              unit=unit),
        Field("maximum_id", "string?", f"{of} of the maximum", lambda d: d.maximum_id or None, "at", "A10"),
    )  # fmt: skip


_DIFFERENCES: tuple[Field[Component], ...] = (
    Field("component", "string", "name of the component", lambda c: c[0], "Component", "A10", is_id=True),
    Field("unit", "string", "unit of the numbers of the row", lambda c: c[1], "Unit", "A4", choices=("rad", "m")),
    *within(lambda c: c[2], differences("the row's")),
)


def _analysis(name: str, text: str, of: Callable[[Statistics], Analysis]) -> Each[Statistics, Component]:
    def components(statistics: Statistics) -> list[Component]:
        analysis = of(statistics)
        return list(zip(analysis.components, analysis.units, analysis.statistics, strict=True))

    return Each(name, text, of=components, fields=_DIFFERENCES, shared="analysis", length=3)


_ANALYSES = (
    _analysis("camera_station_position", "adjusted minus initial positions of stations",
              lambda s: s.station_positions),
    _analysis("camera_station_attitude", "adjusted minus given attitudes of stations",
              lambda s: s.station_attitudes),
    _analysis("ground_point", "adjusted minus given positions of control points, in the components that were known",
              lambda s: s.ground_points),
    _analysis("check_point", "adjusted minus given positions of check points", lambda s: s.check_points),
)  # fmt: skip
ANALYSIS = _ANALYSES[0]
ANALYSES = FieldGroup[Statistics, Statistics]("analyses", "the standard analyses, one row per component", _ANALYSES)


def _report(table: Each[Statistics, Component], title: str, row: str) -> Report[Statistics]:
    """Return an analysis in print; `row` is what its differences are of."""
    return Report(
        title,
        table,
        (
            "component unit",
            table.column("size", "Sample Size", "I8"),
            *(table.column(name, label, "F16.3") for label, name in ROWS),
            table.column("maximum_id", f"{row} with Max. Difference", "A8", shown=_maximum),
        ),
        layout="across",
    )


def _maximum(t: Values, edits: Mapping[str, str] = EDITS) -> list[str]:
    """Return the names of the largest differences, blank where these print as zero."""
    of_components = zip(t["maximum_id"], t["maximum"], t.get("unit", ["m"] * t.count), strict=True)
    return ["" if prints_as_zero(edits[unit], value) else name or "" for name, value, unit in of_components]


REPORTS = (
    _report(_ANALYSES[0], "Camera Station Position Analysis", "Camera"),
    _report(_ANALYSES[1], "Camera Station Attitude Analysis", "Camera"),
    _report(_ANALYSES[2], "Ground Point Analysis", "Point"),
)
CHECK_POINTS = _report(_ANALYSES[3], "Check Point Analysis", "Point")

FRAMES = Rows[Statistics, Statistics](
    "frames", "one row per photo", (
        identity("photo", "block.photos.ids"),
        Field("count", "3 integer", "points of each kind", "plates.count"),
        Field("rms", "3x2 number?", "x and y of each kind", "plates.rms", unit="mm"),
    ),
)  # fmt: skip


PLATE_STATISTICS = FieldGroup[Statistics, Statistics](
    "plate_statistics", "RMS plate residuals", (
        Field("kinds", "3 string", "order of the kinds in count, rms, largest and the totals",
              lambda s: PLATE_KINDS, "Points", "A16", is_id=True),
        FRAMES,
        Field("largest", "3 string?", "photo of the largest root of x^2 + y^2 of each kind",
              lambda s: [str(s.block.photos.ids[photo]) if photo >= 0 else None for photo in s.plates.largest]),
        Field("total_count", "3 integer", "points of each kind in the job", "plates.total_count", "Number", "I8"),
        Field("total_rms", "3x2 number?", "x and y of each kind in the job", "plates.total_rms",
              ("RMS x\num", "RMS y\num"), "F10.2"),
    ),
)  # fmt: skip


def _by_kind(kind: int, name: str) -> Iterator[Field[Statistics]]:
    """Yield number and RMS of the points of a kind, by photo."""
    yield FRAMES.column(f"count[{kind}]", f"{name}\npoints", "I6")
    for n, axis in enumerate("xy"):
        yield FRAMES.column(f"rms[{kind}][{n}]", f"{name}\nRMS {axis} um", "F10.2")


def _rms(label: str, kind: int, axis: int) -> Field[Statistics]:
    """Return a row of Table 6-4; MUSAT printed .000 for a frame without points of the kind."""
    return unrecorded(label, _RMS, lambda t: np.nan_to_num(t["rms"][:, kind, axis]))


def _stars(label: str, kind: int) -> Field[Statistics]:
    """Return the row that marks the frame with the largest RMS, unless even that prints as zero."""

    def shown(t: Values) -> list[str]:
        rows = zip(t["photo"], t["largest"][:, kind], np.nan_to_num(t["rms"][:, kind]).max(axis=1), strict=True)
        return ["****" if photo == most and not prints_as_zero(_RMS, rms) else "" for photo, most, rms in rows]

    return unrecorded(label, "A4", shown)


BY_PHOTO = Report(
    "Plate Residuals By Photo",
    FRAMES,
    ("photo", *_by_kind(0, "Trig."), *_by_kind(1, "Not trig."), *_by_kind(2, "All")),
    worst=lambda t: np.linalg.norm(np.nan_to_num(t["rms"][:, 0]), axis=1) / MICROMETRE,
)
FRAMES_ACROSS = Report(
    "Plate Residuals",
    PLATE_STATISTICS,
    (
        FRAMES.column("photo", "Frame", "A8"),
        *(
            _rms(f"RMS of {name} - {axis}", kind, n)
            for kind, name in enumerate(("Trig. Points", "Points Not Trig.", "All Points"))
            for n, axis in enumerate("xy")
        ),
        *(
            _stars(f"Frame With Max. RMS {name} Points", kind)
            for kind, name in enumerate(("Trig.", "Non-Trig.", "All"))
        ),
    ),
    layout="across",
    nested="frames",
)
STATED = (*REPORTS, BY_PHOTO, FRAMES_ACROSS)


def sections(statistics: Statistics) -> list[Section]:
    """Return the three analyses, together on a page where they fit, and a section for every ten frames."""
    return [*_analyses(statistics), *_frames(statistics)]


def brief(statistics: Statistics) -> list[Section]:
    """Return the analyses, and the RMS of the photos in a line for each."""
    return [*_analyses(statistics), BY_PHOTO.section(statistics)]


def _analyses(statistics: Statistics) -> list[Section]:
    return [analysis_section(report, statistics, new_page=report is REPORTS[0]) for report in REPORTS]


def analysis_section(report: Report[Statistics], statistics: Statistics, *, new_page: bool = False) -> Section:
    """Return one analysis, laid out as Table 6-1."""
    values, runs = report.values(statistics), run_titles(statistics.block)
    return laid_out(report, values, runs, values=lambda: report.cells(values), new_page=new_page)


def laid_out(
    report: Report[Any], t: Values, runs: Sequence[str], edits: Mapping[str, str] = EDITS, **layout: Any
) -> Section:
    """Return an analysis as Table 6-1 has it, with the lines below its title that say which run it was."""
    units = t.get("unit", ["m"] * t.count)
    numbers = {label: np.where(t["size"] == 0, np.nan, t[name]) for label, name in ROWS}
    table = {
        "": [_HEADINGS.get(name, name) for name in t["component"]],
        "Sample Size": list(map(str, t["size"])),
        **{
            label: [edited(edits[unit], [value])[0] for unit, value in zip(units, values, strict=True)]
            for label, values in numbers.items()
        },
        str(report.stated()[-1].heading): _maximum(t, edits),
    }
    title = "\n".join((report.title, *runs, *(["(Degrees, Minutes, Seconds)"] if "rad" in units else [])))
    return _across(title, table, (_LABEL_WIDTH, _CELL_WIDTH), **layout)


def _frames(statistics: Statistics) -> Iterator[Section]:
    """Yield a section for every ten frames."""
    title = "\n".join((FRAMES_ACROSS.title, *run_titles(statistics.block), "(MM)"))
    values = FRAMES_ACROSS.values(statistics)
    columns = FRAMES_ACROSS.side_by_side(values)
    texts = {str(column.heading): edited(str(column.edit), column.printed(values)) for column in columns}
    for first in range(0, len(statistics.block.photos.ids), _ACROSS):
        table = {label: texts_of[first : first + _ACROSS] for label, texts_of in texts.items()}
        cells = (lambda: BY_PHOTO.cells(statistics)) if first == 0 else None
        yield _across(title, table, (38, 9), values=cells, new_page=first == 0)


def _across(title: str, table: Mapping[str, Sequence[str]], widths: tuple[int, int], **layout: Any) -> Section:
    """Return a table whose rows are led by labels; the first, its heads, stands between rules."""
    heads, *rows = [
        (label.ljust(widths[0]) + "".join(cell.strip().rjust(widths[1]) for cell in cells)).rstrip()
        for label, cells in table.items()
    ]
    width = widths[0] + widths[1] * len(next(iter(table.values())))
    head = ["=" * width, heads, "-" * width]
    return Section(title=title, head=head, lines=[*rows, "=" * width], together=True, **layout)


def run_titles(block: Block) -> tuple[str, str]:
    """Return the two lines that say which run it was, as ETL-0306 has them."""
    name = f"MUSAT-{block.options.program}"
    if block.options.refraction is Refraction.NONE:
        return f"Standard {name}", "No Refraction Correction"
    return f"Modified {name}", "Refraction Correction Applied"
