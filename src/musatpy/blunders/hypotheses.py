"""What may be wrong with a block, each hypothesis with what it explains in a linear model of the adjustment.

A hypothesis gives observations up (images, control, stations, ...), or revises what is common to many of them: a
camera constant, the index, a unit of length, the tides of several photos.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from musatpy.adjustment import reliability
from musatpy.adjustment.kinds import MEASURED
from musatpy.adjustment.unknowns import LEVEL
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.blunders.checks import (
    IMAGES_CHECKED,
    CheckedPoints,
    Drop,
    PointChecks,
    dropped,
    put_in_again,
)
from musatpy.blunders.linear_model import LinearModel
from musatpy.blunders.revisions import Revision
from musatpy.model import CauseKind, ObservationKind
from musatpy.model.ranking import falling

PENALTY = 16.0  # squares over sigma0 squared that a parameter must explain: the square of the limit of the tests
_LISTED = 8  # of one kind of hypothesis, those that explain most
_COMMON_CHECKED = 1e-6  # of c'Pc; less says nothing of a common error

_K = ObservationKind


@dataclass(frozen=True, kw_only=True, eq=False)
class GivenUp:
    """Observations of one kind that a hypothesis gives up."""

    kind: ObservationKind
    row: IntArray  # (s,)
    component: IntArray  # (s,)

    @classmethod
    def of_row(cls, kind: ObservationKind, row: int, component: IntArray) -> GivenUp:
        """Return some components (s,) of one row."""
        return cls(kind=kind, row=np.full(len(component), row), component=component)

    @classmethod
    def of_images(cls, rays: IntArray) -> GivenUp:
        """Return images (r,), both coordinates."""
        return cls(kind=_K.PLATE, row=np.repeat(rays, 2), component=np.tile([0, 1], len(rays)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Hypothesis(Revision):
    """Something that may be wrong; numbers are those of the tables of the block."""

    given_up: tuple[GivenUp, ...] = ()  # empty: something is revised
    squares: float = 0.0  # that it explains
    parameters: int = 1
    error: FloatArray = field(default_factory=lambda: np.zeros(0))  # (s,) given minus true
    sigma: FloatArray = field(default_factory=lambda: np.zeros(0))  # (s,) for sigma0 of 1
    name: str = ""  # of several photos: of their group or day

    @property
    def key(self) -> tuple[CauseKind, tuple[int, ...], tuple[int, ...], int]:
        """Return what tells hypotheses apart."""
        return (self.kind, self.photo, self.point, self.member)

    def gain(self, variance: float) -> float:
        """Return the squares explained, less the price of the parameters."""
        return self.squares / variance - PENALTY * self.parameters


def hypotheses(
    model: LinearModel,
    near: BoolArray | None = None,
    wanted: Callable[[Hypothesis], bool] | None = None,
    share: float = 0.0,
    least: float = 0.0,
) -> list[Hypothesis]:
    """Return what explains most, by falling squares explained; some of every kind.

    Of all points, or of those only that are `near` (p,). What points and stations explain may be missing where it
    is less than the `least` squares, or than this `share` of what the `wanted` hypothesis does that explains most.
    """
    options = [*common_errors(model), *_direct(model)]
    checked = model if near is None else model.some(near)
    known = [checks for checks in checked.points if checks.has_priors]
    seen = [checks for checks in checked.points if not checks.has_priors and len(checks.point) > 1]
    # the only point of a group is its worst one as well, and is asked once
    single = [checks for checks in checked.points if not checks.has_priors and len(checks.point) == 1]
    of_single = [option for checks in single for option in _of_points(checked, checks, least)]

    def share_of_best(options: list[Hypothesis]) -> float:
        return share * max((option.squares for option in options if wanted and wanted(option)), default=0.0)

    if wanted is not None:
        worst = [checks.part(checks.squares == checks.squares.max()) for checks in seen]
        likely = [option for checks in worst for option in _of_points(checked, checks, least)]
        least = max(least, share_of_best([*options, *of_single, *likely]))
    options += [*of_single, *_stations(model, least)]
    for checks in (*known, *seen):
        options += _of_points(checked, checks.explaining(least), least)
        least = max(least, share_of_best(options))
    return [options[row] for row in falling([option.squares for option in options]).tolist()]


def of_taken_images(model: LinearModel, points: list[PointChecks], images: Hypothesis) -> Hypothesis:
    """Return a hypothesis, of images of one of some points that the model has taken out, with what it explains."""
    rays, (point,) = images.given_up[0].row[::2], images.point
    checks = next(checks.part(checks.point == point) for checks in points if point in checks.point)
    order = np.flatnonzero(np.isin(checks.rays[0], rays))
    rows = (2 * order[:, None] + np.arange(2)).reshape(-1)
    weight = model.scene.weight[_K.PLATE][checks.rays[:, order]].reshape(1, -1)
    v, Q = put_in_again(checks.residual[:, rows], weight, checks.cofactor[:, rows[:, None], rows])
    drop = dropped(v, weight, Q, IMAGES_CHECKED)
    return _hypothesis(images.kind, drop, 0, photo=images.photo, point=images.point, given_up=images.given_up)


def _of_points(points: CheckedPoints, checks: PointChecks, least: float) -> Iterator[Hypothesis]:
    """Yield single images, all images, and what is known of points, where they explain the `least` squares."""
    m = checks.rays.shape[1]
    if not len(checks.point):
        return
    yield from _of_images(points, checks, CauseKind.IMAGE, checks.rays.reshape(-1, 1), checks.images_drop(), least)
    if m > 1:
        yield from _of_images(points, checks, CauseKind.IMAGES, checks.rays, checks.drop(np.arange(2 * m)), least)
    if checks.has_priors:
        for kind, components in (
            (CauseKind.HORIZONTAL, np.arange(2)),
            (CauseKind.VERTICAL, np.array([2])),
            (CauseKind.CONTROL, np.arange(3)),
            (CauseKind.ELEVATION, np.array([3])),
        ):
            if (checks.weight[:, 2 * m + components] > 0.0).any():
                yield from _of_priors(checks, kind, components, least)


def _of_images(
    points: CheckedPoints, checks: PointChecks, kind: CauseKind, rays: IntArray, drop: Drop, least: float
) -> Iterator[Hypothesis]:
    """Yield groups of images `rays` (k n, r) of points, n groups of each: all first ones, all second ones, ..."""
    n, squares = len(rays) // len(checks.point), np.where(drop.parameters > 0, drop.squares, 0.0)
    for number in range(n):
        for k in _most(squares[number::n], least):
            row = number + n * k
            photo = tuple(np.unique(points.network.photo[rays[row]]).tolist())
            given_up = GivenUp.of_images(rays[row])
            yield _hypothesis(kind, drop, row, photo=photo, point=(int(checks.point[k]),), given_up=(given_up,))


def _of_priors(checks: PointChecks, kind: CauseKind, components: IntArray, least: float) -> Iterator[Hypothesis]:
    """Yield what is known of points, some `components` of it."""
    rows = 2 * checks.rays.shape[1] + components
    drop, known = checks.drop(rows), checks.weight[:, rows] > 0.0
    squares = np.where(drop.parameters > 0, drop.squares, 0.0)
    if kind is CauseKind.CONTROL:  # with one of its parts known only, it is that part
        squares[~(known[:, :2].any(axis=1) & known[:, 2])] = 0.0
    for k in _most(squares, least):
        if kind is CauseKind.ELEVATION:
            given_up = GivenUp.of_row(_K.EQUAL_ELEVATION, int(checks.member[k]), np.array([0]))
        else:
            given_up = GivenUp.of_row(_K.CONTROL, int(checks.control[k]), components[known[k]])
        yield _hypothesis(kind, drop, k, point=(int(checks.point[k]),), given_up=(given_up,))


def _stations(model: LinearModel, least: float) -> Iterator[Hypothesis]:
    """Yield observed positions, attitudes, both, and tides, where they explain the `least` squares."""
    for kind, columns in (
        (CauseKind.POSITION, np.arange(3)),
        (CauseKind.ATTITUDE, np.arange(3, 6)),
        (CauseKind.STATION, np.arange(6)),
        (CauseKind.TIDE, np.array([LEVEL])),
    ):
        if columns.max() >= model.stations.shape[1] or not (model.station_weight[:, columns] > 0.0).any():
            continue
        photos = model.stations_explaining(least, columns)
        drop = model.station_drop(photos, columns)
        squares = np.where(drop.parameters > 0, drop.squares, 0.0)
        if kind is CauseKind.STATION:
            known = model.station_weight[photos] > 0.0
            squares[~(known[:, :3].any(axis=1) & known[:, 3:6].any(axis=1))] = 0.0
        for k in _most(squares, least):
            photo = int(photos[k])
            parts = (
                (_K.STATION_POSITION, columns[columns < 3]),
                (_K.STATION_ATTITUDE, columns[(columns >= 3) & (columns < LEVEL)] - 3),
                (_K.WATER_LEVEL, columns[columns == LEVEL] - LEVEL),
            )
            given_up = tuple(
                GivenUp.of_row(part, photo, components) for part, components in parts if len(components)
            )
            yield _hypothesis(kind, drop, k, photo=(photo,), given_up=given_up)


def _direct(model: LinearModel) -> Iterator[Hypothesis]:
    """Yield what was measured between stations and points."""
    kinds = {kind.observed: kind for kind in MEASURED if len(model.network.measured[kind.observed].row)}
    if not kinds:
        return
    for part in reliability.direct(model.network, model.minimum, model.cofactors):
        if part.kind in kinds:
            kind = kinds[part.kind]
            redundancy = 1.0 - part.weight * part.cofactor
            checked = (redundancy > _COMMON_CHECKED) & (part.weight > 0.0)
            r = np.where(checked, redundancy, 1.0)
            squares = np.where(checked, part.weight * np.square(part.residual) / r, 0.0)
            for k in _most(squares):
                row = int(part.row[k])
                photo, point = kind.links_of(model.scene.block, row)
                yield Hypothesis(
                    kind=CauseKind(kind.noun),
                    photo=photo,
                    point=point,
                    given_up=(GivenUp.of_row(part.kind, row, np.array([0])),),
                    squares=float(squares[k]),
                    error=-part.residual[[k]] / r[k],
                    sigma=1.0 / np.sqrt(part.weight[[k]] * r[k]),
                )


def _most(squares: FloatArray, least: float = 0.0) -> list[int]:
    enough = np.flatnonzero(squares > max(least, 0.0))
    return enough[falling(squares[enough])[:_LISTED]].tolist() if len(enough) else []


def _hypothesis(
    kind: CauseKind,
    drop: Drop,
    k: int,
    photo: tuple[int, ...] = (),
    point: tuple[int, ...] = (),
    given_up: tuple[GivenUp, ...] = (),
) -> Hypothesis:
    return Hypothesis(
        kind=kind,
        photo=photo,
        point=point,
        given_up=given_up,
        squares=float(drop.squares[k]),
        parameters=int(drop.parameters[k]),
        error=drop.error[k],
        sigma=drop.sigma[k],
    )


def common_errors(model: LinearModel) -> Iterator[Hypothesis]:
    """Yield what is common to many observations: an unknown more, one solution of the normal equations each."""
    sums = model.common
    some = np.flatnonzero(sums.weight > 0.0)
    scaled = sums.coupling[some] * model.factor.scale
    solved = np.einsum("cu,uc->c", scaled, model.factor.solve_scaled(scaled.T))
    for number, by_others in zip(some.tolist(), solved.tolist(), strict=True):
        column, weight, pull = sums.columns[number], sums.weight[number], sums.pull[number]
        checked = weight - by_others
        if checked > _COMMON_CHECKED * weight:
            yield Hypothesis(
                kind=column.kind,
                photo=column.photo,
                member=column.member,
                name=column.name,
                squares=float(pull**2 / checked),
                error=np.array([-pull / checked]),
                sigma=np.array([1.0 / np.sqrt(checked)]),
            )
