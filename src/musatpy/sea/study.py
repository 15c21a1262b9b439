"""From the spec of a wave experiment to its results: the experiment itself, and what changes it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import Problem, SpecError
from musatpy.refraction.surface import Surface
from musatpy.refraction.waves import superposed
from musatpy.sea.experiment import Errors, Experiment, Histogram, Spread, Verdict, histogram, run, spread, verdict
from musatpy.sea.experiment_spec import WaveSpec
from musatpy.sea.surfaces import Shape, wave_surface
from musatpy.sea.theory import LinearWave, linear_wave
from musatpy.units import DEGREE

WIDE = 60.0 * DEGREE  # the corner of a super-wide-angle photograph


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """The experiment with one thing changed to `value`; where it could not be run, `reason` says why."""

    value: float
    spread: Spread | None = None
    verdict: Verdict | None = None
    reason: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trials:
    """All values tried of one thing, such as depth."""

    name: str
    unit: str
    trials: tuple[Trial, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class WaveStudy:
    """A wave experiment with its results; lengths and speeds of the waves (k,) are those that were used."""

    spec: WaveSpec
    theory: LinearWave
    length: FloatArray
    speed: FloatArray
    errors: Errors
    spread: Spread
    histogram: Histogram
    verdict: Verdict
    studies: tuple[Trials, ...]
    wide: int  # rays, of two per point, that no usual camera has: beyond `WIDE` of the vertical


def study(spec: WaveSpec, file: str | None = None) -> WaveStudy:
    """Return the results of a spec. Raises `SpecError` where the experiment itself cannot be run."""
    try:
        errors = run(experiment(spec))
    except ValueError as error:
        raise SpecError([Problem(file=file, message=str(error))]) from error
    theory = theory_of(spec)
    length, speed = lengths_and_speeds(spec)
    sizes = spread(errors.error)
    gap = errors.points - np.array(spec.stereo.cameras)[:, None, :]
    wide = np.hypot(gap[..., 0], gap[..., 1]) > -gap[..., 2] * np.tan(WIDE)
    return WaveStudy(
        spec=spec,
        theory=theory,
        length=length,
        speed=speed,
        errors=errors,
        spread=sizes,
        histogram=histogram(errors.error),
        verdict=_verdict(spec, sizes),
        studies=tuple(_studies(spec)),
        wide=int(np.count_nonzero(wide)),
    )


def theory_of(spec: WaveSpec) -> LinearWave:
    """Return the waves (k,) of a spec at its depth, by linear theory."""
    water = spec.water
    period = [wave.period for wave in spec.wave]
    plain = linear_wave(period, water.depth, gravity=water.gravity)
    deep = linear_wave(
        period, water.depth, deep_height=[wave.deep_height or 0.0 for wave in spec.wave], gravity=water.gravity
    )
    return replace(plain, height=_given_or([wave.height for wave in spec.wave], deep.height))


def lengths_and_speeds(spec: WaveSpec) -> tuple[FloatArray, FloatArray]:
    """Return the lengths (k,) m and speeds (k,) m/s of the waves: of theory, or as given in their place."""
    theory = theory_of(spec)
    length = _given_or([wave.length for wave in spec.wave], theory.length)
    return length, _given_or([wave.speed for wave in spec.wave], length / theory.period)


def _given_or(given: list[float | None], theory: FloatArray) -> FloatArray:
    return np.array([known if value is None else value for value, known in zip(given, theory, strict=True)])


def surface_of(spec: WaveSpec) -> Surface:
    """Return the waves of a spec, about the mean level 0; time 0 is the left exposure. Raises `ValueError`."""
    length, speed = lengths_and_speeds(spec)
    amplitude = theory_of(spec).height / 2.0
    return superposed(
        *(
            wave_surface(
                Shape(wave.shape),
                amplitude=float(A),
                length=float(L),
                azimuth=wave.azimuth * DEGREE,
                speed=float(v),
                crest=wave.crest,
                depth=spec.water.depth,
            )
            for wave, A, L, v in zip(spec.wave, amplitude, length, speed, strict=True)
        )
    )


def experiment(spec: WaveSpec, start: float = 0.0) -> Experiment:
    """Return the experiment of a spec, the left exposure at `start` s. Raises `ValueError`."""
    stereo, area = spec.stereo, spec.area
    row, column = np.divmod(np.arange(area.numbers[0] * area.numbers[1]), area.numbers[1])
    x, y = area.first[0] + row * area.spacing[0], area.first[1] + column * area.spacing[1]
    return Experiment(
        cameras=np.array(stereo.cameras),
        times=start + np.array([0.0, stereo.interval]),
        points=np.stack([x, y, np.full(row.shape, -spec.water.depth)], axis=1),
        index=spec.water.index,
        surface=surface_of(spec),
    )


def flying_height(spec: WaveSpec) -> float:
    """Return the mean height (m) of the cameras above the bottom: the H + h that accuracies are parts of."""
    return (spec.stereo.cameras[0][2] + spec.stereo.cameras[1][2]) / 2.0 + spec.water.depth


def _verdict(spec: WaveSpec, sizes: Spread) -> Verdict:
    return verdict(sizes.sigma, flying_height(spec), spec.accuracy.plan, spec.accuracy.height)


def _studies(spec: WaveSpec) -> list[Trials]:
    wanted = spec.study
    first, *others = spec.wave
    longest = max(wave.period for wave in spec.wave)
    starts = tuple(longest * i / wanted.phases for i in range(wanted.phases))
    kinds: list[tuple[str, str, tuple[float, ...], Callable[[float], WaveSpec]]] = [
        ("Depth", "m", wanted.depths, lambda depth: replace(spec, water=replace(spec.water, depth=depth))),
        ("Period", "s", wanted.periods, lambda T: replace(spec, wave=(replace(first, period=T), *others))),
        ("Interval", "s", wanted.intervals, lambda t: replace(spec, stereo=replace(spec.stereo, interval=t))),
    ]
    studies = [
        Trials(name=name, unit=unit, trials=tuple(_trial(change(value), value) for value in values))
        for name, unit, values, change in kinds
        if values
    ]
    if starts:
        studies.append(Trials(name="Exposure", unit="s", trials=tuple(_trial(spec, at, start=at) for at in starts)))
    return studies


def _trial(spec: WaveSpec, value: float, start: float = 0.0) -> Trial:
    try:
        errors = run(experiment(spec, start))
    except ValueError as error:
        return Trial(value=value, reason=str(error))
    sizes = spread(errors.error)
    return Trial(value=value, spread=sizes, verdict=_verdict(spec, sizes))
