"""Waves as unknowns of the orientation, on simulated strips: how much of their error that removes, and when not.

The second technique of the discussion in Okamoto (1982). Every strip is adjusted three times: as if the water were
level, with the waves known, and with their height, length, azimuth and crest unknown. What was given of these
beforehand is wrong by errors drawn from its sigmas, as an honest guess is.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.job import adjust
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import FloatArray
from musatpy.model import AdjustedWaves, Solution
from musatpy.refraction.waves import HEIGHT, LENGTH, Trains
from musatpy.units import DEGREE
from studies.strip import Photographed, Strip, photographed

# errors are drawn of directions from x to y, in which the strip has its waves: azimuths count the other way
_TURNS = np.array([1.0, 1.0, -1.0, 1.0])


@dataclass(frozen=True, kw_only=True)
class Guess:
    """How well the waves are known beforehand: sigmas, the crest's in parts of the length."""

    height: float = 0.3  # of itself
    length: float = 0.05  # of itself
    azimuth: float = 5.0 * DEGREE
    crest: float = 0.1  # of the length

    def times(self, factor: float) -> Guess:
        """Return a guess so many times as bad."""
        return Guess(
            height=self.height * factor,
            length=self.length * factor,
            azimuth=self.azimuth * factor,
            crest=self.crest * factor,
        )

    def sigma(self, values: FloatArray) -> FloatArray:
        """Return the sigmas (k, 4) of waves with parameters (k, 4)."""
        H, L = values[:, HEIGHT], values[:, LENGTH]
        return np.stack([self.height * H, self.length * L, np.full(len(H), self.azimuth), self.crest * L], axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Of check points under water: errors (c, 3) m, and these over their sigmas (c, 3)."""

    error: FloatArray
    normalised: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """One strip, adjusted in the three ways; `unknown` is None where that has not converged.

    error (4,): of the parameters; sigma (4,), inflation (4,): their own, with the a priori unit weight; kept (4,):
    sigma over that of the guess.
    """

    level: Errors
    known: Errors
    unknown: Errors | None
    error: FloatArray
    sigma: FloatArray
    kept: FloatArray
    inflation: FloatArray
    correlation: float  # the largest, in size, of two of the parameters


def run(strip: Strip, guess: Guess, seed: int) -> Run:
    """Return one strip, adjusted in the three ways; the same seed gives the same numbers."""
    rng = np.random.default_rng(seed)
    length = 2.0 * np.pi / float(np.linalg.norm(strip.waves().vector))
    scene = photographed(strip, rng.uniform(-0.5, 0.5) * length, rng)
    truth = Trains.of(scene.waves, strip.depth)
    sigma = guess.sigma(truth.values)
    values = truth.values + sigma * rng.normal(size=sigma.shape) * _TURNS
    origin = np.zeros(3)
    # the speed of a guessed length is that of theory, as the speed of the true one is
    wrong = Sea(
        surface=truth.with_values(values).surface, time=scene.times, origin=origin, sigma=sigma, depth=strip.depth
    )
    solution = adjust(scene.block, sea=wrong)
    found = solution.water.waves if solution.water else None
    if found is None:
        raise AssertionError("the waves were unknown, and are not in the solution")
    difference = (found.value - truth.values)[0]
    return Run(
        level=_errors(scene, adjust(scene.block)),
        known=_errors(scene, adjust(scene.block, sea=Sea(surface=scene.waves, time=scene.times, origin=origin))),
        unknown=_errors(scene, solution) if solution.converged else None,
        error=difference,
        sigma=found.kept[0] * sigma[0],
        kept=found.kept[0],
        inflation=found.inflation[0],
        correlation=_largest(found),
    )


def _errors(scene: Photographed, solution: Solution) -> Errors:
    """Return the errors of the check points of a solution, with sigmas of the a priori unit weight."""
    error = (solution.points.position - scene.points)[scene.check]
    variance = np.einsum("pii->pi", solution.points.covariance)[scene.check] / solution.unit_sigma**2
    return Errors(error=error, normalised=error / np.sqrt(variance))


def _largest(waves: AdjustedWaves) -> float:
    own = np.char.startswith(waves.second, "wave ")
    return float(np.abs(waves.correlation[own]).max(initial=0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Summary:
    """What several runs of one kind have in common. RMS of errors are (2,) m: plan (of both together) and height.

    removed (2,): the share of the RMS error due to waves that goes where these are unknowns; that with known waves
    does not count, it is not the waves'. honesty of the parameters (4,) and heights: RMS of errors over their own
    sigmas, 1 for honest ones. kept (4,): RMS of sigmas over those given beforehand. failed: of `runs` that have not
    converged, which count nowhere else.
    """

    runs: int
    failed: int
    level: FloatArray
    known: FloatArray
    unknown: FloatArray
    removed: FloatArray
    parameter_honesty: FloatArray
    height_honesty: float
    kept: FloatArray
    inflation: FloatArray  # (4,) median variance inflation
    correlation: float  # median of the largest of two parameters


def summary(runs: Iterable[Run]) -> Summary:
    """Return the summary of some runs. Raises `ValueError` where none has converged."""
    every = list(runs)
    done = [(one, one.unknown) for one in every if one.unknown is not None]
    if not done:
        raise ValueError("no run has converged")
    level, known, unknown = (
        _rms(errors)
        for errors in ([one.level for one, _ in done], [one.known for one, _ in done], [found for _, found in done])
    )
    of_waves, left = (np.sqrt(np.maximum(rms**2 - known**2, 0.0)) for rms in (level, unknown))
    error, sigma = np.stack([one.error for one, _ in done]), np.stack([one.sigma for one, _ in done])
    heights = np.concatenate([found.normalised[:, 2] for _, found in done])
    return Summary(
        runs=len(every),
        failed=len(every) - len(done),
        level=level,
        known=known,
        unknown=unknown,
        removed=1.0 - left / of_waves,
        parameter_honesty=np.sqrt(np.mean(np.square(error / sigma), axis=0)),
        height_honesty=float(np.sqrt(np.mean(np.square(heights)))),
        kept=np.sqrt(np.mean(np.square([one.kept for one, _ in done]), axis=0)),
        inflation=np.median([one.inflation for one, _ in done], axis=0),
        correlation=float(np.median([one.correlation for one, _ in done])),
    )


def _rms(errors: list[Errors]) -> FloatArray:
    error = np.concatenate([one.error for one in errors])
    return np.array([np.sqrt(np.mean(np.square(error[:, :2]))), np.sqrt(np.mean(np.square(error[:, 2])))])


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One cell of a study: what is varied, its value, and the strip and the guess with it."""

    varied: str
    value: float
    strip: Strip
    guess: Guess


CONTROL, PERIODS, NOISE, GUESSES = (0, 4, 12, 24), (7.0, 10.0, 15.0), (2.0, 5.0, 15.0, 40.0), (0.3, 1.0, 2.0)
HEIGHTS = {7.0: 0.6, 10.0: 1.0, 15.0: 2.0}  # m in deep water, of waves by their periods


def cells(strip: Strip, guess: Guess) -> list[Cell]:
    """Return the cells of the study of docs/waves_as_unknowns.md about one strip and one guess.

    Control in water with both intervals and with two and three photos; period, noise and guess one at a time.
    """
    found = []
    for photos in (3, 2):
        for interval in (strip.interval, 0.0):
            name = f"control, {photos} photos, {'simultaneous' if interval == 0.0 else f'{interval:g} s apart'}"
            for control in CONTROL:
                other = replace(strip, photos=photos, interval=interval, control=control)
                found.append(Cell(varied=name, value=control, strip=other, guess=guess))
    for period in PERIODS:
        other = replace(strip, period=period, deep_height=HEIGHTS[period])
        found.append(Cell(varied="period", value=period, strip=other, guess=guess))
    found += [Cell(varied="noise", value=one, strip=replace(strip, noise=one), guess=guess) for one in NOISE]
    found += [Cell(varied="guess", value=one, strip=strip, guess=guess.times(one)) for one in GUESSES]
    return found
