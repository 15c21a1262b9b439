"""The listing and the record of models set up (`musat as11 setup`)."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.reports import compilation
from musatpy.reports.compilation import JOB, MODELS, RECOVERED
from musatpy.reports.fields import Document, Field, Rows, flag, identity, same
from musatpy.reports.table import Report

if TYPE_CHECKING:  # a reader of listings knows the tables by their statements alone
    from musatpy.compilation.against_run import AgainstRun
    from musatpy.compilation.compiled import Compiled
    from musatpy.compilation.setups import ModelSetUp

_ABOUT = (
    "Stereomodels of a run, set up: metres, millimetres of the plate, radians. Model axes: X along the base, Z up "
    "at the origin. A number that does not exist is null"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class SetUps:
    """What is reported: the deck on its run, its models, and what its points say of recoverability."""

    compiled: Compiled
    models: list[ModelSetUp]
    against: list[AgainstRun]


def _all(path: str) -> Callable[[SetUps], Any]:
    """Return what takes the values of all models, one after the other."""
    return lambda setups: np.concatenate([attrgetter(path)(model) for model in setups.models])


def _models(path: str) -> Callable[[SetUps], Any]:
    """Return what takes the name of its model for each value."""
    return lambda setups: np.concatenate([[m.model.name] * len(attrgetter(path)(m)) for m in setups.models])


def _of_run(setups: SetUps, name: str) -> Any:
    """Return an attribute of the points of the run."""
    return getattr(setups.compiled.run.block.points, name)[_all("again.points")(setups)]


def _difference(setups: SetUps) -> Any:
    return _all("again.read")(setups) - _all("again.predicted")(setups)


def _in_model(setups: SetUps) -> Any:
    run = setups.compiled.run
    places = (m.model.stereo.model(run.frame.working(run.position[m.again.points])) for m in setups.models)
    return np.concatenate(list(places))


RUN_POINTS: Rows[SetUps, SetUps] = Rows(
    "points",
    "one row per point of the run that both photos of a model show",
    (
        identity("model", _models("again.points")),
        identity("point", lambda s: _of_run(s, "ids")),
        flag("submerged", "flagged so", "Bath", "B", lambda s: _of_run(s, "bathymetric")),
        Field("position", "3 number", "in the model", _in_model, unit="m", exact=True),
        Field("predicted", "2x2 number", "stages, left and right, x and y", _all("again.predicted"),
              [f"{side} {axis}\nmm" for side in "LR" for axis in "xy"], "F10.4", exact=True),
        Field("difference", "2x2 number?", "read less predicted", _difference,
              [f"Read {side}{axis}\nless\num" for side in "LR" for axis in "xy"], "F8.2"),
        Field("y_parallax", "number?", "of refracted rays, by readings where there are any", _all("again.parallax"),
              "py\num", "F7.2"),
        Field("straight_y_parallax", "number?", "of straight rays", _all("again.straight"), "straight\num", "F8.2"),
    ),
)  # fmt: skip
EXPECTED: Rows[SetUps, SetUps] = Rows(
    "expected",
    "standard errors to expect of points at places of a model",
    (
        identity("model", _models("expected.depth")),
        Field("place", "3 number", "in the model", _all("expected.place"), ("X\nm", "Y\nm", "Z\nm"), "F10.2",
              exact=True),
        Field("depth", "number", "below the water; 0: dry, at its height", _all("expected.depth"), "Depth\nm",
              "F7.2"),
        Field("sigma", "3 number?", "east, north, up", _all("expected.sigma"),
              [f"Sigma {axis}\nm" for axis in ("E", "N", "U")], "F8.3"),
        Field("depth_sigma", "number?", "of the depth", _all("expected.points.depth_sigma"), "Depth\nm", "F8.3"),
        Field("pointing_sigma", "number?", "of the height, by pointing", _all("expected.pointing"), "Pointing\nm",
              "F8.3"),
        Field("run_sigma", "number?", "of the height, by the run", _all("expected.of_run"), "Run\nm", "F8.3"),
    ),
)  # fmt: skip
DOCUMENT: Document[Compiled] = Document(
    name="setup_version",
    version="2.0",
    title="musatpy models set up",
    about=_ABOUT,
    nodes=(
        *(JOB, MODELS, RECOVERED, RUN_POINTS, EXPECTED),
        Field("warnings", "* string", "what is odd about the models", same),
    ),
)


# --- the listing ---

AXES_TABLE = Report(
    "Model Axes In Working Axes",
    MODELS,
    (
        "model origin",
        *(
            MODELS.column(f"axes[{i}][{j}]", f"{name}{axis}", "F7.4")
            for i, name in enumerate("XYZ")
            for j, axis in enumerate("xyz")
        ),
    ),
)
GEOMETRY_TABLE = Report(
    "Scales, And Origins In The System Of The Job", MODELS, "model scale base height origin_position"
)
POINT_TABLE = Report("Points Of The Run In The Model", RUN_POINTS)
EXPECTED_TABLE = Report("Standard Errors To Expect", EXPECTED)
STATED = (GEOMETRY_TABLE, AXES_TABLE, POINT_TABLE, EXPECTED_TABLE)


def listing_of(
    setups: SetUps, warnings: Sequence[str], *, carriage_control: bool = False, date: datetime.date | None = None
) -> str:
    """Return the listing of models set up, on pages of 60 lines of 132 columns."""
    compiled, against = setups.compiled, setups.against
    sections = [
        *compilation.model_sections(compiled, against, warnings),
        GEOMETRY_TABLE.section(compiled),
        AXES_TABLE.section(compiled),
        POINT_TABLE.section(setups, new_page=True),
        EXPECTED_TABLE.section(setups, new_page=True),
    ]
    return compilation.listing_of(compiled, sections, carriage_control=carriage_control, date=date)
