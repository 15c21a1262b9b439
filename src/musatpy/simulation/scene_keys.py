"""The keys of a spec that say what is true: job, flight, land, water, waves, points, and what is compiled."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from musatpy.model import CoordinateSystem, ObservationKind, WaterConditions
from musatpy.model.correlations import LEAST_EIGENVALUE, smallest_eigenvalues
from musatpy.model.water import index_fault
from musatpy.specs import Area, Pair, Triple, key, require

if TYPE_CHECKING:
    from musatpy.simulation.terrain import Scene

AREA = "only inside this rectangle: east from, to, north from, to"
INDEX_DECIMALS = 12  # of an index that is computed: the truth is the same on every machine


@dataclass(frozen=True, kw_only=True)
class TrueParameter:
    """The truth of a parameter that a run may adjust, by the names of its record (`adjusted_parameters`)."""

    kind: ObservationKind
    owner: str
    name: str
    value: float

    @classmethod
    def of(
        cls, kind: ObservationKind, owner: str, names: Iterable[str], values: Iterable[float]
    ) -> tuple[Self, ...]:
        """Return the truth of the parameters of an owner."""
        pairs = zip(names, values, strict=True)
        return tuple(cls(kind=kind, owner=owner, name=name, value=value) for name, value in pairs)


class KindKeys:
    """Keys of one kind of observations or unknowns, which a spec may be without."""

    def stated(self, scene: Scene) -> tuple[dict[str, Any], tuple[TrueParameter, ...]]:
        """Return the parts of the block, by name, that the deck says, and the truth of what runs may adjust."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class JobKeys:
    """[job]: coordinate system and place of the block."""

    system: str = key("GEOG", "coordinate system of the deck", choices=tuple(CoordinateSystem))
    centre: Pair = key((0.0, 0.0), "centre of the block: latitude, longitude (degrees), or X, Y (m) in LOCL")
    ellipsoid: str = key("clrk66", "name of the ellipsoid in PROJ; not used in LOCL")

    def __post_init__(self) -> None:
        on_earth = abs(self.centre[0]) <= 89 and abs(self.centre[1]) <= 360
        what = "centre is a latitude within 89 and a longitude within 360 degrees"
        require(self.system == CoordinateSystem.LOCAL or on_earth, what)


@dataclass(frozen=True, kw_only=True)
class CameraKeys:
    """[camera]: the one camera of the block, plate millimetres."""

    id: str = key("CAM1", "camera id", longest=4)
    focal_length: float = key(152.0, "focal length", unit="mm", low=1.0)
    principal_point: Pair = key((0.0, 0.0), "principal point xp, yp", unit="mm")
    format: Pair = key((228.6, 228.6), "size of the plate, x and y", unit="mm", low=1.0)
    margin: float = key(5.0, "images closer to the edge of the plate are not measured", unit="mm", low=0.0)


@dataclass(frozen=True, kw_only=True)
class FlightKeys:
    """[flight]: strips of photos about the centre."""

    strips: int = key(1, "number of strips, the first at the left of the flight direction", low=1)
    photos: int = key(3, "photos per strip", low=1)
    first_photo: int = key(1, "number of the first photo, which is its id", low=0)
    strip_step: int = key(100, "from strip to strip the photo numbers grow by this", low=1)
    height: float = key(
        3000.0, "above the mean water level, or above terrain.level without water", unit="m", low=1.0
    )
    forward_overlap: float = key(0.6, "along the strip", low=0.05, high=0.95)
    side_overlap: float = key(0.3, "between strips", low=0.05, high=0.95)
    azimuth: float = key(90.0, "flight direction, clockwise from north", unit="deg", low=-360.0, high=360.0)
    reverse_alternate: bool = key(False, "every second strip is flown the other way")
    station_scatter: Triple = key((0.0, 0.0, 0.0), "true stations off the plan: east, north, up", unit="m", low=0.0)
    attitude_scatter: Triple = key(
        (0.0, 0.0, 0.0), "true X-tilt, Y-tilt, heading off the plan", unit="deg", low=0.0
    )
    interval: float = key(
        0.0, "from exposure to exposure, in the order of the photos; where there are waves", unit="s", low=0.0,
        quiet=True,
    )  # fmt: skip

    def __post_init__(self) -> None:
        what = "strip_step is smaller than the number of photos in a strip: ids would repeat"
        require(self.strips == 1 or self.strip_step >= self.photos, what)


def require_positive(correlation: Triple) -> None:
    """Raise `ValueError` for correlations that no three errors have."""
    smallest = float(smallest_eigenvalues(np.array([correlation]))[0])
    what = f"correlation: no positive definite matrix, smallest eigenvalue {smallest:.3g}"
    require(smallest > LEAST_EIGENVALUE, what)


