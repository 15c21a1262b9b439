"""The water of a job as the adjustment sees it: its surface over a ground point, and what of it is unknown."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.geometry.geodesy import Frame
from musatpy.model import Block, Program, Treatment, WaterLevel


@dataclass(frozen=True, kw_only=True, eq=False)
class WaterKnowledge:
    """What the deck says of the water, and which of it the adjustment is to find.

    Tides share corrections: one unknown for each of c groups of photos, observed once, as zero. Weights are
    1/sigma^2, 0 where there is no prior.
    """

    tide: FloatArray  # (n,) m, NaN where not given
    group: IntArray  # (n,) correction of the tide of each photo, -1 where it is known
    ids: TextArray  # (c,) names of the corrections
    per_photo: bool  # the corrections stand with the station unknowns, c = n, not in the border
    level_weight: FloatArray  # (c,) 1/m2
    tilt: FloatArray  # (2,) rad, slopes towards east and north
    tilt_weight: float
    tilt_unknown: bool
    index: float
    index_weight: float
    index_unknown: bool

    @property
    def unknown(self) -> bool:
        """True where anything of the water is unknown."""
        return bool(len(self.ids)) or self.tilt_unknown or self.index_unknown


def water_knowledge(block: Block) -> WaterKnowledge:
    """Return what is known of the water of a block; in IIA everything is."""
    options, photos, water = block.options, block.photos, block.water
    n = len(photos.ids)
    simultaneous = options.program is Program.IIIA and water is not None
    mode = options.water_level if simultaneous else WaterLevel.KNOWN
    group, ids = _level_groups(block, mode)
    return WaterKnowledge(
        tide=photos.tide,
        group=group,
        ids=ids,
        per_photo=mode is WaterLevel.PHOTO and n > 0,
        level_weight=_common_weights(photos.tide_sigma, group, len(ids)),
        tilt=np.array([(water.tilt_east or 0.0), (water.tilt_north or 0.0)]) if water else np.zeros(2),
        tilt_weight=_weight(water.tilt_sigma if water else None),
        tilt_unknown=simultaneous and options.water_tilt is Treatment.ADJUST,
        index=water.index if water else 1.0,
        index_weight=_weight(water.sigma if water else None),
        index_unknown=simultaneous and options.water_index is Treatment.ADJUST,
    )


def _level_groups(block: Block, mode: WaterLevel) -> tuple[IntArray, TextArray]:
    """Return which correction each tide has (n,), -1 for none, and the names of the corrections."""
    photos = block.photos
    n = len(photos.ids)
    if mode is WaterLevel.KNOWN:
        return np.full(n, -1), np.zeros(0, dtype=np.str_)
    if mode is WaterLevel.PHOTO:
        return np.where(np.isnan(photos.tide), -1, np.arange(n)), photos.ids
    if mode is WaterLevel.ONE:
        return np.where(np.isnan(photos.tide), -1, 0), np.array([""])
    labels = photos.tide_group if mode is WaterLevel.GROUP else photos.tide_day
    belongs = ~np.isnan(photos.tide) & (labels != "")
    ids, number = np.unique(labels[belongs], return_inverse=True)
    group = np.full(n, -1)
    group[belongs] = number
    return group, ids


def tide_groups(block: Block, known: BoolArray) -> Iterator[tuple[str, IntArray]]:
    """Yield the names and the photos of all, of the groups and of the days, where they are more than one."""
    photos = block.photos
    everyone = np.flatnonzero(known)
    if len(everyone) > 1:
        yield "", everyone
    for what, label in (("group", photos.tide_group), ("day", photos.tide_day)):
        for name in np.unique(label[known & (label != "")]).tolist():
            photo = np.flatnonzero(known & (label == name))
            if 1 < len(photo) < len(everyone):
                yield f"{what} {name}", photo


def is_considered(block: Block, water: WaterKnowledge) -> bool:
    """Return whether a tide, the tilt or the index has a sigma and is no unknown in `water`."""
    tides = (water.group < 0) & np.isfinite(block.photos.tide) & (block.photos.tide_sigma > 0.0)
    if block.water is None or tides.any():
        return bool(tides.any())
    tilt = not water.tilt_unknown and _weight(block.water.tilt_sigma)
    index = not water.index_unknown and _weight(block.water.sigma)
    return bool(tilt or index)


def _common_weights(sigma: FloatArray, group: IntArray, count: int) -> FloatArray:
    """Return the weights (c,) of corrections from the RMS of the sigmas that the tides of their photos have."""
    given = (group >= 0) & np.isfinite(sigma) & (sigma > 0.0)
    number = np.bincount(group[given], minlength=count)
    squares = np.bincount(group[given], weights=np.square(sigma[given]), minlength=count)
    return np.divide(number, squares, out=np.zeros(count), where=number > 0)


def _weight(sigma: float | None) -> float:
    return 0.0 if not sigma else 1.0 / sigma**2


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """The water surface over ground points: a plane, through the level surface that it is tilted against.

    normal (..., 3), depth (...) m of the ground point below it, along the normal; the two that follow are what
    `by_tilt` needs: the slope vector (..., 3) across the vertical, and 1/cos of the tilt (...).
    """

    normal: FloatArray
    depth: FloatArray
    gradient: FloatArray
    secant: FloatArray


def water_heights(slope: FloatArray, tide: FloatArray, ground: FloatArray) -> FloatArray:
    """Return the heights (...) of the water at ground points (..., 3), working, where tides (...) hold.

    `slope` (3,) is the slope vector in working axes; the surface turns about the working origin, which is the
    middle of the stations.
    """
    if not slope.any():
        return np.broadcast_to(tide, ground.shape[:-1])
    return tide + ground @ slope


def surface(frame: Frame, slope: FloatArray, tide: FloatArray, ground: FloatArray) -> Surface:
    """Return the water surface over ground points (..., 3) at tides (...)."""
    up, height = frame.vertical(ground)
    below = water_heights(slope, tide, ground) - height
    if not slope.any():
        level = np.broadcast_to(0.0, up.shape), np.broadcast_to(1.0, below.shape)  # which take no memory
        return Surface(normal=up, depth=below, gradient=level[0], secant=level[1])
    gradient = slope - up * (up @ slope)[..., None]
    secant = np.sqrt(1.0 + np.sum(np.square(gradient), axis=-1))
    return Surface(
        normal=(up - gradient) / secant[..., None], depth=below / secant, gradient=gradient, secant=secant
    )


def by_tilt(
    at: Surface, axis: FloatArray, ground: FloatArray, camera: FloatArray, v: FloatArray, by_camera: FloatArray,
    by_depth: FloatArray,
) -> FloatArray:  # fmt: skip
    """Return the partial derivative (..., 3) of v = W - C by the slope of the surface along `axis` (3,).

    The surface turns about the ground point by omega, which is the same as turning camera and water point back,
    and rises over it.
    """
    across = np.asarray(at.gradient @ axis)[..., None]
    secant = at.secant[..., None]
    up = secant * at.normal + at.gradient
    normal_by_slope = -(axis - up * (up @ axis)[..., None]) / secant - at.normal * across / secant**2
    omega = np.cross(at.normal, normal_by_slope)
    depth_by_slope = (ground @ axis)[..., None] / secant - at.depth[..., None] * across / secant**2
    back = np.einsum("...ij,...j->...i", by_camera, np.cross(omega, camera - ground))
    return np.cross(omega, v) - back + by_depth * depth_by_slope
