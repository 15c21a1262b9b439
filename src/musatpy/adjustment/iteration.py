"""Gauss-Newton with step control, of any problem that can linearise itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, Protocol

import numpy as np

from musatpy.adjustment.normals import SINGULAR, Factor, NormalMatrix, factorised
from musatpy.arrays import FloatArray

_FIRST_DAMPING = 1e-4
_LAST_DAMPING = 1e6
_NEGLIGIBLE_DAMPING = 1e-5
# Relative growth of the sum of squares that a step at the minimum may show: geocentric coordinates are good to a
# nanometre, which under sigmas of a millimetre is a millionth of a square.
_ROUNDING = 1e-6
_NOTHING = 1e-9  # and so may this growth, in squared sigmas: without errors the sum itself is rounding
_LOST = "points stay behind their cameras"
_STUCK = "no step lowers the sum of squares"
# triangulations in a row that end short of their limits: one may be helped by the next, while rays change their
# sides of the water; where that ends short too, points are no guide to the water, and more of them only take time
SHORT = 2
_BLIND = 3  # steps that may be taken while points are behind cameras: a poor start needs one or two
_HEAVY, _GAIN, _STALLED = 1.0, 1e-4, 3  # damping, share of the objective, and steps of one that has come to a halt
_HOPELESS = 100.0  # sigma0 from which nothing that the water does explains the misfit
_SLOW = 0.01  # share of the objective that a last step must gain to go on from such a height
AT_REST = 0.01  # sigmas: what the last step may still change of any adjusted value
_CLOSING = 0.1  # share of the step before, or sigmas, from which on the matrix may be kept
_KEPT = 0.01  # and that a step with a kept matrix may be at most
# times the share of the step before that further ones may be: of a curve, a step d with a matrix of its own leaves
# b d^2 / 2, and one of d' with the same matrix then 2 b d d'
_FURTHER = 4.0
_SLOWEST = 2.0  # times the share of one with the same matrix: what closes in slowly is left to the end
_SEEN = 0.1  # sigmas: what a step that is this long changes of a sum of squares decides no comparison


@dataclass(frozen=True, kw_only=True, eq=False)
class Linearisation:
    """Normal equations of one step, the objective that the step is to lower, and what evaluates it alike."""

    matrix: NormalMatrix
    rhs: FloatArray
    objective: float
    context: Any  # handed back to `apply` and `evaluate`: what both sides of a comparison must have in common
    of_points: float  # r' N^-1 r of the eliminated points, for stations as they are: 0 where all are at their best
    redundancy: int  # degrees of freedom, at least 1
    renewable: bool = False  # `LeastSquares.renewed` is worth while: factorising is not

    @property
    def hopeless(self) -> bool:
        """True where observations are off by far more than any of their sigmas can be wrong."""
        return self.objective > _HOPELESS**2 * self.redundancy

    def length(self, step: FloatArray) -> float:
        """Return the length sqrt(d'N d) of a full `step`, with that of the eliminated points."""
        return float(np.sqrt(max(float(self.rhs @ step) + self.of_points, 0.0)))

    def change(self, step: FloatArray) -> float:
        """Return the largest change that anything adjusted can have by a full `step`, in its own sigmas.

        With d the changes of all unknowns, stations, globals and eliminated points, a function f'd of them has the
        cofactor f'N^-1 f, and (f'd)^2 <= f'N^-1 f d'N d (Cauchy and Schwarz): no image, station or ground point
        moves by more than sqrt(d'N d) of its sigmas, and one combination moves by as much. d'N d = r'd needs no
        inverse. Where observations fit worse than their sigmas say, these grow with sigma0, as they are printed.
        """
        return float(self.length(step) / np.sqrt(max(1.0, self.objective / self.redundancy)))


class LeastSquares(Protocol):
    """A problem: it knows its unknowns and conditions, and nothing of the solver."""

    def linearise(self, state: Any) -> Linearisation:
        """Return the normal equations at `state`."""

    def renewed(self, state: Any, line: Linearisation) -> Linearisation:
        """Return the right side at `state` with the matrix of a linearisation nearby."""

    def evaluate(self, state: Any, context: Any) -> float:
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
class Kept:
    """Normals of a step."""

    line: Linearisation  # without context
    factor: Factor
    closing: float = 0.0  # share that the next step with them is of one, at most; 0 where that is not known


@dataclass(frozen=True, kw_only=True, eq=False)
class Near:
    """That an iteration starts near the minimum of another one, which has the same unknowns.

    It may keep its first matrix, or use from the start that of the other one.
    """

    kept: Kept | None = None
    proven: bool = False  # the observations differ in their values alone, so that steps close in as they did there
    length: float = np.inf  # of the last step of the other one: the first one here is to close in on that
    determined: bool = True  # that iteration has determined the unknowns


class Until(Enum):
    """When an iteration of a large problem ends."""

    REST = "rest"  # below the limits
    CLOSE = "close"  # as soon as its steps close in, so that it may keep its matrix
    FIT = "fit"  # or as soon as misfits are so small that the next step will close in: it gains less than they are
    TESTED = "tested"  # as soon as the next step would change no residual, and no test of it
    COMPARED = "compared"  # as soon as its sum of squares can be compared with others
    WEIGHED = "weighed"  # as soon as a step gains less than the misfits that it leaves: their weights hardly change


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """How an iteration ended: `state` is the last accepted one; `failure` is empty when it converged.

    Of a lost iteration it is the one before the blind steps.
    """

    state: Any
    last_step: FloatArray
    failure: str
    lost: bool = False  # points are behind their cameras: nothing can be built on the state
    hopeless: bool = False  # at a halt by far too high: sides of the water do not matter, nor crests of waves
    change: float = 0.0  # sigmas, by `Linearisation.change`, of the last step where that was a full one
    last: Kept | None = None  # normals of that step, where the iteration converged
    rough: bool = False  # it ended as soon as `Until` said, before the limits

    @property
    def is_final(self) -> bool:
        """True where another triangulation from here does no better."""
        return self.lost or self.hopeless

    @property
    def kept(self) -> Kept | None:
        """Its last normals where another iteration may use them."""
        return self.last if self.last is not None and self.last.line.renewable else None

    @property
    def length(self) -> float:
        """Length of the last step of a rough iteration, which the next one is to go on from, else infinite."""
        return self.last.line.length(self.last_step) if self.last is not None and self.rough else np.inf


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
    start: Near | None = None,
    until: Until = Until.REST,
) -> Outcome:
    """Lower the objective of `problem` from `state` until a full step is below the limits, and changes nothing.

    The limits are those of the problem for what it solves for; that nothing adjusted changes by more than `AT_REST`
    of its own sigma is the same for all problems.
    A step that would raise the objective is taken again with Levenberg's damping, ten times stronger each time;
    every accepted step lets the damping go. From where the objective is infinite, steps are taken without looking,
    but not for long; and heavily damped ones that gain next to nothing end it. Raises `SingularNormalsError`.

    Near the minimum the matrix hardly changes: a large problem keeps it, factorised, and takes new right sides as
    long as each step is a hundredth of the one before at most, or the one after the next would be a hundredth of
    the limits; so it does where nothing moves by a tenth of a sigma. The step that ends it has a matrix of its own,
    or leaves a hundredth of the limits, as steps have closed in. Of an iteration that `start` says to be near its
    minimum the first step may have a kept matrix as well, which, where that is not proven, does not end it unless
    the step itself is a hundredth of the limit.
    What follows may not need the minimum itself: `until` says how near a large problem is to come.
    """
    damping, blind, stalled, before, again = 0.0, 0, 0, state, False
    step, change, length = np.zeros(0), 0.0, start.length if start else 0.0
    begin = start.kept if start else None
    # of the matrix of `kept` is `factor`
    kept, factor, share = (begin.line, begin.factor, begin.closing) if begin else (None, None, 0.0)
    for number in range(1, max_iterations + 1):
        accepted, last = None, length
        if kept is not None:
            line = problem.renewed(state, kept)
            accepted = _step(problem, state, line, 0.0, factor)
        if accepted is None:
            kept = factor = None  # which makes room for the next
            line = problem.linearise(state)
            if not line.matrix.sensible():
                return Outcome(state=before, last_step=step, failure=_LOST, lost=True)
            factor = factorised(line.matrix, damping)
            first_step = None
            if number == 1:
                tested = start is not None and start.determined
                first_step = _first_step(line, factor, tested)
            accepted = _damped_step(problem, state, line, damping, factor, first_step)
        if accepted is None:
            return Outcome(state=state, last_step=step, failure=_STUCK, change=change, hopeless=line.hopeless)
        before = before if blind else state
        state, step, objective, damping = accepted
        if report:
            report(Step(number=number, step=step, objective=objective, damping=damping))
        blind = 0 if np.isfinite(objective) else blind + 1
        if blind == _BLIND:
            return Outcome(state=before, last_step=step, failure=_LOST, lost=True)
        stalled = stalled + 1 if damping >= _HEAVY and objective > (1.0 - _GAIN) * line.objective else 0
        if stalled == _STALLED:
            return Outcome(state=state, last_step=step, failure=_STUCK, hopeless=line.hopeless)
        length, change = (0.0, 0.0) if damping else (line.length(step), line.change(step))
        first = start if number == 1 else None
        near, ends = _closing(until, length, last, objective, kept is not None, share)
        good = damping == 0.0 and bool(np.isfinite(objective)) and (near or kept is None)
        proven = first is None or first.proven or kept is None or length <= _KEPT * AT_REST
        further = (_SLOWEST if again else _FURTHER) * length / last if kept is not None and last > 0.0 else 0.0
        left = max(1.0, further / _KEPT)  # what a kept matrix leaves counts, where that is more than a hundredth
        rest = good and proven and left * change < AT_REST and problem.converged(left * step)
        rough = not rest and ends and good and (line.renewable or until is Until.WEIGHED)
        if factor is not None and (rest or rough):
            normals = Kept(line=replace(line, context=None), factor=factor, closing=0.0 if first else further)
            return Outcome(state=state, last_step=step, failure="", change=change, last=normals, rough=rough)
        again, kept = kept is not None, line if good and near and line.renewable else None
        damping, share = 0.0 if damping <= _NEGLIGIBLE_DAMPING else 0.1 * damping, 0.0
    plural = "" if max_iterations == 1 else "s"
    failure = f"limits not reached in {max_iterations} iteration{plural}"
    slow = objective > (1.0 - _SLOW) * line.objective
    return Outcome(state=state, last_step=step, failure=failure, change=change, hopeless=line.hopeless and slow)


