"""A simulated job, and the same job in the words of other systems, by PROJ and scipy and not by what is tested."""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pyproj
from scipy.spatial.transform import Rotation

from musatpy.geometry.collinearity import AngleForm, attitude_matrix
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.projected import Geoid, Projected
from musatpy.geometry.systems import Geocentric, Geographic, TangentPlane
from musatpy.model import Block
from musatpy.simulation import simulate
from musatpy.systems import Axes, Stated, Statement
from musatpy.units import ARC_SECOND, DEGREE
from reference.earth import earth_of

CLARKE = Ellipsoid("clrk66")
SPECS = Path(__file__).resolve().parents[1] / "simulation" / "specs"
ORIGIN, FALSE = np.array([19.32 * DEGREE, -81.18 * DEGREE, 0.0]), np.array([5000.0, 2000.0, 100.0])
FEET = "+proj=tmerc +lon_0=-80 +k=0.9996 +x_0=200000 +ellps=clrk66 +units=us-ft"
EULER = {AngleForm.OMEGA_PHI_KAPPA: "XYZ", AngleForm.PHI_OMEGA_KAPPA: "YXZ"}


@lru_cache
def job() -> Block:
    """The noise-free strip with noise, observed stations and attitudes that are off, and complete control."""
    simulation = simulate(SPECS / "strip.toml")
    block, rng = simulation.block, np.random.default_rng(11)
    photos, control, n = block.photos, block.control, len(block.photos.ids)
    off = rng.normal(0.0, 0.5, (n, 3)) / [6.37e6, 6.0e6, 1.0]
    photos = replace(
        photos,
        position=photos.position + off,
        position_sigma=np.full((n, 3), 0.5),
        attitude=photos.attitude + rng.normal(0.0, 60.0 * ARC_SECOND, (n, 3)),
        attitude_sigma=np.full((n, 3), 60.0 * ARC_SECOND),
    )
    place = np.where(np.isnan(control.position), simulation.truth.points.job[control.point], control.position)
    control = replace(control, position=place, sigma=np.full(place.shape, 0.05))
    plates = replace(block.plates, xy=block.plates.xy + rng.normal(0.0, 0.005, block.plates.xy.shape))
    return replace(block, photos=photos, control=control, plates=plates)


@dataclass(frozen=True)
class Words:
    """What a statement is made of, told twice: for what is tested, and for PROJ and scipy."""

    statement: Statement
    projection: str = ""  # of PROJ; empty: geographic, geocentric or the plane
    undulation: float = 0.0  # m, of a level geoid


def statements(folder: Path) -> dict[str, Words]:
    utm, feet = Projected("EPSG:26717", CLARKE), Projected(FEET, CLARKE)
    geoid = Projected("EPSG:26717", CLARKE, Geoid(level_geoid(folder)))
    plane = TangentPlane(CLARKE, ORIGIN, FALSE)
    opk, pok, ats = AngleForm
    return {
        "geographic, matrices": Words(Statement(system=Geographic(CLARKE), form=None)),
        "geocentric": Words(Statement(system=Geocentric(CLARKE), axes=Axes.GEOCENTRIC, form=None)),
        "geocentric, azimuth": Words(Statement(system=Geocentric(CLARKE), axes=Axes.SYSTEM, form=ats)),
        "tangent plane": Words(Statement(system=plane, axes=Axes.SYSTEM, form=opk)),
        "tangent plane, vertical": Words(Statement(system=plane, form=pok)),
        "UTM": Words(Statement(system=utm, axes=Axes.SYSTEM, form=pok), "EPSG:26717"),
        "UTM, matrices": Words(Statement(system=utm, axes=Axes.SYSTEM, form=None), "EPSG:26717"),
        "UTM above a geoid": Words(Statement(system=geoid, axes=Axes.SYSTEM, form=ats), "EPSG:26717", -12.5),
        "feet": Words(Statement(system=feet, axes=Axes.SYSTEM, form=opk), FEET),
    }


def level_geoid(folder: Path) -> str:
    """A geoid 12.5 m below the ellipsoid, in NOAA's GTX format over 15-25 N, 85-75 W."""
    header = np.array([15.0, -85.0, 1.0, 1.0], ">f8").tobytes() + np.array([11, 11], ">i4").tobytes()
    path = folder / "level.gtx"
    path.write_bytes(header + np.full((11, 11), -12.5, ">f4").tobytes())
    return str(path)


