"""A statement by the words and numbers that a card or a command has."""

from __future__ import annotations

from enum import StrEnum
from typing import TypeVar

from musatpy.errors import Problem, SystemsError
from musatpy.geometry.collinearity import AngleForm
from musatpy.geometry.systems import Geocentric, Geographic, LocalRectangular, System, TangentPlane
from musatpy.model import Block, EllipsoidSpec, SystemSpec
from musatpy.systems.statement import Axes, Sigmas, Statement, ellipsoid_by

MATRICES = "MATR"  # in the place of an `AngleForm`


class Kind(StrEnum):
    """The kinds of systems."""

    GEOGRAPHIC = "GEOG"
    GEOCENTRIC = "GEOC"
    LOCAL = "LOCL"
    TANGENT_PLANE = "TANG"
    PROJECTED = "PROJ"


def statement_of(spec: SystemSpec, block: Block) -> Statement:
    """Return the statement of a spec for a block with its ellipsoid. Raises `SystemsError` where it is none."""
    return statement_on(spec, block.ellipsoid)


def statement_on(spec: SystemSpec, ellipsoid: EllipsoidSpec | None) -> Statement:
    """Return the statement of a spec on an ellipsoid. Raises `SystemsError` where it is none."""
    kind = _one_of(Kind, spec.kind, "kind of coordinate system")
    _require_fields(spec, kind)
    return Statement(
        system=_system(spec, kind, ellipsoid),
        axes=_one_of(Axes, spec.axes, "kind of axes of attitudes"),
        form=None if spec.angles == MATRICES else _one_of(AngleForm, spec.angles, "form of attitudes", MATRICES),
        sigmas=_one_of(Sigmas, spec.sigmas, "kind of sigmas"),
    )


def _system(spec: SystemSpec, kind: Kind, given: EllipsoidSpec | None) -> System:
    if kind is Kind.LOCAL:
        return LocalRectangular()
    ellipsoid = ellipsoid_by(given, kind)
    if kind is Kind.PROJECTED:
        from musatpy.geometry.projected import Geoid, Projected  # more of PROJ than other jobs need

        return Projected(spec.definition, ellipsoid, Geoid(spec.geoid) if spec.geoid else None)
    if kind is Kind.TANGENT_PLANE:
        assert spec.origin is not None
        return TangentPlane(ellipsoid, spec.origin, spec.false or (0.0, 0.0, 0.0))
    return Geographic(ellipsoid) if kind is Kind.GEOGRAPHIC else Geocentric(ellipsoid)


def _require_fields(spec: SystemSpec, kind: Kind) -> None:
    """Raise `SystemsError` where something is missing that the kind needs, or given that it does not use."""
    users = {"definition": Kind.PROJECTED, "geoid": Kind.PROJECTED}
    users |= {"origin": Kind.TANGENT_PLANE, "false": Kind.TANGENT_PLANE}
    needed = {Kind.PROJECTED: "definition", Kind.TANGENT_PLANE: "origin"}.get(kind)
    problems = []
    if needed and not getattr(spec, needed):
        problems.append(Problem(field=needed, message=f"a system of kind {kind} needs it"))
    for name, user in users.items():
        if user is not kind and getattr(spec, name):
            problems.append(Problem(field=name, message=f"a system of kind {kind} has none"))
    if problems:
        raise SystemsError(problems)


_Choice = TypeVar("_Choice", bound=StrEnum)


def _one_of(choices: type[_Choice], word: str, what: str, *more: str) -> _Choice:
    if word not in list(choices):
        known = ", ".join([*choices, *more])
        raise SystemsError([Problem(message=f"'{word}' is no {what}: {known}")])
    return choices(word)
