"""What a refracting surface that is not level has to say, its height over every place, at every time; two of them.

Surfaces stand in local axes, east, north, up (m): z = s(x, y, t), time t in seconds. A family of surfaces is a
frozen dataclass (or a function that returns one) that has the three members of `Surface`: still or gridded ones are
here, `waves` has the others; `fermat` finds the incidence points and `bending` the refracted rays of any of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from musatpy.arrays import BoolArray, FloatArray

_FINER = 2  # places per interval where limits are looked up: second derivatives are largest near nodes
_MARGIN = 1.05  # for what lies between these places


@dataclass(frozen=True, kw_only=True, eq=False)
class Relief:
    """Height (...) m, its gradient (..., 2) and second derivatives (..., 2, 2) 1/m at places (..., 2)."""

    height: FloatArray
    gradient: FloatArray
    hessian: FloatArray


@dataclass(frozen=True, kw_only=True)
class SurfaceLimits:
    """What a surface keeps to everywhere: bounds from which a search knows where it need not look.

    lowest, highest (m): heights; slope: length of the gradient; curvature (1/m) and third (1/m2): the largest
    second and third derivative along any direction; length (m): its shortest wave, infinite for a plane.
    """

    lowest: float
    highest: float
    slope: float
    curvature: float
    third: float
    length: float


class Surface(Protocol):
    """A refracting surface z = s(x, y, t)."""

    @property
    def limits(self) -> SurfaceLimits:
        """What it keeps to everywhere."""
        ...

    def relief(self, xy: FloatArray, time: ArrayLike = 0.0) -> Relief:
        """Return its shape at places xy (..., 2) m, at times (...) s."""
        ...

    def covers(self, xy: FloatArray, time: ArrayLike = 0.0) -> BoolArray:
        """Tell where (...) it is known: everywhere, but that it has edges."""
        return np.ones(np.shape(xy)[:-1], dtype=bool)


def unit_direction(azimuth: ArrayLike) -> FloatArray:
    """Return the unit vectors (..., 2) of directions (...) rad, counted from x towards y."""
    angle = np.asarray(azimuth, dtype=float)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


@dataclass(frozen=True, kw_only=True)
class PlanarSurface(Surface):
    """z = level + slope . (x, y): `level` m at the origin, `slope` towards x and y; at rest."""

    level: float = 0.0
    slope: tuple[float, float] = (0.0, 0.0)

    @property
    def limits(self) -> SurfaceLimits:
        """What it keeps to: heights are unbounded where it is tilted."""
        steepness = float(np.hypot(*self.slope))
        low, high = (self.level, self.level) if steepness == 0.0 else (-np.inf, np.inf)
        return SurfaceLimits(lowest=low, highest=high, slope=steepness, curvature=0.0, third=0.0, length=np.inf)

    def relief(self, xy: FloatArray, time: ArrayLike = 0.0) -> Relief:
        """Return its shape at places xy (..., 2), the same at all times."""
        return Relief(
            height=self.level + xy @ np.array(self.slope),
            gradient=np.broadcast_to(self.slope, xy.shape),
            hessian=np.zeros((*xy.shape, 2)),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Gridded(Surface):
    """Heights (nx, ny) m over x (nx,) and y (ny,) m, ascending, at least four each; moving as a whole.

    The surface between is the interpolating bicubic spline, whose second derivatives are continuous. `velocity`
    (m/s) towards x and y, the phase speed of its waves, carries the whole along from where it was at time 0.
    Raises `ValueError` where the arrays do not fit. Outside the grid the surface is not known.
    """

    x: FloatArray
    y: FloatArray
    height: FloatArray
    velocity: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if self.height.shape != (len(self.x), len(self.y)):
            raise ValueError("heights of a gridded surface are one row per x, one column per y")
        if min(self.height.shape) < 4:
            raise ValueError("a gridded surface needs four nodes each way")
        if not all((np.diff(nodes) > 0.0).all() for nodes in (self.x, self.y)):
            raise ValueError("the nodes of a gridded surface ascend")
        if not np.isfinite(self.height).all():
            raise ValueError("a gridded surface has a height at every node")

    @cached_property
    def _spline(self) -> Any:
        from scipy.interpolate import RectBivariateSpline  # heavy

        return RectBivariateSpline(self.x, self.y, self.height, s=0)

    @cached_property
    def limits(self) -> SurfaceLimits:
        """What it keeps to, looked up between its nodes."""
        places = np.stack(np.meshgrid(_finer(self.x), _finer(self.y), indexing="ij"), axis=-1)
        relief = self.relief(places)
        low, high = float(relief.height.min()), float(relief.height.max())
        reserve = (_MARGIN - 1.0) * (high - low)
        interval = min(float(np.diff(nodes).min()) for nodes in (self.x, self.y))
        return SurfaceLimits(
            lowest=low - reserve,
            highest=high + reserve,
            slope=_MARGIN * float(np.linalg.norm(relief.gradient, axis=-1).max()),
            curvature=_MARGIN * float(np.abs(np.linalg.eigvalsh(relief.hessian)).max()),
            third=_MARGIN * _largest_third(places, relief.hessian),
            length=4.0 * interval,
        )

    def relief(self, xy: FloatArray, time: ArrayLike = 0.0) -> Relief:
        """Return its shape at places xy (..., 2) m, at times (...) s; outside the grid that of the edge."""
        x, y = self._still(xy, time)

        def by(i: int, j: int) -> FloatArray:
            return self._spline.ev(x, y, dx=i, dy=j)

        cross = by(1, 1)
        return Relief(
            height=by(0, 0),
            gradient=np.stack([by(1, 0), by(0, 1)], axis=-1),
            hessian=np.stack([np.stack([by(2, 0), cross], -1), np.stack([cross, by(0, 2)], -1)], -2),
        )

    def covers(self, xy: FloatArray, time: ArrayLike = 0.0) -> BoolArray:
        """Tell where (...) the grid is."""
        x, y = self._still(xy, time)
        return (x >= self.x[0]) & (x <= self.x[-1]) & (y >= self.y[0]) & (y <= self.y[-1])

    def _still(self, xy: FloatArray, time: ArrayLike) -> tuple[FloatArray, FloatArray]:
        shift = np.asarray(time, dtype=float)[..., None] * np.array(self.velocity)
        place = xy - shift
        return place[..., 0], place[..., 1]


def _finer(nodes: FloatArray) -> FloatArray:
    between = np.arange(_FINER) / _FINER
    return np.append((nodes[:-1, None] + np.diff(nodes)[:, None] * between).reshape(-1), nodes[-1])


def _largest_third(places: FloatArray, hessian: FloatArray) -> float:
    """Return a bound on third derivatives along any direction, from second ones (nx, ny, 2, 2) at places.

    Third derivatives of a cubic spline are constant between nodes along their axis: differences are exact there.
    """
    by_x = np.diff(hessian, axis=0) / np.diff(places[:, :1, 0], axis=0)[..., None, None]
    by_y = np.diff(hessian, axis=1) / np.diff(places[:1, :, 1], axis=1)[..., None, None]
    xxx, xxy = np.abs(by_x[..., 0, 0]).max(), np.abs(by_x[..., 0, 1]).max()
    yyy, xyy = np.abs(by_y[..., 1, 1]).max(), np.abs(by_y[..., 0, 1]).max()
    # of c^3 xxx + 3 c^2 s xxy + 3 c s^2 xyy + s^3 yyy over directions (c, s): Cauchy and Schwarz
    return float(np.sqrt(xxx**2 + 3.0 * xxy**2 + 3.0 * xyy**2 + yyy**2))
