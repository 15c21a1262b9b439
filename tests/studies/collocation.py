"""What interpolation takes out of the errors that waves make: simulated seas, known truth, control of any number.

The stereo pair is that of Okamoto (1982) from 500 m, over water 10 m deep, exposures 3 s apart; waves are 1 m high
in deep water. Control points are scattered at random over the model, their errors are those of mapping through the
waves (`sea.experiment`) with noise; check points stand between them.
"""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.refraction.waves import Harmonic, sinusoidal
from musatpy.sea.experiment import Experiment, run
from musatpy.sea.interpolation.correlation import Correlation, SignalKind
from musatpy.sea.interpolation.estimation import estimate
from musatpy.sea.interpolation.interpolate import Interpolation, InterpolationOptions, interpolate
from musatpy.sea.interpolation.prediction import Collocation, Covariance, Observed, Trend
from musatpy.sea.theory import linear_wave
from musatpy.units import DEGREE

DEPTH, INDEX, INTERVAL = 10.0, 1.34, 3.0  # m, of water, s between exposures
CAMERAS = np.array([[0.0, 0.0, 490.0], [264.0, 0.0, 490.0]])  # m
AREA = np.array([[0.0, -330.0], [330.0, 330.0]])  # m, of the model
DEEP_HEIGHT, AZIMUTH = 1.0, 30.0 * DEGREE  # m from trough to crest, of the swell
WAVES = 24  # of a confused or a wind sea
SPREAD, FAN = 0.3, 45.0 * DEGREE  # parts of the period, to either side of the azimuth, of a wind sea
CHECKS = (15, 30)  # check points along x and y
FAMILIES = (SignalKind.NONE, SignalKind.GAUSSIAN, SignalKind.BESSEL, SignalKind.SWELL)


class SeaState(StrEnum):
    """One wave; waves of one period from all directions; waves of many periods, in a fan about one direction.

    Together they have the mean square height of the one.
    """

    SWELL = "swell"
    CONFUSED = "confused"
    WIND = "wind"


@dataclass(frozen=True, kw_only=True)
class Case:
    """A sea, its period (s), the number of control points and their noise (m), and what chance starts from."""

    state: SeaState = SeaState.SWELL
    period: float = 10.0
    number: int = 100
    noise: float = 0.05
    seed: int = 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Simulated:
    """Control points, and check points: their mapped places (c, 2) m and errors in height (c,) m without noise."""

    control: Observed
    place: FloatArray
    error: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What came of a case, m RMS: errors of the check points before and after, sigmas told for them, and theory.

    `validated` is what the control points alone tell, with their noise; `gaussian` are the errors after, by a
    Gaussian function only. `theory` is the sigma where the covariance is known, that of a sea without a main
    direction: J0 of the wave length. It depends on the places and the noise alone.
    """

    case: Case
    wave_length: float
    spacing: float  # root of the area of a control point, m
    before: float
    after: float
    sigma: float
    validated: float
    gaussian: float
    theory: float
    found: Interpolation

    @property
    def removed(self) -> float:
        """Part of the RMS error that is removed at check points."""
        return 1.0 - self.after / self.before

    @property
    def removed_by_theory(self) -> float:
        """The same by theory."""
        return 1.0 - self.theory / self.before

    @property
    def removed_by_gaussian(self) -> float:
        """The same by a Gaussian function, without any of the others."""
        return 1.0 - self.gaussian / self.before


def sea(case: Case) -> Harmonic:
    """Return the waves of a case, by linear theory."""
    wave = linear_wave(case.period, DEPTH, deep_height=DEEP_HEIGHT)
    amplitude, length, speed = float(wave.height) / 2.0, float(wave.length), float(wave.length) / case.period
    if case.state == SeaState.SWELL:
        return sinusoidal(amplitude=amplitude, length=length, azimuth=AZIMUTH, speed=speed, crest=length / 3.0)
    # the sum has the mean square of the one wave; the case fixes phases and directions: its sea is always the same
    rng = np.random.default_rng([case.seed, WAVES])
    period = np.full(WAVES, case.period)
    azimuth = 2.0 * np.pi * (np.arange(WAVES) + rng.uniform(size=WAVES)) / WAVES
    if case.state == SeaState.WIND:
        period = case.period * rng.uniform(1.0 - SPREAD, 1.0 + SPREAD, WAVES)
        azimuth = AZIMUTH + rng.uniform(-FAN, FAN, WAVES)
    each = linear_wave(period, DEPTH)
    crest = rng.uniform(0.0, each.length)
    heights = np.full(WAVES, amplitude / np.sqrt(WAVES))
    return sinusoidal(amplitude=heights, length=each.length, azimuth=azimuth, speed=each.speed, crest=crest)


def simulated(case: Case) -> Simulated:
    """Return the control and check points of a case."""
    rng = np.random.default_rng(case.seed)
    places = rng.uniform(AREA[0], AREA[1], (case.number, 2))
    cells = (AREA[1] - AREA[0]) / CHECKS
    row, column = np.divmod(np.arange(CHECKS[0] * CHECKS[1]), CHECKS[1])
    checks = AREA[0] + cells * (np.stack([row, column], axis=1) + 0.5)
    place, error = _mapped(case, np.concatenate([places, checks]))
    noisy = error[: case.number] + rng.normal(0.0, case.noise, case.number)
    control = Observed(place=place[: case.number], value=noisy, sigma=np.zeros(case.number))
    return Simulated(control=control, place=place[case.number :], error=error[case.number :])


def _mapped(case: Case, place: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mapped places (m, 2) of points of the bottom at places (m, 2), and their errors in height (m,)."""
    points = np.column_stack([place, np.full(len(place), -DEPTH)])
    times = np.array([0.0, INTERVAL])
    found = run(Experiment(cameras=CAMERAS, times=times, points=points, index=INDEX, surface=sea(case)))
    return (points + found.error)[:, :2], found.error[:, 2]


