"""The plates of a block of readings: reduced as its cards ask for it, and the block with refined coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from musatpy import model
from musatpy.errors import DeckError, PlatesError
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model.tables import taken
from musatpy.reduction.displacements import DOWN, Model
from musatpy.reduction.distortion import Lens, Side
from musatpy.reduction.fiducials import FiducialLimits, Reason
from musatpy.reduction.planar import Comparator, PlanarKind
from musatpy.reduction.plate_steps import PlateReduction, reduce_plate
from musatpy.reduction.readings import Calibration, Grid, MarkDistances, PlateReadings, ReductionPlan
from musatpy.units import MICROMETRE

_AXES = {False: ("X", "Y"), True: ("D1", "D2")}  # of side marks, of corner marks


def reduction_of(block: model.Block) -> tuple[PlateReduction, ...]:
    """Return the reduction of all plates of a block of readings, as its cards ask for it.

    Raises `DeckError` where they ask for the earth's curvature in a job that is not in a grid, or the calibrations
    of a camera contradict each other.
    """
    options = block.reduction or model.ReductionOptions()
    plan = _plan(options, block.comparator)
    if plan.curvature and block.options.system is not model.CoordinateSystem.LOCAL:
        raise DeckError.of(f"earth curvature belongs to jobs in a grid, not to {block.options.system} ones")
    cameras = [_calibration(block, row, options) for row in range(len(block.cameras.ids))]
    plates = [_readings(block, row, options.ground_height) for row in range(len(block.photos.ids))]
    return tuple(
        reduce_plate(plate, cameras[row], plan)
        for plate, row in zip(plates, block.photos.camera.astype(int).tolist(), strict=True)
    )


def _plan(options: model.ReductionOptions, spec: model.ComparatorSpec | None) -> ReductionPlan:
    kinds = {model.Transformation.NONE: None, model.Transformation.DISTANCES: PlanarKind.AFFINE}
    chosen = options.transformation
    atmosphere = None if options.atmosphere is model.Atmosphere.NONE else Model(options.atmosphere.value)
    plan = ReductionPlan(
        fiducials=kinds[chosen] if chosen in kinds else PlanarKind(chosen.value),
        limits=FiducialLimits(residual=_limit(options.residual_limit)),
        refraction=atmosphere,
        curvature=options.curvature is model.Curvature.YES,
    )
    if spec is None:
        return plan
    comparator = Comparator(
        scale=(spec.scale_u, spec.scale_v),
        non_orthogonality=spec.non_orthogonality,
        rotation=spec.rotation,
        left_handed=spec.left_handed,
    )
    limit = _limit(spec.repeat_limit)
    return replace(plan, comparator=comparator, reading_sigma=spec.reading_sigma, repeat_limit=limit)


def _limit(given: float) -> float:
    return given if np.isfinite(given) else float("inf")


def refined(block: model.Block, reductions: Sequence[PlateReduction], *, go_on: bool) -> model.Block:
    """Return the block with refined plate coordinates, one row for each point of a photo.

    Sigmas are those of the readings, taken through the reduction, missing where a reading has none; the flag is
    that of the first reading. Photos that were refused lose their plate coordinates where `go_on` says so; else
    they raise `PlatesError`, each with its reason and residuals. A photo without points has nothing to lose.
    """
    refused = {plate.photo: plate.refusal for plate in reductions if plate.refusal is not None and len(plate.ids)}
    if refused and not go_on:
        messages = {plate.photo: _refusal(plate) for plate in reductions if plate.photo in refused}
        heights = (photo for photo, refusal in refused.items() if refusal.reason is Reason.HEIGHTS)
        raise PlatesError(messages, by_heights=heights)
    rows, xy, sigma = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 2))], [np.zeros((0, 2))]
    for photo, plate in enumerate(reductions):
        if plate.refusal is None:
            readings = np.flatnonzero(block.plates.photo == photo)
            rows.append(readings[np.unique(plate.point_means.target, return_index=True)[1]])
            xy.append(plate.xy)
            given = np.ones_like(plate.sigma, dtype=bool)
            np.logical_and.at(given, plate.point_means.target, ~np.isnan(block.plates.sigma[readings]))
            sigma.append(np.where(given, plate.sigma, np.nan))
    kept = np.concatenate(rows)
    order = np.argsort(kept)  # the order of the deck
    plates = taken(block.plates, kept[order])
    return replace(block, plates=replace(plates, xy=np.concatenate(xy)[order], sigma=np.concatenate(sigma)[order]))


def _refusal(plate: PlateReduction) -> str:
    """Return why a plate was refused, with the residuals that say so."""
    message = plate.refusal.message if plate.refusal else ""
    if plate.mark_distances is not None:
        pairs = zip(plate.ends.tolist(), (plate.mark_distances.residuals / MICROMETRE).tolist(), strict=True)
        residuals = ", ".join(f"{a} - {b} {v:.1f}" for (a, b), v in pairs)
        return f"{message}; residuals of the distances in um: {residuals}"
    if plate.marks is None or not np.isfinite(plate.marks.residuals).any():
        return message
    marks = zip(plate.marks.ids.tolist(), (plate.marks.residuals / MICROMETRE).tolist(), strict=True)
    residuals = ", ".join(f"{name} {x:.1f} {y:.1f}" for name, (x, y) in marks)
    suspects = ", or ".join(plate.marks.suspects)
    without = f"; without mark {suspects} the others keep the limit" if suspects else ""
    return f"{message}{without}; residuals x y in um: {residuals}"


def _calibration(block: model.Block, camera: int, options: model.ReductionOptions) -> Calibration:
    """Return what the cards of a camera (a row) say. Raises `DeckError` where they contradict each other."""
    fiducials = block.fiducials.camera == camera
    has_plates = (block.photos.camera[block.plates.photo] == camera).any()
    by_distances = options.transformation is model.Transformation.DISTANCES and has_plates
    return Calibration(
        focal_length=float(block.cameras.focal_length[camera]),
        principal_point=block.cameras.principal_point[camera],
        mark_ids=block.fiducials.ids[fiducials],
        marks=block.fiducials.xy[fiducials],
        mark_sigma=block.fiducials.sigma[fiducials],
        distances=_distances(block, camera) if by_distances else None,
        reseau=_reseau(block, camera),
        lens=None
        if camera in block.lens_unknowns.of(model.LENS_PARAMETERS).camera
        else lens_of(block, camera, options),
    )


def _distances(block: model.Block, camera: int) -> MarkDistances:
    """Return the calibrated distances of a camera; raises `DeckError` for one without its axes."""
    table = block.mark_distances
    rows = np.flatnonzero(table.camera == camera)
    pairs = {table.axis[row]: tuple(table.marks[row].tolist()) for row in rows.tolist()}
    corners = next((corners for corners, axes in _AXES.items() if set(axes) <= set(pairs)), None)
    if corners is None:
        message = "no distances along both axes (X and Y), or along both diagonals (D1 and D2)"
        raise DeckError.of(f"camera {block.cameras.ids[camera]} has {message}")
    first, second = (pairs[axis] for axis in _AXES[corners])
    return MarkDistances(
        ends=table.marks[rows],
        distance=table.distance[rows],
        sigma=table.sigma[rows],
        first=first,
        second=second,
        corners=corners,
    )


def _reseau(block: model.Block, camera: int) -> Grid | None:
    """Return the calibrated reseau of a camera, in the grid of its rows and columns; None where it has none."""
    table = block.reseau
    crosses = np.flatnonzero(table.camera == camera)
    if not crosses.size:
        return None
    row, column = ((places[crosses] - places[crosses].min()).astype(int) for places in (table.row, table.column))
    shape = (int(row.max()) + 1, int(column.max()) + 1)
    ids, xy = np.full(shape, "", dtype=table.ids.dtype), np.full((*shape, 2), np.nan)
    ids[row, column], xy[row, column] = table.ids[crosses], table.xy[crosses]
    return Grid(ids=ids, xy=xy)


def lens_of(block: model.Block, camera: int, options: model.ReductionOptions) -> Lens | None:
    """Return the distortion of a camera, of its principal point where no other is given; None where it has none."""
    rows = block.distortion.camera == camera
    kinds, values = block.distortion.kind[rows], block.distortion.values[rows]
    name = block.cameras.ids[camera]
    centre, k0, zero = block.cameras.principal_point[camera], 0.0, 0.0
    for row in np.flatnonzero(block.lenses.camera == camera):
        k0, zero = np.nan_to_num([block.lenses.k0[row], block.lenses.zero_radius[row]]).tolist()
        if np.isfinite(block.lenses.centre[row]).all():
            centre = block.lenses.centre[row]
    if not rows.any() and k0 == zero == 0.0:
        return None
    sign = -1.0 if options.polynomials is model.Polynomials.CORRECTION else 1.0
    coefficients = {}
    for kind in ("RADL", "DCEN"):
        given = values[kinds == kind]
        if len(given) > 1:
            raise DeckError.of(f"camera {name} has {len(given)} {kind} distortions")
        coefficients[kind] = np.nan_to_num(given[0]) if len(given) else np.zeros(3)
    table = values[kinds == "TABL"]
    table = table[np.argsort(table[:, 0], kind="stable")]
    try:
        return Lens(
            centre=centre,
            side=Side(options.side.value),
            k=sign * np.concatenate([[k0], coefficients["RADL"]]),
            zero=zero,
            p=sign * coefficients["DCEN"],
            radius=table[:, 0],
            radial=table[:, 1],
        )
    except ValueError as error:
        raise DeckError.of(f"camera {name}: {error}") from None


def _readings(block: model.Block, photo: int, ground_height: float) -> PlateReadings:
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


def _height(block: model.Block, photo: int) -> float:
    """Return the height (m) of an exposure station in the job's system, NaN where it is not given."""
    position = block.photos.position[photo]
    if block.options.system is not model.CoordinateSystem.GEOCENTRIC:
        return float(position[2])
    if block.ellipsoid is None or not np.isfinite(position).all():
        return float("nan")
    return float(Ellipsoid.of(block.ellipsoid).geographic(position)[2])
