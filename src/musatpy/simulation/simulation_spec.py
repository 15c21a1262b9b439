"""The spec of a simulation: what a TOML file can say, with units, limits and meaning of every key."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from musatpy.errors import Problem, SpecError
from musatpy.files import real_path
from musatpy.model import (
    CoordinateSystem,
    Datum,
    Editing,
    Initial,
    Program,
    Refraction,
    Treatment,
    WaterLevel,
    Weights,
)
from musatpy.simulation.blunder_keys import Blunders, GivenBlunder, WrongControl, WrongStation, WrongTide
from musatpy.simulation.compilation_keys import CompilationKeys
from musatpy.simulation.water_keys import WaterKeys
from musatpy.specs import Area, Pair, Triple, key, spec_of, spec_table

_AREA = "only inside this rectangle: east from, to, north from, to"


@dataclass(frozen=True, kw_only=True)
class Job:
    """[job]: coordinate system and place of the block."""

    system: str = key("GEOG", "coordinate system of the deck", choices=tuple(CoordinateSystem))
    centre: Pair = key((0.0, 0.0), "centre of the block: latitude, longitude (degrees), or X, Y (m) in LOCL")
    ellipsoid: str = key("clrk66", "name of the ellipsoid in PROJ; not used in LOCL")
    semi_major_axis: float | None = key(None, "with inverse_flattening, in place of a name", unit="m", low=1.0)
    inverse_flattening: float | None = key(None, "0 is a sphere", low=0.0)

    def __post_init__(self) -> None:
        if (self.semi_major_axis is None) != (self.inverse_flattening is None):
            raise ValueError("semi_major_axis and inverse_flattening go together")
        if self.inverse_flattening and self.inverse_flattening <= 1.0:
            raise ValueError("inverse_flattening is 0, or greater than 1")
        if self.system != CoordinateSystem.LOCAL and not (abs(self.centre[0]) <= 89 and abs(self.centre[1]) <= 360):
            raise ValueError("centre is a latitude within 89 and a longitude within 360 degrees")


@dataclass(frozen=True, kw_only=True)
class CameraKeys:
    """[camera]: the one camera of the block, plate millimetres."""

    id: str = key("CAM1", "camera id", longest=4)
    focal_length: float = key(152.0, "focal length", unit="mm", low=1.0)
    principal_point: Pair = key((0.0, 0.0), "principal point xp, yp", unit="mm")
    format: Pair = key((228.6, 228.6), "size of the plate, x and y", unit="mm", low=1.0)
    margin: float = key(5.0, "images closer to the edge of the plate are not measured", unit="mm", low=0.0)


@dataclass(frozen=True, kw_only=True)
class Flight:
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
        if self.strips > 1 and self.strip_step < self.photos:
            raise ValueError("strip_step is smaller than the number of photos in a strip: ids would repeat")


@dataclass(frozen=True, kw_only=True)
class Terrain:
    """[terrain]: land, a smooth surface of two waves with random phases."""

    level: float = key(50.0, "mean height", unit="m")
    relief: float = key(0.0, "amplitude: heights lie within level -+ relief", unit="m", low=0.0)
    wavelength: float = key(2000.0, "of the waves, east and north", unit="m", low=1.0)


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
        if self.length_error and self.length is None and self.speed is not None:
            raise ValueError("length_error needs a length, or a period alone")


@dataclass(frozen=True, kw_only=True)
class Shoal:
    """[[shoal]]: generated points that lie on the bottom of the sea."""

    share: float = key(1.0, "of the points inside the area that are submerged", low=0.0, high=1.0)
    depth: Pair = key((0.5, 10.0), "least and greatest depth below water.level, evenly spread", unit="m")
    area: Area | None = key(None, _AREA, unit="m")

    def __post_init__(self) -> None:
        if self.depth[1] < self.depth[0]:
            raise ValueError("depth is the least, then the greatest")


@dataclass(frozen=True, kw_only=True)
class Extra:
    """[[points.extra]]: more points, evenly spread at random."""

    number: int = key(doc="number of points", low=1)
    area: Area | None = key(None, _AREA + "; default the stereo coverage", unit="m")


@dataclass(frozen=True, kw_only=True)
class PointKeys:
    """[points]: generated points."""

    per_site: int = key(1, "points at each von Gruber site (below every photo, and left and right of it)", low=0)
    scatter: float = key(0.05, "of the points about their sites, in photo bases", low=0.0, high=0.5)
    extra: tuple[Extra, ...] = key((), "more points")
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
        if sum(place is not None for place in (self.geographic, self.geocentric, self.local)) != 1:
            raise ValueError(f"point {self.id} needs one of geographic, geocentric, local")


@dataclass(frozen=True, kw_only=True)
class ControlKeys:
    """[[control]]: control of one kind (exactly one of number, ids, points)."""

    kind: str = key(doc="what is known", choices=("full", "horizontal", "vertical", "check"))
    number: int | None = key(None, "this many points, spread over the block, keep their ids", low=0)
    ids: tuple[str, ...] = key((), "points spread over the block get these ids", longest=8)
    points: tuple[str, ...] = key((), "these points")
    sigma: Triple | None = key(None, "on the cards, of the known components: east, north, up", unit="m", low=0.0)
    error: Triple = key((0.0, 0.0, 0.0), "actual error of the given coordinates, 1 sigma", unit="m", low=0.0)
    fixed: bool = key(False, "held without error")
    bathymetric: bool = key(False, "number and ids take submerged points, else points on land")
    area: Area | None = key(None, _AREA, unit="m")

    def __post_init__(self) -> None:
        if (self.number is not None) + bool(self.ids) + bool(self.points) != 1:
            raise ValueError("control needs one of number, ids, points")
        known = {"full": (0, 1, 2), "horizontal": (0, 1), "vertical": (2,)}.get(self.kind, ())
        if not self.fixed and not all(self.sigma and self.sigma[component] > 0.0 for component in known):
            raise ValueError("control that is neither fixed nor a check point needs a sigma above zero")


@dataclass(frozen=True, kw_only=True)
class Stations:
    """[stations]: what the deck says of stations and attitudes."""

    position_error: Triple = key((0.0, 0.0, 0.0), "actual error east, north, up", unit="m", low=0.0)
    attitude_error: Triple = key((0.0, 0.0, 0.0), "actual error of X-tilt, Y-tilt, heading", unit="deg", low=0.0)
    error_kind: str = key("normal", "sizes are sigmas, or every error has that size", choices=("normal", "size"))
    position_sigma: Triple | None = key(None, "on the cards; absent: not observed", unit="m", low=0.0)
    attitude_sigma: Triple | None = key(None, "on the cards; absent: not observed", unit="arcsec", low=0.0)
    given: bool = key(True, "false: no station and attitude cards, for options.initial COMPUTE", quiet=True)

    def __post_init__(self) -> None:
        if not self.given and (self.position_sigma or self.attitude_sigma):
            raise ValueError("stations that are not given have no position_sigma and attitude_sigma")


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """[measurement]: errors of the plate coordinates."""

    noise: float = key(10.0, "actual error of x and y, 1 sigma", unit="um", low=0.0)
    sigma: float = key(10.0, "plate sigma on the option card", unit="um", low=0.001)
    submerged_factor: float = key(
        1.0, "noise of submerged points is larger by this, and stands on their cards", low=1.0
    )
    factor_on_cards: bool = key(
        True, "false: their cards have no sigma; options.submerged_factor can stand for it", quiet=True
    )
    least_count: float = key(0.001, "plate coordinates are rounded to this", unit="um", low=0.001)


@dataclass(frozen=True, kw_only=True)
class KeptOut:
    """[kept_out]: plate measurements with the flag N, besides those of [[point]]."""

    number: int = key(0, "random pass points, on all their photos", low=0)
    measurements: tuple[tuple[str, str], ...] = key((), "photo and point of single measurements")


@dataclass(frozen=True, kw_only=True)
class EqualElevation:
    """[[equal_elevation]]: shore points (tie points on land) brought to one level."""

    id: str = key(doc="id of the group", longest=8)
    number: int = key(doc="number of points, spread over the block", low=2)
    level: float | None = key(None, "height; default the highest tide, else terrain.level", unit="m")
    sigma: float = key(0.1, "on the card", unit="m", low=0.0001)
    error: float = key(0.0, "actual scatter about the level, 1 sigma", unit="m", low=0.0)
    wrong: int = key(
        0, "so many of the points, at random, are off the level by `blunder`, besides", low=0, quiet=True
    )
    blunder: float = key(0.0, "how far these points lie above the level", unit="m", low=0.0, quiet=True)
    area: Area | None = key(None, _AREA, unit="m")

    def __post_init__(self) -> None:
        if self.wrong > self.number:
            raise ValueError(f"wrong is more than the {self.number} points")


@dataclass(frozen=True, kw_only=True)
class AirBaseKeys:
    """[[air_base]]: a known distance between two stations."""

    photos: tuple[str, str] = key(doc="the two photo ids")
    sigma: float = key(0.1, "on the card", unit="m", low=0.0001)
    error: float = key(0.0, "actual error, 1 sigma", unit="m", low=0.0)
    blunder: float = key(0.0, "gross error, besides", unit="m", quiet=True)


@dataclass(frozen=True, kw_only=True)
class DistanceKeys:
    """[[distance]]: measured distances between ground points, along the straight line (one of points, number)."""

    points: tuple[str, str] | None = key(None, "the two point ids")
    number: int | None = key(None, "this many pairs of points, at random", low=1)
    sigma: float = key(0.02, "on the card", unit="m", low=0.0001)
    error: float = key(0.0, "actual error, 1 sigma", unit="m", low=0.0)
    blunder: float = key(0.0, "gross error, besides", unit="m")

    def __post_init__(self) -> None:
        if (self.points is None) == (self.number is None):
            raise ValueError("one of points, number is needed")
        if self.points and self.points[0] == self.points[1]:
            raise ValueError("points are two different ones")


@dataclass(frozen=True, kw_only=True)
class HeightDifferenceKeys(DistanceKeys):
    """[[height_difference]]: measured height differences, second point minus first (one of points, number)."""


@dataclass(frozen=True, kw_only=True)
class OptionKeys:
    """[options]: the option card; what is absent takes the program's default."""

    refraction: str | None = key(
        None, "refraction mode; WATPT, or RIGOROUS for IIIA, where not given", choices=tuple(Refraction)
    )
    weights: str = key("FULL", "weights of the conditions", choices=tuple(Weights))
    max_iterations: int | None = key(None, "of one triangulation", low=1, high=999)
    max_passes: int | None = key(None, "of WATPT", low=1, high=999)
    rotation_limit: float | None = key(None, "convergence", unit="arcsec", low=0.001)
    translation_limit: float | None = key(None, "convergence", unit="m", low=0.00001)
    water_limit: float | None = key(None, "convergence of WATPT", unit="m", low=0.00001)
    program: str | None = key(None, "program to run", choices=tuple(Program))
    initial: str | None = key(None, "initial values of the stations", choices=tuple(Initial))
    submerged_factor: float | None = key(None, "on the plate sigmas of submerged points", low=1.0, high=99.0)
    water_level: str | None = key(None, "whose tides share an unknown", choices=tuple(WaterLevel))
    water_tilt: str | None = key(None, "tilt of the water", choices=tuple(Treatment))
    water_index: str | None = key(None, "refractive index", choices=tuple(Treatment))
    datum: str | None = key(None, "what holds the block", choices=tuple(Datum))
    editing: str | None = key(None, "what is done about blunders", choices=tuple(Editing))


