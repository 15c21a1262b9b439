"""Blocks photographed through waves: images by Snell's law across the normal, by a root finder, in any axes."""

from dataclasses import replace

import numpy as np
from scipy.optimize import fsolve

from musatpy.model import Block
from musatpy.model.tables import taken
from musatpy.refraction.waves import Harmonic
from reference import networks
from reference.earth import earth_of
from reference.networks import Plan
from reference.rays import rotation

SHALLOWEST = -1.5  # m: points above are left out, a trough of the waves might leave them dry


def _through_waves(
    camera, ground, frame, height, tide, origin, axes, time, waves: Harmonic, n: float
) -> np.ndarray:
    """Return the vector to the incidence point: Snell's law across the normal, by a root finder, in any axes."""
    east_north, up = axes[:2], frame[2]

    def surface_point(ab: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        level = ground + ab @ frame[:2] + (tide - height) * up
        relief = waves.relief(east_north @ (level - origin), time)
        return level + float(relief.height) * up, up - relief.gradient @ east_north

    def snell(ab: np.ndarray) -> np.ndarray:
        W, m = surface_point(ab)
        a, b = (W - camera) / np.linalg.norm(W - camera), (ground - W) / np.linalg.norm(ground - W)
        return frame[:2] @ np.cross(m, a - n * b)

    gap = camera - ground
    slope = np.array([frame[0] @ gap, frame[1] @ gap]) / (up @ gap)
    ab, found, _, _ = fsolve(snell, (tide - height) * slope * 0.7, xtol=1e-11, full_output=True)
    assert np.abs(found["fvec"]).max() < 1e-10  # sines: no progress below their rounding is no failure
    return surface_point(ab)[0] - camera


def photographed(plan: Plan, waves: Harmonic, interval: float) -> tuple[Block, np.ndarray, np.ndarray, np.ndarray]:
    """Return a block with images through waves, without noise.

    And the times (n,), origin (3,) of the waves, and true points.
    """
    simulated = networks.simulate(plan)
    block, truth = simulated.block, simulated.truth
    earth = earth_of(block)
    native = {name: earth.native(getattr(truth, name)) for name in ("position", "points")}
    camera, ground = earth.cartesian(native["position"]), earth.cartesian(native["points"])
    frames = earth.frame(native["points"])
    camera_frames = earth.frame(earth.native(block.photos.position))  # attitudes are those at the given stations
    middle = native["points"][len(ground) // 2][None] * [1.0, 1.0, 0.0]
    origin, centre, axes = (of(middle)[0] for of in (earth.given, earth.cartesian, earth.frame))
    time = interval * np.arange(len(camera))
    xy = block.plates.xy.copy()
    wet = block.points.bathymetric[block.plates.point]
    deep = native["points"][block.plates.point, 2] < SHALLOWEST
    for row in np.flatnonzero(wet & deep):
        i, p = block.plates.photo[row], block.plates.point[row]
        v = _through_waves(
            camera[i], ground[p], frames[p], native["points"][p, 2], block.photos.tide[i], centre, axes, time[i],
            waves, block.water.index,
        )  # fmt: skip
        U, V, S = rotation(truth.attitude[i]) @ camera_frames[i] @ v
        f, pp = block.cameras.focal_length[0], block.cameras.principal_point[0]
        xy[row] = pp - f * np.array([U, V]) / S
    block = replace(block, plates=taken(replace(block.plates, xy=xy), ~wet | deep))
    return block, time, origin, truth.points
