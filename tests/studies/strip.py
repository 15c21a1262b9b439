"""A strip of photographs of a bay through waves, simulated: points on both shores, points and control under water.

Images are traced through the true waves by `refraction.fermat`. Model axes: x along the flight, y across it, z up
from the mean water level, m; the waves have their origin in the middle of the strip, times count from its middle.
"""

from dataclasses import dataclass

import numpy as np

from musatpy import model
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.geometry import collinearity
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.model.tables import empty
from musatpy.refraction import fermat
from musatpy.refraction.waves import Harmonic, sinusoidal
from musatpy.sea.theory import linear_wave
from musatpy.units import DEGREE, MICROMETRE

_FOCAL_LENGTH, _HALF_FORMAT = 152.0, 110.0  # mm, wide-angle, of 23 cm
# y of the points on the shores and of the outermost ones in the bay, over the flying height
_SHORE, _BAY = 0.62, 0.46
_TILT = 0.5 * DEGREE  # of the attitudes
_START = (1.0, 0.1 * DEGREE)  # m and rad, errors of the stations that the adjustment starts from
_RELIEF = 0.05  # of the depth: roughness of the bottom


@dataclass(frozen=True, kw_only=True)
class Strip:
    """What is photographed, and how. Lengths in m, times in s, angles in rad, noise in um on the plate.

    The shores have control in every model. Of `rows` by `columns` points on the bottom, `control` are control, the
    others check points. Waves by linear theory, from period and height in deep water.
    """

    photos: int = 3
    height: float = 500.0
    base: float = 264.0
    interval: float = 3.0  # from exposure to exposure; 0: simultaneous
    depth: float = 10.0
    index: float = 1.34
    period: float = 10.0
    deep_height: float = 1.0
    azimuth: float = 30.0 * DEGREE
    rows: int = 6
    columns: int = 8
    control: int = 12
    control_sigma: float = 0.05
    noise: float = 5.0  # um

    def waves(self, crest: float = 0.0) -> Harmonic:
        """Return the waves, a crest of them `crest` m beyond the middle of the strip at its middle time."""
        wave = linear_wave(self.period, self.depth, deep_height=self.deep_height)
        return sinusoidal(
            amplitude=0.5 * float(wave.height),
            length=float(wave.length),
            azimuth=self.azimuth,
            speed=float(wave.speed),
            crest=crest,
        )

    @property
    def times(self) -> FloatArray:
        """Times (n,) s of the exposures."""
        return np.asarray((np.arange(self.photos) - 0.5 * (self.photos - 1)) * self.interval)


@dataclass(frozen=True, kw_only=True, eq=False)
class Photographed:
    """A strip as it was photographed: the block to be adjusted, the waves that it is seen through, the truth.

    points (p, 3): true places, x, y, z; check (p,): points on the bottom without control.
    """

    block: model.Block
    waves: Harmonic
    times: FloatArray
    points: FloatArray
    check: BoolArray


def photographed(strip: Strip, crest: float, rng: np.random.Generator) -> Photographed:
    """Return a strip photographed through its waves, moved on by `crest` m; errors are drawn from `rng`."""
    waves = strip.waves(crest)
    points, wet = _points(strip, rng)
    n = strip.photos
    along = (np.arange(n) - 0.5 * (n - 1)) * strip.base
    cameras = np.stack([along, np.zeros(n), np.full(n, strip.height)], axis=1) + rng.normal(0.0, 3.0, (n, 3))
    attitude = rng.normal(0.0, _TILT, (n, 3))
    photo, point, xy = _images(strip, waves, cameras, attitude, points, wet)
    measured = xy + rng.normal(0.0, strip.noise * MICROMETRE, xy.shape)
    given = (
        cameras + rng.normal(0.0, _START[0], cameras.shape),
        attitude + rng.normal(0.0, _START[1], attitude.shape),
    )
    control = np.concatenate([np.flatnonzero(~wet), _chosen(strip, wet)])
    return Photographed(
        block=model.Block(
            titles=("A BAY THROUGH WAVES",),
            options=model.Options(
                program=model.Program.IIIA,
                system=model.CoordinateSystem.LOCAL,
                refraction=model.Refraction.RIGOROUS,
                plate_sigma=strip.noise * MICROMETRE,
                max_iterations=40,
            ),
            ellipsoid=None,
            water=model.Water(index=strip.index),
            cameras=model.Cameras(
                ids=np.array(["WIDE"]),
                focal_length=np.array([_FOCAL_LENGTH]),
                principal_point=np.zeros((1, 2)),
                format_size=np.full((1, 2), 2.0 * _HALF_FORMAT),
            ),
            distortion=empty(model.Distortion),
            fiducials=empty(model.Fiducials),
            photos=_stations(*given),
            fiducial_measurements=empty(model.FiducialMeasurements),
            points=model.Points(ids=_names(wet), bathymetric=wet),
            plates=model.PlateMeasurements(
                photo=photo,
                point=point,
                xy=measured,
                sigma=np.full(xy.shape, np.nan),
                triangulated=np.ones(len(photo), dtype=bool),
            ),
            control=_control(strip, control, points, rng),
            equal_elevations=empty(model.EqualElevations),
            air_bases=empty(model.AirBases),
        ),
        waves=waves,
        times=strip.times,
        points=points,
        check=wet & ~np.isin(np.arange(len(points)), control),
    )


