"""Where things are before any adjustment: plan positions, images put down on level ground."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import DeckError
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.geodesy import ellipsoid_by, frame_of
from musatpy.model import Block, CoordinateSystem
from musatpy.units import DEGREE


def plan(block: Block, system: FloatArray) -> FloatArray:
    """Return east and north (..., 2) of positions (..., 3): X, Y of local jobs, else degrees.

    Degrees are longitude and latitude. NaN where a position is not given as far as it is needed.
    """
    if block.options.system is CoordinateSystem.LOCAL:
        return system[..., :2]
    level = _level(block, system)
    return np.stack([level[..., 1], level[..., 0]], axis=-1) / DEGREE


def _level(block: Block, system: FloatArray) -> FloatArray:
    """Return positions (..., 3), of geocentric jobs as latitude, longitude, height; NaN where not known."""
    if block.options.system is not CoordinateSystem.GEOCENTRIC:
        return np.array(system)
    return ellipsoid_by(block.ellipsoid, block.options.system).geographic(system)


def ground_level(block: Block) -> float:
    """Return the height (m) that stands for the ground: the median of the control, or of the tides without any.

    Raises `DeckError` where a block has neither.
    """
    for heights in (_level(block, block.control.position)[:, 2], block.photos.tide):
        known = heights[np.isfinite(heights)]
        if known.size:
            return float(np.median(known))
    raise DeckError.of("the height of the ground follows from neither control nor tides: give it")


def images_on_ground(block: Block, height: float) -> FloatArray:
    """Return the positions (m, 3), in the job's system, of all images put down on level ground at `height` (m).

    By straight rays from the stations as given, in the level plane below each: approximate. NaN where a photo has
    no station or attitude, or a ray does not come down. Raises `DeckError` for readings, which say no direction.
    """
    if block.raw:
        message = "the plates are comparator readings (RED): where their points are is known only after a run"
        raise DeckError.of(message)
    frame, photos, plates = frame_of(block.options.system, block.ellipsoid), block.photos, block.plates
    known = np.asarray(np.isfinite(np.hstack([photos.position, photos.attitude])).all(axis=1))
    rays = np.flatnonzero(known[plates.photo])
    photo = plates.photo[rays]
    camera = photos.camera[photo]
    image = np.empty((len(rays), 3))
    image[:, :2] = plates.xy[rays] - block.cameras.principal_point[camera]
    image[:, 2] = -block.cameras.focal_length[camera]
    direction = np.einsum("rji,rj->ri", attitude_matrix(photos.attitude[photo]), image)
    station = frame.working(photos.position[photo])
    drop: FloatArray = np.atleast_1d(frame.height(station)) - height
    down = (direction[:, 2] < 0.0) & (drop > 0.0)
    rays, station, direction, drop = rays[down], station[down], direction[down], drop[down]
    below = direction * (drop / -direction[:, 2])[:, None]
    ground = np.full((len(plates.photo), 3), np.nan)
    ground[rays] = frame.system(station + np.einsum("rji,rj->ri", frame.axes(station), below))
    return ground


def near_control(blocks: list[Block], limit: float) -> list[tuple[int, str, int, str, float]]:
    """Return pairs of control points of two blocks, of different names, nearer to each other than `limit` m.

    Rows are block, point, block, point, distance in plan; those without horizontal positions are not compared. It
    is a hint only: what is near is not therefore the same.
    """
    from scipy.spatial.distance import cdist

    places = [_working_plan(block) for block in blocks]
    names = [block.points.ids[block.control.point].tolist() for block in blocks]
    pairs = []
    for first, second in combinations(range(len(blocks)), 2):
        distance = cdist(places[first], places[second])
        for a, b in np.argwhere(distance < limit).tolist():
            one, other = names[first][a], names[second][b]
            if one != other:
                pairs.append((first, one, second, other, float(distance[a, b])))
    return pairs


def _working_plan(block: Block) -> FloatArray:
    """Return control (k, 3) in working axes at height 0, so that distances are those in plan; NaN where unknown."""
    position = _level(block, block.control.position)
    position[:, 2] = 0.0
    return frame_of(block.options.system, block.ellipsoid).from_level(position)
