"""What may be wrong with a block, each hypothesis with what it explains in a linear model of the adjustment.

A hypothesis gives observations up (images, control, stations, ...), or revises what is common to many of them: a
camera constant, the index, a unit of length, the tides of several photos.
"""

from __future__ import annotations

import typing
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from musatpy.adjustment.iteration import LEVEL, State, tide_groups
from musatpy.adjustment.kinds import MEASURED, PRIORS, direct_rows
from musatpy.adjustment.lenses import image_reach
from musatpy.adjustment.network import Network, first_rows
from musatpy.adjustment.normals import Factor
from musatpy.adjustment.sightings import index_partials, residuals
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.blunders import antennas
from musatpy.blunders.linear_model import Drop, LinearModel, PointChecks, dropped, put_in_again
from musatpy.blunders.scene import IMAGES_CHECKED, PENALTY, Factors
from musatpy.model import Block, CauseKind, CoordinateSystem, ObservationKind
from musatpy.model.kinds import CONTROL_CARD, STATION_CARD
from musatpy.model.tables import falling
from musatpy.units import length_unit

_LISTED = 8  # of one kind of hypothesis, those that explain most
_COMMON_CHECKED = 1e-6  # of c'Pc; less says nothing of a common error

_K = ObservationKind
CONTROL, STATIONS, PLATES_TO_FOCAL_LENGTH, HEIGHTS = range(4)  # whose unit of length is wrong; heights of control
Y_REVERSED, X_REVERSED, EXCHANGED, CONTROL_EXCHANGED, HEIGHTS_NEGATED = range(5)  # axes of plates, of control
PLATES, CARDS = 0, 1  # that bear exchanged labels: plate cards, or station cards
_EXCHANGED = "each stands where the card of the other one says: exchange the photo ids on the {} cards"
OF_KINDS = (antennas,)  # errors that many observations of a kind have in common: one file for each that has such
_SAME_UNIT = 0.05  # by which a factor may be off that of a unit
CAUSES = {  # what may be wrong with what was observed of a kind, images and control apart
    _K.STATION_POSITION: CauseKind.POSITION,
    _K.STATION_ATTITUDE: CauseKind.ATTITUDE,
    _K.EQUAL_ELEVATION: CauseKind.ELEVATION,
    **{kind.observed: kind.cause for kind in MEASURED},
    _K.WATER_LEVEL: CauseKind.TIDE,
}


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

    def values_in(self, tables: Factors) -> FloatArray:
        """Return what tables (rows, components) of the kinds say of the observations that are given up (s,)."""
        return np.concatenate([tables[part.kind][part.row, part.component] for part in self.given_up])

    def gain(self, variance: float) -> float:
        """Return the squares explained, less the price of the parameters."""
        return self.squares / variance - PENALTY * self.parameters


def giving_up(block: Block, kind: CauseKind, *parts: GivenUp, **explained: Any) -> Hypothesis:
    """Return the hypothesis that gives observations up, with the photos and the points that they concern."""
    links: dict[str, list[int]] = {"photo": [], "point": []}
    for part in parts:
        table = getattr(block, part.kind.attribute) if part.kind.attribute else block.photos
        if table is block.photos:
            links["photo"] += part.row.tolist()
            continue
        for name, numbers in links.items():
            numbers += getattr(table, name)[part.row].reshape(-1).tolist() if hasattr(table, name) else []
    if parts[0].kind is _K.PLATE:
        links["photo"].sort()
    photo, point = (tuple(dict.fromkeys(numbers)) for numbers in links.values())
    return Hypothesis(kind=kind, photo=photo, point=point, given_up=parts, **explained)


def hypotheses(model: LinearModel, near: BoolArray | None = None) -> list[Hypothesis]:
    """Return what explains most, by falling squares explained; some of every kind.

    Of all points, or of those only that are `near` (p,).
    """
    block, points = model.scene.block, model.points
    if near is not None:
        points = tuple(checks.part(near[checks.point]) for checks in points)
    cards = {kind.observed: first_rows(kind.points(block), model.network.points) for kind in PRIORS}
    options = [*common_errors(model), *_direct(model), *_stations(model)]
    options += [option for checks in points for option in _of_points(block, checks, cards)]
    return [options[row] for row in falling([option.squares for option in options]).tolist()]


