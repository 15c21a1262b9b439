"""Photos resected through the water from their control, where straight rays agree with no station."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from musatpy.adjustment.placing import NOT_FOUND, THROUGH_WATER, Place
from musatpy.arrays import FloatArray
from musatpy.geometry.rotations import attitude_matrix
from musatpy.model import Block, CoordinateSystem, PlaneTreatment, Treatment, WaterLevel

if TYPE_CHECKING:
    from musatpy.orientation.twomedia.sights import Plane, Sights

_FEWEST = 5  # points of two components at least, as the paper has it
_MOST_OUT = 3  # of these, one in so many may be in error


def resected_through_water(block: Block, place: Place) -> Place:
    """Return the places with photos that were not found, as far as their control fits refracted rays.

    The water is unknown as far as it is to the adjustment; a photo without submerged control stays as it is.
    """
    if block.water is None:
        return place
    for photo in np.flatnonzero(place.found == NOT_FOUND).tolist():
        station = _station(block, place, photo)
        if station is not None:
            C, M, found = place.C.copy(), place.M.copy(), place.found.copy()
            (C[photo], M[photo]), found[photo] = station, THROUGH_WATER
            place = replace(place, C=C, M=M, found=found)
    return place


def _station(block: Block, place: Place, photo: int) -> tuple[FloatArray, FloatArray] | None:
    """Return where a photo stands, and the matrix to it, both of the working axes; None where it cannot be told."""
    from musatpy.orientation.twomedia.oriented import OrientationError, orient  # few blocks need it
    from musatpy.orientation.twomedia.single import SINGLE_RAY

    axes = np.asarray(place.frame.axes(np.zeros(3)))
    sights, plane = _sights(block, place, photo, axes), _plane(block, place, photo)
    if len(sights.points) < _FEWEST or not sights.wet.any():
        return None
    try:
        with np.errstate(all="ignore"):  # trial planes are met that no ray reaches
            oriented = orient(sights, SINGLE_RAY, plane)
    except (OrientationError, np.linalg.LinAlgError):
        return None
    if not oriented.fits or _MOST_OUT * oriented.outliers.sum() > len(sights.points):
        return None
    return oriented.at.station[0] @ axes, attitude_matrix(oriented.at.attitude[0]) @ axes


def _sights(block: Block, place: Place, photo: int, axes: FloatArray) -> Sights:
    """Return the images of control on a photo, the control in level axes at the middle of the job."""
    from musatpy.orientation.twomedia.sights import Sights

    table, plates, cameras = block.control, block.plates, block.cameras
    given = np.array(table.position)
    if block.options.system is not CoordinateSystem.GEOCENTRIC:
        middle = place.frame.system(np.zeros(3))  # of what is not given, which is put to nothing again
        given = np.where(np.isfinite(given), given, middle)
    control = np.full((len(block.points.ids), 3), np.nan)
    control[table.point] = np.where(table.known, place.frame.working(given) @ axes.T, np.nan)
    sigma = np.zeros(control.shape)
    sigma[table.point] = np.where(np.isfinite(table.sigma) & ~table.fixed[:, None], table.sigma, 0.0)
    rows = np.flatnonzero((plates.photo == photo) & plates.triangulated & np.isfinite(plates.xy).all(axis=1))
    rows = rows[np.isfinite(control[plates.point[rows]]).sum(axis=1) >= 2]
    points, camera = plates.point[rows], block.photos.camera[photo]
    f = cameras.focal_length[camera]
    return Sights(
        photos=block.photos.ids[photo : photo + 1],
        points=block.points.ids[points],
        photo=np.zeros(len(rows), dtype=int),
        point=np.arange(len(rows)),
        image=(plates.xy[rows] - cameras.principal_point[camera]) / f,
        image_sigma=block.plate_sigmas[rows] / f,
        wet=block.points.bathymetric[points],
        control=control[points],
        control_sigma=sigma[points],
    )


def _plane(block: Block, place: Place, photo: int) -> Plane:
    """Return the water at a photo, over the level axes at the middle of the job."""
    from musatpy.orientation.twomedia.sights import Plane

    options, water = block.options, block.water
    assert water is not None
    treatment = PlaneTreatment.KNOWN if options.water_level is WaterLevel.KNOWN else PlaneTreatment.LEVEL
    if options.water_tilt is Treatment.ADJUST:
        treatment = PlaneTreatment.ADJUST
    tide = float(block.photos.tide[photo] - place.frame.height(np.zeros(3)))
    sigma = float(block.photos.tide_sigma[photo])
    return Plane(
        treatment=treatment,
        slope=(water.tilt_east or 0.0, water.tilt_north or 0.0),
        slope_sigma=water.tilt_sigma,
        level=tide if np.isfinite(tide) else None,
        level_sigma=sigma if np.isfinite(sigma) else None,
        index=water.index,
    )
