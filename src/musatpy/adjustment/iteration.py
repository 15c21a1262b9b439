"""Damped Gauss-Newton, of any problem that can linearise itself, and the state that an adjustment iterates.

That is stations, ground points and levels, and the axes along which photos are adjusted. Of photos that look along
the east-west line phi is 90 degrees, and omega and kappa turn about one line: no step can turn them about the third
axis, and the normal equations are singular. Such photos are adjusted along the same axes in another order, north,
up, east, in which their phi is near zero. What is known of them is stated along east, north, up, by omega, phi,
kappa, as that of all others. And the water as an adjustment sees it: what is known of it, what it is to find.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from musatpy.adjustment.network import BACK, ORDER, Network
from musatpy.adjustment.normals import SINGULAR, Cofactors, Factor, NormalMatrix, factorised
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.geometry.collinearity import (
    AngleForm,
    angle_rates,
    attitude_apart,
    attitude_from_matrix,
    attitude_matrix,
    attitude_matrix_partials,
    wrapped,
)
from musatpy.geometry.geodesy import Frame, water_heights
from musatpy.model import Block, ObservationKind, Photos, Program, Treatment, WaterLevel
from musatpy.model.tables import finite_rows
from musatpy.units import DEGREE

AT_REST = 0.01  # sigmas: what the last step may still change of any adjusted value
_FIRST_DAMPING, _LAST_DAMPING = 1e-4, 1e6  # times the diagonal of the normals
_BLIND = 3  # steps that may be taken while points are behind cameras: a poor start needs one or two
# Relative growth of the sum of squares that a step at the minimum may show: geocentric coordinates are good to a
# nanometre, which under sigmas of a millimetre is a millionth of a square.
_ROUNDING = 1e-6
_NOTHING = 1e-9  # and so may this growth, in squared sigmas: without errors the sum itself is rounding
_LOST = "points stay behind their cameras"
_STUCK = "no step lowers the sum of squares"
_HALTED = 3  # damped steps in a row that gain no more than rounding
_HALT = "damped steps hardly lower the sum of squares any more"
LEVEL = 6  # of the unknowns of a photo, where each has a water level of its own
_ONE_LINE = 1e-8  # rad: nearer, only what omega and kappa have in common has a sigma that is a number


@dataclass(frozen=True, kw_only=True, eq=False)
class Linearisation:
    """Normal equations of one step, the objective that the step is to lower, and what evaluates it alike."""

    matrix: NormalMatrix
    rhs: FloatArray
    objective: float
    context: Any  # handed back to `apply` and `evaluate`: what both sides of a comparison must have in common
    redundancy: int  # degrees of freedom, at least 1
    of_points: float = 0.0  # r' N^-1 r of the eliminated points, where they are not at their best for the stations

    def change(self, step: FloatArray) -> float:
        """Return the largest change that anything adjusted can have by a full `step`, in its own sigmas.

        With d the changes of all unknowns, stations, globals and eliminated points, a function f'd of them has the
        cofactor f'N^-1 f, and (f'd)^2 <= f'N^-1 f d'N d (Cauchy and Schwarz): no image, station or ground point
        moves by more than sqrt(d'N d) of its sigmas, and one combination moves by as much. d'N d = r'd needs no
        inverse. Where observations fit worse than their sigmas say, these grow with sigma0, as they are printed.
        """
        square = float(self.rhs @ step) + self.of_points
        return float(np.sqrt(max(square, 0.0) / max(1.0, self.objective / self.redundancy)))


class LeastSquares(Protocol):
    """A problem: it knows its unknowns and conditions, and nothing of the solver."""

    def linearise(self, state: Any) -> Linearisation:
        """Return the normal equations at `state`."""

    def evaluate(self, state: Any, context: Any = None) -> float:
        """Return the objective at `state`; infinite where the state makes no sense."""

    def apply(self, state: Any, step: FloatArray, context: Any) -> Any:
        """Return the state after a step."""

    def converged(self, step: FloatArray) -> bool:
        """Return whether the step is below the limits."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Step:
    """One accepted step."""

    number: int
    step: FloatArray
    objective: float
    damping: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """How an iteration ended: `state` is the last accepted one; `failure` is empty when it converged.

    Of a lost iteration it is the one before the blind steps.
    """

    state: Any
    last_step: FloatArray
    failure: str
    lost: bool = False  # points are behind their cameras: nothing can be built on the state
    change: float = 0.0  # sigmas, by `Linearisation.change`, of the last step where that was a full one
    factor: Factor | None = None  # of the normals of the last step, where the iteration converged


class SingularNormalsError(Exception):
    """The normal equations cannot be solved; `matrix` is the normal matrix."""

    def __init__(self, matrix: NormalMatrix) -> None:
        super().__init__("singular normal equations")
        self.matrix = matrix


def iterate(
    problem: LeastSquares,
    state: Any,
    max_iterations: int,
    report: Callable[[Step], None] | None = None,
) -> Outcome:
    """Lower the objective of `problem` from `state` until a full step is below the limits, and changes nothing.

    The limits are those of the problem for what it solves for; that nothing adjusted changes by more than `AT_REST`
    of its own sigma is the same for all problems.
    A step that would raise the objective is taken again with Levenberg's damping, ten times stronger each time.
    Every accepted step lets the damping go; three in a row that gain next to nothing under it end the iteration.
    From where the objective is infinite, steps are taken without looking, but not for long. Raises
    `SingularNormalsError`.
    """
    damping, blind, slow, before = 0.0, 0, 0, state
    step, change = np.zeros(0), 0.0
    for number in range(1, max_iterations + 1):
        line = problem.linearise(state)
        if not line.matrix.sensible():
            return Outcome(state=before, last_step=step, failure=_LOST, lost=True)
        factor = factorised(line.matrix, damping)
        if number == 1 and (factor is None or factor.is_weak(SINGULAR)):
            raise SingularNormalsError(line.matrix)
        taken = None if factor is None else _taken(problem, state, line, factor)
        while taken is None and damping < _LAST_DAMPING:
            damping = max(10.0 * damping, _FIRST_DAMPING)
            factor = factorised(line.matrix, damping)
            taken = None if factor is None else _taken(problem, state, line, factor)
        if taken is None:
            return Outcome(state=state, last_step=step, failure=_STUCK, change=change)
        before = before if blind else state
        state, step, objective = taken
        if report:
            report(Step(number=number, step=step, objective=objective, damping=damping))
        blind = 0 if np.isfinite(objective) else blind + 1
        if blind == _BLIND:
            return Outcome(state=before, last_step=step, failure=_LOST, lost=True)
        change = 0.0 if damping else line.change(step)
        if not (damping or blind) and change < AT_REST and problem.converged(step):
            return Outcome(state=state, last_step=step, failure="", change=change, factor=factor)
        slow = slow + 1 if damping and line.objective - objective < _ROUNDING * line.objective else 0
        if slow == _HALTED:
            return Outcome(state=state, last_step=step, failure=_HALT, change=change)
        damping = 0.1 * damping if damping >= _FIRST_DAMPING else 0.0
        factor = taken = None  # which makes room for the next
    plural = "" if max_iterations == 1 else "s"
    damped = "" if change else ", the last step still damped"
    failure = f"limits not reached in {max_iterations} iteration{plural}{damped}"
    return Outcome(state=state, last_step=step, failure=failure, change=change)


def _taken(
    problem: LeastSquares, state: Any, line: Linearisation, factor: Factor
) -> tuple[Any, FloatArray, float] | None:
    """Return state, step and objective after a step, None where it would raise the objective."""
    step = factor.solve(line.rhs)
    after = problem.apply(state, step, line.context)
    objective = problem.evaluate(after, line.context)
    return (after, step, objective) if not_raised(objective, line.objective) else None


def not_raised(objective: float, before: float) -> bool:
    """Return whether an objective is not above the one before by more than rounding."""
    return objective <= before * (1.0 + _ROUNDING) + _NOTHING


@dataclass(frozen=True, kw_only=True, eq=False)
class State:
    """Current values. Positions in working coordinates; attitudes refer to `Network.axes`, the given frames."""

    axes: FloatArray  # (n, 3, 3)
    position: FloatArray  # (n, 3)
    attitude: FloatArray  # (n, 3)
    ground: FloatArray  # (p, 3), NaN where unknown
    levels: FloatArray  # (g,)
    tide: FloatArray  # (n,) m, height of the water at each photo, NaN where not given
    tilt: FloatArray  # (2,) rad, slopes of the water surface towards east and north
    index: float  # refractive index of water
    waves: FloatArray  # (k, 4) height, length, azimuth, crest of unknown waves; (0, 4) where they are known
    parameters: Mapping[ObservationKind, FloatArray]  # (x,) of each kind of further unknowns: of lenses, ...
    squares: FloatArray  # (p,) weighted squares of each point at its optimum, 0 for points that took no part

    @cached_property
    def M(self) -> FloatArray:
        """(n, 3, 3) working axes to photo."""
        return attitude_matrix(self.attitude) @ self.axes

    @cached_property
    def dM(self) -> FloatArray:
        """(n, 3, 3, 3) derivatives of M by omega, phi, kappa."""
        return attitude_matrix_partials(self.attitude) @ self.axes[:, None]


def initial_state(network: Network) -> State:
    """Return the given stations, with ground points and levels still unknown."""
    return State(
        axes=network.axes,
        position=network.position,
        attitude=network.attitude,
        ground=np.full((network.points, 3), np.nan),
        levels=np.full(network.border.count(ObservationKind.EQUAL_ELEVATION), np.nan),
        tide=network.water.tide,
        tilt=network.water.tilt,
        index=network.water.index,
        waves=np.zeros((0, 4)) if network.sea is None else network.sea.waves,
        parameters={kind: known.given for kind, known in network.parameters.items()},
        squares=np.zeros(network.points),
    )


def given_minus(photos: Photos, frame: Frame, position: FloatArray, M: FloatArray, rows: BoolArray) -> FloatArray:
    """Return given stations minus those at `position` (n, 3), working, with the rotations M (n, 3, 3).

    (n, 6): east, north, up there, m, and angles, rad, within half a turn; NaN for others than `rows` (n,).
    """
    difference, axes = np.full((len(rows), 6), np.nan), frame.axes(position[rows])
    shift = frame.working(photos.position[rows]) - position[rows]
    difference[rows, :3] = np.einsum("nij,nj->ni", axes, shift)
    there = attitude_from_matrix(M[rows] @ np.swapaxes(axes, 1, 2))
    difference[rows, 3:] = attitude_apart(photos.attitude[rows], there)
    return difference


def attitude_in(state: State, axes: FloatArray, near: FloatArray) -> FloatArray:
    """Return attitudes (n, 3) referred to other local axes, each angle within half a turn of `near`, or of zero.

    No card has an angle beyond a whole turn.
    """
    angles = wrapped(attitude_from_matrix(state.M @ np.swapaxes(axes, -1, -2)), near)
    return np.where(np.abs(angles) > 2.0 * np.pi, wrapped(angles), angles)


_NEAREST = 5.0 * DEGREE  # of phi to 90: so far given attitudes may be off where adjustments start well


def with_turned_axes(network: Network) -> Network:
    """Return the network with the photos near a phi of 90 degrees along the axes in their other order.

    Of their attitudes as observed, the smallest of three weights holds the turn about each axis. Those not observed
    are turned from 45 degrees on: an approximation may be far off, and no iteration passes well by 90 degrees.
    """
    with np.errstate(invalid="ignore"):
        steep = np.abs(np.sin(network.attitude[:, 1]))
        turned = steep > np.where(network.attitude_weight.any(axis=1), np.cos(_NEAREST), np.sqrt(0.5))
    if not turned.any():
        return network
    axes, attitude = network.axes.copy(), network.attitude.copy()
    position_weight, attitude_weight = network.position_weight.copy(), network.attitude_weight.copy()
    axes[turned] = axes[turned][:, ORDER]
    attitude[turned] = attitude_from_matrix(attitude_matrix(attitude[turned])[..., ORDER])
    position_weight[turned] = position_weight[turned][:, ORDER]
    attitude_weight[turned] = attitude_weight[turned].min(axis=1, keepdims=True)
    return replace(
        network,
        axes=axes,
        attitude=attitude,
        position_weight=position_weight,
        attitude_weight=attitude_weight,
        turned=turned,
    )


def stated_partials(network: Network, state: State) -> FloatArray:
    """Return the partials (n, q, q) of east, north, up, omega, phi, kappa by the unknowns of photos."""
    q = network.pattern.size
    partials = np.broadcast_to(np.eye(q), (network.photos, q, q)).copy()
    rows = np.flatnonzero(network.turned)
    angles = attitude_from_matrix(attitude_matrix(state.attitude[rows])[..., BACK])
    form = AngleForm.OMEGA_PHI_KAPPA
    by_turn = np.linalg.pinv(angle_rates(angles, form), rcond=_ONE_LINE)
    partials[rows, :3, :3] = np.eye(3)[BACK]
    partials[rows, 3:6, 3:6] = by_turn @ angle_rates(state.attitude[rows], form)[:, BACK]
    return partials


def stated(network: Network, state: State, covariances: Cofactors) -> Cofactors:
    """Return the covariances of what is stated of the photos, of those of the unknowns."""
    if not network.turned.any():
        return covariances
    T = stated_partials(network, state)
    i, j = covariances.pattern.pairs.T
    border = T @ covariances.border.reshape(network.photos, network.pattern.size, -1)
    return replace(
        covariances,
        blocks=T[i] @ covariances.blocks @ np.swapaxes(T[j], 1, 2),
        border=border.reshape(covariances.border.shape),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class WaterKnowledge:
    """What the deck says of the water, and which of it the adjustment is to find.

    Tides share corrections: one unknown for each of c groups of photos, observed once, as zero. Weights are
    1/sigma^2, 0 where there is no prior.
    """

    tide: FloatArray  # (n,) m, NaN where not given
    group: IntArray  # (n,) correction of the tide of each photo, -1 where it is known
    ids: TextArray  # (c,) names of the corrections
    per_photo: bool  # the corrections stand with the station unknowns, c = n, not in the border
    level_weight: FloatArray  # (c,) 1/m2
    tilt: FloatArray  # (2,) rad, slopes towards east and north
    tilt_weight: float
    tilt_unknown: bool
    index: float
    index_weight: float
    index_unknown: bool

    @property
    def unknown(self) -> bool:
        """True where anything of the water is unknown."""
        return bool(len(self.ids)) or self.tilt_unknown or self.index_unknown


def water_knowledge(block: Block) -> WaterKnowledge:
    """Return what is known of the water of a block; in IIA everything is."""
    options, photos, water = block.options, block.photos, block.water
    n = len(photos.ids)
    simultaneous = options.program is Program.IIIA and water is not None
    mode = options.water_level if simultaneous else WaterLevel.KNOWN
    group, ids = _level_groups(block, mode)
    return WaterKnowledge(
        tide=photos.tide,
        group=group,
        ids=ids,
        per_photo=mode is WaterLevel.PHOTO and n > 0,
        level_weight=_common_weights(photos.tide_sigma, group, len(ids)),
        tilt=np.array([(water.tilt_east or 0.0), (water.tilt_north or 0.0)]) if water else np.zeros(2),
        tilt_weight=_weight(water.tilt_sigma if water else None),
        tilt_unknown=simultaneous and options.water_tilt is Treatment.ADJUST,
        index=water.index if water else 1.0,
        index_weight=_weight(water.sigma if water else None),
        index_unknown=simultaneous and options.water_index is Treatment.ADJUST,
    )


def _level_groups(block: Block, mode: WaterLevel) -> tuple[IntArray, TextArray]:
    """Return which correction each tide has (n,), -1 for none, and the names of the corrections."""
    photos = block.photos
    n = len(photos.ids)
    if mode is WaterLevel.KNOWN:
        return np.full(n, -1), np.zeros(0, dtype=np.str_)
    if mode is WaterLevel.PHOTO:
        return np.where(np.isnan(photos.tide), -1, np.arange(n)), photos.ids
    if mode is WaterLevel.ONE:
        return np.where(np.isnan(photos.tide), -1, 0), np.array([""])
    labels = photos.tide_group if mode is WaterLevel.GROUP else photos.tide_day
    belongs = ~np.isnan(photos.tide) & (labels != "")
    ids, number = np.unique(labels[belongs], return_inverse=True)
    group = np.full(n, -1)
    group[belongs] = number
    return group, ids


def tide_groups(block: Block, known: BoolArray) -> Iterator[tuple[str, IntArray]]:
    """Yield the names and the photos of all, of the groups and of the days, where they are more than one."""
    photos = block.photos
    everyone = np.flatnonzero(known)
    if len(everyone) > 1:
        yield "", everyone
    for what, label in (("group", photos.tide_group), ("day", photos.tide_day)):
        for name in np.unique(label[known & (label != "")]).tolist():
            photo = np.flatnonzero(known & (label == name))
            if 1 < len(photo) < len(everyone):
                yield f"{what} {name}", photo


def is_considered(block: Block, water: WaterKnowledge) -> bool:
    """Return whether a tide, the tilt or the index has a sigma and is no unknown in `water`."""
    tides = (water.group < 0) & np.isfinite(block.photos.tide) & (block.photos.tide_sigma > 0.0)
    if block.water is None or tides.any():
        return bool(tides.any())
    tilt = not water.tilt_unknown and _weight(block.water.tilt_sigma)
    index = not water.index_unknown and _weight(block.water.sigma)
    return bool(tilt or index)


def _common_weights(sigma: FloatArray, group: IntArray, count: int) -> FloatArray:
    """Return the weights (c,) of corrections from the RMS of the sigmas that the tides of their photos have."""
    given = (group >= 0) & np.isfinite(sigma) & (sigma > 0.0)
    number = np.bincount(group[given], minlength=count)
    squares = np.bincount(group[given], weights=np.square(sigma[given]), minlength=count)
    return np.divide(number, squares, out=np.zeros(count), where=number > 0)


def _weight(sigma: float | None) -> float:
    return 0.0 if not sigma else 1.0 / sigma**2


def heights_and_water(
    network: Network, state: State, points: BoolArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return (m,) the height of the point of each measurement, and that of the water over it; NaN where unknown.

    Of `points` (p,) only, NaN for others, where they are given.
    """
    height, water = np.full((2, len(network.point)), np.nan)
    known = finite_rows(state.ground)
    rays = np.flatnonzero((known if points is None else known & points)[network.point])
    ground = state.ground.take(network.point.take(rays), axis=0)
    height[rays] = network.frame.height(ground)
    water[rays] = water_heights(network.slope(state.tilt), state.tide.take(network.photo.take(rays)), ground)
    return height, water


def water_over(network: Network, state: State) -> FloatArray:
    """Return (m,) the height of the water over the point of each measurement, its waves too; NaN where unknown."""
    _, water = heights_and_water(network, state)
    if network.sea is not None:
        rays = np.flatnonzero(np.isfinite(water))
        photo, ground = network.photo[rays], state.ground[network.point[rays]]
        water[rays] += network.sea.at(state.waves).elevations(photo, ground)
    return water


def level_corrections(network: Network, state: State) -> FloatArray:
    """Return the corrections (c,) m that the tides of groups of photos have received."""
    water = network.water
    out = np.zeros(len(water.ids))
    belongs = water.group >= 0
    out[water.group[belongs]] = (state.tide - water.tide)[belongs]
    return out