def _closing(
    until: Until, length: float, last: float, objective: float, kept: bool, share: float
) -> tuple[bool, bool]:
    """Return whether steps close in, so that they may have a `kept` matrix, and whether that is near enough.

    For comparisons and tests it is where the next step will be short enough, shorter than this one by as much.
    `share`: that of a kept matrix that the next step is at most, 0 where that is not known.
    """
    if until is Until.COMPARED:
        seen = length**2 <= _SEEN * last < np.inf
        return seen or length <= _CLOSING * last, seen
    if until is Until.WEIGHED:
        return False, length**2 <= objective
    near = length <= (_KEPT * last if kept else _CLOSING * max(last, 1.0))
    near |= length**3 <= _KEPT * AT_REST * last**2
    if until is Until.TESTED:
        foreseen = length**2 <= AT_REST * last < np.inf or (kept and 0.0 < share * length <= AT_REST)
        return near, length <= AT_REST or foreseen
    near |= until is Until.FIT and bool(np.sqrt(objective) <= _CLOSING * length)
    return near, near and until is not Until.REST


def not_raised(objective: float, before: float) -> bool:
    """Return whether an objective is not above the one before by more than rounding."""
    return objective <= before * (1.0 + _ROUNDING) + _NOTHING


def _first_step(line: Linearisation, factor: Factor | None, tested: bool) -> FloatArray:
    """Return the first full step of normals that may still have to be `tested`. Raises `SingularNormalsError`."""
    step = None
    if factor is not None:
        step = factor.solve(line.rhs) if tested else factor.tested_solution(line.rhs, SINGULAR)
    if step is None:
        raise SingularNormalsError(line.matrix)
    return step


def _damped_step(
    problem: LeastSquares,
    state: Any,
    line: Linearisation,
    damping: float,
    factor: Factor | None,
    step: FloatArray | None,
) -> tuple[Any, FloatArray, float, float] | None:
    """Return state, step, objective and damping of the first step that is taken.

    `factor` is that of `damping`, and so is the `step`, where it is known.
    """
    while damping <= _LAST_DAMPING:
        accepted = _step(problem, state, line, damping, factor, step)
        if accepted is not None:
            return accepted
        step = None
        damping = max(10.0 * damping, _FIRST_DAMPING)
        factor = factorised(line.matrix, damping)
    return None


def _step(
    problem: LeastSquares,
    state: Any,
    line: Linearisation,
    damping: float,
    factor: Factor | None,
    step: FloatArray | None = None,
) -> tuple[Any, FloatArray, float, float] | None:
    """Return state, step, objective and damping of a step, None where it would raise the objective."""
    if factor is None:
        return None
    step = factor.solve(line.rhs) if step is None else step
    trial = problem.apply(state, step, line.context)
    objective = problem.evaluate(trial, line.context)
    return (trial, step, objective, damping) if not_raised(objective, line.objective) else None
