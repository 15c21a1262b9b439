"""What an adjustment states no number of: points whose rays, and water of which the images, do not determine it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.adjustment.collinear import eliminate
from musatpy.adjustment.network import Network, Participation, PointGroup
from musatpy.adjustment.unknowns import State
from musatpy.arrays import BoolArray, FloatArray
from musatpy.model import Block
from musatpy.model.water import index_range

PART_OF_HEIGHT = 0.1  # of the flying height: a place or a level with a larger sigma is not known
FARTHEST = 100.0  # flying heights: a point of the adjustment that is farther has run away, and is rejected


@dataclass(frozen=True, kw_only=True, eq=False)
class Reach:
    """Lengths of rays: the `nearest` (p,) m of each point, and the flying height, which is their median."""

    nearest: FloatArray
    height: float


def reach_of(network: Network, state: State, part: Participation) -> Reach:
    """Return the lengths of the rays at `state`."""
    with np.errstate(invalid="ignore", over="ignore"):
        rays = np.linalg.norm(state.ground[network.point] - state.position[network.photo], axis=1)
    nearest = np.full(network.points, np.inf)
    np.fmin.at(nearest, network.point, rays)
    rays = rays[part.used & np.isfinite(rays)]
    return Reach(nearest=nearest, height=float(np.median(rays)) if len(rays) else np.inf)


def undetermined_points(
    network: Network, state: State, reach: Reach, covariance: FloatArray, kept_out: tuple[PointGroup, ...]
) -> dict[int, str]:
    """Return the points that their rays do not determine, with the reason: points with `covariance` (p, 3, 3) m2.

    The largest axis of their ellipsoid is above a tenth of the flying height, and that of the one by their rays
    and priors alone too, as if the stations were known: a weak datum is another matter.
    """
    limit = PART_OF_HEIGHT * reach.height
    wide = np.einsum("kii->k", covariance) > limit**2  # the sum of squares of the axes; NaN is not
    reasons = {}
    for group, taken in (*((group, True) for group in network.groups), *((group, False) for group in kept_out)):
        rows = wide[group.point]
        if not rows.any():
            continue
        inside = group.part(rows)
        with np.errstate(all="ignore"):
            by_rays = eliminate(network, state, inside).free_inverse
        for point, cofactor in zip(inside.point.tolist(), by_rays, strict=True):
            sizes = [_largest_axis(of) for of in (covariance[point], cofactor)]
            if min(sizes) > limit and not (taken and reach.nearest[point] > FARTHEST * reach.height):
                reasons[point] = f"its rays do not determine it: its ellipsoid is {sizes[0]:.0f} m long"
    return reasons


def _largest_axis(covariance: FloatArray) -> float:
    """Return the largest standard deviation in any direction, infinite where there is none."""
    if not np.isfinite(covariance).all():
        return np.inf
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))


def limits_of_water(block: Block, height: float) -> dict[str, float]:
    """Return the sigmas beyond which water is not determined, for rays of a `height`.

    Of a level a part of it, of a tilt that a flying height away, of an index the range that the liquid can have.
    """
    low, high = index_range(block.water.liquid if block.water else "")
    return {"level": PART_OF_HEIGHT * height, "tilt": PART_OF_HEIGHT, "index": high - low}


def undetermined_water(
    block: Block, network: Network, part: Participation, loose: BoolArray, sigmas: dict[str, FloatArray]
) -> dict[str, bool]:
    """Return the names of what is not determined, `loose` levels (c,) and whatever has no sigma, in words.

    With each, whether images depend on it: those of flagged points, on photos whose tide is known.
    """
    flagged = part.used & block.points.bathymetric[network.point]
    groups = network.water.group[network.photo[flagged]]
    seen = np.isin(np.arange(len(loose)), groups)
    noun = "photo " if network.water.per_photo else ""
    names = {
        f"the level of the water{f' of {noun}{network.water.ids[row]}' if network.water.ids[row] else ''}": bool(
            seen[row]
        )
        for row in np.flatnonzero(loose).tolist()
    }
    for name, of in (("the tilt of the water", "tilt"), ("the refractive index", "index")):
        if np.isnan(sigmas[of]).any():
            names[name] = bool(flagged.any())
    return names