def outcome(case: Case, families: tuple[SignalKind, ...] = FAMILIES) -> Outcome:
    """Return what comes of a case."""
    data = simulated(case)
    found = interpolate(data.control, InterpolationOptions(families=families))
    predicted = found.uncertain.predict(data.place)
    before = _rms(data.error)
    length = float(linear_wave(case.period, DEPTH).length)
    return Outcome(
        case=case,
        wave_length=length,
        spacing=float(np.sqrt(np.prod(AREA[1] - AREA[0]) / case.number)),
        before=before,
        after=_rms(data.error - predicted.value),
        sigma=_rms(predicted.sigma),
        validated=found.grouped.rms,
        gaussian=_rms(data.error - _gaussian(data).predict(data.place).value),
        theory=_rms(isotropic(data, length, before, case.noise).predict(data.place).sigma),
        found=found,
    )


def _gaussian(data: Simulated) -> Collocation:
    found = estimate(data.control, Trend.CONSTANT, SignalKind.GAUSSIAN, free_noise=True)
    return Collocation(data.control, found.covariance)


def isotropic(data: Simulated, length: float, size: float, noise: float) -> Collocation:
    """Return the collocation of a signal of RMS `size` (m) made of waves of one length (m) from all directions."""
    fade = float(np.log(10.0 * np.ptp(AREA)))  # none worth mentioning
    correlation = Correlation(family=SignalKind.BESSEL, parameters=(float(np.log(length)), fade))
    return Collocation(data.control, Covariance(signal=size**2, noise=noise**2, correlation=correlation))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


NUMBERS = (12, 25, 50, 100, 200, 400)
PERIODS = (4.0, 6.0, 8.0, 10.0, 15.0)
NOISES = (0.02, 0.05, 0.1, 0.2, 0.4)


def cases(state: SeaState) -> dict[str, tuple[Case, ...]]:
    """Return the cases of the study: one thing varied at a time."""
    base = Case(state=state)
    return {
        "number": tuple(replace(base, number=number) for number in NUMBERS),
        "period": tuple(replace(base, period=period) for period in PERIODS),
        "noise": tuple(replace(base, noise=noise) for noise in NOISES),
    }


def study() -> dict[tuple[SeaState, str], tuple[Outcome, ...]]:
    """Return the outcomes of all cases, by sea and what is varied; takes minutes."""
    done: dict[Case, Outcome] = {}
    for state in SeaState:
        for case in (one for varied in cases(state).values() for one in varied):
            if case not in done:
                done[case] = outcome(case)
    return {
        (state, name): tuple(done[case] for case in varied)
        for state in SeaState
        for name, varied in cases(state).items()
    }
