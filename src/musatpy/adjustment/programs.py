"""The programs by their names on the option card."""

from __future__ import annotations

from musatpy.adjustment.job import Progress
from musatpy.adjustment.sea import Sea
from musatpy.model import Block, Program, Solution


def adjust(block: Block, progress: Progress | None = None, sea: Sea | None = None) -> Solution:
    """Return the solution of a block by the program of its options, converged or not.

    `progress` is called after every iteration; with a `sea`, rays are refracted by its waves (refraction RIGOROUS,
    and IIIA). Raises `AdjustmentError` with every reason where the block cannot be adjusted.
    """
    # each run loads the program that it needs
    if block.options.program is Program.IIIA:
        from musatpy.adjustment import musat3a

        return musat3a.adjust(block, progress, sea)
    from musatpy.adjustment import musat2a

    return musat2a.adjust(block, progress, sea)
