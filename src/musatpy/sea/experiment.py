"""What a plane costs when the sea is wavy: the experiment of Okamoto (1982) for any stereo pair and any surface.

Points on the bottom are imaged through the wavy surface, as it is at each exposure, and intersected again from
their images as if the water were level. The attitudes of the photos do not matter: they turn an image ray into
plate coordinates and back. Model axes: x along the flight, y across it, z up, m. Its spec is what a TOML file can
say, with units, limits and meaning of every key.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import SpecError
from musatpy.model.water import index_fault
from musatpy.refraction import bending, fermat
from musatpy.refraction.surface import PlanarSurface, Surface
from musatpy.refraction.waves import superposed
from musatpy.sea.theory import GRAVITY, LinearWave, Shape, linear_wave, wave_surface
from musatpy.specs import Pair, Triple, key, require, spec_of, spec_table
from musatpy.units import DEGREE

_PART = 4096  # points at a time: what a pair of rays needs on the way would fill the memory for a million


@dataclass(frozen=True, kw_only=True, eq=False)
class Experiment:
    """A stereo pair over waves: cameras (2, 3) and points (m, 3) m, times (2,) s of the exposures, index of water.

    `level` (m) is that of the plane which mapping takes for the water.
    """

    cameras: FloatArray
    times: FloatArray
    points: FloatArray
    index: float
    surface: Surface
    level: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class MappingErrors:
    """Errors (m, 3) m of points (m, 3), mapped minus true; y-parallax (m,) m, right ray minus left.

    number (m, 2): refraction points of the ray to each photo, of which the principal one counts; complete (m, 2):
    whether these are all (see `refraction.search`).
    """

    points: FloatArray
    error: FloatArray
    parallax: FloatArray
    number: IntArray
    complete: BoolArray


def run(experiment: Experiment) -> MappingErrors:
    """Return the errors of mapping through waves as if the water were level.

    Raises `ValueError` where a point is not under water, a camera not above it, or the surface not known.
    """
    for time in experiment.times:
        dry = experiment.surface.relief(experiment.points[:, :2], time).height <= experiment.points[:, 2]
        if dry.any():
            raise ValueError(f"point {int(np.argmax(dry)) + 1} stands above the water in a trough")
    cameras, times = experiment.cameras[:, None, :], experiment.times[:, None]
    parts = []
    for start in range(0, len(experiment.points), _PART):
        points = experiment.points[start : start + _PART]
        rays = fermat.incidence(experiment.surface, cameras, points, experiment.index, times)
        air = rays.v / np.linalg.norm(rays.v, axis=-1, keepdims=True)
        bent = bending.refracted_ray(PlanarSurface(level=experiment.level), cameras, air, experiment.index)
        mapped, parallax = intersect(bent.origin, bent.direction)
        parts.append((points, mapped - points, parallax, rays.number.T, rays.complete.T))
    points, error, parallax, number, complete = (np.concatenate(part) for part in zip(*parts, strict=True))
    return MappingErrors(points=points, error=error, parallax=parallax, number=number, complete=complete)


def intersect(origin: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points (m, 3) where two rays (2, m, 3) have no x-parallax, and the y-parallax (m,) left there.

    Okamoto (1982), eq. 36; y is the mean of both rays. Raises `ValueError` where the rays never are so: a base
    across the flight.
    """
    slope = direction / direction[..., 2:]
    at_zero = origin - slope * origin[..., 2:]  # where the rays are at z = 0
    denominator = slope[0, :, 0] - slope[1, :, 0]
    if (np.abs(denominator) < 1e-9).any():
        raise ValueError("the base has no component along x, the flight: x-parallax gives no height")
    Z = (at_zero[1, :, 0] - at_zero[0, :, 0]) / denominator
    left, right = at_zero + slope * Z[:, None]
    return np.stack([left[:, 0], (left[:, 1] + right[:, 1]) / 2.0, Z], axis=1), right[:, 1] - left[:, 1]


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorSizes:
    """Of each coordinate (3,): the signed error that is largest, its point (row), mean, and standard error.

    The standard error is the root of the mean square, as in the paper, not about the mean. `allowed` (3,) m is the
    accuracy asked of a map.
    """

    largest: FloatArray
    point: IntArray
    mean: FloatArray
    sigma: FloatArray
    allowed: FloatArray

    @property
    def kept(self) -> BoolArray:
        """(3,) whether the standard errors due to waves keep within what is allowed."""
        return self.sigma < self.allowed


