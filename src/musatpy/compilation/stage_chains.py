"""From refined plate coordinates back to what the stages read: every step of the reduction undone, last first.

The chain of the plotter's program for plates whose interior orientation was measured on it: earth curvature,
refraction in the air, lens, film (reseau), fiducial transformation, comparator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import takewhile

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.loop import Loop, Stages
from musatpy.errors import CompilationError, Problem
from musatpy.model import Block
from musatpy.reduction.comparator import Comparator
from musatpy.reduction.distortion import Lens, Side
from musatpy.reduction.inversion import inverse
from musatpy.reduction.nadir import Displacement, Together
from musatpy.reduction.planar import Plane
from musatpy.reduction.plate_steps import PlateReduction, Step
from musatpy.reduction.refined_block import reduction_of

_ONE = np.eye(2)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateChain:
    """The steps of one plate; those that are transformations of the plane, at its beginning, at one blow."""

    plate: PlateReduction

    @cached_property
    def bent(self) -> tuple[Step, ...]:
        """The steps behind those."""
        steps = [applied.step for applied in self.plate.steps]
        planes = takewhile(lambda step: isinstance(step, Comparator | Plane), steps)
        return tuple(steps[len(list(planes)) :])

    @cached_property
    def to_readings(self) -> FloatArray:
        """Homography (3, 3) from the plane behind those steps to readings."""
        H = np.eye(3)
        for applied in self.plate.steps[: len(self.plate.steps) - len(self.bent)]:
            step = applied.step
            if isinstance(step, Plane):
                H = step.matrix() @ H
            elif isinstance(step, Comparator):
                H[:2] = step.matrix() @ H[:2]
        return np.asarray(np.linalg.inv(H))

    def readings(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the readings (k, 2) of refined coordinates (k, 2), and their partials (k, 2, 2) by these."""
        return _undone(self.bent, self.to_readings, xy)

    def plates(self, readings: FloatArray) -> FloatArray:
        """Return the refined coordinates (k, 2) of readings (k, 2)."""
        for applied in self.plate.steps:
            readings = applied.step.apply(readings)
        return readings


@dataclass(frozen=True, kw_only=True, eq=False)
class StageChain:
    """The chains of both stages."""

    left: PlateChain
    right: PlateChain

    @cached_property
    def both(self) -> tuple[tuple[Step, ...], FloatArray] | None:
        """Bent steps of both plates at one blow, and (2, 3, 3) to their readings; None where one has no twin."""
        pairs = zip(self.left.bent, self.right.bent, strict=False)
        steps = tuple(step for pair in pairs if (step := _both(*pair)) is not None)
        if not len(steps) == len(self.left.bent) == len(self.right.bent):
            return None
        return steps, np.stack([self.left.to_readings, self.right.to_readings])

    def readings(self, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the readings (k, 2, 2) of refined plate coordinates (k, 2, 2) mm, and their partials by these.

        partials (k, 2, 2, 2); NaN where no reading becomes these coordinates.
        """
        if self.both is not None:
            return _undone(*self.both, xy)
        both = [plate.readings(xy[:, side]) for side, plate in enumerate((self.left, self.right))]
        return np.stack([both[0][0], both[1][0]], axis=1), np.stack([both[0][1], both[1][1]], axis=1)

    def plates(self, readings: FloatArray) -> FloatArray:
        """Return the refined plate coordinates (k, 2, 2) mm of readings (k, 2, 2)."""
        return np.stack([self.left.plates(readings[:, 0]), self.right.plates(readings[:, 1])], axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class RawLoop:
    """The loop of a stereomodel whose stages are read raw."""

    loop: Loop
    chain: StageChain

    def stages(self, mark: FloatArray) -> Stages:
        """Return the readings of the stages at marks (k, 3) in the model, with their partials by the mark."""
        refined = self.loop.stages(mark)
        read, by_plate = self.chain.readings(refined.xy)
        return Stages(xy=read, by_mark=by_plate @ refined.by_mark)

    def mark(self, readings: FloatArray) -> FloatArray:
        """Return the marks (k, 3) in the model of readings (k, 2, 2) of the stages."""
        return self.loop.mark(self.chain.plates(readings))


def chain_of(raw: Block, left: str, right: str) -> StageChain:
    """Return the chain of two photos of a block of raw plates.

    Raises `CompilationError` where one of them has no interior orientation, or a refused one, and `DeckError` as
    `reduction.refined_block.reduction_of`.
    """
    plates = {plate.photo: plate for plate in reduction_of(raw)}
    problems, found = [], []
    for name in (left, right):
        plate = plates.get(name)
        if plate is None:
            problems.append(Problem(message=f"photo {name} has no interior orientation in the deck"))
        elif plate.refusal is not None:
            problems.append(Problem(message=f"photo {name}: {plate.refusal.message}"))
        else:
            found.append(plate)
    if problems:
        raise CompilationError(problems)
    return StageChain(left=PlateChain(plate=found[0]), right=PlateChain(plate=found[1]))


def _both(left: Step, right: Step) -> Step | None:
    """Return a step that does with images (k, 2, 2) of both plates what theirs do, None where they differ."""
    if isinstance(left, Lens) and isinstance(right, Lens):
        ours, theirs = vars(left), vars(right)
        return left if all(np.array_equal(ours[field.name], theirs[field.name]) for field in fields(Lens)) else None
    if isinstance(left, Displacement) and isinstance(right, Displacement):
        return Together.of((left, right))
    return None


def _undone(steps: Sequence[Step], H: FloatArray, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the readings of refined coordinates xy (k, ..., 2), and their partials (k, ..., 2, 2) by these.

    H (..., 3, 3) is the homography to readings from the plane before the steps.
    """
    partials = _ONE
    for step in reversed(steps):
        before = step.inverse(xy)
        partials = _backwards(step, before, xy) @ partials
        xy = before
    plane, shift, down = H[..., :2, :2], H[..., :2, 2], H[..., 2, :2]
    weight = np.einsum("...i,...i->...", xy, down) + H[..., 2, 2]
    read = ((plane @ xy[..., None])[..., 0] + shift) / weight[..., None]
    return read, (plane - read[..., None] * down[..., None, :]) / weight[..., None, None] @ partials


def _backwards(step: Step, before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the derivatives (k, 2, 2) of the points before a step by those after it."""
    if isinstance(step, Lens) and step.side is Side.IDEAL:  # the distortion is stated where the points are known
        return np.asarray(_ONE + step.distortion_partials(after))
    return inverse(step.partials(before))
