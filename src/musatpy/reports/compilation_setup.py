"""The listing and the record of models set up (`musat as11 setup`)."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.reports import compilation
from musatpy.reports.columns import position_columns, vector
from musatpy.reports.compilation import INTERIOR, JOB, MODELS, MOVED, RECOVERED
from musatpy.reports.compilation_points import in_system
from musatpy.reports.encoding import Json
from musatpy.reports.fields import Field, Node, Rows, Schema, properties_of, same
from musatpy.reports.origin import Origin
from musatpy.reports.table import Column, Report, key

if TYPE_CHECKING:  # a reader of listings knows the tables by their statements alone
    from musatpy.compilation.against_run import AgainstRun
    from musatpy.compilation.compiled import Compiled
    from musatpy.compilation.setups import ModelSetUp

_VERSION = "2.0"
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
    same,
    (
        Field("model", "string", "model id", lambda s: _model_ids(s)),
        Field("point", "string", "point id", lambda s: _point_ids(s)),
        Field("submerged", "boolean", "flagged so", lambda s: _submerged(s)),
        Field("position", "3 number", "in the model", lambda s: _in_model(s), "m", exact=True),
        Field(
            "predicted", "2x2 number", "stages, left and right, x and y", lambda s: _of(s, "predicted"), "mm",
            exact=True,
        ),
        Field("difference", "2x2 number?", "read less predicted", lambda s: _difference(s), "mm"),
        Field(
            "y_parallax", "number?", "of refracted rays, by readings where there are any",
            lambda s: _of(s, "parallax"), "mm",
        ),
        Field("straight_y_parallax", "number?", "of straight rays", lambda s: _of(s, "straight"), "mm"),
    ),
)  # fmt: skip
EXPECTED: Rows[SetUps, SetUps] = Rows(
    "expected",
    "standard errors to expect of points at places of a model",
    same,
    (
        Field("model", "string", "model id", lambda s: _expected_ids(s)),
        Field("place", "3 number", "in the model", lambda s: _expected(s, "place"), "m", exact=True),
        Field("depth", "number", "below the water; 0: dry, at its height", lambda s: _expected(s, "depth"), "m"),
        Field("sigma", "3 number?", "east, north, up", lambda s: _expected(s, "sigma"), "m"),
        Field(
            "depth_sigma", "number?", "of the depth",
            lambda s: np.concatenate([m.expected.points.depth_sigma for m in s.models]), "m",
        ),
        Field("pointing_sigma", "number?", "of the height, by pointing", lambda s: _expected(s, "pointing"), "m"),
        Field("run_sigma", "number?", "of the height, by the run", lambda s: _expected(s, "of_run"), "m"),
    ),
)  # fmt: skip


def record_of(setups: SetUps, warnings: Sequence[str]) -> dict[str, Json]:
    """Return the record of models set up."""
    compiled = setups.compiled
    return {
        "setup_version": _VERSION,
        **{node.name: node.json(compiled) for node in (JOB, INTERIOR, MODELS, MOVED)},
        RECOVERED.name: RECOVERED.json((compiled, setups.against)),
        **{node.name: node.json(setups) for node in (RUN_POINTS, EXPECTED)},
        "warnings": list(warnings),
    }


def schema() -> Schema:
    """Return the JSON Schema of the record."""
    nodes: tuple[Node[Any], ...] = (
        Field("setup_version", "const", "of this schema", choices=(_VERSION,)),
        *(JOB, INTERIOR, MODELS, MOVED, RECOVERED, RUN_POINTS, EXPECTED),
        Field("warnings", "* string", "what is odd about the models"),
    )
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "musatpy models set up",
        "description": _ABOUT,
        "type": "object",
        **properties_of(nodes),
    }


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
        key("Model", "A8", "model"),
        *vector(("Origin X\nm", "Origin Y\nm", "Origin Z\nm"), ("F11.3",) * 3, shows="origin"),
        *(
            Column(f"{name}{axis}", "F7.4", shows=f"axes[{i}][{j}]")
            for i, name in enumerate("XYZ")
            for j, axis in enumerate("xyz")
        ),
    ),
)
GEOMETRY_TABLE: Report[Any] = Report(
    title="Scales, And Origins In The System Of The Job",
    table=MODELS,
    columns=(
        key("Model", "A8", "model"),
        Column("Scale\n1 to", "F9.0", shows="scale"),
        Column("Base\nm", "F9.2", shows="base"),
        Column("Height\nm", "F9.2", shows="height"),
        in_system(position_columns("origin_position", 4)),
    ),
)
POINT_TABLE: Report[Any] = Report(
    title="Points Of The Run In The Model",
    table=RUN_POINTS,
    columns=(
        key("Model", "A8", "model"),
        key("Point", "A8", "point"),
        Column("Bath", "A4", shows=Origin(field="submerged", true="B")),
        *(
            Column(f"{side} {axis}\nmm", "F10.4", shows=f"predicted[{i}][{j}]")
            for i, side in enumerate("LR")
            for j, axis in enumerate("xy")
        ),
        *(
            Column(f"Read {side}{axis}\nless\num", "F8.2", shows=f"difference[{i}][{j}]")
            for i, side in enumerate("LR")
            for j, axis in enumerate("xy")
        ),
        Column("py\num", "F7.2", shows="y_parallax"),
        Column("straight\num", "F8.2", shows="straight_y_parallax"),
    ),
)
EXPECTED_TABLE: Report[Any] = Report(
    title="Standard Errors To Expect",
    table=EXPECTED,
    columns=(
        key("Model", "A8", "model"),
        *vector(("X\nm", "Y\nm", "Z\nm"), ("F10.2",) * 3, shows="place"),
        Column("Depth\nm", "F7.2", shows="depth"),
        *vector([f"Sigma {axis}\nm" for axis in ("E", "N", "U")], ("F8.3",) * 3, shows="sigma"),
        Column("Depth\nm", "F8.3", shows="depth_sigma"),
        Column("Pointing\nm", "F8.3", shows="pointing_sigma"),
        Column("Run\nm", "F8.3", shows="run_sigma"),
    ),
)
STATED = (GEOMETRY_TABLE, AXES_TABLE, POINT_TABLE, EXPECTED_TABLE)


def listing_of(
    setups: SetUps,
    warnings: Sequence[str],
    *,
    carriage_control: bool = False,
    date: datetime.date | None = None,
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