def of_taken_images(model: LinearModel, images: Hypothesis) -> Hypothesis:
    """Return a hypothesis, of images of one point that the model has taken out, with what it explains."""
    rays, (point,) = images.given_up[0].row[::2], images.point
    checks = next(checks.part(checks.point == point) for checks in model.points if point in checks.point)
    order = np.flatnonzero(np.isin(checks.rays[0], rays))
    rows = (2 * order[:, None] + np.arange(2)).reshape(-1)
    weight = model.scene.weight[_K.PLATE][checks.rays[:, order]].reshape(1, -1)
    v, Q = put_in_again(checks.residual[:, rows], weight, checks.cofactor[:, rows[:, None], rows])
    return replace(images, **_explained(dropped(v, weight, Q, IMAGES_CHECKED), 0))


def _of_points(block: Block, checks: PointChecks, cards: dict[ObservationKind, IntArray]) -> Iterator[Hypothesis]:
    """Yield single images, all images, and what is known of points: the rows (p,) of their `cards`."""
    m = checks.rays.shape[1]
    has_priors = bool((checks.weight[:, 2 * m :] > 0.0).any())
    choices = [(CauseKind.IMAGE, np.array([image])) for image in range(m)]
    for kind, images in [*choices, (CauseKind.IMAGES, np.arange(m))] if m > 1 else choices:
        drop = checks.drop((2 * images[:, None] + np.arange(2)).reshape(-1))
        for k in _most(drop):
            part = GivenUp.of_images(checks.rays[k, images])
            yield giving_up(block, kind, part, **_explained(drop, k))
    for kind, components in (
        (CauseKind.HORIZONTAL, np.arange(2)),
        (CauseKind.VERTICAL, np.array([2])),
        (CauseKind.CONTROL, np.arange(3)),
        (CauseKind.ELEVATION, np.array([3])),
    ):
        if not (has_priors and (known := checks.weight[:, 2 * m + components] > 0.0).any()):
            continue
        drop = checks.drop(2 * m + components)
        # with one of its parts known only, it is that part
        both = kind is not CauseKind.CONTROL or known[:, :2].any(axis=1) & known[:, 2]
        observed = _K.EQUAL_ELEVATION if kind is CauseKind.ELEVATION else _K.CONTROL
        for k in _most(drop, both):
            given = components[known[k]] * (observed is _K.CONTROL)
            part = GivenUp.of_row(observed, int(cards[observed][checks.point[k]]), given)
            yield giving_up(block, kind, part, **_explained(drop, k))


def _stations(model: LinearModel) -> Iterator[Hypothesis]:
    """Yield observed positions, attitudes, both, and tides."""
    known = model.station_weight > 0.0
    position, attitude = (_K.STATION_POSITION, np.arange(3)), (_K.STATION_ATTITUDE, np.arange(3, 6))
    parts = {
        CauseKind.POSITION: (position,),
        CauseKind.ATTITUDE: (attitude,),
        CauseKind.STATION: (position, attitude),
        CauseKind.TIDE: ((_K.WATER_LEVEL, np.array([LEVEL])),),
    }
    for kind, of_kind in parts.items():
        columns = np.concatenate([column for _, column in of_kind])
        if columns.max() >= known.shape[1] or not known[:, columns].any():
            continue
        drop = model.station_drop(columns)
        for k in _most(drop, np.all([known[:, column].any(axis=1) for _, column in of_kind], axis=0)):
            given_up = (GivenUp.of_row(part, k, column - column[0]) for part, column in of_kind)
            yield giving_up(model.scene.block, kind, *given_up, **_explained(drop, k))


def _direct(model: LinearModel) -> Iterator[Hypothesis]:
    """Yield what was measured between stations and points."""
    kinds = {kind.observed: kind for kind in MEASURED if len(model.network.measured[kind.observed].row)}
    if not kinds:
        return
    for kind, rows in direct_rows(model.network, model.minimum):
        if kind.observed not in kinds:
            continue
        c = len(kind.observed.components)  # of a row of the table, one after the other
        partials, index = rows.partials.reshape(-1, c, rows.index.shape[1]), rows.index[::c]
        Q = partials @ model.cofactors.between(index, index) @ np.swapaxes(partials, 1, 2)
        ties = model.network.measured[kind.observed]
        mixed = None if ties.principal is None else np.swapaxes(ties.principal, 1, 2)
        drop = dropped(rows.residual.reshape(-1, c), rows.weight.reshape(-1, c), Q, _COMMON_CHECKED, mixed)
        for k in _most(drop):
            given_up = GivenUp.of_row(kind.observed, int(rows.row[c * k]), np.arange(c))
            yield giving_up(model.scene.block, kinds[kind.observed].cause, given_up, **_explained(drop, k))


