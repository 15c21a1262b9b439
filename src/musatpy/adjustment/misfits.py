"""What fits least when a run has failed: the observations most at odds with the last state, named for people."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from musatpy.adjustment import sightings
from musatpy.adjustment.direct import air_bases, distances, height_differences, level_corrections, station_deviation
from musatpy.adjustment.ground import prior_rows
from musatpy.adjustment.network import Network
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray
from musatpy.geometry import collinearity
from musatpy.model import Block
from musatpy.units import DEGREE

_AT_ODDS = 20.0  # sigmas: what fits better has not made the run fail
_MOST = 3  # that are named
_COMPONENTS = ("east", "north", "up")
_ANGLES = ("X-tilt", "Y-tilt", "heading")


@dataclass(frozen=True, kw_only=True)
class Misfit:
    """The observation of one kind that fits least."""

    sigmas: float
    text: str


def most_at_odds(block: Block, network: Network, state: State) -> tuple[str, ...]:
    """Return the worst observation of each kind, worst first, with its size: at most three, none that fits well."""
    found = [one for one in _misfits(block, network, state) if np.isfinite(one.sigmas) and one.sigmas > _AT_ODDS]
    found.sort(key=lambda one: -one.sigmas)
    return tuple(f"{one.text} ({one.sigmas:.3g} sigmas)" for one in found[:_MOST])


def _misfits(block: Block, network: Network, state: State) -> Iterator[Misfit]:
    yield from _worst_image(block, network, state)
    yield from _worst_control(block, network, state)
    yield from _worst_station(block, network, state)
    photos, points = block.photos.ids, block.points.ids
    if len(network.base_length):
        length, _ = air_bases(network, state)
        off = length - network.base_length
        row = _worst(off, network.base_weight)
        one, other = photos[network.base_photo[row]]
        text = f"the air base of photos {one} and {other} is off by {abs(off[row]):.2f} m"
        yield _misfit(off, network.base_weight, row, text)
    kept, ties = network.border.kept, network.ties
    for rows, ends, name in (
        (distances, ties.distance, "distance"),
        (height_differences, ties.rise, "height difference"),
    ):
        if len(ends):
            found = rows(network, state)
            row = _worst(found.deviation, found.weight)
            one, other = points[kept[ends[row]]]
            text = f"the {name} of points {one} and {other} is off by {abs(found.deviation[row]):.2f} m"
            yield _misfit(found.deviation, found.weight, row, text)
    if len(network.water.ids):
        off = level_corrections(network, state)
        row = _worst(off, network.water.level_weight)
        named = f" {network.water.ids[row]}" if network.water.ids[row] else ""
        text = f"the water level{named} is {abs(off[row]):.2f} m off its tide"
        yield _misfit(off, network.water.level_weight, row, text)


def _worst_image(block: Block, network: Network, state: State) -> Iterator[Misfit]:
    """Yield the image whose ray is farthest off, by its angle: behind the camera no image can be compared."""
    rays = np.concatenate([group.rays.reshape(-1) for group in network.groups])
    rays = rays[np.isfinite(state.ground[network.point[rays]]).all(axis=1)]
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
    yield _misfit(angle, weight, row, f"{names} {off}")


def _worst_control(block: Block, network: Network, state: State) -> Iterator[Misfit]:
    """Yield the component of a control point, and the point of equal elevation, farthest from what is given."""
    groups = [group for group in network.groups if group.known]
    if not groups:
        return
    point = np.concatenate([group.point for group in groups])
    point = point[np.isfinite(state.ground[point]).all(axis=1)]
    rows = prior_rows(network, state, point, state.ground[point])
    for part in (slice(0, 3), slice(3, 4)):
        off, weight = rows.deviation[:, part], rows.weight[:, part]
        if not (weight > 0.0).any():
            continue
        row, component = np.unravel_index(_worst(off, weight), off.shape)
        size, ident = abs(off[row, component]), block.points.ids[point[row]]
        if off.shape[1] == len(_COMPONENTS):
            text = f"control point {ident} is {size:.2f} m off in {_COMPONENTS[component]}"
        else:
            text = f"point {ident} is {size:.2f} m off its equal elevation"
        yield _misfit(off, weight, int(row) * off.shape[1] + int(component), text)


def _worst_station(block: Block, network: Network, state: State) -> Iterator[Misfit]:
    """Yield the observed component of a station, and the observed angle, farthest from what is given."""
    deviation = station_deviation(network, state)
    for part, weight, names, unit in (
        (slice(0, 3), network.position_weight, _COMPONENTS, "m"),
        (slice(3, 6), network.attitude_weight, _ANGLES, "degrees"),
    ):
        off = deviation[:, part]
        if not (weight > 0.0).any():
            continue
        photo, component = np.unravel_index(_worst(off, weight), off.shape)
        size = abs(off[photo, component]) / (DEGREE if unit == "degrees" else 1.0)
        what = "station" if unit == "m" else "attitude"
        text = (
            f"the observed {what} of photo {block.photos.ids[photo]} is {size:.2f} {unit} off in {names[component]}"
        )
        yield _misfit(off, weight, int(photo) * 3 + int(component), text)


def _worst(off: FloatArray, weight: FloatArray) -> int:
    return int(np.argmax(np.nan_to_num(weight * np.square(off)).reshape(-1)))


def _misfit(off: FloatArray, weight: FloatArray, row: int, text: str) -> Misfit:
    return Misfit(sigmas=float(np.abs(off).reshape(-1)[row] * np.sqrt(weight.reshape(-1)[row])), text=text)
