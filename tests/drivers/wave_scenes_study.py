"""The study of random scenes through waves that are unknown: `python -m drivers.wave_scenes_study [FIRST] COUNT`.

Adjusts the scenes of `reference.wave_scenes` and says of each whether its answer can be used, for the page Waves as
unknowns of the documents.
"""

import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

import musatpy
from musatpy.errors import AdjustmentError
from reference.wave_scenes import Scene, scene

BEYOND = 5.0  # of its own sigmas: no error of a point that chance explains
_LEVEL = 0.999  # of the one-sided test of sigma0


@dataclass(frozen=True, kw_only=True)
class Result:
    """How the adjustment of a scene ended."""

    seed: int
    kind: str  # of scene, in a word
    converged: bool
    reason: str
    sigma0: float
    conspicuous: bool  # sigma0 above its limit
    worst: float  # error of a check point in its sigmas, the largest
    metres: float  # and in m
    truth: float  # largest error of a wave parameter in its sigmas
    open: bool  # the program says that the crests may be others
    determined: bool  # so it says of every parameter
    seconds: float
    iterations: int

    @property
    def status(self) -> str:
        """Return failed, conspicuous or accepted, and of the last whether it is false, and said to be doubtful."""
        if not self.converged:
            return "failed"
        if self.conspicuous:
            return "conspicuous"
        if self.worst <= BEYOND:
            return "right, crests said to be open" if self.open else "right"
        return "false, crests said to be open" if self.open else "FALSE"


def kind_of(made: Scene) -> str:
    """Return what is hard about a scene."""
    plan = made.plan
    words = [
        f"{plan.photos} photos {plan.flying_height:.0f} m {plan.noise:.0f} um",
        "simultaneous" if plan.interval == 0.0 else "",
        "crest at random" if plan.crest == 0.5 else "",
        "nearly level guess" if plan.level_guess else "",
        f"{len(made.waves.values)} waves" if len(made.waves.values) > 1 else "",
        f"open {plan.openness:.2f}",
    ]
    return ", ".join(word for word in words if word)


def result(seed: int) -> Result:
    """Return how the scene of a seed ends."""
    made = scene(seed)
    start = time.process_time()
    try:
        found = musatpy.adjust(made.block)
    except AdjustmentError as error:
        return Result(
            seed=seed, kind=kind_of(made), converged=False, reason=str(error), sigma0=np.nan, conspicuous=False,
            worst=np.nan, metres=np.nan, truth=np.nan, open=False, determined=False,
            seconds=time.process_time() - start, iterations=0,
        )  # fmt: skip
    seconds = time.process_time() - start
    error = (found.points.position - made.points)[made.check]
    sigma = np.sqrt(np.einsum("pii->pi", found.points.covariance))[made.check]
    waves = found.water.waves
    off = (waves.value - made.waves.values) / waves.sigma
    off[:, 2] = np.angle(np.exp(1j * (waves.value - made.waves.values)[:, 2])) / waves.sigma[:, 2]
    return Result(
        seed=seed,
        kind=kind_of(made),
        converged=found.converged,
        reason=found.reason,
        sigma0=found.sigma0,
        conspicuous=bool(found.sum_of_squares > chi2.ppf(_LEVEL, found.degrees_of_freedom)),
        worst=float(np.abs(error / sigma).max()),
        metres=float(np.abs(error).max()),
        truth=float(np.abs(off).max()),
        open=any("crests" in one or "crest of wave" in one for one in found.warnings),
        determined=set(waves.verdicts.ravel()) == {"determined"},
        seconds=seconds,
        iterations=len(found.iterations),
    )


def results(first: int, count: int) -> list[Result]:
    """Return the results of scenes, in the order of their seeds."""
    with ProcessPoolExecutor(max_workers=2) as pool:
        return list(pool.map(result, range(first, first + count), chunksize=4))


def lines(every: list[Result]) -> list[str]:
    """Return how often what came out, the times, and a line of each scene that is not right."""
    counts = Counter(one.status for one in every)
    seconds = np.array([one.seconds for one in every])
    out = [f"{number:5d}  {status}" for status, number in sorted(counts.items())]
    out.append(f"seconds: median {np.median(seconds):.2f}, mean {seconds.mean():.2f}, most {seconds.max():.2f}")
    for one in every:
        if not one.status.startswith("right"):
            out.append(
                f"seed {one.seed} {one.status}: {one.kind}; sigma0 {one.sigma0:.2f}, worst point {one.worst:.1f} "
                f"sigmas, {one.metres:.2f} m, waves {one.truth:.1f} sigmas, "
                f"{'' if one.determined else 'not '}all determined{', ' if one.reason else ''}{one.reason}"
            )
    return out


if __name__ == "__main__":
    *start, number = (int(word) for word in sys.argv[1:])
    print("\n".join(lines(results(start[0] if start else 0, number))))