@dataclass(frozen=True, kw_only=True)
class SimulationSpec:
    """The whole file; units are those of each key."""

    title: tuple[str, ...] = key(("SIMULATED BLOCK",), "title cards", longest=68)
    seed: int = key(1, "of every random number", low=0)
    job: Job = key(Job)
    camera: CameraKeys = key(CameraKeys)
    flight: Flight = key(Flight)
    terrain: Terrain = key(Terrain)
    water: WaterKeys | None = key(None)
    wave: tuple[WaveTrain, ...] = key((), quiet=True)
    shoal: tuple[Shoal, ...] = key(())
    points: PointKeys = key(PointKeys)
    point: tuple[GivenPoint, ...] = key(())
    control: tuple[ControlKeys, ...] = key(())
    stations: Stations = key(Stations)
    measurement: Measurement = key(Measurement)
    blunders: Blunders = key(Blunders)
    blunder: tuple[GivenBlunder, ...] = key(())
    kept_out: KeptOut = key(KeptOut)
    equal_elevation: tuple[EqualElevation, ...] = key(())
    air_base: tuple[AirBaseKeys, ...] = key(())
    distance: tuple[DistanceKeys, ...] = key((), quiet=True)
    height_difference: tuple[HeightDifferenceKeys, ...] = key((), quiet=True)
    wrong_control: tuple[WrongControl, ...] = key((), quiet=True)
    wrong_tide: tuple[WrongTide, ...] = key((), quiet=True)
    wrong_station: tuple[WrongStation, ...] = key((), quiet=True)
    options: OptionKeys = key(OptionKeys)
    compilation: CompilationKeys | None = key(None, quiet=True)

    def __post_init__(self) -> None:
        submerged = bool(self.shoal) or any(point.bathymetric for point in self.point)
        if submerged and self.water is None:
            raise ValueError("submerged points need a [water] table")
        if self.water is None and (self.wrong_tide or self.blunders.flagged_submerged):
            raise ValueError("wrong_tide and blunders.flagged_submerged need a [water] table")
        if self.water and self.water.tides and len(self.water.tides) != self.flight.strips * self.flight.photos:
            raise ValueError(f"water.tides has {len(self.water.tides)} values, not one per photo")
        if self.wave and (self.water is None or any(self.water.tilt)):
            raise ValueError("waves need a [water] table, and level water: no tilt")
        if len({train.id for train in self.wave}) < len(self.wave):
            raise ValueError("two waves have the same id")
        if self.wrong_station and not self.stations.given:
            raise ValueError("wrong_station needs stations that are given")
        here = "local" if self.job.system == CoordinateSystem.LOCAL else "geographic or geocentric"
        for point in self.point:
            if (point.local is not None) != (self.job.system == CoordinateSystem.LOCAL):
                raise ValueError(f"point {point.id}: a {self.job.system} job needs {here} coordinates")


