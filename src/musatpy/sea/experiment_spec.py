"""The spec of a wave experiment: what a TOML file can say, with units, limits and meaning of every key."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from musatpy.model.water import index_fault
from musatpy.sea.theory import GRAVITY, Shape
from musatpy.specs import Pair, Triple, key, require, spec_of, spec_table


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
