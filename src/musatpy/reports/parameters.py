"""Further parameters that were estimated: values, sigmas, tests, and whether the observations determine them."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np

from musatpy.arrays import IntArray
from musatpy.model import GRID_PLACES, AdjustedParameters, DistortionGrid, ObservationKind
from musatpy.reports.fields import Field, Rows
from musatpy.reports.pages import Section
from musatpy.reports.table import Report
from musatpy.reports.values import Values
from musatpy.statistics import Statistics

_MOST = 200  # parameters whose covariance is recorded
_KINDS = tuple(kind.label for kind in ObservationKind if kind.is_parameter)

PARAMETERS = Rows[Statistics, AdjustedParameters](
    "adjusted_parameters", "one row per parameter of a camera or line that was adjusted; empty without any",
    of=attrgetter("solution.parameters"), fields=(
        Field("kind", "enum", "what the parameter belongs to",
              lambda w: [ObservationKind(kind).label for kind in w.kind.tolist()], choices=_KINDS, is_id=True),
        Field("of", "string", "id of the camera or line", "owner", "Of", "A8", is_id=True),
        Field("parameter", "string", "as on its card", heading="Param.", edit="A7", is_id=True),
        Field("unit", "string", "of values and sigmas", heading="Unit", edit="A5"),
        Field("given", "number", "of the deck", heading="Given", edit="E14.6"),
        Field("given_sigma", "number?", "of the deck; null: free", "prior_sigma", "Sigma", "E9.3"),
        Field("adjusted", "number", "adjusted", "value", "Adjusted", "E14.6"),
        Field("sigma", "number?", "a posteriori; null: not determined", heading="Sigma", edit="E9.3"),
        Field("test", "number?", "adjusted minus given in sigmas", heading="Test\nvalue", edit="F8.1"),
        Field("kept", "number?", "sigma, with the a priori unit weight, over that given; null: free"),
        Field("inflation", "number?", "variance inflation factor", heading="Variance\ninflation", edit="F10.1"),
        Field("effect", "number?", "of one sigma on the image farthest from the principal point; null: on none",
              lambda w: w.spread * w.effect, "Sigma at\nedge, um", "F9.2", unit="um"),
        Field("verdict", "string", "whether it was determined, and with which other unknown it is correlated",
              lambda w: w.verdicts, "", "A44"),
        Field("tied", "4 string", "the other parameter, place of a station, attitude, and unknown of the water or "
              "else with the strongest correlation; empty: none"),
        Field("correlation", "5 number?", "with these, and with the mean depth of submerged points"),
        Field("covariance", "* number?", "with all parameters in this order; empty of more than 200",
              lambda w: w.covariance if w.count <= _MOST else np.zeros((w.count, 0)), exact=True),
    ),
)  # fmt: skip
GRID = Rows[Statistics, DistortionGrid](
    "distortion_grid", "one row per place of a grid on the plates of cameras whose distortion was adjusted",
    of=attrgetter("solution.grid"), fields=(
        Field("camera", "string", "id", heading="Camera", edit="A6", is_id=True),
        Field("place", "2 number", "measured, from the principal point", heading=("x\nmm", "y\nmm"), edit="F9.2"),
        Field("distortion", "2 number", "measured minus ideal place, about the principal point",
              heading=("dx\num", "dy\num"), edit="F9.2"),
        Field("sigma", "2 number?", "by the joint covariance of the parameters; null: one is not determined",
              heading=("Sigma dx\num", "Sigma dy\num"), edit="F9.2"),
    ),
)  # fmt: skip
REPORT: Report[Statistics] = Report(
    "Adjusted Parameters", PARAMETERS, worst=lambda t: np.abs(np.nan_to_num(t["test"]))
)
_TIES = (("Parameter", "A14"), ("Station", "A15"), ("Attitude", "A16"), ("Water or else", "A23"))
_PREFIX = re.compile(r"^photo | of \w+(?= \S+$)")  # of `photo 12 east` and `K1 of camera RC8`: the heading has it


def _short(group: int, table: Values) -> list[str]:
    """Return the names of what parameters are tied to most, without what the heading says."""
    return [_PREFIX.sub("", names[group]) for names in table["tied"]]


def _tie(group: int, heading: str, edit: str) -> tuple[Field[Any], Field[Any]]:
    name = replace(PARAMETERS.column(f"tied[{group}]", heading, edit), shown=partial(_short, group))
    return name, PARAMETERS.column(f"correlation[{group}]", "Corr.", "F6.3")


TIED: Report[Statistics] = Report(
    "Correlations Of Parameters",
    PARAMETERS,
    columns=(
        "of parameter",
        *(column for group, tie in enumerate(_TIES) for column in _tie(group, *tie)),
        PARAMETERS.column("correlation[4]", "Mean\ndepth", "F6.3"),
    ),
    worst=lambda t: np.abs(np.nan_to_num(t["correlation"])).max(axis=1),
)
DISTORTION: Report[Statistics] = Report(
    "Distortion Of Plates", GRID, which=lambda t: _every_second(len(t["sigma"]))
)
RECORD, STATED = (PARAMETERS, GRID), (REPORT, TIED, DISTORTION)


def _every_second(places: int) -> IntArray:
    """Return the rows of every second place of grids, along x and along y."""
    grid = np.arange(places).reshape(-1, GRID_PLACES, GRID_PLACES)
    return grid[:, ::2, ::2].reshape(-1)


def sections(statistics: Statistics) -> list[Section]:
    """Return the parameters, nothing where there are none."""
    if statistics.solution.parameters is None:
        return []
    note = (
        "A parameter is determined where its sigma is at most half of that given, only by its prior where it keeps "
        "0.95 of it. It is not determined where a sigma of it, by the given sigmas of the observations, turns rays "
        "by more than 50 plate sigmas, unless its prior knows it to a tenth of a radian, or of the flying height. "
        "The test value says whether a parameter differs from what was given."
    )
    about = (
        "Beside each parameter the unknowns with which it has the strongest correlation, and that with the mean "
        "depth of submerged points."
    )
    sections = [REPORT.section(statistics, note), TIED.section(statistics, about)]
    if statistics.solution.grid is not None:
        about = (
            "Measured minus ideal place about the principal point: distortion and affinity as adjusted, with "
            "sigmas by the joint covariance of their parameters."
        )
        sections.append(DISTORTION.section(statistics, about))
    return sections
