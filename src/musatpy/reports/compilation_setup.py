"""The listing and the record of models set up (`musat as11 setup`)."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.reports import compilation
from musatpy.reports.compilation import JOB, MODELS, RECOVERED
from musatpy.reports.fields import Document, Field, Rows, identity, same
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


RUN_POINTS: Rows[SetUps, SetUps] = Rows(
    "points",
    "one row per point of the run that both photos of a model show",
    (
        identity("model", lambda s: _model_ids(s)),
        identity("point", lambda s: _point_ids(s)),
        Field("submerged", "boolean", "flagged so", lambda s: _submerged(s), heading="Bath", edit="A4",
              words={True: "B", False: ""}),
        Field("position", "3 number", "in the model", lambda s: _in_model(s), "m", exact=True),
        Field("predicted", "2x2 number", "stages, left and right, x and y", lambda s: _of(s, "predicted"), "mm",
              exact=True, heading=[f"{side} {axis}\nmm" for side in "LR" for axis in "xy"], edit="F10.4"),
        Field("difference", "2x2 number?", "read less predicted", lambda s: _difference(s), "mm",
              heading=[f"Read {side}{axis}\nless\num" for side in "LR" for axis in "xy"], edit="F8.2"),
        Field("y_parallax", "number?", "of refracted rays, by readings where there are any",
              lambda s: _of(s, "parallax"), "mm", heading="py\num", edit="F7.2"),
        Field("straight_y_parallax", "number?", "of straight rays", lambda s: _of(s, "straight"), "mm",
              heading="straight\num", edit="F8.2"),
    ),
)  # fmt: skip
EXPECTED: Rows[SetUps, SetUps] = Rows(
    "expected",
    "standard errors to expect of points at places of a model",
    (
        identity("model", lambda s: _expected_ids(s)),
        Field("place", "3 number", "in the model", lambda s: _expected(s, "place"), "m", exact=True,
              heading=("X\nm", "Y\nm", "Z\nm"), edit="F10.2"),
        Field("depth", "number", "below the water; 0: dry, at its height", lambda s: _expected(s, "depth"), "m",
              heading="Depth\nm", edit="F7.2"),
        Field("sigma", "3 number?", "east, north, up", lambda s: _expected(s, "sigma"), "m",
              heading=[f"Sigma {axis}\nm" for axis in ("E", "N", "U")], edit="F8.3"),
        Field("depth_sigma", "number?", "of the depth",
              lambda s: np.concatenate([m.expected.points.depth_sigma for m in s.models]), "m", heading="Depth\nm",
              edit="F8.3"),
        Field("pointing_sigma", "number?", "of the height, by pointing", lambda s: _expected(s, "pointing"), "m",
              heading="Pointing\nm", edit="F8.3"),
        Field("run_sigma", "number?", "of the height, by the run", lambda s: _expected(s, "of_run"), "m",
              heading="Run\nm", edit="F8.3"),
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


def _of(setups: SetUps, name: str) -> Any:
    return np.concatenate([getattr(model.again, name) for model in setups.models])


def _difference(setups: SetUps) -> Any:
    return _of(setups, "read") - _of(setups, "predicted")


def _model_ids(setups: SetUps) -> Any:
    return np.repeat([m.model.name for m in setups.models], [len(m.again.points) for m in setups.models])


def _point_ids(setups: SetUps) -> Any:
    return setups.compiled.run.block.points.ids[_of(setups, "points")]


def _submerged(setups: SetUps) -> Any:
    return setups.compiled.run.block.points.bathymetric[_of(setups, "points")]


def _in_model(setups: SetUps) -> Any:
    run = setups.compiled.run
    return np.concatenate(
        [m.model.stereo.model(run.frame.working(run.position[m.again.points])) for m in setups.models]
    )


def _expected_ids(setups: SetUps) -> Any:
    return np.repeat([m.model.name for m in setups.models], [len(m.expected.depth) for m in setups.models])


def _expected(setups: SetUps, name: str) -> Any:
    return np.concatenate([getattr(model.expected, name) for model in setups.models])


# --- the listing ---

AXES_TABLE: Report[Any] = Report(
    title="Model Axes In Working Axes",
    table=MODELS,
    columns=(
        "model",
        "origin",
        *(
            MODELS.column(f"axes[{i}][{j}]", f"{name}{axis}", "F7.4")
            for i, name in enumerate("XYZ")
            for j, axis in enumerate("xyz")
        ),
    ),
)
GEOMETRY_TABLE: Report[Any] = Report(
    title="Scales, And Origins In The System Of The Job",
    table=MODELS,
    columns=("model", "scale", "base", "height", "origin_position"),
)
POINT_TABLE: Report[Any] = Report(title="Points Of The Run In The Model", table=RUN_POINTS)
EXPECTED_TABLE: Report[Any] = Report(title="Standard Errors To Expect", table=EXPECTED)
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
