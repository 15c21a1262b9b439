"""The sounding datum on a run: a height everywhere, or a surface that a grid file has over the ellipsoid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.triangulation import Triangulation
from musatpy.errors import CompilationError, Problem, ProblemsError
from musatpy.geometry.geodesy import Frame
from musatpy.model.compilation import SoundingDatum

if TYPE_CHECKING:
    from musatpy.geometry.projected import Geoid


@dataclass(frozen=True, kw_only=True, eq=False)
class Datum:
    """A sounding datum: heights of the job, m; with a grid, those above its surface."""

    name: str = ""
    height: float = 0.0
    sigma: float = 0.0
    geoid: Geoid | None = None
    frame: Frame | None = None  # of the job, where there is a grid

    @property
    def title(self) -> str:
        """What depths are below."""
        return self.name or "the height 0 of the job"

    def over(self, position: FloatArray) -> FloatArray:
        """Return the heights (k,) of the datum at positions (k, 3) of the job, NaN outside its grid."""
        height = np.full(len(position), self.height)
        if self.geoid is None or self.frame is None:
            return height
        known = np.isfinite(position).all(axis=1)
        level = self.frame.level(self.frame.working(position[known]))
        height[known] += self.geoid.undulation(level[:, 0], level[:, 1])
        height[~known] = np.nan
        return height


def datum_of(spec: SoundingDatum | None, run: Triangulation) -> Datum:
    """Return the datum of a deck on a run, the height 0 without one. Raises `CompilationError` for a bad grid."""
    if spec is None:
        return Datum()
    plain = Datum(name=spec.name, height=spec.height, sigma=spec.sigma)
    if not spec.geoid:
        return plain
    if run.map_system is None:
        raise CompilationError([Problem(message="VDT: the run is a local job, and no grid of heights reaches it")])
    from musatpy.geometry.projected import Geoid  # PROJ, for few decks

    try:
        geoid = Geoid(spec.geoid)
    except ProblemsError as error:
        raise CompilationError(error.problems) from error
    return Datum(name=spec.name, height=spec.height, sigma=spec.sigma, geoid=geoid, frame=run.frame)
