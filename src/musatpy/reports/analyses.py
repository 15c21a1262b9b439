"""The analyses of stations and control that MUSAT printed (ETL-0306, Tables 6-1 to 6-3 and 6-5 to 6-7)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from musatpy.model import Block, Refraction
from musatpy.reports import result_record
from musatpy.reports.editing import edited, prints_as_zero
from musatpy.reports.pages import Section
from musatpy.reports.table import Report
from musatpy.reports.values import Values
from musatpy.statistics import Analysis, Statistics

_LABEL_WIDTH, _CELL_WIDTH = 36, 18
EDITS = {"rad": "S16.3", "m": "F16.2"}
_HEADINGS = {"X": "X (M)", "Y": "Y (M)", "Z": "Z (M)", "Elevation": "Elev. (M)"}
_HEADINGS |= {"East": "East (M)", "North": "North (M)", "Up": "Up (M)"}

ROWS = (  # with their fields in the record
    ("Sum of Differences", "sum"),
    ("Mean Value of Differences", "mean"),
    ("RMS of Differences", "rms"),
    ("Standard Deviation from Mean", "deviation"),
    ("Maximum Difference", "maximum"),
)
_SIZE = "Sample Size"


@dataclass(frozen=True, eq=False)
class Layout:
    """One analysis in print: its title, what its rows are, and where its numbers are, in the record too."""

    title: str
    row: str
    analysis: Callable[[Statistics], Analysis]
    table: str

    @property
    def report(self) -> Report[Statistics]:
        """The same with a row for each component."""
        table: Any = next(node for node in result_record.ANALYSES.fields if node.name == self.table)
        row = f"{self.row} with Max. Difference"
        return Report(
            title=self.title,
            table=table,
            path=f"analyses.{self.table}",
            layout="across",
            columns=(
                *("component", "unit", "size", *(table.column(name, label, "F16.3") for label, name in ROWS)),
                table.column("maximum_id", row, "A8", shown=_maximum),
            ),
        )


def _maximum(t: Values) -> list[str]:
    """Return the names of the largest differences, blank where these print as zero."""
    of_components = zip(t["maximum_id"], t["maximum"], t["unit"], strict=True)
    return ["" if prints_as_zero(EDITS[unit], value) else name or "" for name, value, unit in of_components]


LAYOUTS = (
    Layout("Camera Station Position Analysis", "Camera", lambda s: s.station_positions, "camera_station_position"),
    Layout("Camera Station Attitude Analysis", "Camera", lambda s: s.station_attitudes, "camera_station_attitude"),
    Layout("Ground Point Analysis", "Point", lambda s: s.ground_points, "ground_point"),
)
STATED = tuple(layout.report for layout in LAYOUTS)


def sections(statistics: Statistics) -> list[Section]:
    """Return the three analyses, together on a page where they fit."""
    return [analysis_section(layout, statistics, new_page=number == 0) for number, layout in enumerate(LAYOUTS)]


def analysis_section(layout: Layout, statistics: Statistics, *, new_page: bool = False) -> Section:
    """Return one analysis, laid out as Table 6-1."""
    section = laid_out(layout.analysis(statistics), layout.title, run_titles(statistics.block), layout.row)
    return replace(section, values=lambda: layout.report.cells(statistics), new_page=new_page)


def laid_out(
    analysis: Analysis, title: str, runs: Sequence[str], row: str, edits: Mapping[str, str] = EDITS
) -> Section:
    """Return an analysis as Table 6-1 has it, with the lines below its title that say which run it was."""
    titles = [title, *runs]
    if "rad" in analysis.units:
        titles.append("(Degrees, Minutes, Seconds)")
    double, single = ("=" * (_LABEL_WIDTH + 3 * _CELL_WIDTH), "-" * (_LABEL_WIDTH + 3 * _CELL_WIDTH))
    headings = [_HEADINGS.get(name, name) for name in analysis.components]
    head = [double, _row("", headings), single]
    return Section(
        title="\n".join(titles),
        head=head,
        lines=[*_lines(analysis, row, edits), double],
        together=True,
    )


def run_titles(block: Block) -> tuple[str, str]:
    """Return the two lines that say which run it was, as ETL-0306 has them."""
    name = f"MUSAT-{block.options.program}"
    if block.options.refraction is Refraction.NONE:
        return f"Standard {name}", "No Refraction Correction"
    return f"Modified {name}", "Refraction Correction Applied"


def _lines(analysis: Analysis, row: str, edits: Mapping[str, str]) -> list[str]:
    lines = [_row(_SIZE, [str(d.size) for d in analysis.statistics])]
    for label, name in ROWS:
        cells = [
            edited(edits[unit], [getattr(d, name) if d.size else float("nan")])[0]
            for unit, d in zip(analysis.units, analysis.statistics, strict=True)
        ]
        lines.append(_row(label, cells))
    names = [
        "" if d.size == 0 or prints_as_zero(edits[unit], d.maximum) else d.maximum_id
        for unit, d in zip(analysis.units, analysis.statistics, strict=True)
    ]
    lines.append(_row(f"{row} with Max. Difference", names))
    return lines


def _row(label: str, cells: list[str]) -> str:
    return (label.ljust(_LABEL_WIDTH) + "".join(cell.rjust(_CELL_WIDTH) for cell in cells)).rstrip()