def _most(drop: Drop, among: BoolArray | bool = True) -> list[int]:
    """Return which groups of observations explain most, of those that are tested and `among` (k,) them."""
    enough = np.flatnonzero((drop.squares > 0.0) & (drop.parameters > 0) & among)
    return enough[falling(drop.squares[enough])[:_LISTED]].tolist()


def _explained(drop: Drop, k: int) -> dict[str, Any]:
    """Return what giving up one of several groups explains, as fields of a hypothesis."""
    squares, parameters = float(drop.squares[k]), int(drop.parameters[k])
    return {"squares": squares, "parameters": parameters, "error": drop.error[k], "sigma": drop.sigma[k]}


def common_errors(model: LinearModel) -> list[Hypothesis]:
    """Return what is common to many observations: camera constants, the index, and common errors of tides.

    An error of one unit adds a column c to the observations. As an unknown more it explains
    (c'Pv)^2 / c'P Qvv P c, where c'P Qvv P c = c'Pc - (A'Pc)' N^-1 (A'Pc) (Baarda 1968); points are eliminated, and
    follow.
    """
    network, state, block = model.network, model.state, model.scene.block
    cameras, unknown = int(block.photos.camera.max()) + 1, network.water.unknown or network.border.count(_K.WAVE)
    index = bool(unknown and not network.border.count(_K.WATER_INDEX))  # it counts, and is no unknown itself
    columns = []
    for camera in range(cameras):
        columns.append(Hypothesis(kind=CauseKind.FOCAL_LENGTH, member=camera))
        columns += [Hypothesis(kind=CauseKind.PRINCIPAL_POINT, member=2 * camera + axis) for axis in range(2)]
        columns.append(Hypothesis(kind=CauseKind.DISTORTION, member=camera))
    columns += [Hypothesis(kind=CauseKind.INDEX)] if index else []
    bend = _bends(block)
    weight, pull = np.zeros((2, len(columns)))
    coupling = np.zeros((len(columns), len(model.step)))
    for checks in model.points:
        rows = slice(0, 2 * checks.rays.shape[1])
        c = _errors_of_images(network, state, 4 * block.photos.camera, checks.rays, len(columns), index, bend)
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
    return [*_unknowns_more(columns, weight, pull, coupling, model.factor), *tides, *_of_kinds(model)]


def of_kinds(block: Block) -> list[ModuleType]:
    """Return what has errors in common of those kinds of observations that a block has."""
    return [module for module in OF_KINDS if getattr(block, module.KIND.attribute).count]


def _of_kinds(model: LinearModel) -> Iterator[Hypothesis]:
    """Yield what observations of a kind have in common; errors that are whole with what just these explain."""
    network, block = model.network, model.scene.block
    errors = [one for module in of_kinds(block) for one in module.common_errors(block, network, model.minimum)]
    columns = [Hypothesis(kind=one.kind, member=one.member, photo=one.photo, name=one.name) for one in errors]
    u = len(model.step)
    weight, pull, coupling = np.zeros(len(errors)), np.zeros(len(errors)), np.zeros((len(errors), u))
    for kind, rows in direct_rows(network, model.minimum) if errors else ():
        for number, error in enumerate(errors):
            c = error.of(kind.observed, block, network)
            if c is not None:
                weight[number] += float(rows.weight @ np.square(c))
                pull[number] += float(rows.weight @ (c * rows.residual))
                weighted = (rows.weight * c)[:, None] * rows.partials
                coupling[number] += np.bincount(rows.index.reshape(-1), weighted.reshape(-1), u)
    for one in _unknowns_more(columns, weight, pull, coupling, model.factor):
        whole = next(error.whole for column, error in zip(columns, errors, strict=True) if column.key == one.key)
        if whole is not None:  # (c'Pv)^2 / c'.. c belongs to that many of them (reversals of a sign), not to one
            size, sigma = float(one.error[0]), float(one.sigma[0])
            one = replace(
                one,
                squares=(2.0 * size - 1.0) / sigma**2,
                error=whole,
                sigma=np.abs(whole) * sigma,
            )
        yield one


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