def told(block: Block, words: Words) -> Stated:
    """Return the job as the statement has it."""
    photos, control = block.photos, block.control
    axes = reference_axes(block, words, photos.position)  # rows in geocentric axes
    frame = earth_of(block).frame(photos.position)
    to_photo = Rotation.from_euler("XYZ", photos.attitude).as_matrix().swapaxes(1, 2)
    M = to_photo @ frame @ axes.swapaxes(1, 2)
    angles = np.full((len(M), 3), np.nan)
    if words.statement.form in EULER:
        angles = Rotation.from_matrix(M.swapaxes(1, 2)).as_euler(EULER[words.statement.form])
    elif words.statement.form is AngleForm.AZIMUTH_TILT_SWING:
        angles = Rotation.from_matrix(M.swapaxes(1, 2)).as_euler("ZXZ") * [-1.0, 1.0, 1.0] + [0.0, 0.0, np.pi]
    photos = replace(
        photos,
        position=coordinates(block, words, photos.position),
        attitude=angles,
        tide=photos.tide - words.undulation,
    )
    control = replace(control, position=coordinates(block, words, control.position))
    matrices = M if words.statement.form is None else None
    return Stated(block=replace(block, photos=photos, control=control), matrices=matrices)


def coordinates(block: Block, words: Words, level: np.ndarray) -> np.ndarray:
    """Return coordinates (n, 3) of latitude, longitude and height."""
    system, earth = words.statement.system, earth_of(block)
    if words.projection:
        east, north = transformer(words.projection).transform(*np.degrees(level[:, [1, 0]]).T)
        return np.column_stack([east, north, level[:, 2] - words.undulation])
    xyz = earth.cartesian(level) + earth.origin
    if isinstance(system, TangentPlane):
        return (xyz - earth.cartesian(ORIGIN) - earth.origin) @ earth.frame(ORIGIN).T + FALSE
    return xyz if isinstance(system, Geocentric) else level


def reference_axes(block: Block, words: Words, level: np.ndarray) -> np.ndarray:
    """Return the axes (n, 3, 3) that attitudes refer to, rows in geocentric axes."""
    system, statement, earth = words.statement.system, words.statement, earth_of(block)
    frame = earth.frame(level)
    if statement.axes is Axes.VERTICAL:
        return frame
    if statement.axes is Axes.GEOCENTRIC or isinstance(system, Geocentric):
        return np.broadcast_to(np.eye(3), frame.shape)
    if isinstance(system, TangentPlane):
        return np.broadcast_to(earth.frame(ORIGIN), frame.shape)
    return grid_axes(block, words.projection, level, frame[:, 2])


def grid_axes(block: Block, projection: str, level: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return rows east, north and normal of a grid: where its lines run on the ground."""
    earth, back = earth_of(block), transformer(projection)
    east, north = back.transform(*np.degrees(level[:, [1, 0]]).T)
    ends = []
    for step in (100.0, -100.0):
        longitude, latitude = np.radians(back.transform(east, north + step, direction="INVERSE"))
        ends.append(earth.cartesian(np.column_stack([latitude, longitude, np.zeros(len(level))])))
    line = ends[0] - ends[1]
    y = line - up * np.einsum("ni,ni->n", up, line)[:, None]
    y /= np.linalg.norm(y, axis=1)[:, None]
    return np.stack([np.cross(y, up), y, up], axis=1)


def rays(block: Block, position: np.ndarray, attitude: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Return adjusted rays (m, 3) of all images of a geographic job, geocentric."""
    earth, plates = earth_of(block), block.plates
    M = attitude_matrix(attitude) @ earth.frame(earth.native(position))
    camera = block.photos.camera[plates.photo]
    xy = plates.xy + residual - block.cameras.principal_point[camera]
    image = np.column_stack([xy, -block.cameras.focal_length[camera]])
    image /= np.linalg.norm(image, axis=1)[:, None]
    return np.einsum("mji,mj->mi", M[plates.photo], image)


@lru_cache
def transformer(projection: str) -> pyproj.Transformer:
    crs = pyproj.CRS(projection)
    return pyproj.Transformer.from_crs(crs.geodetic_crs, crs, always_xy=True)
