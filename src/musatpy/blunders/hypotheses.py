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
from musatpy.adjustment.sightings import all_residuals, index_partials
from musatpy.adjustment.unknowns import LEVEL
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.blunders.factors import taking_part
from musatpy.blunders.linear_model import (
    IMAGES_CHECKED,
    Drop,
    LinearModel,
    PointChecks,
    dropped,
    put_in_again,
)
from musatpy.blunders.revisions import Revision
from musatpy.blunders.tides import tide_groups
from musatpy.model import Block, CauseKind, CoordinateSystem, ObservationKind
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

    Of all points, or of those only that are `near` (p,). What points explain may be missing where it is less than
    the `least` squares, or than this `share` of what the `wanted` hypothesis does that explains most.
    """
    options = [*_stations(model), *common_errors(model), *_direct(model)]
    points = [checks if near is None else checks.part(near[checks.point]) for checks in model.points]
    known = [checks for checks in points if checks.has_priors]
    seen = [checks for checks in points if not checks.has_priors and len(checks.point)]
    loose = model.loose
    near = np.ones(model.network.points, dtype=bool) if near is None else near

    def share_of_best(options: list[Hypothesis]) -> float:
        return share * max((option.squares for option in options if wanted and wanted(option)), default=0.0)

    if wanted is not None:
        worst = [checks.part(checks.squares == checks.squares.max()) for checks in seen]
        likely = [option for checks in worst for option in _of_points(model, checks, least)]
        least = max(least, share_of_best([*options, *likely, *of_worst_point(model, near, least)]))
    for checks in (*known, *seen):
        part = checks.part(checks.explaining(least))
        if len(part.point):
            options += _of_points(model, part, least)
        least = max(least, share_of_best(options))
    for checks in loose.checks(loose.explaining(least, near)) if loose is not None else ():
        options += _of_points(model, checks, least)
    return [options[row] for row in falling([option.squares for option in options]).tolist()]


def of_worst_point(model: LinearModel, near: BoolArray | None = None, least: float = 0.0) -> list[Hypothesis]:
    """Return what the images explain of the loose point, of those `near` (p,), that fits least of all."""
    loose = model.loose
    if loose is None:
        return []
    near = np.ones(model.network.points, dtype=bool) if near is None else near
    worst = loose.checks(near & (loose.squares == loose.squares[near].max(initial=0.0)))
    return [option for checks in worst for option in _of_points(model, checks, least)]


def of_taken_images(model: LinearModel, images: Hypothesis) -> Hypothesis:
    """Return a hypothesis, of images of a point that the model checks and has taken out, with what it explains."""
    rays, (point,) = images.given_up[0].row[::2], images.point
    checks = next(checks.part(checks.point == point) for checks in model.points if point in checks.point)
    order = np.flatnonzero(np.isin(checks.rays[0], rays))
    rows = (2 * order[:, None] + np.arange(2)).reshape(-1)
    weight = model.scene.weight[_K.PLATE][checks.rays[:, order]].reshape(1, -1)
    v, Q = put_in_again(checks.residual[:, rows], weight, checks.cofactor[:, rows[:, None], rows])
    drop = dropped(v, weight, Q, IMAGES_CHECKED)
    return _hypothesis(images.kind, drop, 0, photo=images.photo, point=images.point, given_up=images.given_up)


def _of_points(model: LinearModel, checks: PointChecks, least: float) -> Iterator[Hypothesis]:
    """Yield single images, all images, and what is known of points, where they explain the `least` squares."""
    m = checks.rays.shape[1]
    for image, drop in enumerate(checks.image_drops()):
        rows = np.array([2 * image, 2 * image + 1])
        yield from _largest(model, checks, CauseKind.IMAGE, rows, drop, least, image)
    if m > 1:
        rows = np.arange(2 * m)
        yield from _largest(model, checks, CauseKind.IMAGES, rows, checks.drop(rows), least)
    if checks.has_priors:
        for kind, rows in (
            (CauseKind.HORIZONTAL, np.arange(2)),
            (CauseKind.VERTICAL, np.array([2])),
            (CauseKind.CONTROL, np.arange(3)),
            (CauseKind.ELEVATION, np.array([3])),
        ):
            yield from _largest(model, checks, kind, 2 * m + rows, checks.drop(2 * m + rows), least)


def _largest(
    model: LinearModel,
    checks: PointChecks,
    kind: CauseKind,
    rows: IntArray,
    drop: Drop,
    least: float,
    image: int | None = None,
) -> Iterator[Hypothesis]:
    m = checks.rays.shape[1]
    squares = np.where(drop.parameters > 0, drop.squares, 0.0)
    if kind is CauseKind.CONTROL:  # with one of its parts known only, it is that part
        known = checks.weight[:, rows] > 0.0
        squares[~(known[:, :2].any(axis=1) & known[:, 2])] = 0.0
    for k in _most(squares, least):
        if image is not None or kind is CauseKind.IMAGES:
            rays = checks.rays[k] if image is None else checks.rays[k, image : image + 1]
            given_up = GivenUp.of_images(rays)
        elif kind is CauseKind.ELEVATION:
            given_up = GivenUp.of_row(_K.EQUAL_ELEVATION, int(checks.member[k]), np.array([0]))
        else:
            components = (rows - 2 * m)[checks.weight[k, rows] > 0.0]
            given_up = GivenUp.of_row(_K.CONTROL, int(checks.control[k]), components)
        photo = tuple(np.unique(model.network.photo[given_up.row]).tolist()) if given_up.kind is _K.PLATE else ()
        yield _hypothesis(kind, drop, k, photo=photo, point=(int(checks.point[k]),), given_up=(given_up,))


def _stations(model: LinearModel) -> Iterator[Hypothesis]:
    """Yield observed positions, attitudes, both, and tides."""
    for kind, columns in (
        (CauseKind.POSITION, np.arange(3)),
        (CauseKind.ATTITUDE, np.arange(3, 6)),
        (CauseKind.STATION, np.arange(6)),
        (CauseKind.TIDE, np.array([LEVEL])),
    ):
        if columns.max() >= model.stations.shape[1] or not (model.station_weight[:, columns] > 0.0).any():
            continue
        drop = model.station_drop(columns)
        squares = np.where(drop.parameters > 0, drop.squares, 0.0)
        if kind is CauseKind.STATION:
            known = model.station_weight > 0.0
            squares[~(known[:, :3].any(axis=1) & known[:, 3:6].any(axis=1))] = 0.0
        for k in _most(squares):
            parts = (
                (_K.STATION_POSITION, columns[columns < 3]),
                (_K.STATION_ATTITUDE, columns[(columns >= 3) & (columns < LEVEL)] - 3),
                (_K.WATER_LEVEL, columns[columns == LEVEL] - LEVEL),
            )
            given_up = tuple(GivenUp.of_row(part, k, components) for part, components in parts if len(components))
            yield _hypothesis(kind, drop, k, photo=(k,), given_up=given_up)


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
    return [int(k) for k in falling(squares)[:_LISTED] if squares[k] > max(least, 0.0)]


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


@dataclass(frozen=True, kw_only=True, eq=False)
class _Column:
    """What an error of one unit adds to the observations, if it is common to many."""

    kind: CauseKind
    member: int = 0
    photo: tuple[int, ...] = ()
    name: str = ""
    images: FloatArray | None = None  # (m, 2)
    control: FloatArray | None = None  # (k, 3)
    stations: FloatArray | None = None  # (n, q)


def _columns(model: LinearModel) -> Iterator[_Column]:
    """Yield camera constants, the index, units of length, and common errors of tides."""
    network, state, block = model.network, model.state, model.scene.block
    used, photo = taking_part(network), network.photo
    m, n, q = len(photo), network.photos, model.stations.shape[1]
    xy = network.xy + all_residuals(network, state, used)
    ray = (xy - network.principal_point[photo]) / network.focal_length[photo][:, None]
    for camera in range(len(block.cameras.ids)):
        taken = used & (block.photos.camera == camera)[photo]
        if taken.any():
            images_taken = taken[:, None]
            yield _Column(kind=CauseKind.FOCAL_LENGTH, member=camera, images=np.where(images_taken, -ray, 0.0))
            for axis in range(2):
                member, unit = 2 * camera + axis, -np.eye(2)[axis]
                yield _Column(kind=CauseKind.PRINCIPAL_POINT, member=member, images=images_taken * unit)
    wet = np.flatnonzero(used & network.refracted)
    unknown = network.water.unknown or network.border.count(_K.WAVE)
    if len(wet) and unknown and not network.border.count(_K.WATER_INDEX):
        column = np.zeros((m, 2))
        column[wet] = -index_partials(network, state, wet)
        yield _Column(kind=CauseKind.INDEX, images=column)
    yield from _units(block, n, q)
    if network.water.per_photo:
        for name, photos in tide_groups(block, network.water.level_weight > 0.0):
            column = np.zeros((n, q))
            column[photos, LEVEL] = 1.0
            yield _Column(kind=CauseKind.TIDES, photo=tuple(photos.tolist()), name=name, stations=column)


def _units(block: Block, photos: int, unknowns: int) -> Iterator[_Column]:
    """Yield what a wrong unit of length does: to heights, in local jobs to all coordinates."""
    system = block.options.system
    if system is CoordinateSystem.GEOCENTRIC:
        return
    axes = slice(0, 3) if system is CoordinateSystem.LOCAL else slice(2, 3)
    control, stations = np.zeros((len(block.control.point), 3)), np.zeros((photos, unknowns))
    control[:, axes] = np.nan_to_num(block.control.position[:, axes])
    stations[:, axes] = np.nan_to_num(block.photos.position[:, axes])
    yield _Column(kind=CauseKind.UNIT, member=0, control=control)
    yield _Column(kind=CauseKind.UNIT, member=1, stations=stations)


def common_errors(model: LinearModel) -> Iterator[Hypothesis]:
    """Yield what is common to many observations: an unknown more, one solution of the normal equations each."""
    columns = list(_columns(model))
    weight, pull, coupling = _of_columns(model, columns)
    scaled = coupling * model.factor.scale
    solved = np.einsum("cu,uc->c", scaled, model.factor.solve_scaled(scaled.T))
    for number, column in enumerate(columns):
        checked = weight[number] - float(solved[number])
        if weight[number] > 0.0 and checked > _COMMON_CHECKED * weight[number]:
            yield Hypothesis(
                kind=column.kind,
                photo=column.photo,
                member=column.member,
                name=column.name,
                squares=float(pull[number] ** 2 / checked),
                error=np.array([-pull[number] / checked]),
                sigma=np.array([1.0 / np.sqrt(checked)]),
            )


def _of_columns(model: LinearModel, columns: list[_Column]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return c'Pc (C,) and c'Pv (C,) of columns c of observations, and c'PA (C, u) by stations and globals.

    The points follow.
    """
    weight, pull = np.zeros((2, len(columns)))
    coupling = np.zeros((len(columns), len(model.step)))
    on_images = [number for number, column in enumerate(columns) if column.images is not None]
    images = _stacked([columns[number].images for number in on_images])
    on_control = [number for number, column in enumerate(columns) if column.control is not None]
    control = _stacked([columns[number].control for number in on_control])
    if on_images and model.loose is not None:
        loose = model.loose.left_over(np.moveaxis(images, -1, 0))
        weight[on_images], pull[on_images] = loose.weight, loose.pull
        coupling[on_images, : loose.coupling.shape[1]] = loose.coupling
    for checks in model.points:
        k, m = checks.rays.shape
        parts = [(on_images, slice(0, 2 * m), images[checks.rays].reshape(k, 2 * m, -1))] if on_images else []
        if on_control and checks.has_priors:
            of_control = np.where(checks.control[:, None, None] >= 0, control[checks.control], 0.0)
            parts.append((on_control, slice(2 * m, 2 * m + 3), of_control))
        for numbers, rows, c in parts:
            weighted = np.swapaxes(checks.weight[:, rows, None] * c, 1, 2)
            by_point = weighted @ checks.ground[:, rows]
            weight[numbers] += np.einsum("kco,koc->c", weighted, c)
            weight[numbers] -= np.einsum("kci,kci->c", by_point @ checks.inverse, by_point)
            pull[numbers] += np.einsum("kco,ko->c", weighted, checks.residual[:, rows])
            coupled = (weighted @ checks.partials[:, rows]).transpose(1, 0, 2).reshape(len(numbers), -1)
            for number, values in zip(numbers, coupled, strict=True):
                coupling[number] += np.bincount(checks.unknowns.reshape(-1), values, coupling.shape[1])
    for number, column in enumerate(columns):
        if column.stations is not None:
            weighted = model.station_weight * column.stations
            coupling[number, : weighted.size] += weighted.reshape(-1)
            weight[number] += float(np.sum(weighted * column.stations))
            pull[number] += float(np.sum(weighted * model.stations))
    return weight, pull, coupling


def _stacked(columns: list[FloatArray | None]) -> FloatArray:
    """Return columns of one shape as the last axis of an array, empty without columns."""
    values = [column for column in columns if column is not None]
    return np.stack(values, axis=-1) if values else np.zeros(0)