def _errors_of_images(
    network: Network, state: State, camera: IntArray, rays: IntArray, columns: int, index: bool, bend: FloatArray
) -> FloatArray:
    """Return what errors of one unit add to images (k, m): (k, 2m, columns), in the order of `common_errors`.

    `camera` (n,) is the first column of that of each photo; the `index` of the water has the last one, and `bend`
    (m, 2) is what `_bends` returns.
    """
    photo = network.photo[rays]
    image = network.xy[rays] + residuals(network, state, rays.reshape(-1)).reshape(*rays.shape, 2)
    ray = (image - network.principal_point[photo]) / network.focal_length[photo][..., None]
    out = np.zeros((*rays.shape, 2, columns))
    np.put_along_axis(out, camera[photo][..., None, None], -ray[..., None], axis=-1)
    for axis in range(2):
        np.put_along_axis(out[:, :, axis], camera[photo][..., None] + 1 + axis, -1.0, axis=-1)
    np.put_along_axis(out, camera[photo][..., None, None] + 3, -bend[rays][..., None], axis=-1)
    if index:
        wet = network.refracted[rays]
        out[wet, :, -1] = -index_partials(network, state, rays[wet])
    return out.reshape(len(rays), 2 * rays.shape[1], -1)


def _bends(block: Block) -> FloatArray:
    """Return what (m, 2) mm a radial distortion of r^3 does to images, of 1 mm at the farthest one of a camera."""
    principal, camera = block.cameras.principal_point, block.photos.camera[block.plates.photo]
    off, reach = block.plates.xy - principal[camera], image_reach(block, principal)[0][camera, None]
    return np.asarray(off * np.square(off).sum(axis=1, keepdims=True) / reach**3)


def revised(block: Block, revision: Hypothesis) -> Block:
    """Return the block with something revised."""
    photo = np.array(revision.photo, dtype=int)
    cameras, photos, value = block.cameras, block.photos, revision.value
    match revision.kind:
        case CauseKind.FOCAL_LENGTH:
            f = cameras.focal_length.copy()
            f[revision.member] -= value
            return replace(block, cameras=replace(cameras, focal_length=f))
        case CauseKind.PRINCIPAL_POINT:
            principal = cameras.principal_point.copy()
            principal[divmod(revision.member, 2)] -= value
            return replace(block, cameras=replace(cameras, principal_point=principal))
        case CauseKind.DISTORTION:
            on = photos.camera[block.plates.photo] == revision.member
            xy = block.plates.xy + value * on[:, None] * _bends(block)
            return replace(block, plates=replace(block.plates, xy=xy))
        case CauseKind.INDEX:
            assert block.water is not None  # no index is tested without
            return replace(block, water=replace(block.water, index=block.water.index - value, conditions=None))
        case CauseKind.TIDES:
            tide = photos.tide.copy()
            tide[photo] -= value
            return replace(block, photos=replace(photos, tide=tide))
        case CauseKind.LABELS:
            if revision.member == PLATES:
                return replace(block, plates=replace(block.plates, photo=_exchanged(block.plates.photo, photo)))
            position = photos.position.copy()
            position[photo] = position[photo[::-1]]
            return replace(block, photos=replace(photos, position=position))
        case CauseKind.EXCHANGED_CONTROL:
            point = _exchanged(block.control.point, np.array(revision.point, dtype=int))
            return replace(block, control=replace(block.control, point=point))
        case CauseKind.AXES:
            return _with_other_axes(block, revision.member)
        case CauseKind.UNIT:
            return _rescaled(block, revision)
    changed = next(module.REVISIONS[revision.kind] for module in OF_KINDS if revision.kind in module.REVISIONS)
    return typing.cast(Block, changed(block, photo, revision.member, value))


def _exchanged(link: IntArray, pair: IntArray) -> IntArray:
    first, second = pair.tolist()
    return np.where(link == first, second, np.where(link == second, first, link))


def _with_other_axes(block: Block, member: int) -> Block:
    """Return the block with its plate axes, or those of its control, reversed or exchanged."""
    if member in (CONTROL_EXCHANGED, HEIGHTS_NEGATED):
        position = block.control.position
        position = position[:, [1, 0, 2]] if member == CONTROL_EXCHANGED else position * np.array([1.0, 1.0, -1.0])
        return replace(block, control=replace(block.control, position=position))
    xy = block.plates.xy
    xy = xy[:, ::-1] if member == EXCHANGED else xy * np.where(member == X_REVERSED, [-1.0, 1.0], [1.0, -1.0])
    return replace(block, plates=replace(block.plates, xy=xy))


