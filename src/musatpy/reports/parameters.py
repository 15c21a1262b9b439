"""Further parameters that were estimated: values, sigmas, tests, and whether the observations determine them."""

from __future__ import annotations

from operator import attrgetter

import numpy as np

from musatpy.model import AdjustedParameters, ObservationKind
from musatpy.reports.fields import Field, Rows
from musatpy.reports.pages import Section
from musatpy.reports.table import Report
from musatpy.statistics import Statistics

_KINDS = tuple(kind.label for kind in ObservationKind if kind.is_parameter)

PARAMETERS = Rows[Statistics, AdjustedParameters](
    "adjusted_parameters", "one row per parameter of a camera or line that was adjusted; empty without any",
    of=attrgetter("solution.parameters"), fields=(
        Field("kind", "enum", "what the parameter belongs to",
              lambda w: [ObservationKind(kind).label for kind in w.kind.tolist()], choices=_KINDS, is_id=True),
        Field("of", "string", "id of the camera or line", "owner", "Of", "A8", is_id=True),
        Field("parameter", "string", "as on its card", heading="Param.", edit="A6", is_id=True),
        Field("unit", "string", "of values and sigmas", heading="Unit", edit="A5"),
        Field("given", "number", "of the deck", heading="Given", edit="E14.6"),
        Field("given_sigma", "number?", "of the deck; null: free", "prior_sigma", "Sigma", "E9.1"),
        Field("adjusted", "number", "adjusted", "value", "Adjusted", "E14.6"),
        Field("sigma", "number?", "a posteriori; null: not determined", heading="Sigma", edit="E9.1"),
        Field("test", "number?", "adjusted minus given in sigmas", heading="Test\nvalue", edit="F8.1"),
        Field("kept", "number?", "sigma, with the a priori unit weight, over that given; null: free"),
        Field("inflation", "number?", "variance inflation factor", heading="Variance\ninflation", edit="F10.1"),
        Field("effect", "number?", "of one sigma on the image farthest from the principal point; null: on none",
              lambda w: w.spread * w.effect, "Sigma at\nedge, um", "F9.2", unit="um"),
        Field("verdict", "string", "whether it was determined, and with which other unknown it is correlated",
              lambda w: w.verdicts, "", "A44"),
    ),
)  # fmt: skip
REPORT: Report[Statistics] = Report(
    "Adjusted Parameters", PARAMETERS, worst=lambda t: np.abs(np.nan_to_num(t["test"]))
)
RECORD, STATED = (PARAMETERS,), (REPORT,)


def sections(statistics: Statistics) -> list[Section]:
    """Return the parameters, nothing where there are none."""
    if statistics.solution.parameters is None:
        return []
    note = (
        "A parameter is determined where its sigma is at most half of that given, only by its prior where it keeps "
        "0.95 of it, and not where its sigma is beyond anything that a user could believe: one of a camera would "
        "move an image by 2 % of its distance from the principal point. The test value says whether a parameter "
        "differs from what was given."
    )
    return [REPORT.section(statistics, note)]
