"""The keys of a spec that say what is compiled in the simulated block."""

from __future__ import annotations

from dataclasses import dataclass

from musatpy.specs import Pair, key


@dataclass(frozen=True, kw_only=True)
class CompilationKeys:
    """[compilation]: readings in the models of neighbours of a strip over a smooth bottom, and soundings of it."""

    points: int = key(100, "points on the bottom in each model, evenly spread", low=0)
    dry: int = key(10, "points on land in each model", low=0)
    profiles: int = key(1, "lines along the base in each model", low=0, high=9)
    readings: int = key(31, "of each profile", low=2)
    pace: float = key(0.0, "time between readings of a profile; 0: it is not known", unit="s", low=0.0, quiet=True)
    grid: float = key(0.0, "spacing of a grid of posts over the bottom; 0: none", unit="m", low=0.0, quiet=True)
    depth: Pair = key((2.0, 20.0), "least and greatest depth of the bottom below water.level", unit="m", low=0.01)
    wavelength: float = key(10000.0, "of the two waves that the bottom is made of", unit="m", low=1.0)
    pointing: float = key(5.0, "error of each stage coordinate, 1 sigma, and on the card", unit="um", low=0.0)
    bias: float = key(0.0, "x-parallax by which the operator sets the mark above the bottom", unit="um")
    contours: float = key(2.0, "interval of contours", unit="m", low=0.001)
    soundings: int = key(200, "of the bottom, evenly spread", low=0)
    sounding_error: float = key(0.1, "of a sounding, 1 sigma, and in the file", unit="m", low=0.0)
    place_error: float = key(0.0, "of its place, east and north, 1 sigma", unit="m", low=0.0)
    datum_offset: float = key(0.0, "how far the datum of the soundings is above water.level", unit="m")

    def __post_init__(self) -> None:
        if self.depth[1] < self.depth[0]:
            raise ValueError("depth is the least, then the greatest")