@dataclass(frozen=True, kw_only=True)
class TerrainKeys:
    """[terrain]: land, a smooth surface of two waves with random phases."""

    level: float = key(50.0, "mean height", unit="m")
    relief: float = key(0.0, "amplitude: heights lie within level -+ relief", unit="m", low=0.0)
    wavelength: float = key(2000.0, "of the waves, east and north", unit="m", low=1.0)


@dataclass(frozen=True, kw_only=True)
class ConditionKeys:
    """[water.conditions]: what the true index comes from, on a WTC card in its place."""

    temperature: float = key(doc="of the water", unit="degC")
    salinity: float = key(doc="of the water, 0 for fresh water", unit="ppt", low=0.0)

    def __post_init__(self) -> None:
        index_of(self.on_card)

    @property
    def on_card(self) -> WaterConditions:
        """What the card says."""
        return WaterConditions(
            temperature=round(self.temperature, 2),
            salinity=round(self.salinity, 2),
            wavelength=550.0,
            formula="QUANFRY",
        )


def index_of(conditions: WaterConditions) -> float:
    """Return the index that a deck with these conditions has; raises `ValueError` beyond the range of a formula."""
    from musatpy.formats import refractive_index as formulas  # few specs need it

    return formulas.index_of(conditions)


@dataclass(frozen=True, kw_only=True)
class SurfaceKeys:
    """[water]: the water surface; without this table there is none."""

    index: float = key(1.34, "true refractive index", low=1.0, high=2.0)
    index_error: float = key(0.0, "actual error of the index on the water card", low=-1.0, high=1.0, quiet=True)
    index_sigma: float | None = key(None, "its sigma on the water card", low=0.0)
    liquid: str = key("", "name of the liquid where it is not water: at most 12 characters", quiet=True)
    level: float = key(0.0, "mean height of the surface", unit="m")
    tides: tuple[float, ...] = key((), "height of the surface at each photo, in place of the next two", unit="m")
    tide_trend: float = key(0.0, "growth of the tide from photo to photo, about level in the middle", unit="m")
    tide_scatter: float = key(0.0, "random part of the tide of each photo", unit="m", low=0.0)
    tide_sigma: float | None = key(None, "sigma on the tide cards", unit="m", low=0.0)
    level_error: float = key(0.0, "actual error that all tide cards have in common", unit="m", quiet=True)
    group_size: int = key(
        0, "so many photos, one after the other, are a group on the tide cards; 0: no groups", low=0, quiet=True
    )
    day_size: int = key(0, "so many photos are a day on the tide cards; 0: no days", low=0, quiet=True)
    photo_level_error: float = key(
        0.0, "actual error of the tide of each photo, 1 sigma", unit="m", low=0.0, quiet=True
    )
    tilt: Pair = key(
        (0.0, 0.0), "true slopes of the surface towards east and north, about the middle of the stations",
        unit="arcsec", low=-3600.0, high=3600.0, quiet=True,
    )  # fmt: skip
    tilt_on_card: Pair | None = key(
        None, "the slopes on the water card; absent: none, level", unit="arcsec", low=-3600.0, high=3600.0
    )
    tilt_sigma: float | None = key(None, "their sigma on the water card", unit="arcsec", low=0.0)
    conditions: ConditionKeys | None = key(None, quiet=True)
    wave_origin: Pair = key(
        (0.0, 0.0), "from which the crests of waves count: east and north of the centre", unit="m", quiet=True
    )

    def __post_init__(self) -> None:
        for index, where in ((self.index, ""), (self.index + self.index_error, "on the card: ")):
            if fault := index_fault(index, self.liquid):
                raise ValueError(f"{where}{fault}" + ("" if self.liquid else " by the key liquid"))
        if self.conditions is not None:
            index = round(index_of(self.conditions.on_card), INDEX_DECIMALS)
            alone = self.index in (type(self).index, index) and not self.index_error
            require(alone, "the index is given by its conditions: index and index_error do not go with them")
            object.__setattr__(self, "index", index)