def _points(strip: Strip, rng: np.random.Generator) -> tuple[FloatArray, BoolArray]:
    """Return the points (p, 3) on both shores and on the bottom, and which are under water (p,)."""
    half = 0.5 * (strip.photos - 1) * strip.base
    x = np.linspace(-half, half, 2 * strip.photos - 1)
    shores = np.array(
        [[a, side * _SHORE * strip.height, rng.uniform(1.0, 20.0)] for a in x for side in (-1.0, 1.0)]
    )
    reach = _BAY * strip.height
    a, b = np.linspace(-half, half, strip.columns), np.linspace(-reach, reach, strip.rows)
    bottom = np.array([[u, v, -strip.depth] for u in a for v in b])
    spacing = np.array([a[1] - a[0], b[1] - b[0]])
    bottom[:, :2] += rng.uniform(-0.3, 0.3, (len(bottom), 2)) * spacing
    bottom[:, 2] *= 1.0 + rng.uniform(-_RELIEF, _RELIEF, len(bottom))
    return np.concatenate([shores, bottom]), np.arange(len(shores) + len(bottom)) >= len(shores)


def _names(wet: BoolArray) -> TextArray:
    return np.array([f"{'W' if one else 'L'}{i + 1}" for i, one in enumerate(wet)])


def _chosen(strip: Strip, wet: BoolArray) -> IntArray:
    """Return the control points among those under water, spread evenly over the bay."""
    under = np.flatnonzero(wet)
    # multiples of the golden section fill any rectangle evenly, however many there are
    rank = np.argsort((np.arange(len(under)) * 0.5 * (np.sqrt(5.0) - 1.0)) % 1.0, kind="stable")
    return np.sort(under[rank[: strip.control]])


def _images(
    strip: Strip, waves: Harmonic, cameras: FloatArray, attitude: FloatArray, points: FloatArray, wet: BoolArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return photo (m,), point (m,) and plate coordinates (m, 2) mm of all points within the format."""
    v = points - cameras[:, None]
    v[:, wet] = fermat.incidence(waves, cameras[:, None], points[wet], strip.index, strip.times[:, None]).v
    xy = collinearity.image(v, attitude_matrix(attitude)[:, None], np.full(v.shape[:2], _FOCAL_LENGTH), np.zeros(2))
    photo, point = np.nonzero((np.abs(xy) < _HALF_FORMAT).all(axis=2))
    return photo, point, xy[photo, point]


def _stations(position: FloatArray, attitude: FloatArray) -> model.Photos:
    n = len(position)
    nothing = np.full((n, 3), np.nan)
    return model.Photos(
        ids=np.array([str(i + 1) for i in range(n)]),
        camera=np.zeros(n, dtype=int),
        position=position,
        position_sigma=nothing,
        attitude=attitude,
        attitude_sigma=nothing,
        tide=np.zeros(n),
        tide_sigma=np.full(n, np.nan),
    )


def _control(strip: Strip, rows: IntArray, points: FloatArray, rng: np.random.Generator) -> model.Control:
    count = len(rows)
    return model.Control(
        point=rows,
        kind=np.full(count, int(model.ControlKind.FULL)),
        fixed=np.zeros(count, dtype=bool),
        position=points[rows] + rng.normal(0.0, strip.control_sigma, (count, 3)),
        sigma=np.full((count, 3), strip.control_sigma),
    )
