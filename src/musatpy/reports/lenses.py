"""Lenses that were estimated: values, sigmas, tests, and whether the observations determine them."""

from __future__ import annotations

from operator import attrgetter

import numpy as np

from musatpy.model import LENS_PARAMETERS, LENS_UNITS, AdjustedLenses
from musatpy.reports.fields import Field, Rows
from musatpy.reports.pages import Section
from musatpy.reports.table import Report
from musatpy.statistics import Statistics

_UNITS = dict(zip(LENS_PARAMETERS, LENS_UNITS, strict=True))

LENSES = Rows[Statistics, AdjustedLenses](
    "adjusted_lenses", "one row per parameter of a lens that was adjusted; empty where cameras were held",
    of=attrgetter("solution.lenses"), fields=(
        Field("camera", "string", "camera id", heading="Camera", edit="A6", is_id=True),
        Field("parameter", "enum", "as on its card", heading="Param.", edit="A6", choices=LENS_PARAMETERS,
              is_id=True),
        Field("unit", "enum", "of values and sigmas", lambda w: [_UNITS[name] for name in w.parameter.tolist()],
              "Unit", "A5", choices=tuple(dict.fromkeys(LENS_UNITS))),
        Field("given", "number", "of the deck", heading="Given", edit="E14.6"),
        Field("given_sigma", "number?", "of the deck; null: free", "prior_sigma", "Sigma", "E9.1"),
        Field("adjusted", "number", "adjusted", "value", "Adjusted", "E14.6"),
        Field("sigma", "number?", "a posteriori; null: not determined", heading="Sigma", edit="E9.1"),
        Field("test", "number?", "adjusted minus given in sigmas", heading="Test\nvalue", edit="F8.1"),
        Field("kept", "number?", "sigma, with the a priori unit weight, over that given; null: free"),
        Field("inflation", "number?", "variance inflation factor", heading="Variance\ninflation", edit="F10.1"),
        Field("effect", "number", "of one sigma on the image farthest from the principal point",
              lambda w: w.spread * w.effect, "Sigma at\nedge, um", "F9.2", unit="um"),
        Field("verdict", "string", "whether it was determined, and with which other unknown it is correlated",
              lambda w: w.verdicts, "", "A44"),
    ),
)  # fmt: skip
REPORT: Report[Statistics] = Report(
    "Lenses: Adjusted Parameters", LENSES, worst=lambda t: np.abs(np.nan_to_num(t["test"]))
)
RECORD, STATED = (LENSES,), (REPORT,)


def sections(statistics: Statistics) -> list[Section]:
    """Return the parameters, nothing where cameras were held."""
    if statistics.solution.lenses is None:
        return []
    note = (
        "A parameter is determined where its sigma is at most half of that given, only by its prior where it keeps "
        "0.95 of it, and not where its sigma would move an image by 2 % of its distance from the principal point. "
        "The test value says whether a parameter differs from what was given."
    )
    return [REPORT.section(statistics, note)]
