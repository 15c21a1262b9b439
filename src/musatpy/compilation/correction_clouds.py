"""LAS and LAZ files of an old compilation corrected: whatever else their points have stays with them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from musatpy.arrays import FloatArray
from musatpy.compilation.correcting import Corrected
from musatpy.compilation.correction_layers import Corrector, Tally, measures
from musatpy.pointfiles.las_files import rewrite

_ADDED = {
    "depth": ("f4", "below the water, m"),
    "sigma_depth": ("f4", "m"),
    "sigma_east": ("f4", "m"),
    "sigma_north": ("f4", "m"),
    "sigma_up": ("f4", "m"),
}


def correct_cloud(source: Path, target: Path, correction: Corrector, tallies: list[Tally]) -> None:
    """Correct the points of a file chunk by chunk; those without a position are left out, and tallied.

    Raises `DepthError` for a file that has one of the dimensions of depths and sigmas already, or that cannot hold
    the true points; `OSError`.
    """

    def work(chunks: Iterator[FloatArray]) -> Iterator[Corrected]:
        for apparent in chunks:
            done = correction(apparent)
            tallies.append(Tally.of(done))
            yield done

    rewrite(source, target, _ADDED, work, _values, "true points", kept=lambda done: done.known)


def _values(given: Any, done: Corrected) -> Iterator[tuple[str, Any]]:
    """Yield coordinates and dimensions of points that stay, and what they get."""
    known = done.known
    yield from zip("xyz", done.xyz[known].T, strict=True)
    for name, column in measures(done, known).items():
        yield name, column.values
