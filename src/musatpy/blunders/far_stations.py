"""Given stations, not observed, that are far from where the images say: wrong cards, labels, units."""

from __future__ import annotations

import numpy as np

from musatpy.adjustment.unknowns import State, given_minus
from musatpy.arrays import BoolArray, FloatArray
from musatpy.blunders.exchanges import FAR, exchanged_photos, flying_height
from musatpy.blunders.revisions import FEET
from musatpy.blunders.scene import Scene
from musatpy.model import Block, Cause, CauseKind, CoordinateSystem, Initial
from musatpy.units import DEGREE

_TURNED = 10.0 * DEGREE  # farther than any start value that serves
_SCALE = 0.05  # by which the extent of the stations may be off that of a foot
_MANY = 3  # stations have an extent


def misplaced(block: Block, scene: Scene, state: State) -> list[list[Cause]]:
    """Return what may be wrong with the given stations that were not observed, in groups of equal explanations."""
    photos = block.photos
    geographic = block.options.system is CoordinateSystem.GEOGRAPHIC
    control, station = ("CTG", "STA") if geographic else ("CTX", "STX")
    given = np.isfinite(np.concatenate([photos.position, photos.attitude], axis=1)).all(axis=1)
    if not given.any():
        return []
    difference = given_minus(photos, scene.network.frame, state.position, state.M, given)
    shift, turn = difference[:, :3], difference[:, 3:]
    height = flying_height(scene, state)
    observed = np.isfinite(photos.position_sigma).any(axis=1)
    far = np.linalg.norm(np.nan_to_num(shift), axis=1) / (FAR * height)
    far = np.where(observed, 0.0, far)
    turned = np.where(np.isfinite(photos.attitude_sigma).any(axis=1), 0.0, np.abs(np.nan_to_num(turn)).max(axis=1))
    if not ((far > 1.0) | (turned > _TURNED)).any():
        return []
    divisor = _unit(block, scene, state, given)
    if divisor:
        whose, cards = ("control", (control,)) if divisor > 0.0 else ("stations", (station,))
        advice = f"{whose} in feet, all else in metres: read the unit again"
        return [[Cause(kind=CauseKind.UNIT, cards=cards, component=whose, size=(FEET,), advice=advice)]]
    groups: list[list[Cause]] = []
    exchanged: set[int] = set()
    for pair in exchanged_photos(block, scene, state):
        if far[list(pair)].max() > 0.0:
            exchanged |= set(pair)
            ids = tuple(photos.ids[list(pair)].tolist())
            groups.append([_labels(ids, "station cards", (station, "ATT")), _labels(ids, "plate cards", ("PLT",))])
    worst = np.maximum(far, turned / _TURNED)
    for photo in np.argsort(-worst, kind="stable").tolist():
        if worst[photo] > 1.0 and photo not in exchanged and block.options.initial is not Initial.COMPUTE:
            groups.append([_start(str(photos.ids[photo]), shift[photo], turn[photo], far[photo] > 1.0, station)])
    return groups


def _unit(block: Block, scene: Scene, state: State, given: BoolArray) -> float:
    """Return 1 where the control is as if in feet, -1 where the stations are; 0 else."""
    if np.count_nonzero(given) < _MANY or block.options.system is not CoordinateSystem.LOCAL:
        return 0.0
    stations = scene.network.frame.working(block.photos.position[given])
    extent = [float(np.linalg.norm(place - place.mean(axis=0))) for place in (state.position[given], stations)]
    ratio = extent[0] / extent[1] if extent[1] > 0.0 else 0.0
    if abs(ratio / FEET - 1.0) < _SCALE:
        return 1.0
    return -1.0 if abs(ratio * FEET - 1.0) < _SCALE else 0.0


def _labels(ids: tuple[str, ...], which: str, cards: tuple[str, ...]) -> Cause:
    return Cause(
        kind=CauseKind.LABELS,
        cards=cards,
        photos=ids,
        component=which,
        advice=f"each stands where the card of the other one says: exchange the photo ids on the {which}",
    )


def _start(photo: str, shift: FloatArray, turn: FloatArray, far: bool, station: str) -> Cause:
    return Cause(
        kind=CauseKind.START,
        cards=(station,) if far else ("ATT",),
        photos=(photo,),
        component="position" if far else "angles",
        size=tuple((shift if far else turn / DEGREE).tolist()),
        unit="m" if far else "degrees",
        parameters=3,
        drop=0.0,
        advice="read the card again: the given values, from which the run starts, are far from what the images say",
    )
