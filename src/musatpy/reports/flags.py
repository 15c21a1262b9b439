"""Points whose heights contradict their flags: where they stand to the water, and with the other flag."""

from __future__ import annotations

from musatpy.arrays import IntArray
from musatpy.reports.editing import number_text
from musatpy.reports.fields import Field, Rows, same
from musatpy.reports.pages import Section
from musatpy.reports.table import Report
from musatpy.reports.text import wrapped
from musatpy.statistics import Statistics
from musatpy.statistics.gates import FLAGS as TITLE
from musatpy.statistics.gates import squares_choose


def _rows(statistics: Statistics) -> IntArray:
    return statistics.flags.doubted


FLAGS = Rows[Statistics, Statistics](
    "flags_against_heights",
    "one row per point whose height contradicts its flag, the worst first; with the other flag for all too",
    same,
    (
        Field("point", "string", "point id", lambda s: s.block.points.ids[s.flags.point[_rows(s)]], heading="Point",
              edit="A8", is_id=True),
        Field("bathymetric", "boolean", "flagged as submerged", lambda s: s.flags.flagged[_rows(s)], heading="Flag",
              edit="A4", words={True: "B", False: ""}),
        Field("height", "number", "adjusted", lambda s: s.flags.height[_rows(s)], "m", heading="Height\nm",
              edit="F12.3"),
        Field("water", "number", "lowest over a point that is not flagged, highest over one that is",
              lambda s: s.flags.water[_rows(s)], "m", heading="Water\nm", edit="F10.3"),
        Field("sigma", "number", "of the height above the water", lambda s: s.flags.sigma[_rows(s)], "m",
              heading="Sigma\nm", edit="F8.3"),
        Field("sigmas", "number", "on the wrong side of the water", lambda s: s.flags.sigmas[_rows(s)],
              heading="Sigmas\nbeyond", edit="F8.1"),
        Field("other_height", "number?", "with the other flag; null where it was not to be had",
              lambda s: s.flags.other_height[_rows(s)], "m", heading="Other flag\nm", edit="F12.3"),
    ),
)  # fmt: skip
RECORD = (FLAGS,)
TABLE: Report[Statistics] = Report(
    title=TITLE,
    table=FLAGS,
    columns=("point", "bathymetric", "height", "water", "sigma", "sigmas", "other_height"),
)
STATED = (TABLE,)


def sections(statistics: Statistics) -> list[Section]:
    """Return the points in doubt, and what their flags mean for the fit; nothing where no flag is contradicted."""
    tests, other = statistics.flags, statistics.solution.other_flags
    if not len(tests.doubted):
        return []
    note = (
        f"Of {len(tests.point)} points held against the water of their photos, these lie below all of it without "
        f"the flag B, or stand above it with it, by more than {number_text('F8.1', tests.limit)} sigmas. A point "
        "that is dry and lies below the water (dike, polder, sump) has the flag D."
    )
    if other is not None and squares_choose(statistics.solution):
        own = statistics.solution.sum_of_squares
        squares = [number_text("F12.1", value) for value in (own, other.sum_of_squares)]
        note += f" v'Pv is {squares[0]}, with all of them flagged the other way {squares[1]}."
    return [TABLE.section(statistics, below=["", *wrapped([note])])]