def _rescaled(block: Block, revision: Hypothesis) -> Block:
    if revision.member == PLATES_TO_FOCAL_LENGTH:
        return replace(block, plates=replace(block.plates, xy=block.plates.xy / revision.value))
    of_all = block.options.system is CoordinateSystem.LOCAL and revision.member != HEIGHTS
    axes = slice(0, 3) if of_all else slice(2, 3)
    table = block.photos if revision.member == STATIONS else block.control
    position = table.position.copy()
    position[:, axes] /= revision.value
    if revision.member != STATIONS:
        return replace(block, control=replace(block.control, position=position))
    return replace(block, photos=replace(block.photos, position=position))


def moved_state(state: State, revision: Hypothesis) -> State:
    """Return a state that goes with what is revised."""
    photo, value = list(revision.photo), revision.value
    match revision.kind:
        case CauseKind.INDEX:
            return replace(state, index=state.index - value)
        case CauseKind.TIDES:
            tide = state.tide.copy()
            tide[photo] -= value
            return replace(state, tide=tide)
        case CauseKind.LABELS if revision.member == PLATES:
            position, attitude = state.position.copy(), state.attitude.copy()
            position[photo], attitude[photo] = position[photo[::-1]], attitude[photo[::-1]]
            return replace(state, position=position, attitude=attitude)
    return state


class MemberWords(NamedTuple):
    """What a member of a kind is in words."""

    cards: str  # to read again, as `model.CauseKind` has them
    component: str
    advice: str  # of a unit of length, with what it does not agree


MEMBERS = {
    (CauseKind.UNIT, CONTROL): MemberWords(CONTROL_CARD, "control", "stations and tides imply"),
    (CauseKind.UNIT, STATIONS): MemberWords(STATION_CARD, "stations", "control and tides imply"),
    (CauseKind.UNIT, PLATES_TO_FOCAL_LENGTH): MemberWords(
        "PLT CAM", "plate coordinates", "the focal length implies"
    ),
    (CauseKind.UNIT, HEIGHTS): MemberWords(CONTROL_CARD, "heights of the control", "its plan implies"),
    (CauseKind.AXES, Y_REVERSED): MemberWords(
        "PLT", "y of the plates", "y runs down: reverse its sign, or read how the axes were defined"
    ),
    (CauseKind.AXES, X_REVERSED): MemberWords(
        "PLT", "x of the plates", "x runs backwards: reverse its sign, or read how the axes were defined"
    ),
    (CauseKind.AXES, EXCHANGED): MemberWords(
        "PLT", "x and y of the plates", "exchanged: read the description of the comparator again"
    ),
    (CauseKind.AXES, CONTROL_EXCHANGED): MemberWords(
        CONTROL_CARD, "plan of the control", "east and north are exchanged: read the list of control again"
    ),
    (CauseKind.AXES, HEIGHTS_NEGATED): MemberWords(
        CONTROL_CARD, "heights of the control", "they have the other sign: depths for heights?"
    ),
    (CauseKind.LABELS, PLATES): MemberWords("PLT", "plate cards", _EXCHANGED.format("plate")),
    (CauseKind.LABELS, CARDS): MemberWords(STATION_CARD, "station cards", _EXCHANGED.format("station")),
}


def in_words(revision: Hypothesis) -> MemberWords:
    """Return what a revision is in words; its `value` is that of the unit of length."""
    kind = revision.kind
    words = MEMBERS.get((kind, revision.member), MemberWords(kind.cards, kind.component, kind.advice))
    if kind is CauseKind.PRINCIPAL_POINT:
        return words._replace(component="xy"[revision.member % 2])
    if kind is CauseKind.UNIT:
        return words._replace(advice=_other_unit(words, revision.member, revision.value))
    return words


def _other_unit(words: MemberWords, member: int, factor: float) -> str:
    """Return what to do about lengths that are `factor` times what the others want."""
    whose, (others, _, imply) = words.component, words.advice.rpartition(" ")
    of_plates = member == PLATES_TO_FOCAL_LENGTH
    right, scale = ("millimetres", 1e3) if of_plates else ("metres", 1.0)
    unit, inverse = (length_unit(of_metres, _SAME_UNIT) for of_metres in (scale * factor, 1.0 / factor))
    if not of_plates and "feet" in (unit, inverse):
        units = ("feet", "metres") if unit == "feet" else ("metres", "feet")
        return f"{whose} in {units[0]}, all else in {units[1]}: read the unit again"
    if unit:
        return f"{whose} in {unit}, {others} in {right}: read the unit again"
    return f"{whose} {factor:.5g} times what {others} {imply}: read both units again"
