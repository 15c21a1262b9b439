"""How a job is stated: its coordinate system, what its attitudes refer to, and what its sigmas are of.

The adjustment knows geographic, geocentric and local jobs, attitudes omega, phi, kappa in the local vertical, and
sigmas along east, north, up. A statement says how the same job reads elsewhere.

A statement by the words and numbers that a card or a command has.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TypeVar

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.errors import Problem, SystemsError
from musatpy.geometry.collinearity import AngleForm, angle_rates, angles_by_turn, in_axes, matrix_of, wrapped
from musatpy.geometry.geodesy import Ellipsoid, ellipsoid_by
from musatpy.geometry.systems import Geocentric, Geographic, LocalRectangular, System, TangentPlane
from musatpy.model import Block, CoordinateSystem, EllipsoidSpec, SystemSpec

NATIVE = AngleForm.OMEGA_PHI_KAPPA  # the form of the adjustment


class Axes(StrEnum):
    """The axes that attitudes refer to, at the position of the station."""

    VERTICAL = "VERT"  # east, north, up
    SYSTEM = "GRID"  # those of the coordinate system: grid north and the normal, the plane's, the geocentric
    GEOCENTRIC = "GEOC"


class Sigmas(StrEnum):
    """What the sigmas of a job are of."""

    LOCAL = "LOCL"  # metres along east, north, up; omega, phi, kappa in the local vertical: as in every deck
    SYSTEM = "SYST"  # the coordinates and the attitudes as they are stated


_FORMS = {
    AngleForm.OMEGA_PHI_KAPPA: "omega, phi, kappa",
    AngleForm.PHI_OMEGA_KAPPA: "phi, omega, kappa",
    AngleForm.AZIMUTH_TILT_SWING: "azimuth, tilt, swing",
}
_AXES = {
    Axes.VERTICAL: "in the local vertical",
    Axes.SYSTEM: "along the axes of the system",
    Axes.GEOCENTRIC: "along geocentric axes",
}
_SIGMAS = {
    Sigmas.LOCAL: "along east, north, up and of omega, phi, kappa in the local vertical",
    Sigmas.SYSTEM: "of these coordinates and attitudes",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Statement:
    """How a job is stated. Raises `SystemsError` where the attitudes have no such axes."""

    system: System
    axes: Axes = Axes.VERTICAL
    form: AngleForm | None = NATIVE  # None: rotation matrices
    sigmas: Sigmas = Sigmas.LOCAL

    def __post_init__(self) -> None:
        system = self.system
        if self.axes is Axes.SYSTEM and not system.own_axes:
            message = f"attitudes cannot refer to axes of the system: {system.text} has none"
            raise SystemsError.of(message, field="axes")
        if self.axes is Axes.GEOCENTRIC and system.ellipsoid is None:
            raise SystemsError.of(f"geocentric axes of attitudes in a job that is {system.text}", field="axes")

    @property
    def text(self) -> str:
        """What is stated, in a line for people."""
        return f"{self.system.text}; {self.attitudes_text}; sigmas {self.sigmas_text}"

    @property
    def attitudes_text(self) -> str:
        """What states attitudes, and along which axes."""
        form = "rotation matrices" if self.form is None else _FORMS[self.form]
        return f"{form} {self.axes_text}"

    @property
    def axes_text(self) -> str:
        """Along which axes attitudes are."""
        return _AXES[self.axes]

    @property
    def turned(self) -> bool:
        """Whether attitudes refer to other axes than the local vertical."""
        return self.axes is not Axes.VERTICAL

    @property
    def along_system(self) -> bool:
        """Whether attitudes refer to the axes of the system."""
        return self.axes is Axes.SYSTEM

    @property
    def sigmas_text(self) -> str:
        """What sigmas are of."""
        return _SIGMAS[self.sigmas]

    def reference(self, level: FloatArray) -> FloatArray:
        """Return the axes (n, 3, 3) that attitudes refer to, as rows along east, north, up at level positions."""
        if self.axes is Axes.SYSTEM:
            return self.system.axes(level)
        if self.axes is Axes.GEOCENTRIC:
            assert self.system.ellipsoid is not None
            return np.swapaxes(self.system.ellipsoid.frame(level), -1, -2)
        return np.broadcast_to(np.eye(3), (len(level), 3, 3))


@dataclass(frozen=True, kw_only=True, eq=False)
class Attitudes:
    """n attitudes as they are stated."""

    angles: FloatArray  # (n, 3) rad, NaN where stated as matrices
    matrix: FloatArray  # (n, 3, 3) reference axes to photo
    partials: FloatArray  # (n, 3, 3) stated angles, or small rotations, by omega, phi, kappa; NaN in gimbal cases
    lost: BoolArray  # (n,) gimbal cases


def attitudes_out(statement: Statement, level: FloatArray, attitude: FloatArray) -> Attitudes:
    """Return attitudes (n, 3), omega, phi, kappa in the local verticals of level positions, as they are stated.

    Matrices have the small rotations along the reference axes in the place of angles.
    """
    axes = statement.reference(level)
    matrix = in_axes(matrix_of(attitude, NATIVE), axes)
    turn = axes @ angle_rates(attitude, NATIVE)
    if statement.form is None:
        none = np.full((len(level), 3), np.nan)
        return Attitudes(angles=none, matrix=matrix, partials=turn, lost=np.zeros(len(level), dtype=bool))
    angles, partials, lost = angles_by_turn(matrix, statement.form, turn)
    angles = _same_turns(angles, attitude, statement.form)
    return Attitudes(angles=angles, matrix=matrix, partials=partials, lost=lost)


def attitudes_in(statement: Statement, level: FloatArray, stated: FloatArray) -> Attitudes:
    """Return attitudes as omega, phi, kappa in the local verticals of level positions.

    `stated` are angles (n, 3) rad, or matrices (n, 3, 3). The partials are those of omega, phi, kappa by the stated
    angles, or by the small rotations along the reference axes.
    """
    axes = np.swapaxes(statement.reference(level), -1, -2)
    form = statement.form
    matrix = in_axes(stated if form is None else matrix_of(stated, form), axes)
    turn = axes if form is None else axes @ angle_rates(stated, form)
    angles, partials, lost = angles_by_turn(matrix, NATIVE, turn)
    if form is not None:
        angles = _same_turns(angles, stated, form)
    return Attitudes(angles=angles, matrix=matrix, partials=partials, lost=lost)


def _same_turns(angles: FloatArray, before: FloatArray, form: AngleForm) -> FloatArray:
    """Return angles (n, 3) with whole turns added that bring them near what they were: a heading of 350 stays one.

    `form` is the one that is not that of the adjustment, if any: of its angles only kappa is like one before.
    """
    alike = {NATIVE: [True, True, True], AngleForm.PHI_OMEGA_KAPPA: [False, False, True]}
    return np.where(alike.get(form, False), wrapped(angles, before), angles)


def own_statement(block: Block) -> Statement:
    """Return how a block states itself: the system of its options, attitudes as in the adjustment.

    Raises `SystemsError` where its ellipsoid is missing or unknown.
    """
    if block.options.system is CoordinateSystem.LOCAL:
        return Statement(system=LocalRectangular())
    ellipsoid = ellipsoid_of(block)
    geographic = block.options.system is CoordinateSystem.GEOGRAPHIC
    return Statement(system=Geographic(ellipsoid) if geographic else Geocentric(ellipsoid))


def ellipsoid_of(block: Block) -> Ellipsoid:
    """Return the ellipsoid of a block. Raises `SystemsError` where it is missing or unknown."""
    return ellipsoid_by(block.ellipsoid, block.options.system)


def require_same_earth(block: Block, system: System) -> None:
    """Raise `SystemsError` unless the job and the system stand on one ellipsoid, or both on none."""
    local = block.options.system is CoordinateSystem.LOCAL
    if local != (system.ellipsoid is None):
        what = "a local job stands nowhere on the ellipsoid" if local else "the job is on the ellipsoid"
        raise SystemsError.of(f"{what}, the system is {system.text}: neither can be stated in the other")
    if system.ellipsoid is None:
        return
    if not ellipsoid_of(block).has_axes(*system.ellipsoid.axes):
        raise SystemsError.of(f"{system.text} is on another ellipsoid than the job: no datum is shifted")


MATRICES = "MATR"  # in the place of an `AngleForm`


class SystemKind(StrEnum):
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
    kind = _one_of(SystemKind, spec.kind, "kind of coordinate system")
    _require_fields(spec, kind)
    return Statement(
        system=_system(spec, kind, ellipsoid),
        axes=_one_of(Axes, spec.axes, "kind of axes of attitudes"),
        form=None if spec.angles == MATRICES else _one_of(AngleForm, spec.angles, "form of attitudes", MATRICES),
        sigmas=_one_of(Sigmas, spec.sigmas, "kind of sigmas"),
    )


def _system(spec: SystemSpec, kind: SystemKind, given: EllipsoidSpec | None) -> System:
    if kind is SystemKind.LOCAL:
        return LocalRectangular()
    ellipsoid = ellipsoid_by(given, kind)
    if kind is SystemKind.PROJECTED:
        from musatpy.geometry.projected import Geoid, Projected  # more of PROJ than other jobs need

        return Projected(spec.definition, ellipsoid, Geoid(spec.geoid) if spec.geoid else None)
    if kind is SystemKind.TANGENT_PLANE:
        assert spec.origin is not None
        return TangentPlane(ellipsoid, spec.origin, spec.false or (0.0, 0.0, 0.0))
    return Geographic(ellipsoid) if kind is SystemKind.GEOGRAPHIC else Geocentric(ellipsoid)


def _require_fields(spec: SystemSpec, kind: SystemKind) -> None:
    """Raise `SystemsError` where something is missing that the kind needs, or given that it does not use."""
    users = {"definition": SystemKind.PROJECTED, "geoid": SystemKind.PROJECTED}
    users |= {"origin": SystemKind.TANGENT_PLANE, "false": SystemKind.TANGENT_PLANE}
    needed = {SystemKind.PROJECTED: "definition", SystemKind.TANGENT_PLANE: "origin"}.get(kind)
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
        raise SystemsError.of(f"'{word}' is no {what}: {known}")
    return choices(word)