def load_spec(path: str | Path) -> SimulationSpec:
    """Return the spec in a TOML file. Raises `SpecError` with every problem found.

    A key `extends = "other.toml"` at the top takes everything from that file (beside this one) first; tables are
    merged, anything else replaced.
    """
    raw = _read_table(Path(path), ())
    return spec_from_table(raw, str(path))


def spec_from_table(raw: dict[str, Any], file: str | None = None) -> SimulationSpec:
    """Return the spec of a parsed TOML table. Raises `SpecError` with every problem found."""
    return spec_of(SimulationSpec, raw, file)


def _read_table(path: Path, above: tuple[Path, ...]) -> dict[str, Any]:
    """Return the table of a file, merged over those that it extends."""
    raw = spec_table(path)
    base = raw.pop("extends", None)
    if base is None:
        return raw
    if not isinstance(base, str) or real_path(path) in above:
        message = "extends names another file, and not in a circle"
        raise SpecError([Problem(file=str(path), message=message)])
    return _merged(_read_table(path.parent / base, (*above, real_path(path))), raw)


def _merged(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """Return `base` with the values of `over` in it, tables merged."""
    merged = dict(base)
    for name, value in over.items():
        below = base.get(name)
        merged[name] = _merged(below, value) if isinstance(value, dict) and isinstance(below, dict) else value
    return merged
