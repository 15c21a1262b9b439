"""Sigmas in other words, and the correlations that are lost on the way because cards have sigmas only.

Whole blocks: from what a job states to what the adjustment knows, and back.

What an adjustment found, as a statement has it, with its covariances.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.errors import Problem, SystemsError
from musatpy.geometry.body import BodyAngles, body_angles, body_matrix
from musatpy.geometry.collinearity import in_axes, orthogonal, wrapped
from musatpy.geometry.systems import Geocentric, MapFactors, System
from musatpy.model import Block, CoordinateSystem, ReductionOptions, Solution, WaveOrigin
from musatpy.model.block import with_tables
from musatpy.model.correlations import on_cards
from musatpy.systems.statement import (
    Axes,
    Sigmas,
    Statement,
    attitudes_in,
    attitudes_out,
    own_statement,
    require_same_earth,
)

MOST = 0.1  # correlation: a weight is a hundredth too small where it is left out
_WORTH_SAYING = 0.005


@dataclass
class Findings:
    """What is wrong, and what is worth saying, gathered so that every reason is told at once."""

    refused: list[Problem] = field(default_factory=list)
    warnings: list[Problem] = field(default_factory=list)

    def refuse(self, rows: BoolArray, kind: str, ids: TextArray, why: str) -> None:
        """Refuse each of the (n,) rows by its kind and name, which is `found` in the problem."""
        for name in ids[rows]:
            self.refused.append(Problem(message=f"{kind} {name}: {why}", found=str(name)))

    def warn(self, message: str, found: str | None = None, field: str | None = None) -> None:
        """Say something that stops nothing, of the photo or point `found` or a `field` of the spec if of one."""
        self.warnings.append(Problem(message=message, severity="warning", found=found, field=field))

    def stop(self) -> None:
        """Raise `SystemsError` if anything was refused."""
        if self.refused:
            raise SystemsError(self.refused)


@dataclass(frozen=True, kw_only=True, eq=False)
class Owners:
    """Whose sigmas they are."""

    kind: str
    ids: TextArray  # (n,)
    what: str  # positions, attitudes


def propagated(
    sigma: FloatArray, partials: FloatArray, owners: Owners, plane_alone: bool, findings: Findings
) -> FloatArray:
    """Return the sigmas (n, 3) of what depends on uncorrelated values of these sigmas (n, 3) by partials (n, 3, 3).

    A sigma that is not a number stays none: the first two together, and all three unless `plane_alone`. What would
    be correlated by more than 0.1 is refused, because a job holds no correlations; less is left out, and said.
    """
    missing: BoolArray = np.asarray(np.isnan(sigma))
    some, all_three = np.any(missing, axis=1, keepdims=True), np.all(missing, axis=1, keepdims=True)
    torn = (some & ~all_three)[:, 0]
    if plane_alone:
        torn = missing[:, 0] != missing[:, 1]
    why = f"some of the sigmas of its {owners.what} are not given, and the others cannot be restated without them"
    findings.refuse(np.asarray(torn), owners.kind, owners.ids, why)
    variance = np.where(missing, 0.0, sigma) ** 2
    used = np.where(all_three[:, :, None], 0.0, partials)
    covariance = np.einsum("nij,nj,nkj->nik", used, variance, used)
    out = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    scale = out[:, :, None] * out[:, None, :]
    correlation = np.divide(covariance, scale, out=np.zeros_like(covariance), where=scale > 0.0)
    largest = np.abs(correlation - correlation * np.eye(3)).max(axis=(1, 2), initial=0.0)
    what = "has to be stated (CTC)" if owners.what == "coordinates" else "no job can hold"
    why = f"the sigmas of its {owners.what} would be correlated by more than {MOST}, which {what}"
    findings.refuse(np.asarray(largest > MOST), owners.kind, owners.ids, why)
    most = float(largest.max(initial=0.0))
    if _WORTH_SAYING < most <= MOST:
        findings.warn(f"correlations of up to {most:.3f} between the sigmas of {owners.what} are left out")
    gone = missing.copy()
    gone[:, :2] |= np.any(missing[:, :2], axis=1, keepdims=True)
    if not plane_alone:
        gone |= some
    return np.where(gone, np.nan, out)


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
    points, tables = block.points.ids[control.point], _tables_of_places(block)
    require_same_earth(block, system)
    findings = Findings()
    _require_complete(system, photos.position, "photo", photos.ids, findings)
    _require_complete(system, control.position, "control point", points, findings)
    _require_level_heights(block, system, findings)
    angles = _angles_or_matrices(given, statement, findings)
    findings.stop()
    station = level_of(system, photos.position)
    places = {name: level_of(system, place) for name, place in tables.items()}
    _tell_outside(system, np.concatenate([station, places["control"]]), findings)
    turned = attitudes_in(statement, station, angles)
    _tell_lost(turned.lost, photos.ids, "omega and kappa", findings)
    job = _with_sigmas(block, statement, station, turned.partials, True, findings)
    tide = photos.tide + np.where(np.isnan(photos.tide), np.nan, system.undulation(station))
    known = CoordinateSystem.LOCAL if system.ellipsoid is None else CoordinateSystem.GEOGRAPHIC
    job = _with(job, known, station, turned.angles, tide)
    job = _with_places(job, places, places, statement, True, findings)
    job = _with_origin(job, lambda place: level_of(system, place))
    job = replace(job, reduction=_with_ground(block, system, station - photos.position))
    findings.stop()
    job = _with_inertial(job, statement, np.swapaxes(statement.reference(station), 1, 2))
    return job, tuple(findings.warnings)


def stated(block: Block, statement: Statement) -> Stated:
    """Return a job of the adjustment, geographic, geocentric or local, as a statement has it.

    The option of the system becomes that in which the job would be adjusted: geographic for all that is neither
    geocentric nor local.
    Raises `SystemsError` with every reason.
    """
    system, photos, tables = statement.system, block.photos, _tables_of_places(block)
    require_same_earth(block, system)
    job_system, findings = own_statement(block).system, Findings()
    station = level_of(job_system, photos.position)
    level = {name: level_of(job_system, place) for name, place in tables.items()}
    _require_complete(system, station, "photo", photos.ids, findings)
    _require_complete(system, level["control"], "control point", block.points.ids[block.control.point], findings)
    _require_level_heights(block, system, findings)
    findings.stop()
    _tell_outside(system, np.concatenate([station, level["control"]]), findings)
    turned = attitudes_out(statement, station, photos.attitude)
    _tell_lost(turned.lost, photos.ids, "first and third angle", findings)
    out = _with_sigmas(block, statement, station, turned.partials, False, findings)
    position = coordinates_of(system, station)
    tide = photos.tide - np.where(np.isnan(photos.tide), np.nan, system.undulation(station))
    known = CoordinateSystem.GEOCENTRIC if isinstance(system, Geocentric) else CoordinateSystem.GEOGRAPHIC
    if system.ellipsoid is None:
        known = CoordinateSystem.LOCAL
    out = _with(out, known, position, turned.angles, tide)
    places = {name: coordinates_of(system, at) for name, at in level.items()}
    out = _with_places(out, level, places, statement, False, findings)
    out = _with_origin(out, lambda place: coordinates_of(system, level_of(job_system, place)))
    findings.stop()
    out = replace(out, reduction=_with_ground(block, system, position - station))
    out = _with_inertial(out, statement, statement.reference(station))
    matrices = turned.matrix if statement.form is None else None
    return Stated(block=out, matrices=matrices, warnings=tuple(findings.warnings))


def _with_inertial(block: Block, statement: Statement, axes: FloatArray) -> Block:
    """Return a block with its inertial attitudes along other axes, rows (n, 3, 3) of each photo in the old.

    Raises `SystemsError` where these need a position that is not known.
    """
    table, convention, findings = block.inertial_attitudes, block.inertial_convention, Findings()
    if not (table.count and statement.turned and convention):
        return block
    at, form = axes[table.photo], BodyAngles(convention.angles)
    why = "the axes of its inertial attitude need the position of the station"
    findings.refuse(np.asarray(np.isnan(at).any(axis=(1, 2))), "photo", block.photos.ids[table.photo], why)
    findings.stop()
    angles = wrapped(body_angles(in_axes(body_matrix(table.angles, form), at), form), table.angles)
    return replace(block, inertial_attitudes=replace(table, angles=angles))


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


def _with_places(
    block: Block, level: Mapping[str, FloatArray], places: Mapping[str, FloatArray], statement: Statement,
    to_level: bool, findings: Findings,
) -> Block:  # fmt: skip
    """Return a block with its tables of places with covariances in other coordinates, of which `level` are level.

    If sigmas are those of the system, covariances follow the coordinates: `to_level` ones, or from these.
    """
    tables: dict[str, Any] = {}
    for name, place in places.items():
        table: Any = getattr(block, name)
        sigma, correlation = table.sigma, table.correlation
        if statement.sigmas is Sigmas.SYSTEM:
            partials = _rates(statement, level[name], to_level)
            of_photos, whole = hasattr(table, "photo"), table.correlated[:, None]
            owners = Owners(
                kind="photo" if of_photos else table.row_noun,
                ids=block.photos.ids[table.photo] if of_photos else block.points.ids[table.point],
                what=f"{table.row_noun}s" if of_photos else "coordinates",
            )
            alone = statement.system.plane_alone
            sigma = propagated(np.where(whole, np.nan, sigma), partials, owners, alone, findings)
            size, restated = on_cards(partials @ table.covariance @ np.swapaxes(partials, 1, 2))
            sigma, correlation = np.where(whole, size, sigma), np.where(whole, restated, correlation)
        tables[name] = replace(table, position=place, sigma=sigma, correlation=correlation)
    return with_tables(block, tables)


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


def _tables_of_places(block: Block) -> dict[str, FloatArray]:
    """Return the places of the tables that have covariances of theirs."""
    tables: dict[str, Any] = {**block.tables()}
    return {name: table.position for name, table in tables.items() if hasattr(table, "correlated")}


def _with_sigmas(
    block: Block, statement: Statement, level: FloatArray, by_angle: FloatArray, to_level: bool, findings: Findings
) -> Block:
    """Return a block with the sigmas of stations, `level` ones (n, 3), restated if they are those of the system."""
    if statement.sigmas is not Sigmas.SYSTEM:
        return block
    photos = block.photos
    station = Owners(kind="photo", ids=photos.ids, what="positions")
    turn = Owners(kind="photo", ids=photos.ids, what="attitudes")
    by_station, alone = _rates(statement, level, to_level), statement.system.plane_alone
    position = propagated(photos.position_sigma, by_station, station, alone, findings)
    attitude = propagated(photos.attitude_sigma, by_angle, turn, False, findings)
    return replace(block, photos=replace(photos, position_sigma=position, attitude_sigma=attitude))


def _rates(statement: Statement, level: FloatArray, to_level: bool) -> FloatArray:
    """Return the rates (n, 3, 3) of coordinates with level ones, or `to_level` the other way."""
    rates = rates_at(statement.system, level)
    return np.asarray(np.linalg.inv(rates), float) if to_level else rates


def _with(
    block: Block, known: CoordinateSystem, position: FloatArray, attitude: FloatArray, tide: FloatArray
) -> Block:
    """Return a block with other stations, attitudes and tides."""
    photos = replace(block.photos, position=position, attitude=attitude, tide=tide)
    return replace(block, options=replace(block.options, system=known), photos=photos)


@dataclass(frozen=True, kw_only=True, eq=False)
class StatedSolution:
    """Adjusted stations (n) and points (p) in the words of a statement, rows as in the block.

    Coordinates are those of the system, angles radians. The covariances are a posteriori, of the coordinates in
    their own units and of the stated angles (of the small rotations along the reference axes, where attitudes are
    matrices), about axes held at the adjusted station. Places that the system does not reach are NaN.
    """

    statement: Statement
    position: FloatArray  # (n, 3)
    angles: FloatArray  # (n, 3), NaN where stated as matrices
    matrix: FloatArray  # (n, 3, 3) reference axes to photo
    covariance: FloatArray  # (n, 6, 6)
    lost: BoolArray  # (n,) gimbal cases: first and third angle have no covariance of their own
    points: FloatArray  # (p, 3) NaN where not determined
    point_covariance: FloatArray  # (p, 3, 3)
    apparent: FloatArray  # (s, 3) submerged points without refraction, rows as in the solution
    predicted: FloatArray  # (s, 3) and as predicted
    tide: FloatArray  # (n,) m, adjusted where the adjustment knows water, in heights of the system
    undulation: FloatArray  # (n,) m, of the surface of these heights above the ellipsoid, at the stations
    factors: MapFactors | None  # (n,) of the map at the stations; None: not projected
    far_stations: BoolArray  # (n,) places that the system does not reach
    far_points: BoolArray  # (p,)


def stated_solution(solution: Solution, statement: Statement) -> StatedSolution:
    """Return a solution in the words of a statement. Raises `SystemsError` where that cannot be."""
    block, system = solution.block, statement.system
    require_same_earth(block, system)
    job_system = own_statement(block).system
    stations, points = (
        level_of(job_system, solution.stations.position),
        level_of(job_system, solution.points.position),
    )
    station, point = reached(statement, stations), reached(statement, points)
    turned = attitudes_out(statement, station, solution.stations.attitude)
    rates = np.zeros((len(station), 6, 6))
    rates[:, :3, :3], rates[:, 3:, 3:] = rates_at(system, station), turned.partials
    by_point = rates_at(system, point)
    undulation = system.undulation(station)
    tide = block.photos.tide if solution.water is None else solution.water.tide
    return StatedSolution(
        statement=statement,
        position=coordinates_of(system, station),
        angles=turned.angles,
        matrix=turned.matrix,
        covariance=_at(station, rates @ solution.stations.covariance @ np.swapaxes(rates, 1, 2)),
        lost=turned.lost,
        points=coordinates_of(system, point),
        point_covariance=_at(point, by_point @ solution.points.covariance @ np.swapaxes(by_point, 1, 2)),
        apparent=coordinates_of(system, reached(statement, level_of(job_system, solution.bathymetric.apparent))),
        predicted=coordinates_of(system, reached(statement, level_of(job_system, solution.bathymetric.predicted))),
        tide=tide - undulation,
        undulation=undulation,
        factors=system.factors(station),
        far_stations=_is_far(station, stations),
        far_points=_is_far(point, points),
    )


def reached(statement: Statement, level: FloatArray) -> FloatArray:
    """Return level positions (n, 3), NaN where the system of a statement does not reach."""
    try:
        _stand(statement, level)
        return level
    except SystemsError:
        out, known = np.full(level.shape, np.nan), np.isfinite(level).all(axis=1)
        for row in np.flatnonzero(known).tolist():
            try:
                _stand(statement, level[row : row + 1])
            except SystemsError:
                continue
            out[row] = level[row]
        return out


def _stand(statement: Statement, level: FloatArray) -> None:
    """Raise `SystemsError` unless all that is asked of a system can be had at level positions."""
    coordinates_of(statement.system, level)
    rates_at(statement.system, level)
    statement.reference(level)


def _at(places: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return covariances (n, k, k), NaN where the place (n, 3) is not known."""
    unknown: BoolArray = np.asarray(np.isnan(places).any(axis=1))
    return np.where(unknown[:, None, None], np.nan, covariance)


def _is_far(reached_places: FloatArray, places: FloatArray) -> BoolArray:
    return np.asarray(np.isnan(reached_places).any(axis=1) & np.isfinite(places).all(axis=1))
