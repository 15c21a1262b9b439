"""LAS and LAZ files of an old compilation corrected: whatever else their points have stays with them."""

from __future__ import annotations

from pathlib import Path

from musatpy.compilation.correction_layers import Corrector, Tally, measures
from musatpy.pointfiles.las_files import coordinates, rewritten

_ADDED = {
    "depth": ("f4", "below the water, m"),
    "sigma_depth": ("f4", "m"),
    "sigma_east": ("f4", "m"),
    "sigma_north": ("f4", "m"),
    "sigma_up": ("f4", "m"),
}


def correct_cloud(source: Path, target: Path, correction: Corrector, tallies: list[Tally]) -> None:
    """Correct the points of a file chunk by chunk; those without a position are left out, and tallied.

    Raises `InterchangeError` for a file that has one of the dimensions of depths and sigmas already, or that cannot
    hold the true points; `OSError`.
    """
    with rewritten(source, target, _ADDED) as (chunks, write):
        for given in chunks:
            done = correction(coordinates(given))
            tallies.append(Tally.of(done))
            measured = {name: column.values for name, column in measures(done, done.known).items()}
            write(given[done.known], dict(zip("xyz", done.xyz[done.known].T, strict=True)) | measured)
