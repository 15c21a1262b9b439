"""Plate reduction of a block: from its tables to readings and calibrations, and refined coordinates back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import DeckError, PlatesError, Problem
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.rotations import attitude_matrix
from musatpy.model import Block, CoordinateSystem, PlateMeasurements
from musatpy.reduction.distortion import Lens, Side
from musatpy.reduction.fiducials import Reason
from musatpy.reduction.nadir import DOWN
from musatpy.reduction.pipeline import BlockReduction, PlateReduction, reduce_block
from musatpy.reduction.readings import Calibration, Grid, MarkDistances, Plan, PlateReadings
from musatpy.units import MICROMETRE


def reduce_plates(
    block: Block,
    plan: Plan,
    *,
    ground_height: float,
    side: Side,
    correction: bool = False,
    symmetry: Mapping[str, FloatArray] | None = None,
    k0: Mapping[str, float] | None = None,
    distances: Mapping[str, MarkDistances] | None = None,
    reseaux: Mapping[str, Grid] | None = None,
) -> BlockReduction:
    """Return the reduction of all plates of a block whose plate coordinates and fiducials are comparator readings.

    `ground_height` (m) is of the ground or water that the photos show, `side` that of the cameras' distortion;
    `correction`: its coefficients, not its tables, have the opposite sign. By camera id: principal points of best
    symmetry (2,) mm (those of autocollimation where not given), linear coefficients of the radial distortion,
    calibrated distances between marks, reseaux. Raises `DeckError` where the plan asks for the earth's curvature in
    a job that is not in a grid, or a distortion cannot be used.
    """
    if plan.curvature and block.options.system is not CoordinateSystem.LOCAL:
        message = f"earth curvature belongs to jobs in a grid, not to {block.options.system} ones"
        raise DeckError([Problem(message=message)])
    cameras = {}
    for row, name in enumerate(block.cameras.ids.tolist()):
        camera = _calibration(block, row)
        centre = (symmetry or {}).get(name, camera.principal_point)
        lens = _lens(block, row, side, np.asarray(centre), (k0 or {}).get(name, 0.0), -1.0 if correction else 1.0)
        between, reseau = (distances or {}).get(name), (reseaux or {}).get(name)
        cameras[name] = replace(camera, lens=lens, distances=between, reseau=reseau)
    plates = [_readings(block, row, ground_height) for row in range(len(block.photos.ids))]
    names = block.cameras.ids[block.photos.camera].tolist()
    return reduce_block(plates, cameras, dict(zip(block.photos.ids.tolist(), names, strict=True)), plan)


def refined(block: Block, reduction: BlockReduction, *, go_on: bool) -> Block:
    """Return the block with refined plate coordinates, one row for each point of a photo.

    Sigmas are those of the readings, taken through the reduction, missing where a reading has none; the flag is
    that of the first reading. Photos that were refused lose their plate coordinates where `go_on` says so; else
    they raise `PlatesError`, each with its reason and residuals. A photo without points has nothing to lose.
    """
    refused = {plate.photo: _refusal(plate) for plate in reduction.refused if len(plate.ids)}
    if refused and not go_on:
        why = {plate.photo: plate.refusal.reason for plate in reduction.refused if plate.refusal is not None}
        raise PlatesError(refused, by_heights=(photo for photo in refused if why[photo] is Reason.HEIGHTS))
    rows, xy, sigma = [], [], []
    for photo, plate in enumerate(reduction.plates):
        if plate.refusal is None:
            own = np.flatnonzero(block.plates.photo == photo)
            first = np.unique(plate.point_means.target, return_index=True)[1]
            rows.append(own[first])
            xy.append(plate.xy)
            unknown = np.isnan(block.plates.sigma[own])
            given = np.ones_like(plate.sigma, dtype=bool)
            np.logical_and.at(given, plate.point_means.target, ~unknown)
            sigma.append(np.where(given, plate.sigma, np.nan))
    kept = np.concatenate(rows) if rows else np.zeros(0, dtype=np.int64)
    order = np.argsort(kept)  # the order of the deck
    kept = kept[order]
    plates = PlateMeasurements(
        photo=block.plates.photo[kept],
        point=block.plates.point[kept],
        xy=(np.concatenate(xy) if xy else np.zeros((0, 2)))[order],
        sigma=(np.concatenate(sigma) if sigma else np.zeros((0, 2)))[order],
        triangulated=block.plates.triangulated[kept],
    )
    return replace(block, plates=plates)


def _refusal(plate: PlateReduction) -> str:
    """Return why a plate was refused, with the residuals that say so."""
    message = plate.refusal.message if plate.refusal else ""
    if plate.mark_distances is not None:
        off = (plate.mark_distances.residuals / MICROMETRE).tolist()
        told = ", ".join(f"{a} - {b} {v:.1f}" for (a, b), v in zip(plate.ends.tolist(), off, strict=True))
        return f"{message}; residuals of the distances in um: {told}"
    if plate.marks is None or not np.isfinite(plate.marks.residuals).any():
        return message
    pairs = zip(plate.marks.ids.tolist(), (plate.marks.residuals / MICROMETRE).tolist(), strict=True)
    told = ", ".join(f"{name} {x:.1f} {y:.1f}" for name, (x, y) in pairs)
    suspects = ", or ".join(plate.marks.suspects)
    without = f"; without mark {suspects} the others keep the limit" if suspects else ""
    return f"{message}{without}; residuals x y in um: {told}"


def _calibration(block: Block, camera: int) -> Calibration:
    own = block.fiducials.camera == camera
    return Calibration(
        focal_length=float(block.cameras.focal_length[camera]),
        principal_point=block.cameras.principal_point[camera],
        mark_ids=block.fiducials.ids[own],
        marks=block.fiducials.xy[own],
        mark_sigma=block.fiducials.sigma[own],
    )


def _lens(block: Block, camera: int, side: Side, centre: FloatArray, k0: float, sign: float) -> Lens | None:
    """Return the distortion of a camera, its coefficients times `sign`; None where the block has none."""
    own = block.distortion.camera == camera
    kinds, values = block.distortion.kind[own], block.distortion.values[own]
    name = block.cameras.ids[camera]
    if not own.any() and k0 == 0.0:
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
            k=sign * np.concatenate([[k0], found["RADL"]]),
            p=sign * found["DCEN"],
            radius=table[:, 0],
            radial=table[:, 1],
        )
    except ValueError as error:
        raise DeckError([Problem(message=f"camera {name}: {error}")]) from None


def _readings(block: Block, photo: int, ground_height: float) -> PlateReadings:
    marks = block.fiducial_measurements.photo == photo
    points = block.plates.photo == photo
    crosses = block.cross_measurements.photo == photo
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
        cross_ids=block.cross_measurements.ids[crosses],
        crosses=block.cross_measurements.xy[crosses],
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
    ellipsoid = Ellipsoid.of(spec)
    return float(ellipsoid.geographic(position)[2])
