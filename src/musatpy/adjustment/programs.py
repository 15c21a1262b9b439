"""The programs by their names on the option card."""

from __future__ import annotations

import numpy as np

from musatpy.adjustment.sea import Sea
from musatpy.errors import AdjustmentError, Problem
from musatpy.model import Block, Program, Solution
from musatpy.model.progress import Progress


def adjust(block: Block, progress: Progress | None = None, sea: Sea | None = None) -> Solution:
    """Return the solution of a block by the program of its options, converged or not.

    `progress` is called after every iteration; with a `sea`, rays are refracted by its waves (refraction RIGOROUS,
    and IIIA). Raises `AdjustmentError` with every reason where the block cannot be adjusted.
    """
    try:
        # each run loads the program that it needs
        if block.options.program is Program.IIIA:
            from musatpy.adjustment import musat3a

            return musat3a.adjust(block, progress, sea)
        from musatpy.adjustment import musat2a

        return musat2a.adjust(block, progress, sea)
    except np.linalg.LinAlgError as error:
        message = "equations of the adjustment cannot be solved: points or stations have run away"
        advice = "gross errors make them (OP2 editing EDIT looks for these and takes them out)"
        raise AdjustmentError([Problem(message=f"{message}, as {advice}")]) from error
