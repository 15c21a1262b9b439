"""The spec of a simulation: what a TOML file can say, with units, limits and meaning of every key.

What is true stands in `scene_keys`; here is what a deck says of it, and with which errors.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from musatpy import model
from musatpy.errors import SpecError
from musatpy.files import real_path
from musatpy.simulation import scene_keys
from musatpy.simulation.sensors import AntennaKeys, InertialKeys
from musatpy.simulation.true_lens import LensKeys, PortKeys
from musatpy.specs import Area, Pair, Triple, key, require, spec_of, spec_table


@dataclass(frozen=True, kw_only=True)
class ControlKeys:
    """[[control]]: control of one kind (exactly one of number, ids, points)."""

    kind: str = key(doc="what is known", choices=("full", "horizontal", "vertical", "check"))
    number: int | None = key(None, "this many points, spread over the block, keep their ids", low=0)
    ids: tuple[str, ...] = key((), "points spread over the block get these ids", longest=8)
    points: tuple[str, ...] = key((), "these points")
    sigma: Triple | None = key(None, "on the cards, of the known components: east, north, up", unit="m", low=0.0)
    error: Triple = key((0.0, 0.0, 0.0), "actual error of the given coordinates, 1 sigma", unit="m", low=0.0)
    correlation: Triple | None = key(
        None, "of sigma, and of the errors: east north, east up, north up", low=-1.0, high=1.0, quiet=True
    )
    fixed: bool = key(False, "held without error")
    bathymetric: bool = key(False, "number and ids take submerged points, else points on land")
    area: Area | None = key(None, scene_keys.AREA, unit="m")

    def __post_init__(self) -> None:
        given = (self.number is not None) + bool(self.ids) + bool(self.points)
        require(given == 1, "control needs one of number, ids, points")
        known = {"full": (0, 1, 2), "horizontal": (0, 1), "vertical": (2,)}.get(self.kind, ())
        if not self.fixed and not all(self.sigma and self.sigma[component] > 0.0 for component in known):
            raise ValueError("control that is neither fixed nor a check point needs a sigma above zero")
        if self.correlation:
            require(self.kind == "full" and not self.fixed, "correlation is for full control that is not fixed")
            scene_keys.require_positive(self.correlation)


@dataclass(frozen=True, kw_only=True)
class StationKeys:
    """[stations]: what the deck says of stations and attitudes."""

    position_error: Triple = key((0.0, 0.0, 0.0), "actual error east, north, up", unit="m", low=0.0)
    attitude_error: Triple = key((0.0, 0.0, 0.0), "actual error of X-tilt, Y-tilt, heading", unit="deg", low=0.0)
    error_kind: str = key("normal", "sizes are sigmas, or every error has that size", choices=("normal", "size"))
    position_sigma: Triple | None = key(None, "on the cards; absent: not observed", unit="m", low=0.0)
    attitude_sigma: Triple | None = key(None, "on the cards; absent: not observed", unit="arcsec", low=0.0)


@dataclass(frozen=True, kw_only=True)
class MeasurementKeys:
    """[measurement]: errors of the plate coordinates."""

    noise: float = key(10.0, "actual error of x and y, 1 sigma", unit="um", low=0.0)
    sigma: float = key(10.0, "plate sigma on the option card", unit="um", low=0.001)
    submerged_factor: float = key(
        1.0, "noise of submerged points is larger by this, and stands on their cards", low=1.0
    )
    least_count: float = key(0.001, "plate coordinates are rounded to this", unit="um", low=0.001)


@dataclass(frozen=True, kw_only=True)
class KeptOutKeys:
    """[kept_out]: plate measurements with the flag N, besides those of [[point]]."""

    number: int = key(0, "random pass points, on all their photos", low=0)
    measurements: tuple[tuple[str, str], ...] = key((), "photo and point of single measurements")


@dataclass(frozen=True, kw_only=True)
class ShoreKeys:
    """[[equal_elevation]]: shore points (tie points on land) brought to one level."""

    id: str = key(doc="id of the group", longest=8)
    number: int = key(doc="number of points, spread over the block", low=2)
    level: float | None = key(None, "height; default the highest tide, else terrain.level", unit="m")
    sigma: float = key(0.1, "on the card", unit="m", low=0.0001)
    error: float = key(0.0, "actual scatter about the level, 1 sigma", unit="m", low=0.0)
    area: Area | None = key(None, scene_keys.AREA, unit="m")


@dataclass(frozen=True, kw_only=True)
class AirBaseKeys:
    """[[air_base]]: a known distance between two stations."""

    photos: tuple[str, str] = key(doc="the two photo ids")
    sigma: float = key(0.1, "on the card", unit="m", low=0.0001)
    error: float = key(0.0, "actual error, 1 sigma", unit="m", low=0.0)


@dataclass(frozen=True, kw_only=True)
class DistanceKeys:
    """[[distance]]: measured distances between ground points, along the straight line (one of points, number)."""

    points: tuple[str, str] | None = key(None, "the two point ids")
    number: int | None = key(None, "this many pairs of points, at random", low=1)
    sigma: float = key(0.02, "on the card", unit="m", low=0.0001)
    error: float = key(0.0, "actual error, 1 sigma", unit="m", low=0.0)

    def __post_init__(self) -> None:
        require((self.points is None) != (self.number is None), "one of points, number is needed")
        require(not self.points or self.points[0] != self.points[1], "points are two different ones")


@dataclass(frozen=True, kw_only=True)
class HeightDifferenceKeys(DistanceKeys):
    """[[height_difference]]: measured height differences, second point minus first (one of points, number)."""


def _check_sizes(size: Pair, log: bool) -> None:
    """Raise `ValueError` where sizes cannot be drawn."""
    require(size[0] <= size[1], "size is the least, then the greatest")
    require(not log or size[0] > 0.0, "log needs a least size above zero")


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
class BlunderKeys:
    """[blunders]: gross errors at random; of plate measurements each in x or y."""

    number: int = key(0, "number of measurements hit", low=0)
    share: float = key(0.0, "or the share of all measurements", low=0.0, high=1.0)
    size: Pair = key((100.0, 1000.0), "least and greatest size, sign at random", unit="um", low=0.0)
    log: bool = key(False, "sizes are spread evenly in their logarithm", quiet=True)
    swapped: int = key(0, "pairs of images on one photo whose names are exchanged", low=0, quiet=True)
    misnamed: int = key(
        0, "images that bear the name of a point which is not measured on their photo", low=0, quiet=True
    )
    control: tuple[ControlBlunders, ...] = key((), quiet=True)

    def __post_init__(self) -> None:
        require(not (self.number and self.share), "blunders have a number or a share, not both")
        _check_sizes(self.size, self.log)


@dataclass(frozen=True, kw_only=True)
class GivenBlunder:
    """[[blunder]]: a gross error of one plate measurement."""

    photo: str = key(doc="photo id")
    point: str = key(doc="point id")
    x: float = key(0.0, "added to x", unit="um")
    y: float = key(0.0, "added to y", unit="um")


@dataclass(frozen=True, kw_only=True)
class OptionKeys:
    """[options]: the option card; what is absent takes the program's default."""

    refraction: str | None = key(
        None, "refraction mode; WATPT, or RIGOROUS for IIIA, where not given", choices=tuple(model.Refraction)
    )
    weights: str = key("FULL", "weights of the conditions", choices=tuple(model.Weights))
    max_iterations: int | None = key(None, "of one triangulation", low=1, high=999)
    max_passes: int | None = key(None, "of WATPT", low=1, high=999)
    rotation_limit: float | None = key(None, "convergence", unit="arcsec", low=0.001)
    translation_limit: float | None = key(None, "convergence", unit="m", low=0.00001)
    water_limit: float | None = key(None, "convergence of WATPT", unit="m", low=0.00001)
    program: str | None = key(None, "program to run", choices=tuple(model.Program))
    initial: str | None = key(None, "initial values of the stations", choices=tuple(model.Initial))
    submerged_factor: float | None = key(None, "on the plate sigmas of submerged points", low=1.0, high=99.0)
    water_level: str | None = key(None, "whose tides share an unknown", choices=tuple(model.WaterLevel))
    water_tilt: str | None = key(None, "tilt of the water", choices=tuple(model.Treatment))
    water_index: str | None = key(None, "refractive index", choices=tuple(model.Treatment))
    datum: str | None = key(None, "what holds the block", choices=tuple(model.Datum))
    editing: str | None = key(None, "what is done about blunders", choices=tuple(model.Editing))


