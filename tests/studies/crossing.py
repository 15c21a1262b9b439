"""A section through a wave with every ray from one point under water: Okamoto (1982), Figure 7."""

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.refraction.all_refraction_points import search
from musatpy.refraction.stationary import RayEnds
from musatpy.refraction.surface import unit_direction
from musatpy.refraction.waves import Harmonic


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossing:
    """Along the wave and up (m): the surface over `along` (m,), the point `ground` (2,), the principal ray first.

    place (k, 2): refraction points; above (k, 2): further along their rays towards the camera; minimum (k,).
    """

    along: FloatArray
    height: FloatArray
    ground: FloatArray
    place: FloatArray
    above: FloatArray
    minimum: BoolArray


def crossing(wave: Harmonic, camera: FloatArray, ground: FloatArray, index: float, reach: float) -> Crossing:
    """Return the section along the direction of the first component, `reach` m to each side of a ground point (3,).

    The camera (3,) is to lie over the section: rays are shown turned into it.
    """
    direction = wave.vector[0] / np.linalg.norm(wave.vector[0])
    points = search(wave, RayEnds.of(camera, ground, index, 0.0))
    place = np.column_stack([points.xy, wave.relief(points.xy).height])
    back = camera - place
    above = place + back / back[:, 2:] * reach / 2.0
    middle = float(ground[:2] @ direction)
    along = np.linspace(middle - reach, middle + reach, 801)
    across = unit_direction(np.arctan2(direction[0], -direction[1]))
    side = float(ground[:2] @ across)
    height = wave.relief(along[:, None] * direction + side * across).height

    def flat(places: FloatArray) -> FloatArray:
        return np.column_stack([places[:, :2] @ direction, places[:, 2]])

    return Crossing(
        along=along,
        height=height,
        ground=flat(ground[None])[0],
        place=flat(place),
        above=flat(above),
        minimum=points.minimum,
    )
