"""Initial values of single photos from their control under water, where straight rays agree with no station.

The water is a plane, unknown or known as the job has it: Okamoto and Mori (1974), (13).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.adjustment.initial import MOST_MISSED, THROUGH_WATER, UNHELD, PhotoPlaces, full_control
from musatpy.adjustment.iteration import WaterKnowledge, water_knowledge
from musatpy.adjustment.network import first_rows
from musatpy.arrays import IntArray
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.model import Block, PlaneTreatment, Refraction
from musatpy.model.tables import finite_rows
from musatpy.orientation.twomedia.methods import SINGLE_RAY
from musatpy.orientation.twomedia.oriented import OrientationError, Oriented, orient
from musatpy.orientation.twomedia.rays import PHOTO
from musatpy.orientation.twomedia.sights import Sights, WaterPlane

_STATION = slice(3, PHOTO)  # of the unknowns of a photo


def oriented_through_water(block: Block, place: PhotoPlaces, lost: IntArray) -> PhotoPlaces:
    """Return the places with those photos of `lost` (k,) that their control orients through the water."""
    if block.water is None or block.options.refraction is Refraction.NONE:
        return place
    axes, water = place.frame.axes(np.zeros(3)), water_knowledge(block)
    C, M, names = place.C.copy(), place.M.copy(), place.found.copy()
    reasons, notes = dict(place.reasons), list(place.notes)
    for photo in lost.tolist():
        sights = _sights(block, place, photo)
        if not sights.wet.any() or np.isnan(water.tide[photo]):
            continue
        tide = float(water.tide[photo]) - float(place.frame.height(np.zeros(3)))
        try:
            oriented = _oriented(sights, _plane(water, photo, tide))
        except OrientationError as error:
            reasons[photo] = f"{place.reasons[photo]}; through the water, {error}"
            continue
        C[photo] = oriented.at.station[0] @ axes
        M[photo] = attitude_matrix(oriented.at.attitude[0]) @ axes
        names[photo] = THROUGH_WATER
        notes.append(_note(oriented))
    return replace(place, C=C, M=M, found=names, reasons=reasons, notes=tuple(notes))


def _sights(block: Block, place: PhotoPlaces, photo: int) -> Sights:
    """Return the images of full control on a photo, in the level axes at the working origin."""
    plates, control, ground = block.plates, block.control, full_control(block, place)
    usable = plates.triangulated & np.isfinite(plates.xy).all(axis=1)
    rows = np.flatnonzero(usable & (plates.photo == photo) & finite_rows(ground[plates.point]))
    points, point = np.unique(plates.point[rows], return_inverse=True)
    card = first_rows(control.point, len(ground))[points]
    camera = block.photos.camera[photo]
    f = block.cameras.focal_length[camera]
    sigma = np.where(np.isnan(plates.sigma[rows]), block.options.plate_sigma, plates.sigma[rows])
    return Sights(
        photos=block.photos.ids[[photo]],
        points=block.points.ids[points],
        photo=np.zeros(len(rows), dtype=np.int64),
        point=point,
        image=(plates.xy[rows] - block.cameras.principal_point[camera]) / f,
        image_sigma=sigma / f,
        wet=block.points.bathymetric[points],
        control=ground[points] @ place.frame.axes(np.zeros(3)).T,
        control_sigma=np.where(control.fixed[card, None], 0.0, control.sigma[card]),
    )


def _plane(water: WaterKnowledge, photo: int, tide: float) -> WaterPlane:
    """Return the plane of the water at a photo as the job knows it, `tide` at the working origin."""
    level_unknown = bool(water.group[photo] >= 0)
    level_weight = float(water.level_weight[water.group[photo]]) if level_unknown else 0.0
    loose = PlaneTreatment.LEVEL if level_unknown else PlaneTreatment.KNOWN
    return WaterPlane(
        treatment=PlaneTreatment.ADJUST if water.tilt_unknown else loose,
        slope=(float(water.tilt[0]), float(water.tilt[1])),
        slope_sigma=_sigma(water.tilt_weight),
        level=tide,
        level_sigma=_sigma(level_weight),
        index=water.index,
        index_sigma=_sigma(water.index_weight),
        index_unknown=water.index_unknown,
    )


def _sigma(weight: float) -> float | None:
    return weight**-0.5 if weight else None


def _oriented(sights: Sights, plane: WaterPlane) -> Oriented:
    """Return the orientation. Raises `OrientationError` where points contradict it or do not hold the station."""
    with np.errstate(invalid="ignore"):  # of trials that make no sense
        oriented = orient(sights, SINGLE_RAY, plane)
    height = float(np.median(np.linalg.norm(oriented.points - oriented.at.station[0], axis=1)))
    error = float(np.linalg.norm(oriented.sigma[_STATION]))
    if oriented.sigma0 > MOST_MISSED or not error < UNHELD * height:
        raise OrientationError(f"{SINGLE_RAY.name}: no station agrees with the known points and is held by them")
    return oriented


def _note(oriented: Oriented) -> str:
    """Return how a photo was found, and the control that contradicts the rest."""
    sights = oriented.sights
    wrong = sights.points[oriented.outliers].tolist()
    without = f", without control {', '.join(wrong)}" if wrong else ""
    return (
        f"photo {sights.photos[0]}: straight rays agree with no station; "
        f"its initial values are those of its control through the water ({SINGLE_RAY.name}{without})"
    )
