"""Why a run has failed, for people: the observations most at odds with the last state, and what is not at rest."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.adjustment import sightings
from musatpy.adjustment.iteration import State
from musatpy.adjustment.kinds import SEARCHED
from musatpy.adjustment.kinds.kind import in_digits
from musatpy.adjustment.network import Network
from musatpy.arrays import FloatArray
from musatpy.geometry import collinearity
from musatpy.model import Block, WaterPass
from musatpy.model.tables import finite_rows
from musatpy.units import DEGREE

_AT_ODDS = 20.0  # sigmas: what fits better has not made the run fail
_MOST = 3  # that are named


def most_at_odds(block: Block, network: Network, state: State) -> tuple[str, ...]:
    """Return the worst observation of each kind, worst first, with its size: at most three, none that fits well."""
    misfits = [misfit for misfit in _misfits(block, network, state) if _AT_ODDS < misfit[0] < np.inf]
    misfits.sort(key=lambda misfit: -misfit[0])
    return tuple(f"{text} ({sigmas:.3g} sigmas)" for sigmas, text in misfits[:_MOST])


def _misfits(block: Block, network: Network, state: State) -> Iterator[tuple[float, str]]:
    """Yield the observation of each kind that fits least: its sigmas, and the text."""
    yield from _worst_image(block, network, state)
    for kind in SEARCHED:
        weight = kind.weights(network, block)
        if (weight > 0.0).any():
            off = kind.residuals(network, block, state)
            worst = _worst(off, weight)
            row, component = divmod(worst, off.shape[1])
            text = kind.misfit(block, network, row, component, abs(off[row, component]))
            yield _sigmas(off, weight, worst), text


def _worst_image(block: Block, network: Network, state: State) -> Iterator[tuple[float, str]]:
    """Yield the image whose ray is farthest off, by its angle: behind the camera no image can be compared."""
    rays = np.concatenate([group.rays.reshape(-1) for group in network.groups])
    rays = rays[finite_rows(state.ground[network.point[rays]])]
    if not len(rays):
        return
    photo, ground = network.photo[rays], state.ground[network.point[rays]]
    f, pp = network.focal_length[photo], network.principal_point[photo]
    seen = collinearity.in_front(ground - state.position[photo], state.M[photo])
    image = collinearity.image_vector(sightings.image_coordinates(network, state, rays, ground), f, pp)
    image = np.where(seen[:, None], image, -image)
    measured = collinearity.image_vector(network.xy[rays], f, pp)
    sine = np.linalg.norm(np.cross(image, measured), axis=1)
    angle = np.arctan2(sine, np.einsum("ri,ri->r", image, measured))
    weight = np.square(f) * network.weight[rays].mean(axis=1)
    row = _worst(angle, weight)
    names = f"point {block.points.ids[network.point[rays[row]]]} on photo {block.photos.ids[photo[row]]}"
    off = "is behind the camera" if not seen[row] else f"is {angle[row] / DEGREE:.3f} degrees off its ray"
    yield _sigmas(angle, weight, row), f"{names} {off}"


def _worst(off: FloatArray, weight: FloatArray) -> int:
    return int(np.argmax(np.nan_to_num(weight * np.square(off)).reshape(-1)))


def _sigmas(off: FloatArray, weight: FloatArray, row: int) -> float:
    return float(np.abs(off).reshape(-1)[row] * np.sqrt(weight.reshape(-1)[row]))


def unrest_of_water(block: Block, last: WaterPass) -> str:
    """Return what still moves after the last pass of the water point correction, which is not at rest."""
    points = block.points.ids
    if last.movement >= block.options.water_limit:
        return f"point {points[last.point]} still moves {in_digits(last.movement, 4)} m"
    if last.turning >= 0:
        return f"rays of point {points[last.turning]} still change between wet and dry"
    point, photo = points[block.plates.point[last.image]], block.photos.ids[block.plates.photo[last.image]]
    change = in_digits(last.image_change, 2)
    return f"the corrected image of point {point} on photo {photo} still changes by {change} sigmas"
