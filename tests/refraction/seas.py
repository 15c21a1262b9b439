"""Water surfaces that the tests of waves share, one of every family."""

from dataclasses import dataclass

import numpy as np

from musatpy.refraction.surface import Gridded, PlanarSurface, Relief, Surface, SurfaceLimits
from musatpy.refraction.waves import Superposed, Trochoid, sinusoidal, stokes, superposed

SWELL = sinusoidal(amplitude=0.49, length=92.0, azimuth=0.5, speed=9.2, crest=7.0, level=0.3)
CHOP = sinusoidal(
    amplitude=[0.15, 0.05], length=[25.0, 13.0], azimuth=[0.9, -0.4], speed=[6.2, 4.5], crest=[6.0, 1.0]
)


def measured(interval: float = 3.0, velocity: tuple[float, float] = (5.0, 2.0)) -> Gridded:
    """Return swell and chop at time 0 as a grid of heights."""
    x, y = np.arange(-150.0, 150.0 + interval, interval), np.arange(-120.0, 120.0 + interval, interval)
    places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    return Gridded(x=x, y=y, height=superposed(SWELL, CHOP).relief(places).height, velocity=velocity)


SEAS: dict[str, Surface] = {
    "level": PlanarSurface(level=0.7),
    "tilted": PlanarSurface(level=-0.2, slope=(0.01, -0.02)),
    "sinusoidal": SWELL,
    "superposed": superposed(SWELL, CHOP),
    "stokes": stokes(amplitude=0.25, length=68.0, azimuth=0.5, speed=6.8, depth=5.0, crest=17.0),
    "trochoidal": Trochoid(amplitude=0.6, length=30.0, azimuth=-0.3, speed=6.8, crest=3.0, level=0.1),
    "gridded": measured(),
    "mixed": Superposed(
        surfaces=(
            PlanarSurface(level=0.2, slope=(0.01, 0.0)),
            CHOP,
            Trochoid(amplitude=0.4, length=40.0, azimuth=1.0),
        )
    ),
}


@dataclass(frozen=True)
class Tilted:
    """A surface turned about one of its places: there, its height stays and its gradient changes by `slope`."""

    surface: Surface
    about: np.ndarray
    slope: np.ndarray
    level: float = 0.0

    @property
    def limits(self) -> SurfaceLimits:
        return self.surface.limits

    def relief(self, xy, time=0.0) -> Relief:
        plain = self.surface.relief(xy, time)
        return Relief(
            height=plain.height + self.level + (xy - self.about) @ self.slope,
            gradient=plain.gradient + self.slope,
            hessian=plain.hessian,
        )

    def covers(self, xy, time=0.0):
        return self.surface.covers(xy, time)
