"""Initial values of the exposure stations from the plate coordinates and the control alone.

Pairs are oriented, joined to models, and these placed on the control; photos that no pair holds are resected from
known and intersected points; a robust adjustment of the whole block then takes the bends out of long strips.
Submerged points take part where their straight rays meet, with a small weight.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.placing import (
    MODEL,
    MOSAIC,
    Place,
    misfit,
    models_of,
    placed,
    resected,
    sights_of,
    typical_height,
)
from musatpy.adjustment.refinement import refined_stations
from musatpy.adjustment.unknowns import given_minus
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray, finite_rows
from musatpy.errors import AdjustmentError, Problem
from musatpy.geometry.rotations import attitude_from_matrix
from musatpy.model import Block, Initial, Photos
from musatpy.model.tables import Table, per_row
from musatpy.orientation.mosaic import mosaics
from musatpy.orientation.strips import Sights
from musatpy.units import DEGREE

GIVEN, NOT_FOUND = "given", ""  # how a photo was found, besides the names in `placing`

_MOSTLY = 0.7  # share of the photos of a mosaic that models must hold to be completed by resection
_MOST_SHIFT = 0.1  # of the flying height, and
_MOST_TURN = 5.0 * DEGREE  # a given value may be off; up to there adjustments start well
_NOMINAL = "too little is known to place the block: what nothing gives of its place, heading and scale is arbitrary"


@dataclass(frozen=True, kw_only=True, eq=False)
class InitialValues(Table):
    """The n photos of a block with what was found filled in, and how the given values compare with it."""

    photos: Photos  # NaN where nothing was found or given
    found: TextArray = per_row()  # (n,) "given", "model", "mosaic", "resection", "water", or empty
    difference: FloatArray = per_row(
        6
    )  # (n, 6) given minus computed: east, north, up m, angles rad; NaN where not both
    beyond: BoolArray = per_row()  # (n,) the difference is more than a tenth of the flying height, or 5 degrees
    problems: tuple[Problem, ...]  # photos that could not be found, each with its reason
    notes: tuple[str, ...]  # on photos found in an unusual way, and on a block that nothing places


def started(block: Block) -> tuple[Block, tuple[str, ...]]:
    """Return the block with the initial values that its options ask for, and warnings.

    Raises `AdjustmentError` with every photo whose initial values are neither given nor found.
    """
    if block.options.initial is Initial.GIVEN:
        return block, ()
    values = initial_photos(block)
    if block.options.initial is Initial.COMPUTE:
        if values.problems:
            raise AdjustmentError(values.problems)
        return replace(block, photos=values.photos), values.notes
    unchecked = np.flatnonzero(np.isnan(values.difference).any(axis=1))
    return block, (
        *(_disagreement(block, values, row) for row in np.flatnonzero(values.beyond).tolist()),
        *(f"photo {block.photos.ids[row]}: its given values could not be checked" for row in unchecked.tolist()),
    )


def _disagreement(block: Block, values: InitialValues, row: int) -> str:
    # z: no sign where it rounds to zero
    east, north, up = (f"{shift:z.0f} m" for shift in values.difference[row, :3])
    angles = ", ".join(f"{angle / DEGREE:z.1f}" for angle in values.difference[row, 3:])
    return (
        f"photo {block.photos.ids[row]}: the given station is {east} east, {north} north, {up} up, "
        f"and the given angles are {angles} degrees off what the plates and the control say"
    )


def initial_photos(block: Block) -> InitialValues:
    """Return the initial values of a block, computed unless its options say CHECK.

    A station with an observed component (one with a sigma) stays as given, and so does an observed angle; all else
    is computed, and stays as given only where that fails. With CHECK everything stays as given, and is only
    compared. The models are placed on the control and the observed stations, and on other given stations where
    these are too few. Raises `AdjustmentError` where the ellipsoid is unknown.
    """
    place = _found(block, sights_of(block))
    lost = np.flatnonzero((place.found == NOT_FOUND) & ~_given(block.photos))
    if lost.size and block.options.initial is Initial.COMPUTE:
        from musatpy.adjustment.through_water import oriented_through_water  # most jobs have no use for it

        place = oriented_through_water(block, place, lost)
    return _values(block, place, place.found != NOT_FOUND)


def _found(block: Block, sights: Sights) -> Place:
    """Return the places by joined models, or by the mosaic where that finds photos that the models do not."""
    joined = placed(block, sights, models_of(block, sights), MODEL)
    if (joined.found == MODEL).all():
        return _completed(block, sights, joined)
    flat = placed(block, sights, mosaics(sights), MOSAIC)
    by_models = np.count_nonzero(joined.found) >= _MOSTLY * np.count_nonzero(flat.found)
    first, second = (joined, flat) if by_models else (flat, joined)
    place = _completed(block, sights, first)
    if misfit(block, sights, place)[0] and (second.found != NOT_FOUND).any():
        both = sorted((place, _completed(block, sights, second)), key=lambda place: misfit(block, sights, place))
        place = _filled(block, *both)
    return place


def _filled(block: Block, place: Place, other: Place) -> Place:
    """Return the places with the photos that only the other ones have, refined again if there are any."""
    lost = (place.found == NOT_FOUND) & (other.found != NOT_FOUND)
    if not lost.any():
        return place
    filled = replace(
        place,
        C=np.where(lost[:, None], other.C, place.C),
        M=np.where(lost[:, None, None], other.M, place.M),
        found=np.where(lost, other.found, place.found),
    )
    return refined_stations(block, filled, typical_height(block, filled))


def _completed(block: Block, sights: Sights, place: Place) -> Place:
    """Return the places with single photos resected, refined as a whole."""
    place = resected(block, sights, place)
    if not (place.found != NOT_FOUND).any():
        return place
    return refined_stations(block, place, typical_height(block, place))


def _values(block: Block, place: Place, computed: BoolArray) -> InitialValues:
    photos, frame = block.photos, place.frame
    n = len(photos.ids)
    attitude = np.full((n, 3), np.nan)
    axes = frame.axes(place.C[computed])
    attitude[computed] = attitude_from_matrix(place.M[computed] @ np.swapaxes(axes, 1, 2))
    given = _given(photos)
    difference = given_minus(photos, frame, place.C, place.M, computed & given)
    new = computed if block.options.initial is not Initial.CHECK else np.zeros(n, dtype=bool)
    position = np.array(photos.position)
    moved = new & ~(np.isfinite(photos.position_sigma).any(axis=1) & finite_rows(photos.position))
    position[moved] = frame.system(place.C[moved])
    observed = np.isfinite(photos.attitude_sigma) & np.isfinite(photos.attitude)
    found = np.where(new, place.found, np.where(given, GIVEN, NOT_FOUND))
    with np.errstate(invalid="ignore"):
        beyond = np.linalg.norm(difference[:, :3], axis=1) > _MOST_SHIFT * typical_height(block, place)
        beyond |= (np.abs(difference[:, 3:]) > _MOST_TURN).any(axis=1)
    return InitialValues(
        photos=replace(
            photos, position=position, attitude=np.where(new[:, None] & ~observed, attitude, photos.attitude)
        ),
        found=found,
        difference=difference,
        beyond=beyond,
        notes=(*place.notes, *((_NOMINAL,) if place.nominal else ())),
        problems=_problems(photos, np.flatnonzero(found == NOT_FOUND), place),
    )


def _given(photos: Photos) -> BoolArray:
    """Return (n,) whether station and attitude are given."""
    return np.isfinite(np.concatenate([photos.position, photos.attitude], axis=1)).all(axis=1)


def _problems(photos: Photos, rows: IntArray, place: Place) -> tuple[Problem, ...]:
    """Return why photos were not found, those with one reason together."""
    alike: dict[str, list[str]] = {}
    for row in rows.tolist():
        alike.setdefault(place.reasons[row], []).append(photos.ids[row])
    return tuple(
        Problem(message=f"no initial values of {'photo' if len(ids) == 1 else 'photos'} {', '.join(ids)}: {reason}")
        for reason, ids in alike.items()
    )
