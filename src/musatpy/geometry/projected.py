"""Projected coordinate systems that PROJ knows, and heights above a geoid model.

A system is one projection of the job's own ellipsoid and datum: positions are projected, never shifted. Easting,
northing and height stand in the order x, y, z whatever order the register gives the axes; easting and northing are
in the unit of the system, the height is in metres.

Scale factors and convergence are taken from the map itself, not from PROJ's `get_factors`, which leaves out units,
senses of axes and prime meridians other than Greenwich (proj 9.5: EPSG:2263, EPSG:2048, EPSG:27561).
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
from numpy.typing import ArrayLike
from pyproj.datadir import get_data_dir, get_user_data_dir  # type: ignore[attr-defined]
from pyproj.exceptions import CRSError, ProjError
from pyproj.network import is_network_enabled, set_network_enabled  # type: ignore[attr-defined]
from pyproj.transformer import TransformerGroup

from musatpy.arrays import BoolArray, FloatArray
from musatpy.errors import SystemsError
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.systems import MapFactors, System, moved

_STEP = 5000.0  # m: fourth-order differences of smooth maps are good to 1e-12 at such steps
_SLOPE_STEP = 10.0  # m: geoid grids are interpolated between points some kilometres apart
# PROJ takes names, and guesses
_DEFINITION = re.compile(r"(\d+$)|([A-Za-z]+:\w+(\+\w+)?$)|(.*\bproj=)|(\w+\[)", re.DOTALL)
_ABOUT_TEXT = {"type=crs", "no_defs", "wktext"}  # parameters of a PROJ string that say nothing of the map
_SHOWN = 80  # characters of a definition in messages
_INVERSIONS = 8  # Newton steps after PROJ's inverse; one is enough for all but tabulated projections
_ROUNDING = 4.0 * np.finfo(float).eps  # of the larger coordinate: nearer, an inverse is as good as it gets
_TURN = 2.0 * np.pi
_MISSED = 1e-6  # m: an inverse that does not come back to its coordinates within a micrometre is none


class Geoid:
    """A geoid model: undulations above the job's ellipsoid in a grid file that the user names and has.

    `grid` is a file, or the name of one in the folders where PROJ looks (`PROJ_DATA`, the user's PROJ folder).
    Nothing is ever downloaded. Raises `SystemsError` where there is no such file, or PROJ cannot read it.
    """

    def __init__(self, grid: str) -> None:
        self.name = Path(grid).name
        path = grid_file(grid)
        try:
            with no_network():
                self._shift = pyproj.Transformer.from_pipeline(f'+proj=vgridshift +grids="{path}" +multiplier=1')
        except ProjError as error:
            raise SystemsError.of(f"geoid model {grid}: PROJ cannot read {path}", field="geoid") from error
        self._path = str(path)

    def __reduce__(self) -> tuple[Any, ...]:
        """Let other processes open the grid anew."""
        return type(self), (self._path,)

    def undulation(self, latitude: ArrayLike, longitude: ArrayLike) -> FloatArray:
        """Return heights (...) m of the geoid above the ellipsoid, NaN outside the grid. Angles in radians."""
        latitude, longitude = np.broadcast_arrays(latitude, longitude)
        _, _, height = self._shift.transform(longitude, latitude, np.zeros(latitude.shape), radians=True)
        height = np.asarray(height, dtype=float)
        return np.where(np.isfinite(height), height, np.nan)

    def reached(self, level: ArrayLike) -> FloatArray:
        """Return the undulations (...) at level positions (..., 3). Raises `SystemsError` outside the grid."""
        level = np.asarray(level, dtype=float)
        out = self.undulation(level[..., 0], level[..., 1])
        refuse_lost(np.isfinite(level[..., :2]).all(axis=-1) & np.isnan(out), level, f"the geoid model {self.name}")
        return out


class Projected(System):
    """A projected system by EPSG code (`"EPSG:32617"`, `"32617"`), PROJ string or WKT.

    Heights are ellipsoidal, or above `geoid`. Raises `SystemsError` where PROJ does not know the system, where it
    is not a projected one, is made of two (a compound one: name its geoid model instead), asks for a datum shift,
    or has another ellipsoid than the job.
    """

    def __init__(self, definition: str, ellipsoid: Ellipsoid, geoid: Geoid | None = None) -> None:
        crs = _projected_crs(definition)
        require_ellipsoid(definition, crs, ellipsoid)
        heights = f"heights above {geoid.name}" if geoid else "ellipsoidal heights"
        super().__init__(f"{crs_name(definition, crs)}, {heights}")
        self.names = ("E", "N", "H" if geoid else "h")
        self.definition = definition
        self.ellipsoid: Ellipsoid = ellipsoid
        self.geoid, self.height_alone = geoid, geoid is None
        self.unit = float(crs.axis_info[0].unit_conversion_factor)  # m
        plane = "m" if self.unit == 1.0 else str(crs.axis_info[0].unit_name)
        self.units = (plane, plane, "m")
        base = crs.geodetic_crs
        self._meridian = base.prime_meridian.longitude * base.prime_meridian.unit_conversion_factor
        self._angle = float(base.axis_info[0].unit_conversion_factor)  # rad
        self._area = crs.area_of_use.bounds if crs.area_of_use else None  # degrees: west, south, east, north
        self._map = _conversion(definition, base, crs)

    def __reduce__(self) -> tuple[Any, ...]:
        """Let other processes make the map anew: those of PROJ cannot be handed over."""
        return type(self), (self.definition, self.ellipsoid, self.geoid)

    def coordinates(self, level: ArrayLike) -> FloatArray:
        level = np.asarray(level, dtype=float)
        out = np.empty(level.shape)
        out[..., :2] = self._forward(level)
        self._refuse(np.isfinite(level[..., :2]).all(axis=-1) & ~np.isfinite(out[..., :2]).all(axis=-1), level)
        out[..., 2] = level[..., 2] - self.undulation(level)
        return out

    def level(self, coordinates: ArrayLike) -> FloatArray:
        coordinates = np.asarray(coordinates, dtype=float)
        out = self._backward(coordinates)
        out[..., 2] = coordinates[..., 2] + self.undulation(out)
        return out

    def outside(self, level: ArrayLike) -> BoolArray:
        """Return (...) where positions lie outside the area of use that the register states, if it does."""
        latitude, longitude = np.moveaxis(np.degrees(np.asarray(level, dtype=float)[..., :2]), -1, 0)
        if self._area is None:
            return np.zeros(latitude.shape, dtype=bool)
        west, south, east, north = self._area
        beyond = np.remainder(longitude - west, 360.0) > np.remainder(east - west, 360.0)
        if east - west >= 360.0:
            beyond = np.zeros(latitude.shape, dtype=bool)
        return beyond | (latitude < south) | (latitude > north)

    def jacobian(self, level: ArrayLike) -> FloatArray:
        level = np.asarray(level, dtype=float)
        out = np.zeros((*level.shape, 3))
        out[..., :2, :2] = self._rates(level)
        out[..., 2, 2] = 1.0
        if self.geoid:
            for along, step in enumerate(_SLOPE_STEP * np.eye(3)[:2]):
                sides = [self.undulation(moved(self.ellipsoid, level, sign * step)) for sign in (1.0, -1.0)]
                out[..., 2, along] = -(sides[0] - sides[1]) / (2.0 * _SLOPE_STEP)
        return out

    def axes(self, level: ArrayLike) -> FloatArray:
        """Return the axes of the grid (..., 3, 3) as rows along east, north, up: these turned by the convergence.

        The third axis is the normal of the ellipsoid. Raises `SystemsError` where the grid is left-handed.
        """
        level = np.asarray(level, dtype=float)
        rates = self._rates(level)
        if (rates[..., 0, 0] * rates[..., 1, 1] < rates[..., 0, 1] * rates[..., 1, 0]).any():
            message = f"{self.text}: its axes are left-handed, so attitudes cannot refer to them"
            raise SystemsError.of(message, field="axes")
        angle = _convergence(rates)
        out = np.zeros((*level.shape, 3))
        out[..., 0, 0] = out[..., 1, 1] = np.cos(angle)
        out[..., 1, 0] = np.sin(angle)
        out[..., 0, 1] = -out[..., 1, 0]
        out[..., 2, 2] = 1.0
        return out

    def factors(self, level: ArrayLike) -> MapFactors:
        """Return convergence and scale factors at level positions (..., 3), whatever their heights."""
        level = np.array(level, dtype=float)
        level[..., 2] = 0.0
        rates = self._rates(level) * self.unit
        parallel, meridian = np.linalg.norm(rates, axis=-2)[..., 0], np.linalg.norm(rates, axis=-2)[..., 1]
        return MapFactors(convergence=_convergence(rates), meridian_scale=meridian, parallel_scale=parallel)

    def _forward(self, level: FloatArray) -> FloatArray:
        """Return x and y (..., 2), NaN where the map does not reach."""
        longitude = np.remainder(level[..., 1] - self._meridian + np.pi, 2.0 * np.pi) - np.pi
        x, y = self._map.transform(longitude / self._angle, level[..., 0] / self._angle)
        return _finite(x, y)

    def _backward(self, coordinates: FloatArray) -> FloatArray:
        """Return latitude and longitude of x and y as (..., 3), the height 0; as `_forward` has it, to rounding."""
        xy = coordinates[..., :2]
        longitude, latitude = self._map.transform(xy[..., 0], xy[..., 1], direction="INVERSE")
        place = np.zeros(coordinates.shape)
        place[..., :2] = _finite(latitude, longitude) * self._angle + [0.0, self._meridian]
        for _ in range(_INVERSIONS):
            missed = xy - self._forward(place)
            wrong = np.abs(missed).max(axis=-1) > _ROUNDING * (1.0 + np.abs(xy).max(axis=-1))
            if not wrong.any():
                break
            metres = np.zeros((np.count_nonzero(wrong), 3))
            metres[:, :2] = np.linalg.solve(self._rates(place[wrong]), missed[wrong][..., None])[..., 0]
            place[wrong] = moved(self.ellipsoid, place[wrong], metres)
        missed = np.abs(xy - self._forward(place)).max(axis=-1) * self.unit
        known = np.isfinite(xy).all(axis=-1)
        self._refuse(np.asarray(known & ~(missed < _MISSED)), coordinates)
        place[..., 1] = np.remainder(place[..., 1] + np.pi, 2.0 * np.pi) - np.pi
        place[~known, :2] = np.nan
        return place

    def _rates(self, level: FloatArray) -> FloatArray:
        """Return d(x, y)/d(east, north) (..., 2, 2) by metres on the ground in its height.

        Differences along the tangent, so that neither the poles nor the ends of longitude are special.
        """
        origin, frame = self.ellipsoid.geocentric(level), self.ellipsoid.frame(level)
        out = np.empty((*level.shape[:-1], 2, 2))
        for along in range(2):
            step = _STEP * frame[..., along, :]
            ends = [self._forward(self.ellipsoid.geographic(origin + k * step)) for k in (1.0, -1.0, 2.0, -2.0)]
            out[..., along] = (8.0 * (ends[0] - ends[1]) - (ends[2] - ends[3])) / (12.0 * _STEP)
        self._refuse(np.asarray(np.isfinite(level).all(axis=-1) & ~np.isfinite(out).all(axis=(-2, -1))), level)
        return out

    def _refuse(self, lost: BoolArray, places: FloatArray) -> None:
        refuse_lost(lost, places, self.text)


def refuse_lost(lost: BoolArray, places: FloatArray, what: str) -> None:
    """Raise `SystemsError` where places (..., 3) are lost to something, with the first of them."""
    if not lost.any():
        return
    x, y = places[lost][0, :2]
    angular = abs(x) <= _TURN and abs(y) <= _TURN
    first = f"{np.degrees(x):.6f}, {np.degrees(y):.6f} degrees" if angular else f"{x:.3f}, {y:.3f}"
    where = first if lost.size == 1 else f"{np.count_nonzero(lost)} of the places, the first at {first}"
    raise SystemsError.of(f"{what} does not reach {where}")


def _convergence(rates: FloatArray) -> FloatArray:
    """Return the angle (...) from true to grid north, clockwise, where the map has rates (..., 2, 2)."""
    return np.arctan2(-rates[..., 0, 1], rates[..., 1, 1])


def _finite(first: ArrayLike, second: ArrayLike) -> FloatArray:
    out = np.stack([np.asarray(first, dtype=float), np.asarray(second, dtype=float)], axis=-1)
    out[~np.isfinite(out).all(axis=-1)] = np.nan
    return out


def crs_of(definition: str) -> Any:
    """Return the system of a definition in PROJ's register, of whatever kind. Raises `SystemsError` for none."""
    text = definition.strip()
    if not _DEFINITION.match(text):
        raise _refused(definition, "is no coordinate system: give its code (EPSG:32617), a PROJ string or WKT")
    try:
        with no_network():
            crs = pyproj.CRS.from_user_input(f"EPSG:{text}" if text.isdigit() else text)
    except CRSError as error:
        raise _refused(definition, "is no coordinate system that PROJ knows") from error
    if crs.is_bound:
        why = "asks for a datum shift (towgs84, nadgrids): a job has one datum and none is shifted"
        raise _refused(definition, why)
    return crs


def crs_name(definition: str, crs: Any) -> str:
    """Return what to call a system: its name, and the code or PROJ string that it was given by."""
    known = [] if crs.name == "unknown" else [crs.name]
    given = [] if "[" in definition else [definition.strip()]  # WKT has its name
    return ", ".join([*known, *given])


def _refused(definition: str, why: str) -> SystemsError:
    return SystemsError.of(f"{_short(definition)} {why}", field="definition")


def _projected_crs(definition: str) -> Any:
    """Return the system of a definition. Raises `SystemsError` unless it is a plain projected one."""
    crs = crs_of(definition)
    if crs.is_compound:
        why = "has heights of its own: give the projected system, and the geoid model by its grid file"
        raise _refused(definition, why)
    if not crs.is_projected:
        raise _refused(definition, f"is no projected system but a {crs.type_name}")
    if len(crs.axis_info) != 2:
        raise _refused(definition, "has three axes: give the projected system alone")
    try:
        ignored = _ignored(definition.strip())
    except ProjError as error:
        raise _refused(definition, f"cannot be projected to: {error}") from error
    if ignored:
        raise _refused(definition, f"has what PROJ would pass over in silence: {', '.join(ignored)}")
    return crs


def _ignored(text: str) -> list[str]:
    """Return the parameters of a PROJ string that the projection does not use: misspelt ones, further steps."""
    terms = [word.lstrip("+") for word in text.split()]
    given = [word for word in terms if word not in _ABOUT_TEXT]
    if "[" in text or not any(word.startswith("proj=") for word in terms):
        return []
    with no_network():
        used = pyproj.Transformer.from_pipeline(" ".join(f"+{word}" for word in given)).definition
    keys = [word.partition("=")[0] for word in used.split()]
    return [word for i, word in enumerate(given) if word.partition("=")[0] not in keys or word in given[:i]]


def require_ellipsoid(definition: str, crs: Any, ellipsoid: Ellipsoid) -> None:
    """Raise `SystemsError` unless a system of the register stands on an ellipsoid."""
    registered, registered_name = crs.ellipsoid, crs.name
    a, b = ellipsoid.axes
    if ellipsoid.has_axes(registered.semi_major_metre, registered.semi_minor_metre):
        return
    name = registered_name if "[" in definition else _short(definition)  # WKT has its name
    raise SystemsError.of(
        f"{name} is on the ellipsoid {registered.name} ({registered.semi_major_metre:.3f}, "
        f"{registered.semi_minor_metre:.4f} m), the job on another ({a:.3f}, {b:.4f} m): no datum is shifted",
        field="definition",
    )


def _short(definition: str) -> str:
    """Return a definition for messages: WKT has hundreds of characters."""
    return definition if len(definition) <= _SHOWN else f"{definition[:_SHOWN]}..."


def _conversion(definition: str, base: Any, crs: Any) -> pyproj.Transformer:
    """Return the projection from longitude and latitude of its base. Raises `SystemsError` where PROJ lacks it."""
    with no_network():
        group = TransformerGroup(base, crs, always_xy=True, allow_ballpark=False)
    if group.unavailable_operations or len(group.transformers) != 1:
        missing = ", ".join(grid.short_name for way in group.unavailable_operations for grid in way.grids)
        message = (
            f"PROJ has no single way to project to {_short(definition)}{f': it needs {missing}' if missing else ''}"
        )
        raise SystemsError.of(message)
    return group.transformers[0]


def grid_file(grid: str) -> Path:
    """Return where a grid file is. Raises `SystemsError` with the folders that do not have it."""
    if Path(grid).is_file() and '"' not in grid:
        return Path(grid).resolve()
    data = [os.environ.get(name, "") for name in ("PROJ_DATA", "PROJ_LIB")]
    folders = [*os.pathsep.join([*data, get_data_dir()]).split(os.pathsep)]
    folders = [folder for folder in dict.fromkeys([*folders, get_user_data_dir()]) if folder]
    for folder in folders:
        if grid and (Path(folder) / grid).is_file():
            return Path(folder) / grid
    message = f"geoid model {grid}: there is no such file, nor is it in {', '.join(folders)}"
    raise SystemsError.of(message, field="geoid")


@contextmanager
def no_network() -> Iterator[None]:
    """Keep PROJ from downloading what it lacks, whatever its settings say."""
    before = is_network_enabled()
    set_network_enabled(False)
    try:
        yield
    finally:
        set_network_enabled(before)
