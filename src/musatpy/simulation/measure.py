"""What the deck says of the truth, each with its errors: plates, control, stations, bases, distances, heights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.draws import Draws
from musatpy.errors import SpecError
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix
from musatpy.model import Control, ControlKind, CoordinateSystem, PlateMeasurements
from musatpy.model.block import known_of_kinds
from musatpy.model.correlations import correlations_of
from musatpy.simulation.mistakes import drawn_sizes, gross_control
from musatpy.simulation.simulation_spec import AirBaseKeys, ControlKeys, DistanceKeys
from musatpy.simulation.terrain import GIVEN, Scene, TrueGround, inside, spread
from musatpy.simulation.true_images import TrueImages
from musatpy.simulation.world import ATTITUDE_DECIMALS, METRE_DECIMALS, TruePlaces, World, on_grid
from musatpy.units import DEGREE, MICROMETRE

_NONE = (np.nan,) * 3  # of sigmas that no card has


@dataclass(frozen=True, kw_only=True)
class Blunder:
    """One gross error: added to the measured coordinates of a point on a photo."""

    photo: str
    point: str
    added: tuple[float, ...]  # x, y mm


@dataclass(frozen=True, kw_only=True)
class MeasuredPlates:
    """m measurements, row by row the true images, of points of the ground, with their gross errors."""

    table: PlateMeasurements
    hit: IntArray  # (b,) rows with gross errors
    blunders: tuple[Blunder, ...]


@dataclass(frozen=True, kw_only=True)
class GivenControl:
    """k control points of the ground as the deck gives them, and their actual errors."""

    table: Control
    error: FloatArray  # (k, 3) m east north up, given minus true
    gross: FloatArray  # (k, 3) m, the gross errors in it
    names: tuple[str, ...]  # (p,) ids of all ground points, control renamed


def choose_control(scene: Scene, images: TrueImages) -> GivenControl:
    """Return the control. Raises `SpecError` where a table asks for points that are not there."""
    ground, names = scene.ground, list(scene.ground.ids)
    free = images.rays(len(names)) >= 2
    free[ground.shore >= 0] = False
    chosen: list[IntArray] = []
    for i, table in enumerate(scene.spec.control, start=1):
        points = _control_points(table, ground, free, f"control[{i}]")
        free[points] = False
        for point, name in zip(points, table.ids, strict=False):
            names[point] = name
        chosen.append(points)
    repeated = sorted({name for name in names if names.count(name) > 1}) if len(set(names)) < len(names) else []
    if repeated:
        raise SpecError.of(f"used more than once: {', '.join(repeated)}", field="point ids")
    return _given_control(scene, chosen, tuple(names))


def _control_points(table: ControlKeys, ground: TrueGround, free: BoolArray, where: str) -> IntArray:
    """Return the rows of the ground that a [[control]] table takes."""
    if table.points:
        rows = {name: row for row, name in enumerate(ground.ids)}
        missing = [name for name in table.points if name not in rows or not free[rows[name]]]
        if missing:
            message = f"not measured on two photos, or control already: {', '.join(missing)}"
            raise SpecError.of(message, field=where)
        return np.array([rows[name] for name in table.points])
    fitting = free & (ground.bathymetric == table.bathymetric) & inside(ground.plan, table.area)
    candidates = np.flatnonzero(fitting & (ground.origin != GIVEN))
    number = len(table.ids) if table.number is None else table.number
    if number > len(candidates):
        raise SpecError.of(f"{number} points are asked for, {len(candidates)} are there", field=where)
    return spread(ground.plan, candidates, number)


def _given_control(scene: Scene, chosen: list[IntArray], names: tuple[str, ...]) -> GivenControl:
    """Return the control of all tables, one after the other, with its errors."""
    tables, draws, counts = scene.spec.control, scene.draws, [len(points) for points in chosen]
    point = np.concatenate([*chosen, np.empty(0, dtype=np.int64)])
    kind = np.repeat([ControlKind[table.kind.upper()] for table in tables], counts).astype(int)
    known = known_of_kinds(kind)
    sizes = np.repeat(np.array([table.error for table in tables]).reshape(-1, 3), counts, axis=0)
    if scene.spec.job.system == CoordinateSystem.GEOCENTRIC:
        on_card = np.ones_like(known)  # X, Y, Z are given together; the kind says what is known
    else:
        on_card = known | (kind == ControlKind.CHECK)[:, None]
    gross = gross_control(scene.spec, known, draws)
    correlation = np.repeat([table.correlation or _NONE for table in tables], counts, axis=0).reshape(-1, 3)
    drawn, rows = draws.normal("control errors", len(point), 3), np.isfinite(correlation).all(axis=1)
    root = np.linalg.cholesky(correlations_of(correlation[rows]))
    drawn[rows] = np.einsum("kij,kj->ki", root, drawn[rows])
    error = np.round(drawn * sizes, 6) * on_card + gross
    error += 0.0  # no -0.0 in the truth
    given = _shifted(scene.world, scene.ground.places[point], error).job
    sigma = np.array([table.sigma or _NONE for table in tables]).reshape(-1, 3)
    table = Control(
        point=point,
        kind=kind,
        fixed=np.repeat(np.array([table.fixed for table in tables], dtype=bool), counts),
        position=np.where(on_card, given, np.nan),
        sigma=np.where(known, np.repeat(sigma, counts, axis=0), np.nan),
        correlation=correlation,
    )
    return GivenControl(table=table, error=error, gross=gross, names=names)


def _shifted(world: World, places: TruePlaces, shift: FloatArray) -> TruePlaces:
    """Return places moved east, north and up (k, 3) m."""
    return world.at_xyz(places.xyz + np.einsum("kji,kj->ki", places.vertical, shift))


def state_stations(scene: Scene) -> dict[str, FloatArray]:
    """Return stations and attitudes as the deck gives them, columns of `Photos`: with errors, as cards have them.

    The attitude is turned to the vertical frame of the given position, which is not that of the true one.
    """
    keys, flight, n = scene.spec.stations, scene.flight, len(scene.flight.ids)
    draw = scene.draws.normal if keys.error_kind == "normal" else scene.draws.signs
    true = flight.stations
    given = _shifted(scene.world, true, draw("station errors", n, 3) * keys.position_error)
    turn = draw("attitude errors", n, 3) * keys.attitude_error * DEGREE
    M = attitude_matrix(flight.attitude) @ true.vertical @ np.swapaxes(given.vertical, -1, -2)
    return {
        "position": given.job,
        "attitude": on_grid(attitude_from_matrix(M) + turn, ATTITUDE_DECIMALS),
        "position_sigma": np.tile(keys.position_sigma or _NONE, (n, 1)),
        "attitude_sigma": np.tile(keys.attitude_sigma or _NONE, (n, 1)) * (DEGREE / 3600.0),
    }


def measure_plates(scene: Scene, images: TrueImages, control: GivenControl) -> MeasuredPlates:
    """Return the measured plate coordinates: noise, then blunders, then the least count.

    Raises `SpecError` where a table names a measurement that is not there.
    """
    keys, ids, m = scene.spec.measurement, scene.flight.ids, len(images.photo)
    factor = np.where(scene.ground.bathymetric[images.point], keys.submerged_factor, 1.0)[:, None]
    noise = scene.draws.normal("plate noise", m, 2) * (factor * keys.noise * MICROMETRE)
    links = zip(images.photo.tolist(), images.point.tolist(), strict=True)
    rows = {(ids[photo], control.names[point]): row for row, (photo, point) in enumerate(links)}
    added = _blunders(scene, m, rows)
    ticks = np.rint((images.xy + noise + added) / (keys.least_count * MICROMETRE))
    sigma = np.repeat(np.where(factor > 1.0, factor * keys.sigma * MICROMETRE, np.nan), 2, axis=1)
    names, hit = list(rows), np.flatnonzero(np.any(added != 0.0, axis=1))
    return MeasuredPlates(
        table=PlateMeasurements(
            photo=images.photo,
            point=images.point,
            xy=np.round(ticks * (keys.least_count * MICROMETRE), 6),
            sigma=np.round(sigma, 5).astype(float),
            triangulated=~_kept_out(scene, images, control, rows),
        ),
        hit=hit,
        blunders=tuple(
            Blunder(photo=names[row][0], point=names[row][1], added=tuple(added[row].tolist())) for row in hit
        ),
    )


def _blunders(scene: Scene, m: int, rows: dict[tuple[str, str], int]) -> FloatArray:
    """Return the gross errors (m, 2) mm."""
    keys, draws, added = scene.spec.blunders, scene.draws, np.zeros((m, 2))
    number = keys.number or round(keys.share * m)
    if number > m:
        raise SpecError.of(f"there are only {m} measurements", field="blunders.number")
    hit = draws.pick("blunders", m, number)
    size = drawn_sizes(draws, "blunder sizes", number, keys.size, keys.log)
    axis = (draws.uniform("blunder axes", number) < 0.5).astype(int)
    added[hit, axis] = np.round(size * draws.signs("blunder signs", number), 3) * MICROMETRE
    for given in scene.spec.blunder:
        added[_row(rows, given.photo, given.point, "blunder")] += np.array([given.x, given.y]) * MICROMETRE
    return added


def _row(rows: dict[tuple[str, str], int], photo: str, point: str, field: str) -> int:
    """Return the row of a measurement; raises `SpecError` where there is none."""
    if (photo, point) not in rows:
        raise SpecError.of(f"point {point} is not measured on photo {photo}", field=field)
    return rows[photo, point]


def _kept_out(
    scene: Scene, images: TrueImages, control: GivenControl, rows: dict[tuple[str, str], int]
) -> BoolArray:
    """Return which measurements (m,) carry the flag that keeps them out of the solution."""
    spec, points = scene.spec, np.zeros(len(scene.ground.ids), dtype=bool)
    points[: len(spec.point)] = [not given.triangulated for given in spec.point]
    passes = np.setdiff1d(np.unique(images.point), control.table.point)
    points[passes[scene.draws.pick("kept out", len(passes), spec.kept_out.number)]] = True
    kept = points[images.point]
    kept[[_row(rows, *name, "kept_out.measurements") for name in spec.kept_out.measurements]] = True
    return np.asarray(kept)


# --- between two places ---


@dataclass(frozen=True, kw_only=True)
class Ties:
    """Measurements (d,) between two points, or photos: as the deck gives them, and as they are."""

    point: IntArray  # (d, 2) rows of the ground, of air bases those of the flight
    given: FloatArray  # (d,) m
    true: FloatArray  # (d,) m
    sigma: FloatArray  # (d,) m


def air_bases(scene: Scene) -> Ties:
    """Return the air bases, between rows of the photos. Raises `SpecError` where a photo is unknown."""
    tables, rows = scene.spec.air_base, {name: row for row, name in enumerate(scene.flight.ids)}
    unknown = [name for base in tables for name in base.photos if name not in rows]
    if unknown:
        raise SpecError.of(f"unknown photos: {', '.join(unknown)}", field="air_base")
    photo = np.array([[rows[name] for name in base.photos] for base in tables], dtype=int).reshape(-1, 2)
    true = _lengths(scene.flight.stations.xyz[photo])
    return _measured("air bases", tables, photo, np.arange(len(photo)), true, scene.draws)


def _lengths(ends: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))


def distances(scene: Scene, names: tuple[str, ...], usable: IntArray) -> Ties:
    """Return the distances between points. Raises `SpecError` as `_pairs` does."""
    tables, draws = scene.spec.distance, scene.draws
    point, table = _pairs("distance", tables, names, usable, draws)
    return _measured("distance errors", tables, point, table, _lengths(scene.ground.places.xyz[point]), draws)


def height_differences(scene: Scene, names: tuple[str, ...], usable: IntArray) -> Ties:
    """Return the height differences, second point minus first. Raises `SpecError` as `_pairs` does."""
    tables, draws = scene.spec.height_difference, scene.draws
    point, table = _pairs("height_difference", tables, names, usable, draws)
    rise = np.diff(scene.ground.places.natural[point, 2], axis=1)[:, 0]
    return _measured("height_difference errors", tables, point, table, rise, draws)


def _pairs(
    field: str, tables: Sequence[DistanceKeys], names: tuple[str, ...], usable: IntArray, draws: Draws
) -> tuple[IntArray, IntArray]:
    """Return pairs (d, 2) of `usable` points, and the table (d,) that each is from.

    Raises `SpecError` where a point is unknown or takes no part, or too few points are there.
    """
    rows = {names[row]: int(row) for row in usable}
    pairs: list[tuple[int, int]] = []
    for i, table in enumerate(tables, start=1):
        missing = [name for name in table.points or () if name not in rows]
        if missing:
            message = f"not measured on two photos, or kept out: {', '.join(missing)}"
            raise SpecError.of(message, field=f"{field}[{i}].points")
        if table.points:
            pairs.append((rows[table.points[0]], rows[table.points[1]]))
        else:
            assert table.number is not None  # one of the two, the table says
            pairs += _random_pairs(f"{field}[{i}].number", f"{field} pairs", table.number, usable, draws)
    table_of = np.repeat(np.arange(len(tables)), [table.number or 1 for table in tables])
    return np.array(pairs, dtype=int).reshape(-1, 2), table_of


def _random_pairs(field: str, stream: str, number: int, usable: IntArray, draws: Draws) -> list[tuple[int, int]]:
    """Return different pairs of points. Raises `SpecError` where there are not so many."""
    k = len(usable)
    if number > k * (k - 1) // 2:
        raise SpecError.of(f"there are only {k} points for {number} pairs", field=field)
    pairs: dict[tuple[int, int], tuple[int, int]] = {}
    while len(pairs) < number:
        first, second = (draws.uniform(stream, 2) * [k, k - 1]).astype(int).tolist()
        second += second >= first
        pairs.setdefault((min(first, second), max(first, second)), (int(usable[first]), int(usable[second])))
    return list(pairs.values())


def _measured(
    stream: str,
    tables: Sequence[DistanceKeys | AirBaseKeys],
    point: IntArray,
    table: IntArray,
    true: FloatArray,
    draws: Draws,
) -> Ties:
    """Return measurements of the `true` values (d,), each with the errors of its table."""
    size, sigma = np.array([[keys.error, keys.sigma] for keys in tables]).reshape(-1, 2)[table].T
    given = np.round(true + draws.normal(stream, len(point)) * size, METRE_DECIMALS)
    return Ties(point=point, given=given, true=true, sigma=sigma)
