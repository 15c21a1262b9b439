"""Plate reduction of a block: from its tables to readings and calibrations, and refined coordinates back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from musatpy.errors import DeckError, Problem
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.rotations import attitude_matrix
from musatpy.model import Block, CoordinateSystem, PlateMeasurements
from musatpy.reduction.distortion import Lens, Side
from musatpy.reduction.nadir import DOWN
from musatpy.reduction.pipeline import BlockReduction, reduce_block
from musatpy.reduction.readings import Calibration, Grid, MarkDistances, Plan, PlateReadings

FloatArray = NDArray[np.float64]


def reduce_plates(
    block: Block,
    plan: Plan,
    *,
    ground_height: float,
    side: Side,
    symmetry: Mapping[str, FloatArray] | None = None,
    distances: Mapping[str, MarkDistances] | None = None,
    reseaux: Mapping[str, Grid] | None = None,
) -> BlockReduction:
    """Return the reduction of all plates of a block whose plate coordinates and fiducials are comparator readings.

    `ground_height` (m) is of the ground or water that the photos show, `side` that of the cameras' distortion. What
    the block's tables do not have comes by camera id: principal points of best symmetry (2,) mm (those of
    autocollimation where not given), calibrated distances between marks, reseaux. Raises `DeckError` where the plan
    asks for the earth's curvature in a job that is not in a grid, or a distortion cannot be used.
    """
    if plan.curvature and block.options.system is not CoordinateSystem.LOCAL:
        message = f"earth curvature belongs to jobs in a grid, not to {block.options.system} ones"
        raise DeckError([Problem(message=message)])
    cameras = {}
    for row, name in enumerate(block.cameras.ids.tolist()):
        camera = _calibration(block, row, side, (symmetry or {}).get(name))
        cameras[name] = replace(camera, distances=(distances or {}).get(name), reseau=(reseaux or {}).get(name))
    plates = [_readings(block, row, ground_height) for row in range(len(block.photos.ids))]
    names = block.cameras.ids[block.photos.camera].tolist()
    return reduce_block(plates, cameras, dict(zip(block.photos.ids.tolist(), names, strict=True)), plan)


def refined(block: Block, reduction: BlockReduction, *, go_on: bool) -> Block:
    """Return the block with refined plate coordinates, one row for each point of a photo.

    Sigma and flag of a point are those of its first reading. Photos that were refused lose their plate coordinates
    where `go_on` says so; else they raise `DeckError`, each with its reason.
    """
    if reduction.refused and not go_on:
        raise DeckError(
            Problem(message=f"photo {plate.photo}: {plate.refusal.message}")
            for plate in reduction.refused
            if plate.refusal is not None
        )
    rows, xy = [], []
    for photo, plate in enumerate(reduction.plates):
        if plate.refusal is None:
            own = np.flatnonzero(block.plates.photo == photo)
            first = np.unique(plate.point_means.target, return_index=True)[1]
            rows.append(own[first])
            xy.append(plate.xy)
    kept = np.concatenate(rows) if rows else np.zeros(0, dtype=np.int64)
    order = np.argsort(kept)  # the order of the deck
    kept = kept[order]
    plates = PlateMeasurements(
        photo=block.plates.photo[kept],
        point=block.plates.point[kept],
        xy=(np.concatenate(xy) if xy else np.zeros((0, 2)))[order],
        sigma=block.plates.sigma[kept],
        triangulated=block.plates.triangulated[kept],
    )
    return replace(block, plates=plates)


def _calibration(block: Block, camera: int, side: Side, symmetry: FloatArray | None) -> Calibration:
    own = block.fiducials.camera == camera
    principal_point = block.cameras.principal_point[camera]
    return Calibration(
        focal_length=float(block.cameras.focal_length[camera]),
        principal_point=principal_point,
        mark_ids=block.fiducials.ids[own],
        marks=block.fiducials.xy[own],
        mark_sigma=block.fiducials.sigma[own],
        lens=_lens(block, camera, side, principal_point if symmetry is None else np.asarray(symmetry)),
    )


def _lens(block: Block, camera: int, side: Side, centre: FloatArray) -> Lens | None:
    """Return the distortion of a camera; None where the block has none."""
    own = block.distortion.camera == camera
    kinds, values = block.distortion.kind[own], block.distortion.values[own]
    name = block.cameras.ids[camera]
    if not own.any():
        return None
    found = {}
    for kind in ("RADL", "DCEN"):
        rows = values[kinds == kind]
        if len(rows) > 1:
            raise DeckError([Problem(message=f"camera {name} has {len(rows)} {kind} distortions")])
        found[kind] = np.nan_to_num(rows[0]) if len(rows) else np.zeros(3)
    table = values[kinds == "TABL"]
    table = table[np.argsort(table[:, 0], kind="stable")]
    try:
        return Lens(
            centre=centre,
            side=side,
            k=np.concatenate([[0.0], found["RADL"]]),
            p=found["DCEN"],
            radius=table[:, 0],
            radial=table[:, 1],
        )
    except ValueError as error:
        raise DeckError([Problem(message=f"camera {name}: {error}")]) from None


def _readings(block: Block, photo: int, ground_height: float) -> PlateReadings:
    marks = block.fiducial_measurements.photo == photo
    points = block.plates.photo == photo
    attitude = block.photos.attitude[photo]
    known = bool(np.isfinite(attitude).all())
    return PlateReadings(
        photo=str(block.photos.ids[photo]),
        mark_ids=block.fiducial_measurements.ids[marks],
        marks=block.fiducial_measurements.xy[marks],
        mark_sigma=block.fiducial_measurements.sigma[marks],
        point_ids=block.points.ids[block.plates.point[points]],
        point_sigma=block.plates.sigma[points],
        points=block.plates.xy[points],
        camera_height=_height(block, photo),
        ground_height=ground_height,
        nadir=attitude_matrix(attitude) @ DOWN if known else DOWN,  # without an attitude: as if vertical
    )


def _height(block: Block, photo: int) -> float:
    """Return the height (m) of an exposure station in the job's system, NaN where it is not given."""
    position = block.photos.position[photo]
    if block.options.system is not CoordinateSystem.GEOCENTRIC or not np.isfinite(position).all():
        return float(position[2]) if block.options.system is not CoordinateSystem.GEOCENTRIC else float("nan")
    spec = block.ellipsoid
    if spec is None:
        return float("nan")
    ellipsoid = Ellipsoid(spec.name, spec.semi_major_axis, spec.inverse_flattening)
    return float(ellipsoid.geographic(position)[2])
