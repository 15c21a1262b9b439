"""What may be wrong with a block, each hypothesis with what it explains in a linear model of the adjustment.

A hypothesis gives observations up (images, control, stations, ...), or revises what is common to many of them: a
camera constant, the index, a unit of length, the tides of several photos.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from musatpy.adjustment import reliability
from musatpy.adjustment.kinds import MEASURED
from musatpy.adjustment.kinds.water import level_corrections
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import Factor
from musatpy.adjustment.unknowns import LEVEL, State
from musatpy.adjustment.water_surface import tide_groups
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.blunders.checks import (
    Drop,
    PointChecks,
    dropped,
    put_in_again,
)
from musatpy.blunders.linear_model import Column, LinearModel
from musatpy.blunders.revisions import Revision
from musatpy.blunders.scene import IMAGES_CHECKED, PENALTY
from musatpy.model import Block, CauseKind, ObservationKind
from musatpy.model.ranking import falling

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


def hypotheses(model: LinearModel, near: BoolArray | None = None) -> list[Hypothesis]:
    """Return what explains most, by falling squares explained; some of every kind.

    Of all points, or of those only that are `near` (p,).
    """
    points = model if near is None else model.some(near)
    options = [*common_errors(model), *_direct(model), *_stations(model)]
    options += [option for checks in points.points for option in _of_points(model.network, checks)]
    return [options[row] for row in falling([option.squares for option in options]).tolist()]


def of_taken_images(model: LinearModel, images: Hypothesis) -> Hypothesis:
    """Return a hypothesis, of images of one point that the model has taken out, with what it explains."""
    rays, (point,) = images.given_up[0].row[::2], images.point
    checks = next(checks.part(checks.point == point) for checks in model.points if point in checks.point)
    order = np.flatnonzero(np.isin(checks.rays[0], rays))
    rows = (2 * order[:, None] + np.arange(2)).reshape(-1)
    weight = model.scene.weight[_K.PLATE][checks.rays[:, order]].reshape(1, -1)
    v, Q = put_in_again(checks.residual[:, rows], weight, checks.cofactor[:, rows[:, None], rows])
    drop = dropped(v, weight, Q, IMAGES_CHECKED)
    return _hypothesis(images.kind, drop, 0, photo=images.photo, point=images.point, given_up=images.given_up)


def _of_points(network: Network, checks: PointChecks) -> Iterator[Hypothesis]:
    """Yield single images, all images, and what is known of points."""
    if not len(checks.point):
        return
    m = checks.rays.shape[1]
    for image in range(m):
        yield from _of_images(network, checks, CauseKind.IMAGE, np.array([image]))
    if m > 1:
        yield from _of_images(network, checks, CauseKind.IMAGES, np.arange(m))
    for kind, components in (
        (CauseKind.HORIZONTAL, np.arange(2)),
        (CauseKind.VERTICAL, np.array([2])),
        (CauseKind.CONTROL, np.arange(3)),
        (CauseKind.ELEVATION, np.array([3])),
    ):
        if checks.has_priors and (checks.weight[:, 2 * m + components] > 0.0).any():
            yield from _of_priors(checks, kind, components)


def _of_images(network: Network, checks: PointChecks, kind: CauseKind, images: IntArray) -> Iterator[Hypothesis]:
    """Yield some of the images (r,) of points."""
    rays, drop = checks.rays[:, images], checks.drop((2 * images[:, None] + np.arange(2)).reshape(-1))
    for k in _most(drop):
        photo, given_up = tuple(np.unique(network.photo[rays[k]]).tolist()), GivenUp.of_images(rays[k])
        yield _hypothesis(kind, drop, k, photo=photo, point=(int(checks.point[k]),), given_up=(given_up,))


def _of_priors(checks: PointChecks, kind: CauseKind, components: IntArray) -> Iterator[Hypothesis]:
    """Yield what is known of points, some `components` of it."""
    rows = 2 * checks.rays.shape[1] + components
    drop, known = checks.drop(rows), checks.weight[:, rows] > 0.0
    # with one of its parts known only, it is that part
    both = kind is not CauseKind.CONTROL or known[:, :2].any(axis=1) & known[:, 2]
    for k in _most(drop, both):
        if kind is CauseKind.ELEVATION:
            given_up = GivenUp.of_row(_K.EQUAL_ELEVATION, int(checks.member[k]), np.array([0]))
        else:
            given_up = GivenUp.of_row(_K.CONTROL, int(checks.control[k]), components[known[k]])
        yield _hypothesis(kind, drop, k, point=(int(checks.point[k]),), given_up=(given_up,))


def _stations(model: LinearModel) -> Iterator[Hypothesis]:
    """Yield observed positions, attitudes, both, and tides."""
    known = model.station_weight > 0.0
    parts = {
        CauseKind.POSITION: ((_K.STATION_POSITION, np.arange(3)),),
        CauseKind.ATTITUDE: ((_K.STATION_ATTITUDE, np.arange(3, 6)),),
        CauseKind.STATION: ((_K.STATION_POSITION, np.arange(3)), (_K.STATION_ATTITUDE, np.arange(3, 6))),
        CauseKind.TIDE: ((_K.WATER_LEVEL, np.array([LEVEL])),),
    }
    for kind, of_kind in parts.items():
        columns = np.concatenate([column for _, column in of_kind])
        if columns.max() >= known.shape[1] or not known[:, columns].any():
            continue
        drop = model.station_drop(columns)
        for k in _most(drop, np.all([known[:, column].any(axis=1) for _, column in of_kind], axis=0)):
            given_up = tuple(GivenUp.of_row(part, k, column - column[0]) for part, column in of_kind)
            yield _hypothesis(kind, drop, k, photo=(k,), given_up=given_up)


def _direct(model: LinearModel) -> Iterator[Hypothesis]:
    """Yield what was measured between stations and points."""
    kinds = {kind.observed: kind for kind in MEASURED if len(model.network.measured[kind.observed].row)}
    if not kinds:
        return
    for part in reliability.direct(model.network, model.minimum, model.cofactors):
        if part.kind in kinds:
            kind = kinds[part.kind]
            drop = dropped(
                part.residual[:, None], part.weight[:, None], part.cofactor[:, None, None], _COMMON_CHECKED
            )
            for k in _most(drop):
                row = int(part.row[k])
                photo, point = kind.links_of(model.scene.block, row)
                given_up = GivenUp.of_row(part.kind, row, np.array([0]))
                yield _hypothesis(kind.cause, drop, k, photo=photo, point=point, given_up=(given_up,))


def _most(drop: Drop, among: BoolArray | bool = True) -> list[int]:
    """Return which groups of observations explain most, of those that are tested and `among` (k,) them."""
    enough = np.flatnonzero((drop.squares > 0.0) & (drop.parameters > 0) & among)
    return enough[falling(drop.squares[enough])[:_LISTED]].tolist()


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
    columns = [sums.columns[number] for number in some.tolist()]
    return _unknowns_more(columns, sums.weight[some], sums.pull[some], sums.coupling[some], model.factor)


def common_tides(
    block: Block, network: Network, state: State, factor: Factor, taken: BoolArray
) -> Iterator[Hypothesis]:
    """Yield what is common to known tides of several photos; photos that are `taken` (n,) belong to none."""
    weight, q = network.water.level_weight, network.pattern.size
    columns = [Column.of_tides(*group, network) for group in tide_groups(block, (weight > 0.0) & ~taken)]
    coupling, pull = np.zeros((len(columns), factor.matrix.size)), level_corrections(network, state) * weight
    for row, column in zip(coupling, columns, strict=True):
        photo = np.array(column.photo)
        row[photo * q + LEVEL] = weight[photo]
    pulls = np.array([float(pull[list(column.photo)].sum()) for column in columns])
    return _unknowns_more(columns, coupling.sum(axis=1), pulls, coupling, factor)


def _unknowns_more(
    columns: Sequence[Column], weight: FloatArray, pull: FloatArray, coupling: FloatArray, factor: Factor
) -> Iterator[Hypothesis]:
    """Yield what errors explain whose sums are those of `CommonErrors`."""
    scaled = coupling * factor.scale
    by_others = np.einsum("cu,uc->c", scaled, factor.solve_scaled(scaled.T))
    for number, column in enumerate(columns):
        checked = weight[number] - by_others[number]
        if checked > _COMMON_CHECKED * weight[number]:
            yield Hypothesis(
                kind=column.kind,
                photo=column.photo,
                member=column.member,
                name=column.name,
                squares=float(pull[number] ** 2 / checked),
                error=np.array([-pull[number] / checked]),
                sigma=np.array([1.0 / np.sqrt(checked)]),
            )
