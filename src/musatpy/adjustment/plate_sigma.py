"""A plate sigma that is a guess: adjusted again with its variance component until that is 1.

Foerstner (1979): v'Pv of the plate coordinates over the sum of their redundancy numbers estimates the factor of
their variance alone, whatever the sigmas of stations and control are worth, which stay as their cards have them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from musatpy.model import Block, ObservationKind, Solution

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
