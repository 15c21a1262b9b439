"""What may be wrong with a block, each hypothesis with what it explains in a linear model of the adjustment.

A hypothesis gives observations up (images, control, stations, ...), or revises what is common to many of them: a
camera constant, the index, a unit of length, the tides of several photos.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from musatpy.adjustment import propagation
from musatpy.adjustment.kinds import MEASURED, PRIORS
from musatpy.adjustment.network import Network, first_rows
from musatpy.adjustment.normals import Factor
from musatpy.adjustment.sightings import index_partials, residuals
from musatpy.adjustment.unknowns import LEVEL, State
from musatpy.adjustment.water_surface import tide_groups
from musatpy.arrays import BoolArray, FloatArray, IntArray, falling
from musatpy.blunders.linear_model import Drop, LinearModel, PointChecks, dropped, put_in_again
from musatpy.blunders.scene import IMAGES_CHECKED, PENALTY
from musatpy.model import Block, CauseKind, ObservationKind

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
class Hypothesis:
    """Something that may be wrong; numbers are those of the tables of the block."""

    kind: CauseKind
    member: int = 0  # camera; twice the camera plus the axis; whose unit, whose labels
    photo: tuple[int, ...] = ()
    point: tuple[int, ...] = ()
    value: float = 0.0  # given minus true, as revised; of a unit of length, what the given ones are divided by
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
    block, points = model.scene.block, model.points
    if near is not None:
        points = tuple(checks.part(near[checks.point]) for checks in points)
    cards = {kind.observed: first_rows(kind.points(block), model.network.points) for kind in PRIORS}
    options = [*common_errors(model), *_direct(model), *_stations(model)]
    options += [option for checks in points for option in _of_points(model.network, checks, cards)]
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


def _of_points(
    network: Network, checks: PointChecks, cards: dict[ObservationKind, IntArray]
) -> Iterator[Hypothesis]:
    """Yield single images, all images, and what is known of points: the rows (p,) of their `cards`."""
    m = checks.rays.shape[1]
    has_priors = bool((checks.weight[:, 2 * m :] > 0.0).any())
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
        if has_priors and (checks.weight[:, 2 * m + components] > 0.0).any():
            yield from _of_priors(checks, kind, components, cards)


def _of_images(network: Network, checks: PointChecks, kind: CauseKind, images: IntArray) -> Iterator[Hypothesis]:
    """Yield some of the images (r,) of points."""
    rays, drop = checks.rays[:, images], checks.drop((2 * images[:, None] + np.arange(2)).reshape(-1))
    for k in _most(drop):
        photo, given_up = tuple(np.unique(network.photo[rays[k]]).tolist()), GivenUp.of_images(rays[k])
        yield _hypothesis(kind, drop, k, photo=photo, point=(int(checks.point[k]),), given_up=(given_up,))


def _of_priors(
    checks: PointChecks, kind: CauseKind, components: IntArray, cards: dict[ObservationKind, IntArray]
) -> Iterator[Hypothesis]:
    """Yield what is known of points, some `components` of it."""
    rows = 2 * checks.rays.shape[1] + components
    drop, known = checks.drop(rows), checks.weight[:, rows] > 0.0
    # with one of its parts known only, it is that part
    both = kind is not CauseKind.CONTROL or known[:, :2].any(axis=1) & known[:, 2]
    observed = _K.EQUAL_ELEVATION if kind is CauseKind.ELEVATION else _K.CONTROL
    for k in _most(drop, both):
        point, given = int(checks.point[k]), components[known[k]]
        part = GivenUp.of_row(observed, int(cards[observed][point]), given * (observed is _K.CONTROL))
        yield _hypothesis(kind, drop, k, point=(point,), given_up=(part,))


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
    for part in propagation.direct(model.network, model.minimum, model.cofactors):
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


def common_errors(model: LinearModel) -> list[Hypothesis]:
    """Return what is common to many observations: camera constants, the index, and common errors of tides.

    An error of one unit adds a column c to the observations. As an unknown more it explains
    (c'Pv)^2 / c'P Qvv P c, where c'P Qvv P c = c'Pc - (A'Pc)' N^-1 (A'Pc) (Baarda 1968); points are eliminated, and
    follow.
    """
    network, state, block = model.network, model.state, model.scene.block
    index = _index_counts(network)
    cameras = range(_cameras(block))
    columns = [
        Hypothesis(kind=kind, member=member)
        for camera in cameras
        for kind, member in (
            (CauseKind.FOCAL_LENGTH, camera),
            (CauseKind.PRINCIPAL_POINT, 2 * camera),
            (CauseKind.PRINCIPAL_POINT, 2 * camera + 1),
        )
    ]
    columns += [Hypothesis(kind=CauseKind.INDEX)] if index else []
    weight, pull = np.zeros((2, len(columns)))
    coupling = np.zeros((len(columns), len(model.step)))
    for checks in model.points:
        rows = slice(0, 2 * checks.rays.shape[1])
        c = _errors_of_images(network, state, block, checks.rays)
        weighted = np.swapaxes(checks.weight[:, rows, None] * c, 1, 2)
        by_point = weighted @ checks.ground[:, rows]
        weight += np.einsum("kco,koc->c", weighted, c)
        weight -= np.einsum("kci,kci->c", by_point @ checks.inverse, by_point)
        pull += np.einsum("kco,ko->c", weighted, checks.residual[:, rows])
        coupled = (weighted @ checks.partials[:, rows]).transpose(1, 0, 2).reshape(len(columns), -1)
        for row, values in zip(coupling, coupled, strict=True):
            row += np.bincount(checks.unknowns.reshape(-1), values, coupling.shape[1])
    tides: Iterator[Hypothesis] = iter(())
    if network.water.per_photo:
        tides = common_tides(block, network, model.station_weight[:, LEVEL], model.stations[:, LEVEL], model.factor)
    return [*_unknowns_more(columns, weight, pull, coupling, model.factor), *tides]


def common_tides(
    block: Block, network: Network, weight: FloatArray, residual: FloatArray, factor: Factor
) -> Iterator[Hypothesis]:
    """Yield what is common to known tides of several photos: weights and residuals (n,), adjusted minus observed.

    Photos without a weight belong to none.
    """
    groups = list(tide_groups(block, weight > 0.0))
    columns = [Hypothesis(kind=CauseKind.TIDES, name=name, photo=tuple(photo.tolist())) for name, photo in groups]
    coupling = np.zeros((len(columns), factor.matrix.size))
    for row, (_, photo) in zip(coupling, groups, strict=True):
        row[photo * network.pattern.size + LEVEL] = weight[photo]
    pull = np.array([float((weight * residual)[photo].sum()) for _, photo in groups])
    return _unknowns_more(columns, coupling.sum(axis=1), pull, coupling, factor)


def _unknowns_more(
    columns: Sequence[Hypothesis], weight: FloatArray, pull: FloatArray, coupling: FloatArray, factor: Factor
) -> Iterator[Hypothesis]:
    """Yield what errors explain, of columns c: c'Pc and c'Pv (C,), and c'PA (C, u) by stations and globals."""
    scaled = coupling * factor.scale
    by_others = np.einsum("cu,uc->c", scaled, factor.solve_scaled(scaled.T))
    for number, column in enumerate(columns):
        checked = weight[number] - by_others[number]
        if checked > _COMMON_CHECKED * weight[number]:
            yield replace(
                column,
                squares=float(pull[number] ** 2 / checked),
                error=np.array([-pull[number] / checked]),
                sigma=np.array([1.0 / np.sqrt(checked)]),
            )


def _index_counts(network: Network) -> bool:
    """Return whether the index of the water, which is no unknown itself, is worth a hypothesis."""
    unknown = network.water.unknown or network.border.count(_K.WAVE) > 0
    return bool(unknown and not network.border.count(_K.WATER_INDEX))


def _cameras(block: Block) -> int:
    """Return how many cameras photos have, the last of them included."""
    return int(block.photos.camera.max()) + 1


def _errors_of_images(network: Network, state: State, block: Block, rays: IntArray) -> FloatArray:
    """Return what errors of one unit add to images (k, m): (k, 2m, C), in the order of `common_errors`."""
    cameras = _cameras(block)
    photo, index = network.photo[rays], _index_counts(network)
    camera = 3 * block.photos.camera[photo]
    image = network.xy[rays] + residuals(network, state, rays.reshape(-1)).reshape(*rays.shape, 2)
    ray = (image - network.principal_point[photo]) / network.focal_length[photo][..., None]
    out = np.zeros((*rays.shape, 2, 3 * cameras + index))
    np.put_along_axis(out, camera[..., None, None], -ray[..., None], axis=-1)
    for axis in range(2):
        np.put_along_axis(out[:, :, axis], camera[..., None] + 1 + axis, -1.0, axis=-1)
    if index:
        wet = network.refracted[rays]
        out[wet, :, -1] = -index_partials(network, state, rays[wet])
    return out.reshape(len(rays), 2 * rays.shape[1], -1)
