"""The keys of a spec that make gross errors."""

from __future__ import annotations

from dataclasses import dataclass

from musatpy.specs import Pair, Triple, key


def _check_sizes(size: Pair, log: bool) -> None:
    """Raise `ValueError` where sizes cannot be drawn."""
    if size[1] < size[0]:
        raise ValueError("size is the least, then the greatest")
    if log and size[0] <= 0.0:
        raise ValueError("log needs a least size above zero")


@dataclass(frozen=True, kw_only=True)
class ControlBlunders:
    """[[blunders.control]]: gross errors of random control points, each hit once at most."""

    number: int = key(doc="number of control points hit", low=1)
    component: str = key(doc="in a random direction, or up or down", choices=("horizontal", "vertical"))
    size: Pair = key((1.0, 1000.0), "least and greatest size", unit="m", low=0.0)
    log: bool = key(False, "sizes are spread evenly in their logarithm")

    def __post_init__(self) -> None:
        _check_sizes(self.size, self.log)


@dataclass(frozen=True, kw_only=True)
class Blunders:
    """[blunders]: gross errors at random; of plate measurements each in x or y."""

    number: int = key(0, "number of measurements hit", low=0)
    share: float = key(0.0, "or the share of all measurements", low=0.0, high=1.0)
    size: Pair = key((100.0, 1000.0), "least and greatest size, sign at random", unit="um", low=0.0)
    log: bool = key(False, "sizes are spread evenly in their logarithm", quiet=True)
    swapped: int = key(0, "pairs of images on one photo whose names are exchanged", low=0, quiet=True)
    misnamed: int = key(
        0, "images that bear the name of a point which is not measured on their photo", low=0, quiet=True
    )
    flagged_dry: int = key(0, "submerged points that the deck does not flag so", low=0, quiet=True)
    flagged_submerged: int = key(0, "points on land that the deck flags as submerged", low=0, quiet=True)
    control: tuple[ControlBlunders, ...] = key((), quiet=True)

    def __post_init__(self) -> None:
        if self.number and self.share:
            raise ValueError("blunders have a number or a share, not both")
        _check_sizes(self.size, self.log)


@dataclass(frozen=True, kw_only=True)
class GivenBlunder:
    """[[blunder]]: a gross error of one plate measurement."""

    photo: str = key(doc="photo id")
    point: str = key(doc="point id")
    x: float = key(0.0, "added to x", unit="um")
    y: float = key(0.0, "added to y", unit="um")


@dataclass(frozen=True, kw_only=True)
class WrongControl:
    """[[wrong_control]]: a gross error of one control point, in components that its card gives."""

    point: str = key(doc="point id")
    east: float = key(0.0, "added", unit="m")
    north: float = key(0.0, "added", unit="m")
    up: float = key(0.0, "added", unit="m")


@dataclass(frozen=True, kw_only=True)
class WrongStation:
    """[[wrong_station]]: gross errors of the station and attitude cards of one photo."""

    photo: str = key(doc="photo id")
    east: float = key(0.0, "added", unit="m")
    north: float = key(0.0, "added", unit="m")
    up: float = key(0.0, "added", unit="m")
    x_tilt: float = key(0.0, "added", unit="deg", low=-180.0, high=180.0)
    y_tilt: float = key(0.0, "added", unit="deg", low=-180.0, high=180.0)
    heading: float = key(0.0, "added", unit="deg", low=-360.0, high=360.0)

    @property
    def shift(self) -> Triple:
        """East, north, up, m."""
        return self.east, self.north, self.up

    @property
    def turn(self) -> Triple:
        """X-tilt, Y-tilt, heading, degrees."""
        return self.x_tilt, self.y_tilt, self.heading


@dataclass(frozen=True, kw_only=True)
class WrongTide:
    """[[wrong_tide]]: a gross error of tide cards."""

    photos: tuple[str, ...] = key((), "photo ids; absent: all")
    error: float = key(doc="added to their tides", unit="m")
