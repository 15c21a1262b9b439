"""The programs by their names on the option card."""

from __future__ import annotations

import numpy as np

from musatpy.adjustment.job import prepared
from musatpy.adjustment.wavy_water import Sea
from musatpy.errors import AdjustmentError, NumericalError, Problem, numerics
from musatpy.model import Block, PlateSigma, Program, Solution
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
                return program(block, progress, sea)
            from musatpy.adjustment.plate_sigma import estimated

            return estimated(block, lambda weighted: program(weighted, progress, sea))
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
