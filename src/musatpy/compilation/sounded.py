"""Soundings that meet the bottom of a compilation, and those that do not, with their reasons."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.compilation.bottom import Surface
from musatpy.errors import Problem, SoundingError
from musatpy.soundings.differences import Differences
from musatpy.soundings.sounding_files import Soundings
from musatpy.surfaces.tin import INSIDE, OUTSIDE, REASONS

STEEP = "the bottom is steeper there than the limit"


@dataclass(frozen=True, kw_only=True)
class Matching:
    """How soundings are held against a bottom.

    `datum` (m): how far the datum of the soundings is below that of the compilation, with its sigma; sigma of
    soundings whose file has none, sigma of their place (m); the steepest slope of the bottom that counts.
    """

    datum: float = 0.0
    datum_sigma: float = 0.0
    sigma: float = 0.0
    plan_sigma: float = 0.0
    steepest: float = np.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class Sounded:
    """Soundings beside a bottom: those that meet it, their `rows` (k,), and why the rows of others do not.

    `xy` (k, 2) m: where they stand on the map of the first model.
    """

    soundings: Soundings
    rows: IntArray
    xy: FloatArray
    differences: Differences
    reasons: dict[int, str]


def sounded(surfaces: list[Surface], soundings: Soundings, how: Matching) -> Sounded:
    """Return soundings beside the surfaces of models; where these overlap beside the surer one.

    Raises `SoundingError` where their coordinates are not of the kind of the job's.
    """
    n = len(soundings.depth)
    value, sigma, slope = np.full(n, np.nan), np.full(n, np.inf), np.full(n, np.nan)
    reason = np.full(n, OUTSIDE)
    for surface in surfaces:
        if surface.tin is None:
            continue
        if (surface.plan is not None) != soundings.angular:
            needed = "lat and lon" if surface.plan is not None else "x and y"
            raise SoundingError([Problem(message=f"the job has {needed}: give the soundings in these")])
        at = surface.tin.at(surface.places(soundings.place))
        reason = np.where(reason == INSIDE, reason, np.where(at.reason == OUTSIDE, reason, at.reason))
        surer = at.sigma < sigma
        value[surer], sigma[surer] = at.value[surer], at.sigma[surer]
        slope[surer] = np.linalg.norm(at.gradient[surer], axis=1)
    steep = slope > how.steepest
    met = np.flatnonzero(np.isfinite(value) & ~steep)
    of_map = next((surface for surface in surfaces if surface.tin is not None), None)
    of_soundings = np.where(np.isfinite(soundings.sigma[met]), soundings.sigma[met], how.sigma)
    parts = (sigma[met], of_soundings, slope[met] * how.plan_sigma, np.full(len(met), how.datum_sigma))
    lost = np.setdiff1d(np.arange(n), met).tolist()
    return Sounded(
        soundings=soundings,
        rows=met,
        xy=np.zeros((0, 2)) if of_map is None else of_map.places(soundings.place[met]),
        differences=Differences(
            names=soundings.names[met],
            compiled=value[met],
            sounded=soundings.depth[met] + how.datum,
            sigma=np.sqrt(np.sum(np.square(parts), axis=0)),
        ),
        reasons={row: STEEP if steep[row] else REASONS[int(reason[row])] for row in lost},
    )
