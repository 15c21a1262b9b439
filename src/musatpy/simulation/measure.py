"""What the deck says of the truth, each with its errors: plates, control, stations, bases, distances, heights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.draws import Draws
from musatpy.errors import Problem, SpecError
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix
from musatpy.model import ControlKind, CoordinateSystem
from musatpy.simulation.flight import TrueFlight
from musatpy.simulation.mistakes import drawn_sizes, gross_control
from musatpy.simulation.simulation_spec import AirBaseKeys, ControlKeys, DistanceKeys, SimulationSpec
from musatpy.simulation.terrain import GIVEN, TrueGround, inside, spread
from musatpy.simulation.true_images import TrueImages
from musatpy.simulation.world import ATTITUDE_DECIMALS, METRE_DECIMALS, World, on_grid
from musatpy.units import DEGREE, MICROMETRE


@dataclass(frozen=True, kw_only=True)
class Blunder:
    """One gross error: added to the measured coordinates of a point on a photo."""

    photo: str
    point: str
    added: tuple[float, float]  # mm


@dataclass(frozen=True, kw_only=True)
class MeasuredPlates:
    """m measurements, row by row the true images."""

    xy: FloatArray  # (m, 2) mm
    sigma: FloatArray  # (m, 2) mm, NaN where the job's holds
    triangulated: BoolArray  # (m,)
    hit: IntArray  # (b,) rows with gross errors
    blunders: tuple[Blunder, ...]


@dataclass(frozen=True, kw_only=True)
class GivenControl:
    """k control points as the deck gives them, and their actual errors."""

    point: IntArray  # (k,) row of the ground
    kind: IntArray  # (k,) ControlKind
    fixed: BoolArray  # (k,)
    position: FloatArray  # (k, 3) in the job's system, NaN where unknown
    sigma: FloatArray  # (k, 3) m
    error: FloatArray  # (k, 3) m east north up, given minus true
    gross: FloatArray  # (k, 3) m, the gross errors in it
    names: tuple[str, ...]  # (p,) ids of all ground points, control renamed


@dataclass(frozen=True, kw_only=True)
class GivenStations:
    """n stations as the deck gives them, NaN where it does not."""

    position: FloatArray  # (n, 3) in the job's system
    attitude: FloatArray  # (n, 3) rad, in the local vertical frame of the given position
    position_sigma: FloatArray  # (n, 3) m
    attitude_sigma: FloatArray  # (n, 3) rad


def choose_control(
    spec: SimulationSpec, ground: TrueGround, images: TrueImages, world: World, draws: Draws
) -> GivenControl:
    """Return the control. Raises `SpecError` where a table asks for points that are not there."""
    names = list(ground.ids)
    free = images.rays(len(names)) >= 2
    free[ground.shore >= 0] = False
    chosen: list[IntArray] = []
    for i, table in enumerate(spec.control, start=1):
        points = _control_points(table, ground, free, f"control[{i}]")
        free[points] = False
        for point, name in zip(points, table.ids, strict=False):
            names[point] = name
        chosen.append(points)
    repeated = sorted({name for name in names if names.count(name) > 1}) if len(set(names)) < len(names) else []
    if repeated:
        raise SpecError([Problem(field="point ids", message=f"used more than once: {', '.join(repeated)}")])
    return _given_control(spec, ground, chosen, tuple(names), world, draws)


def _control_points(table: ControlKeys, ground: TrueGround, free: BoolArray, where: str) -> IntArray:
    """Return the rows of the ground that a [[control]] table takes."""
    if table.points:
        rows = {name: row for row, name in enumerate(ground.ids)}
        missing = [name for name in table.points if name not in rows or not free[rows[name]]]
        if missing:
            message = f"not measured on two photos, or control already: {', '.join(missing)}"
            raise SpecError([Problem(field=where, message=message)])
        return np.array([rows[name] for name in table.points])
    fitting = free & (ground.bathymetric == table.bathymetric) & inside(ground.plan, table.area)
    candidates = np.flatnonzero(fitting & (ground.origin != GIVEN))
    number = len(table.ids) if table.number is None else table.number
    if number > len(candidates):
        raise SpecError(
            [Problem(field=where, message=f"{number} points are asked for, {len(candidates)} are there")]
        )
    return spread(ground.plan, candidates, number)


def _given_control(
    spec: SimulationSpec,
    ground: TrueGround,
    chosen: list[IntArray],
    names: tuple[str, ...],
    world: World,
    draws: Draws,
) -> GivenControl:
    """Return the control of all tables, one after the other, with its errors."""
    counts = [len(points) for points in chosen]
    point = np.concatenate([*chosen, np.empty(0, dtype=np.int64)])
    kind = np.repeat([ControlKind[table.kind.upper()] for table in spec.control], counts).astype(int)
    horizontal, vertical = kind != ControlKind.VERTICAL, kind != ControlKind.HORIZONTAL
    # components east, north, up that a kind of control knows
    known = np.stack([horizontal, horizontal, vertical], axis=-1) & (kind != ControlKind.CHECK)[:, None]
    sizes = np.repeat(np.array([table.error for table in spec.control]).reshape(-1, 3), counts, axis=0)
    if spec.job.system == CoordinateSystem.GEOCENTRIC:
        on_card = np.ones_like(known)  # X, Y, Z are given together; the kind says what is known
    else:
        on_card = known | (kind == ControlKind.CHECK)[:, None]
    gross = gross_control(spec, known, draws)
    error = np.round(draws.normal("control errors", len(point), 3) * sizes, 6) * on_card + gross
    error += 0.0  # no -0.0 in the truth
    true = ground.places[point]
    given = world.at_xyz(true.xyz + np.einsum("kji,kj->ki", true.vertical, error)).job
    no_sigma = (np.nan,) * 3
    sigma = np.array([table.sigma or no_sigma for table in spec.control]).reshape(-1, 3)
    return GivenControl(
        point=point,
        kind=kind,
        fixed=np.repeat(np.array([table.fixed for table in spec.control], dtype=bool), counts),
        position=np.where(on_card, given, np.nan),
        sigma=np.where(known, np.repeat(sigma, counts, axis=0), np.nan),
        error=error,
        gross=gross,
        names=names,
    )


def state_stations(spec: SimulationSpec, flight: TrueFlight, world: World, draws: Draws) -> GivenStations:
    """Return stations and attitudes as the deck gives them: with errors, on the grid of the cards.

    The attitude is turned to the vertical frame of the given position, which is not that of the true one.
    """
    keys, n = spec.stations, len(flight.ids)
    draw = draws.normal if keys.error_kind == "normal" else draws.signs
    shift = draw("station errors", n, 3) * keys.position_error
    turn = draw("attitude errors", n, 3) * keys.attitude_error * DEGREE
    true = flight.stations
    given = world.at_xyz(true.xyz + np.einsum("kji,kj->ki", true.vertical, shift))
    M = attitude_matrix(flight.attitude) @ true.vertical @ np.swapaxes(given.vertical, -1, -2)
    nan = (np.nan,) * 3
    return GivenStations(
        position=given.job,
        attitude=on_grid(attitude_from_matrix(M) + turn, ATTITUDE_DECIMALS),
        position_sigma=np.tile(keys.position_sigma or nan, (n, 1)),
        attitude_sigma=np.tile(keys.attitude_sigma or nan, (n, 1)) * (DEGREE / 3600.0),
    )


def measure_plates(
    spec: SimulationSpec,
    flight: TrueFlight,
    ground: TrueGround,
    control: GivenControl,
    images: TrueImages,
    draws: Draws,
) -> MeasuredPlates:
    """Return the measured plate coordinates: noise, then blunders, then the least count."""
    keys, m = spec.measurement, len(images.photo)
    submerged = ground.bathymetric[images.point]
    factor = np.where(submerged, keys.submerged_factor, 1.0)[:, None]
    noise = draws.normal("plate noise", m, 2) * (factor * keys.noise * MICROMETRE)
    added = _blunders(spec, flight, control.names, images, draws)
    ticks = np.rint((images.xy + noise + added) / (keys.least_count * MICROMETRE))
    hit = np.flatnonzero(np.any(added != 0.0, axis=1))
    sigma = np.repeat(np.where(factor > 1.0, factor * keys.sigma * MICROMETRE, np.nan), 2, axis=1)
    return MeasuredPlates(
        xy=np.round(ticks * (keys.least_count * MICROMETRE), 6),
        sigma=np.round(sigma, 5).astype(float),
        triangulated=~_kept_out(spec, flight, ground, control, images, draws),
        hit=hit,
        blunders=tuple(
            Blunder(
                photo=flight.ids[images.photo[row]],
                point=control.names[images.point[row]],
                added=(float(added[row, 0]), float(added[row, 1])),
            )
            for row in hit
        ),
    )


def _rows(flight: TrueFlight, names: tuple[str, ...], images: TrueImages) -> dict[tuple[str, str], int]:
    """Return the row of each measurement by photo id and point id."""
    return {
        (flight.ids[photo], names[point]): row
        for row, (photo, point) in enumerate(zip(images.photo, images.point, strict=True))
    }


def _blunders(
    spec: SimulationSpec, flight: TrueFlight, names: tuple[str, ...], images: TrueImages, draws: Draws
) -> FloatArray:
    """Return the gross errors (m, 2) mm. Raises `SpecError` where one names a measurement that is not there."""
    keys, m = spec.blunders, len(images.photo)
    added = np.zeros((m, 2))
    number = keys.number or round(keys.share * m)
    if number > m:
        raise SpecError([Problem(field="blunders.number", message=f"there are only {m} measurements")])
    hit = draws.pick("blunders", m, number)
    size = drawn_sizes(draws, "blunder sizes", number, keys.size, keys.log)
    axis = (draws.uniform("blunder axes", number) < 0.5).astype(int)
    added[hit, axis] = np.round(size * draws.signs("blunder signs", number), 3) * MICROMETRE
    if spec.blunder:
        rows = _rows(flight, names, images)
        for blunder in spec.blunder:
            added[_row(rows, blunder.photo, blunder.point, "blunder")] += (
                np.array([blunder.x, blunder.y]) * MICROMETRE
            )
    return added


def _row(rows: dict[tuple[str, str], int], photo: str, point: str, field: str) -> int:
    """Return the row of a measurement; raises `SpecError` where there is none."""
    if (photo, point) not in rows:
        raise SpecError([Problem(field=field, message=f"point {point} is not measured on photo {photo}")])
    return rows[photo, point]


def _kept_out(
    spec: SimulationSpec,
    flight: TrueFlight,
    ground: TrueGround,
    control: GivenControl,
    images: TrueImages,
    draws: Draws,
) -> BoolArray:
    """Return which measurements (m,) carry the flag that keeps them out of the solution."""
    points = np.zeros(len(ground.ids), dtype=bool)
    points[: len(spec.point)] = [not given.triangulated for given in spec.point]
    passes = np.setdiff1d(np.unique(images.point), control.point)
    points[passes[draws.pick("kept out", len(passes), spec.kept_out.number)]] = True
    kept = points[images.point]
    if spec.kept_out.measurements:
        rows = _rows(flight, control.names, images)
        for photo, point in spec.kept_out.measurements:
            kept[_row(rows, photo, point, "kept_out.measurements")] = True
    return np.asarray(kept)


# --- between two places ---


@dataclass(frozen=True, kw_only=True)
class Ties:
    """Measurements (d,) between two points, or photos: as the deck gives them, and as they are."""

    point: IntArray  # (d, 2) rows of the ground, of air bases those of the flight
    given: FloatArray  # (d,) m
    true: FloatArray  # (d,) m
    sigma: FloatArray  # (d,) m


def air_bases(spec: SimulationSpec, flight: TrueFlight, draws: Draws) -> Ties:
    """Return the air bases, between rows of the photos. Raises `SpecError` where a photo is unknown."""
    rows = {name: row for row, name in enumerate(flight.ids)}
    unknown = [name for base in spec.air_base for name in base.photos if name not in rows]
    if unknown:
        raise SpecError([Problem(field="air_base", message=f"unknown photos: {', '.join(unknown)}")])
    photo = np.array([[rows[name] for name in base.photos] for base in spec.air_base], dtype=int).reshape(-1, 2)
    true = _lengths(flight.stations.xyz[photo])
    return _measured("air bases", spec.air_base, photo, np.arange(len(photo)), true, draws)


def _lengths(ends: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))


def distances(
    spec: SimulationSpec, ground: TrueGround, names: tuple[str, ...], usable: IntArray, draws: Draws
) -> Ties:
    """Return the distances between points. Raises `SpecError` as `_pairs` does."""
    point, table = _pairs("distance", spec.distance, names, usable, draws)
    return _measured("distance errors", spec.distance, point, table, _lengths(ground.places.xyz[point]), draws)


def height_differences(
    spec: SimulationSpec, ground: TrueGround, names: tuple[str, ...], usable: IntArray, draws: Draws
) -> Ties:
    """Return the height differences, second point minus first. Raises `SpecError` as `_pairs` does."""
    point, table = _pairs("height_difference", spec.height_difference, names, usable, draws)
    height = ground.places.natural[point, 2]
    return _measured(
        "height_difference errors", spec.height_difference, point, table, height[:, 1] - height[:, 0], draws
    )


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
            raise SpecError([Problem(field=f"{field}[{i}].points", message=message)])
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
        raise SpecError([Problem(field=field, message=f"there are only {k} points for {number} pairs")])
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