def spread(
    error: FloatArray, flying_height: float = np.nan, plan: float = 10000.0, height: float = 5000.0
) -> ErrorSizes:
    """Return how errors (m, 3) are spread, of a map from a flying height (m) above the bottom.

    Allowed are 1/`plan` of it in x and y, 1/`height` in z: Okamoto (1982), below Table 6.
    """
    row = np.argmax(np.abs(error), axis=0)
    return ErrorSizes(
        largest=error[row, np.arange(3)],
        point=row,
        mean=error.mean(axis=0),
        sigma=np.sqrt(np.mean(np.square(error), axis=0)),
        allowed=flying_height / np.array([plan, plan, height]),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Histogram:
    """How many errors (3, bins) of each coordinate lie between edges (3, bins + 1) m, symmetrical about zero."""

    edges: FloatArray
    count: IntArray


def histogram(error: FloatArray, bins: int = 21) -> Histogram:
    """Return the histograms of errors (m, 3), each up to its largest; an odd number of bins has one about zero."""
    reach = np.maximum(np.abs(error).max(axis=0), 1e-12)  # no errors at all still need a width
    edges = np.linspace(-reach, reach, bins + 1, axis=1)
    count = [np.histogram(error[:, axis], edges[axis])[0] for axis in range(3)]
    return Histogram(edges=edges, count=np.array(count))


@dataclass(frozen=True, kw_only=True)
class Stereo:
    """[stereo]: the two photos, in model axes: x along the flight, y across it, z up from the mean water level."""

    cameras: tuple[Triple, Triple] = key(doc="stations of the left and the right photo", unit="m")
    interval: float = key(0.0, "time from the left exposure to the right; 0 is simultaneous", unit="s", low=0.0)

    def __post_init__(self) -> None:
        left, right = self.cameras
        require(min(left[2], right[2]) > 0.0, "a camera is above the water: its third coordinate is positive")
        what = "the base has no component along x, the flight: x-parallax gives no height"
        require(abs(right[0] - left[0]) >= 1e-3, what)


@dataclass(frozen=True, kw_only=True)
class StillWater:
    """[water]: index and depth."""

    depth: float = key(doc="of a level bottom below the mean water level", unit="m", low=0.01)
    index: float = key(1.34, "refractive index of water relative to air", low=1.0, high=2.0)
    liquid: str = key("", "name of the liquid where it is not water")
    gravity: float = key(GRAVITY, "for the theory of waves", unit="m/s2", low=1.0, high=20.0)

    def __post_init__(self) -> None:
        if fault := index_fault(self.index, self.liquid):
            raise ValueError(fault)


@dataclass(frozen=True, kw_only=True)
class WaveKeys:
    """[[wave]]: one train of waves; any number of them are added up."""

    period: float = key(doc="of the wave", unit="s", low=0.01)
    deep_height: float | None = key(
        None, "height in deep water, from which theory finds that at depth", unit="m", low=0.0
    )
    height: float | None = key(None, "height at depth, in place of deep_height", unit="m", low=0.0)
    azimuth: float = key(0.0, "direction it runs to, from x towards y", unit="deg", low=-360.0, high=360.0)
    crest: float = key(
        0.0, "distance from the origin, in that direction, of a crest at the left exposure", unit="m"
    )
    shape: str = key(Shape.SINUSOIDAL, "of the wave", choices=tuple(Shape))
    length: float | None = key(None, "in place of what theory finds from period and depth", unit="m", low=0.01)
    speed: float | None = key(None, "of the crests, in place of length over period", unit="m/s")

    def __post_init__(self) -> None:
        require((self.deep_height is None) != (self.height is None), "a wave needs one of deep_height, height")

    @property
    def is_bound(self) -> bool:
        """Whether the wave stays as it is when depth or period change."""
        return self.deep_height is None or self.length is not None or self.speed is not None


@dataclass(frozen=True, kw_only=True)
class CheckArea:
    """[area]: check points on the bottom, numbered along y first."""

    first: Pair = key(doc="x and y of the first", unit="m")
    spacing: Pair = key(doc="along x and y", unit="m", low=0.001)
    numbers: tuple[int, int] = key(doc="along x and y", low=2, high=1000)


@dataclass(frozen=True, kw_only=True)
class Variations:
    """[study]: what else is tried, one thing at a time; cameras keep their heights above the water."""

    depths: tuple[float, ...] = key((), "other depths", unit="m", low=0.01)
    periods: tuple[float, ...] = key((), "other periods of the first wave", unit="s", low=0.01)
    phases: int = key(0, "so many exposures, evenly over the longest period", low=0, high=1000)
    intervals: tuple[float, ...] = key((), "other times between the exposures", unit="s", low=0.0)


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """[accuracy]: what is asked of the map, as parts of the flying height above the bottom."""

    plan: float = key(10000.0, "in x and y", low=1.0)
    height: float = key(5000.0, "in z", low=1.0)


@dataclass(frozen=True, kw_only=True)
class WaveSpec:
    """The whole file."""

    title: str = key("WAVES", "first line of the report", longest=120)
    stereo: Stereo = key()
    water: StillWater = key()
    wave: tuple[WaveKeys, ...] = key()
    area: CheckArea = key()
    study: Variations = key(Variations)
    accuracy: Accuracy = key(Accuracy)

    def __post_init__(self) -> None:
        require(bool(self.wave), "there is no [[wave]]")
        bound = [i for i, wave in enumerate(self.wave, start=1) if wave.is_bound]
        why = "having height, length or speed given"
        if self.study.depths and bound:
            raise ValueError(f"study.depths: wave {bound[0]} does not follow the depth, {why}")
        if self.study.periods and 1 in bound:
            raise ValueError(f"study.periods: wave 1 does not follow the period, {why}")


def load_spec(path: str | Path) -> WaveSpec:
    """Return the spec in a TOML file. Raises `SpecError` with every problem found."""
    return spec_of(WaveSpec, spec_table(Path(path)), str(path))


WIDE = 60.0 * DEGREE  # the corner of a super-wide-angle photograph


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """The experiment with one thing changed to `value`; where it could not be run, `reason` says why."""

    value: float
    spread: ErrorSizes | None = None
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
    errors: MappingErrors
    spread: ErrorSizes
    histogram: Histogram
    studies: tuple[Trials, ...]
    wide: int  # rays, of two per point, that no usual camera has: beyond `WIDE` of the vertical


def study(spec: WaveSpec, file: str | None = None) -> WaveStudy:
    """Return the results of a spec. Raises `SpecError` where the experiment itself cannot be run."""
    try:
        errors = run(experiment(spec))
    except ValueError as error:
        raise SpecError.of(error, file=file) from error
    theory = theory_of(spec)
    length, speed = lengths_and_speeds(spec)
    gap = errors.points - np.array(spec.stereo.cameras)[:, None, :]
    wide = np.hypot(gap[..., 0], gap[..., 1]) > -gap[..., 2] * np.tan(WIDE)
    return WaveStudy(
        spec=spec,
        theory=theory,
        length=length,
        speed=speed,
        errors=errors,
        spread=_spread(spec, errors),
        histogram=histogram(errors.error),
        studies=tuple(_studies(spec)),
        wide=int(np.count_nonzero(wide)),
    )


def theory_of(spec: WaveSpec) -> LinearWave:
    """Return the waves (k,) of a spec at its depth, by linear theory."""
    water = spec.water
    period, height = [wave.period for wave in spec.wave], [wave.deep_height or 0.0 for wave in spec.wave]
    theory = linear_wave(period, water.depth, deep_height=height, gravity=water.gravity)
    return replace(theory, height=_given_or([wave.height for wave in spec.wave], theory.height))


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
    waves = [
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
    ]
    return superposed(*waves)


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


def _spread(spec: WaveSpec, errors: MappingErrors) -> ErrorSizes:
    return spread(errors.error, flying_height(spec), spec.accuracy.plan, spec.accuracy.height)


def _studies(spec: WaveSpec) -> list[Trials]:
    wanted, (first, *others) = spec.study, spec.wave
    longest = max(wave.period for wave in spec.wave)
    starts = [longest * i / wanted.phases for i in range(wanted.phases)]
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
    return Trial(value=value, spread=_spread(spec, errors))
