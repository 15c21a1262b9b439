"""Plate Residuals: RMS per frame, frames across (ETL-0306, Tables 6-4 and 6-8)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.reports.analyses import run_titles
from musatpy.reports.editing import edited, prints_as_zero
from musatpy.reports.fields import Field
from musatpy.reports.pages import Section
from musatpy.reports.result_record import FRAMES, PLATE_STATISTICS
from musatpy.reports.table import Report
from musatpy.reports.values import Values
from musatpy.statistics import Statistics
from musatpy.units import MICROMETRE

_LABEL_WIDTH, _CELL_WIDTH = 38, 9
_ACROSS = 10  # frames on the width of the paper
_RMS = "F9.3"  # mm

# Labels of Table 6-4, with the column of `PlateStatistics.rms` and its axis.
ROWS = (
    ("RMS of Trig. Points - x", 0, 0),
    ("RMS of Trig. Points - y", 0, 1),
    ("RMS of Points Not Trig. - x", 1, 0),
    ("RMS of Points Not Trig. - y", 1, 1),
    ("RMS of All Points - x", 2, 0),
    ("RMS of All Points - y", 2, 1),
)
STARS = (
    ("Frame With Max. RMS Trig. Points", 0),
    ("Frame With Max. RMS Non-Trig. Points", 1),
    ("Frame With Max. RMS All Points", 2),
)


def _columns(kind: int, name: str) -> Iterator[Field[Statistics]]:
    """Yield number and RMS of the points of a kind, by photo."""
    yield FRAMES.column(f"count[{kind}]", f"{name}\npoints", "I6")
    for n, axis in enumerate("xy"):
        yield FRAMES.column(f"rms[{kind}][{n}]", f"{name}\nRMS {axis} um", "F10.2")


def _rms(label: str, kind: int, axis: int) -> Field[Statistics]:
    """Return a row of Table 6-4; MUSAT printed .000 for a frame without points of the kind."""
    return Field(label, heading=label, edit=_RMS, shown=lambda t: np.nan_to_num(t["rms"][:, kind, axis]))


def _stars(label: str, kind: int) -> Field[Statistics]:
    """Return the row that marks the frame with the largest RMS, unless even that prints as zero."""

    def shown(t: Values) -> list[str]:
        rows = zip(t["photo"], t["largest"][:, kind], np.nan_to_num(t["rms"][:, kind]).max(axis=1), strict=True)
        return ["****" if photo == most and not prints_as_zero(_RMS, rms) else "" for photo, most, rms in rows]

    return Field(label, heading=label, edit="A9", shown=shown)


BY_PHOTO: Report[Statistics] = Report(
    title="Plate Residuals By Photo",
    table=FRAMES,
    path="plate_statistics.frames",
    worst=lambda t: np.linalg.norm(np.nan_to_num(t["rms"][:, 0]), axis=1) / MICROMETRE,
    columns=("photo", *_columns(0, "Trig."), *_columns(1, "Not trig."), *_columns(2, "All")),
)
ACROSS: Report[Statistics] = Report(
    title="Plate Residuals",
    layout="across",
    table=PLATE_STATISTICS,
    nested="frames",
    columns=("photo", *(_rms(*row) for row in ROWS), *(_stars(*row) for row in STARS)),
)
STATED = (BY_PHOTO, ACROSS)


def brief(statistics: Statistics) -> list[Section]:
    """Return the RMS of the photos in a line for each."""
    return [BY_PHOTO.section(statistics)]


def sections(statistics: Statistics) -> list[Section]:
    """Return one section for every ten frames."""
    frames = len(statistics.block.photos.ids)
    return [
        _group(statistics, first, min(first + _ACROSS, frames), new_page=first == 0)
        for first in range(0, frames, _ACROSS)
    ]


def _group(statistics: Statistics, first: int, last: int, *, new_page: bool) -> Section:
    width = _LABEL_WIDTH + _CELL_WIDTH * (last - first)
    ids = [f"{name:>{_CELL_WIDTH}.8}" for name in statistics.block.photos.ids[first:last].tolist()]
    lines = []
    for label, kind, axis in ROWS:
        # MUSAT printed .000 for a frame without points of the kind.
        rms = np.nan_to_num(statistics.plates.rms[first:last, kind, axis])
        lines.append(_row(label, edited(_RMS, rms)))
    for label, kind in STARS:
        lines.append(_row(label, [_star(statistics, frame, kind) for frame in range(first, last)]))
    return Section(
        title="\n".join(("Plate Residuals", *run_titles(statistics.block), "(MM)")),
        head=["=" * width, _row("Frame", ids), "-" * width],
        lines=[*lines, "=" * width],
        values=(lambda: BY_PHOTO.cells(statistics)) if new_page else None,
        new_page=new_page,
        together=True,
    )


def _star(statistics: Statistics, frame: int, kind: int) -> str:
    """Return the mark of the frame with the largest RMS, unless even that prints as zero."""
    plates = statistics.plates
    if plates.largest[kind] != frame or prints_as_zero(_RMS, plates.rms[frame, kind].max()):
        return ""
    return "****"


def _row(label: str, cells: list[str]) -> str:
    return (label.ljust(_LABEL_WIDTH) + "".join(cell.rjust(_CELL_WIDTH) for cell in cells)).rstrip()
