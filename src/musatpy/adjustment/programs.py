"""The programs by their names on the option card, and again with the plate sigma where that is a guess.

It is adjusted with its variance component until that is 1. Foerstner (1979): v'Pv of the plate coordinates over the
sum of their redundancy numbers estimates the factor of their variance alone, whatever the sigmas of stations and
control are worth, which stay as their cards have them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from musatpy.adjustment.job import prepared
from musatpy.adjustment.wavy_water import Sea
from musatpy.errors import AdjustmentError, NumericalError, Problem, numerics
from musatpy.model import Block, ObservationKind, PlateSigma, Program, Solution
from musatpy.model.progress import Progress


def adjust(block: Block, progress: Progress | None = None, sea: Sea | None = None) -> Solution:
    """Return the solution of a block by the program of its options, converged or not.

    Of a plate sigma that is a guess, stations and points are those by its variance component. `progress` is called
    after every iteration; with a `sea`, rays are refracted by its waves (refraction RIGOROUS,
    and IIIA). Raises `AdjustmentError` with every reason where the block cannot be adjusted.
    """
    # each run loads the program that it needs
    if block.options.program is Program.IIIA:
        from musatpy.adjustment.musat3a import adjust as program
    else:
        from musatpy.adjustment.musat2a import adjust as program
    try:
        with numerics("the adjustment"):
            if block.options.plate_sigma_is is PlateSigma.KNOWN:
                solution = program(block, progress, sea)
            else:
                solution = estimated(block, lambda weighted: program(weighted, progress, sea))
            return replace(solution, cards=block.photos.position)
    except NumericalError as error:
        advice = Problem(message="OP2 editing EDIT looks for gross errors and takes them out", severity="warning")
        suspicions = (Problem(message=text, severity="warning") for text in _suspicions(block, sea))
        raise NumericalError([*error.problems, *suspicions, advice]) from error


def _suspicions(block: Block, sea: Sea | None) -> tuple[str, ...]:
    """Return which photos and points are most at odds at the start of a run; none where that makes no sense."""
    try:
        with numerics("the start"), np.errstate(all="ignore"):
            job, state = prepared(block, None, sea)
            return job.suspicions(state, "failed")
    except AdjustmentError:
        return ()


_ADJUSTMENTS = 20  # at most: plates that check themselves take three to five
_AT_REST = 1e-4  # of the plate sigma: a hundredth of what a million images tell of it
_CHECKED = 1.0  # redundancy of all plates together, below which they say nothing of their sigma
_FINEST = 1e-5  # mm: coordinates of six decimals without error have residuals below


def with_plate_sigmas(block: Block, factor: float) -> Block:
    """Return the block with all its plate sigmas, of the job and of single images, times a factor."""
    options = replace(block.options, plate_sigma=block.options.plate_sigma * factor)
    return replace(block, options=options, plates=replace(block.plates, sigma=block.plates.sigma * factor))


def estimated(block: Block, adjust: Callable[[Block], Solution]) -> Solution:
    """Return the solution by the plate sigma that its own residuals show; its block has that one.

    What has not converged, and plates that nothing checks, keep the sigma that they came with.
    """
    factor = 1.0
    solution = adjust(block)
    for _ in range(_ADJUSTMENTS):
        component = plate_component(solution)
        if not solution.converged or component is None:
            break
        component = max(component, _FINEST / float(np.median(solution.block.plate_sigmas)))
        if abs(component - 1.0) < _AT_REST:
            break
        factor *= component
        solution = adjust(with_plate_sigmas(block, factor))
    return replace(solution, plate_factor=factor)


def plate_component(solution: Solution) -> float | None:
    """Return the factor of the plate sigmas that the residuals of the plates show; None where nothing checks them.

    What errors of considered water add to the residuals is no error of the plates.
    """
    observed = solution.observed
    if observed is None:
        return None
    plates = observed.kind == ObservationKind.PLATE
    redundancy = observed.redundancy[plates]
    if redundancy.sum() < _CHECKED:
        return None
    variances = np.square(observed.sigma[plates])
    squares = np.square(observed.residual[plates]) - observed.considered[plates]
    return float(np.sqrt(max(np.sum(squares / variances), 0.0) / redundancy.sum()))
