"""Whole blocks: from what a job states to what the adjustment knows, and back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.errors import Problem
from musatpy.geometry.collinearity import orthogonal
from musatpy.geometry.systems import Geocentric, System
from musatpy.model import Block, CoordinateSystem, ReductionOptions, WaveOrigin
from musatpy.systems.sigmas import Findings, Owners, propagated
from musatpy.systems.statement import (
    Axes,
    Sigmas,
    Statement,
    attitudes_in,
    attitudes_out,
    own_statement,
    require_same_earth,
)

_ROUNDED = 1e-4  # elements of a matrix may be as far from those of a rotation as rounding on cards makes them


@dataclass(frozen=True, kw_only=True, eq=False)
class Stated:
    """A block whose positions, tides, attitudes (and sigmas, if so stated) are those of a statement."""

    block: Block
    matrices: FloatArray | None  # (n, 3, 3) reference axes to photo; None: the attitudes of the block
    warnings: tuple[Problem, ...] = ()


def entered(given: Stated, statement: Statement) -> tuple[Block, tuple[Problem, ...]]:
    """Return the job that the adjustment knows of a stated one, with warnings of what it cannot hold.

    The job is geographic, or local where the statement is. What is stated in metres and is no coordinate (bases,
    distances) stays as it is. Raises `SystemsError` with every reason.
    """
    block, system = given.block, statement.system
    photos, control = block.photos, block.control
    points = block.points.ids[control.point]
    require_same_earth(block, system)
    findings = Findings()
    _require_complete(system, photos.position, "photo", photos.ids, findings)
    _require_complete(system, control.position, "control point", points, findings)
    _require_level_heights(block, system, findings)
    angles = _angles_or_matrices(given, statement, findings)
    findings.stop()
    station, mark = level_of(system, photos.position), level_of(system, control.position)
    _tell_outside(system, np.concatenate([station, mark]), findings)
    turned = attitudes_in(statement, station, angles)
    _tell_lost(turned.lost, photos.ids, "omega and kappa", findings)
    sigmas = photos.position_sigma, photos.attitude_sigma, control.sigma
    if statement.sigmas is Sigmas.SYSTEM:
        by_station, by_mark = (np.asarray(np.linalg.inv(rates_at(system, at)), float) for at in (station, mark))
        sigmas = _restated(block, system, by_station, turned.partials, by_mark, findings)
    findings.stop()
    tide = photos.tide + np.where(np.isnan(photos.tide), np.nan, system.undulation(station))
    known = CoordinateSystem.LOCAL if system.ellipsoid is None else CoordinateSystem.GEOGRAPHIC
    job = _with(block, known, (station, turned.angles, mark, tide), sigmas)
    job = _with_origin(job, lambda place: level_of(system, place))
    job = replace(job, reduction=_with_ground(block, system, station - photos.position))
    return job, tuple(findings.warnings)


def stated(block: Block, statement: Statement) -> Stated:
    """Return a job of the adjustment, geographic, geocentric or local, as a statement has it.

    The option of the system becomes that in which the job would be adjusted: geographic for all that is neither
    geocentric nor local.
    Raises `SystemsError` with every reason.
    """
    system, photos, control = statement.system, block.photos, block.control
    require_same_earth(block, system)
    job_system, findings = own_statement(block).system, Findings()
    station, mark = level_of(job_system, photos.position), level_of(job_system, control.position)
    _require_complete(system, station, "photo", photos.ids, findings)
    _require_complete(system, mark, "control point", block.points.ids[control.point], findings)
    _require_level_heights(block, system, findings)
    findings.stop()
    _tell_outside(system, np.concatenate([station, mark]), findings)
    turned = attitudes_out(statement, station, photos.attitude)
    _tell_lost(turned.lost, photos.ids, "first and third angle", findings)
    sigmas = photos.position_sigma, photos.attitude_sigma, control.sigma
    if statement.sigmas is Sigmas.SYSTEM:
        rates = rates_at(system, station), turned.partials, rates_at(system, mark)
        sigmas = _restated(block, system, *rates, findings)
    findings.stop()
    places = coordinates_of(system, station), coordinates_of(system, mark)
    tide = photos.tide - np.where(np.isnan(photos.tide), np.nan, system.undulation(station))
    known = CoordinateSystem.GEOCENTRIC if isinstance(system, Geocentric) else CoordinateSystem.GEOGRAPHIC
    if system.ellipsoid is None:
        known = CoordinateSystem.LOCAL
    out = _with(block, known, (places[0], turned.angles, places[1], tide), sigmas)
    out = _with_origin(out, lambda place: coordinates_of(system, level_of(job_system, place)))
    out = replace(out, reduction=_with_ground(block, system, places[0] - station))
    matrices = turned.matrix if statement.form is None else None
    return Stated(block=out, matrices=matrices, warnings=tuple(findings.warnings))


def level_of(system: System, coordinates: FloatArray) -> FloatArray:
    """Return level coordinates (n, 3); what is not known stays so. Raises `SystemsError`."""
    return _where_known(system, system.level, coordinates)


def coordinates_of(system: System, level: FloatArray) -> FloatArray:
    """Return coordinates (n, 3) of level ones; what is not known stays so. Raises `SystemsError`."""
    return _where_known(system, system.coordinates, level)


def _where_known(system: System, function: Callable[[FloatArray], FloatArray], places: FloatArray) -> FloatArray:
    if system.plane_alone:
        return function(places)
    out, known = np.full(places.shape, np.nan), np.isfinite(places).all(axis=1)
    out[known] = function(places[known])
    return out


def _with_origin(block: Block, restated: Callable[[FloatArray], FloatArray]) -> Block:
    """Return a block with the origin of its waves, where there is one, in other coordinates."""
    if block.wave_origin is None:
        return block
    x, y, z = restated(np.array([block.wave_origin.position]))[0].tolist()
    return replace(block, wave_origin=WaveOrigin(position=(x, y, z)))


def _require_complete(system: System, places: FloatArray, kind: str, ids: TextArray, findings: Findings) -> None:
    """Refuse places of which too little is known to take them from the system, or into it."""
    known = np.isfinite(places)
    plane = known[:, :2].all(axis=1)
    if not system.plane_alone:
        torn = known.any(axis=1) & ~known.all(axis=1)
        findings.refuse(np.asarray(torn), kind, ids, f"all three coordinates are needed, {system.text}")
        return
    half = known[:, 0] != known[:, 1]
    findings.refuse(half, kind, ids, "one of two horizontal coordinates is missing")
    if not system.height_alone:
        why = f"its height needs its horizontal position, {system.text}"
        findings.refuse(known[:, 2] & ~plane, kind, ids, why)


def _require_level_heights(block: Block, system: System, findings: Findings) -> None:
    """Refuse, or warn of, heights that refer to a geoid in places that nobody knows before the adjustment."""
    if system.height_alone or system.plane_alone is False:
        return
    photos = block.photos
    nowhere = np.isfinite(photos.tide) & ~np.isfinite(photos.position[:, :2]).all(axis=1)
    findings.refuse(nowhere, "photo", photos.ids, f"its tide needs the position of the station, {system.text}")
    if len(block.height_differences.difference):
        message = f"height differences are those of ellipsoidal heights, and cannot be stated in {system.text}"
        findings.refused.append(Problem(message=message))
    if len(block.equal_elevations.point):
        findings.warn("equal elevations are equal ellipsoidal heights: the geoid is taken as level among them")


def _with_ground(block: Block, system: System, change: FloatArray) -> ReductionOptions | None:
    """Return the options of a reduction, the ground as much higher as the stations (n, 3) are on average.

    Beside geocentric coordinates its height is an ellipsoidal one, as in geographic jobs.
    """
    up = change[:, 2][np.isfinite(change[:, 2])]
    if block.reduction is None or isinstance(system, Geocentric) or not up.size:
        return block.reduction
    return replace(block.reduction, ground_height=block.reduction.ground_height + float(up.mean()))


def _angles_or_matrices(given: Stated, statement: Statement, findings: Findings) -> FloatArray:
    """Return the attitudes (n, 3), or rotations (n, 3, 3), that are stated; refuse what is none or has no axes."""
    photos = given.block.photos
    if statement.form is not None:
        out, known = photos.attitude, np.isfinite(photos.attitude).all(axis=1)
    else:
        matrices = np.asarray(given.matrices, dtype=float)
        if matrices.shape != (len(photos.ids), 3, 3):
            findings.refused.append(Problem(message="attitudes are stated as matrices, and none are given"))
            return np.full((len(photos.ids), 3, 3), np.nan)
        known = np.isfinite(matrices).all(axis=(1, 2))
        out, missed = np.full(matrices.shape, np.nan), np.zeros(len(matrices))
        out[known] = orthogonal(matrices[known])
        missed[known] = np.abs(matrices - out)[known].max(axis=(1, 2))  # of a mirror image about 2
        findings.refuse(
            missed > _ROUNDED, "photo", photos.ids, "its matrix is no rotation (right-handed, of unit rows)"
        )
    if statement.axes is not Axes.VERTICAL:
        nowhere = known & ~np.isfinite(photos.position).all(axis=1)
        findings.refuse(
            np.asarray(nowhere), "photo", photos.ids, "the axes of its attitude need the position of the station"
        )
    return out


def _tell_lost(lost: BoolArray, ids: TextArray, angles: str, findings: Findings) -> None:
    for name in ids[lost]:
        findings.warn(
            f"photo {name}: {angles} turn about one line (gimbal lock), one of them is set to zero", str(name)
        )


def _tell_outside(system: System, level: FloatArray, findings: Findings) -> None:
    number = int(np.count_nonzero(system.outside(level)))
    if number:
        findings.warn(
            f"{number} of the {len(level)} stations and control points lie outside the area of {system.text}",
            field="definition",
        )


def rates_at(system: System, level: FloatArray) -> FloatArray:
    """Return d(coordinates)/d(east, north, up) (n, 3, 3) at places of which not all need be known.

    An unknown height counts as 0, which changes the scale by a few parts in 10 000; where the horizontal position
    is unknown, so are its sigmas, and the rates are those of metres.
    """
    place = np.where(np.isnan(level), [np.nan, np.nan, 0.0], level)
    out, known = np.tile(np.eye(3), (len(level), 1, 1)), np.isfinite(place).all(axis=1)
    out[known] = system.jacobian(place[known])
    return out


def _restated(
    block: Block,
    system: System,
    by_station: FloatArray,
    by_angle: FloatArray,
    by_mark: FloatArray,
    findings: Findings,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the sigmas of station positions, attitudes and control by partials (., 3, 3)."""
    photos, control = block.photos, block.control
    station = Owners(kind="photo", ids=photos.ids, what="positions")
    turn = Owners(kind="photo", ids=photos.ids, what="attitudes")
    mark = Owners(kind="control point", ids=block.points.ids[control.point], what="coordinates")
    alone = system.plane_alone
    return (
        propagated(photos.position_sigma, by_station, station, alone, findings),
        propagated(photos.attitude_sigma, by_angle, turn, False, findings),
        propagated(control.sigma, by_mark, mark, alone, findings),
    )


def _with(
    block: Block,
    known: CoordinateSystem,
    values: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    sigmas: tuple[FloatArray, FloatArray, FloatArray],
) -> Block:
    """Return a block with other stations, attitudes, control and tides, and sigmas of the first three."""
    station, angles, mark, tide = values
    photos = replace(block.photos, position=station, attitude=angles, tide=tide)
    return replace(
        block,
        options=replace(block.options, system=known),
        photos=replace(photos, position_sigma=sigmas[0], attitude_sigma=sigmas[1]),
        control=replace(block.control, position=mark, sigma=sigmas[2]),
    )