@dataclass(frozen=True, kw_only=True)
class SimulationSpec:
    """The whole file; units are those of each key."""

    title: tuple[str, ...] = key(("SIMULATED BLOCK",), "title cards", longest=68)
    seed: int = key(1, "of every random number", low=0)
    job: scene_keys.JobKeys = key(scene_keys.JobKeys)
    camera: scene_keys.CameraKeys = key(scene_keys.CameraKeys)
    lens: LensKeys | None = key(None)
    port: PortKeys | None = key(None, quiet=True)
    flight: scene_keys.FlightKeys = key(scene_keys.FlightKeys)
    terrain: scene_keys.TerrainKeys = key(scene_keys.TerrainKeys)
    water: scene_keys.SurfaceKeys | None = key(None)
    wave: tuple[scene_keys.WaveTrain, ...] = key((), quiet=True)
    shoal: tuple[scene_keys.ShoalKeys, ...] = key(())
    points: scene_keys.PointKeys = key(scene_keys.PointKeys)
    point: tuple[scene_keys.GivenPoint, ...] = key(())
    control: tuple[ControlKeys, ...] = key(())
    stations: StationKeys = key(StationKeys)
    inertial: InertialKeys | None = key(None, quiet=True)
    measurement: MeasurementKeys = key(MeasurementKeys)
    blunders: BlunderKeys = key(BlunderKeys)
    blunder: tuple[GivenBlunder, ...] = key(())
    kept_out: KeptOutKeys = key(KeptOutKeys)
    equal_elevation: tuple[ShoreKeys, ...] = key(())
    air_base: tuple[AirBaseKeys, ...] = key(())
    distance: tuple[DistanceKeys, ...] = key((), quiet=True)
    height_difference: tuple[HeightDifferenceKeys, ...] = key((), quiet=True)
    antenna: AntennaKeys | None = key(None, quiet=True)
    options: OptionKeys = key(OptionKeys)
    compilation: scene_keys.CompilationKeys | None = key(None, quiet=True)

    def __post_init__(self) -> None:
        submerged = bool(self.shoal) or any(point.bathymetric for point in self.point)
        require(self.water is not None or not submerged, "submerged points need a [water] table")
        if self.water and self.water.tides and len(self.water.tides) != self.flight.strips * self.flight.photos:
            raise ValueError(f"water.tides has {len(self.water.tides)} values, not one per photo")
        if self.port and self.water and (self.port.water > 1.0 or self.wave):
            raise ValueError("over [water], a camera behind a [port] is in air: port.water = 1.0, and no waves")
        level = self.water is not None and not any(self.water.tilt)
        require(level or not self.wave, "waves need a [water] table, and level water: no tilt")
        require(len({train.id for train in self.wave}) == len(self.wave), "two waves have the same id")
        here = "local" if self.job.system == model.CoordinateSystem.LOCAL else "geographic or geocentric"
        for point in self.point:
            if (point.local is not None) != (self.job.system == model.CoordinateSystem.LOCAL):
                raise ValueError(f"point {point.id}: a {self.job.system} job needs {here} coordinates")


def load_spec(path: str | Path) -> SimulationSpec:
    """Return the spec in a TOML file. Raises `SpecError` with every problem found.

    A key `extends = "other.toml"` at the top takes everything from that file (beside this one) first; tables are
    merged, anything else replaced.
    """
    return spec_from_table(_read_table(Path(path), ()), str(path))


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
        raise SpecError.of("extends names another file, and not in a circle", file=path)
    return _merged(_read_table(path.parent / base, (*above, real_path(path))), raw)


def _merged(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """Return `base` with the values of `over` in it, tables merged."""
    merged = dict(base)
    for name, value in over.items():
        below = base.get(name)
        merged[name] = _merged(below, value) if isinstance(value, dict) and isinstance(below, dict) else value
    return merged