@dataclass(frozen=True, kw_only=True)
class WaveTrain:
    """[[wave]]: a wave on the water, two at most of period, length and speed; errors and sigmas of its card."""

    id: str = key(doc="wave id", longest=4)
    shape: str = key("SINU", "of the wave", choices=("SINU", "STOK"))
    period: float | None = key(None, "of the wave", unit="s", low=0.01)
    length: float | None = key(None, "of the wave; absent: that of linear theory", unit="m", low=0.01)
    speed: float | None = key(None, "of the crests; absent: length over period", unit="m/s", low=0.001)
    depth: float | None = key(None, "of the water, for theory; absent: deep", unit="m", low=0.01)
    height: float = key(doc="from trough to crest", unit="m", low=0.0)
    azimuth: float = key(0.0, "direction it runs to, clockwise from north", unit="deg", low=-360.0, high=360.0)
    crest: float = key(
        0.0, "distance of a crest from the origin, in that direction, at the first exposure", unit="m"
    )
    height_error: float = key(0.0, "actual error of the height on the card", unit="m", quiet=True)
    length_error: float = key(
        0.0, "actual error of the length on the card, which then stands there", unit="m", quiet=True
    )
    azimuth_error: float = key(0.0, "actual error of the direction on the card", unit="deg", quiet=True)
    crest_error: float = key(0.0, "actual error of the crest on the card", unit="m", quiet=True)
    height_sigma: float | None = key(None, "sigma on a WVS card: the height is unknown", unit="m", low=0.0)
    length_sigma: float | None = key(None, "sigma on a WVS card: the length is unknown", unit="m", low=0.0)
    azimuth_sigma: float | None = key(None, "sigma on a WVS card: the direction is unknown", unit="deg", low=0.0)
    crest_sigma: float | None = key(None, "sigma on a WVS card: the crest is unknown", unit="m", low=0.0)

    def __post_init__(self) -> None:
        has_length = self.length is not None or self.speed is None
        require(has_length or not self.length_error, "length_error needs a length, or a period alone")


@dataclass(frozen=True, kw_only=True)
class ShoalKeys:
    """[[shoal]]: generated points that lie on the bottom of the sea."""

    share: float = key(1.0, "of the points inside the area that are submerged", low=0.0, high=1.0)
    depth: Pair = key((0.5, 10.0), "least and greatest depth below water.level, evenly spread", unit="m")
    area: Area | None = key(None, AREA, unit="m")

    def __post_init__(self) -> None:
        require(self.depth[0] <= self.depth[1], "depth is the least, then the greatest")


@dataclass(frozen=True, kw_only=True)
class ExtraKeys:
    """[[points.extra]]: more points, evenly spread at random."""

    number: int = key(doc="number of points", low=1)
    area: Area | None = key(None, AREA + "; default the stereo coverage", unit="m")


@dataclass(frozen=True, kw_only=True)
class PointKeys:
    """[points]: generated points."""

    per_site: int = key(1, "points at each von Gruber site (below every photo, and left and right of it)", low=0)
    scatter: float = key(0.05, "of the points about their sites, in photo bases", low=0.0, high=0.5)
    extra: tuple[ExtraKeys, ...] = key((), "more points")
    first_id: int = key(1, "ids are numbers from here on", low=0)


@dataclass(frozen=True, kw_only=True)
class GivenPoint:
    """[[point]]: one point at a given place (exactly one of geographic, geocentric, local)."""

    id: str = key(doc="point id", longest=8)
    geographic: Triple | None = key(None, "latitude, longitude (degrees), height (m)")
    geocentric: Triple | None = key(None, "X, Y, Z", unit="m")
    local: Triple | None = key(None, "X, Y, Z of a LOCL job", unit="m")
    bathymetric: bool = key(False, "submerged, wherever a tide stands above it")
    photos: tuple[str, ...] = key((), "measured on these only; default: wherever it is seen")
    triangulated: bool = key(True, "false: kept out of the solution by a flag on its plate cards")

    def __post_init__(self) -> None:
        places = sum(place is not None for place in (self.geographic, self.geocentric, self.local))
        require(places == 1, f"point {self.id} needs one of geographic, geocentric, local")


@dataclass(frozen=True, kw_only=True)
class CompilationKeys:
    """[compilation]: readings in the models of neighbours of a strip over a smooth bottom, and soundings of it."""

    points: int = key(100, "points on the bottom in each model, evenly spread", low=0)
    dry: int = key(10, "points on land in each model", low=0)
    profiles: int = key(1, "lines along the base in each model", low=0, high=9)
    readings: int = key(31, "of each profile", low=2)
    depth: Pair = key((2.0, 20.0), "least and greatest depth of the bottom below water.level", unit="m", low=0.01)
    wavelength: float = key(10000.0, "of the two waves that the bottom is made of", unit="m", low=1.0)
    pointing: float = key(5.0, "error of each stage coordinate, 1 sigma, and on the card", unit="um", low=0.0)
    soundings: int = key(200, "of the bottom, evenly spread", low=0)
    sounding_error: float = key(0.1, "of a sounding, 1 sigma, and in the file", unit="m", low=0.0)

    def __post_init__(self) -> None:
        require(self.depth[0] <= self.depth[1], "depth is the least, then the greatest")
