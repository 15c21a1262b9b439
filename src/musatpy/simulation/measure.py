"""What the deck says of the truth: plate coordinates, control, stations, each with its errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.draws import Draws
from musatpy.errors import Problem, SpecError
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix
from musatpy.model import ControlKind, CoordinateSystem
from musatpy.simulation.flight import TrueFlight
from musatpy.simulation.mistakes import drawn_sizes, gross_control
from musatpy.simulation.simulation_spec import ControlKeys, SimulationSpec
from musatpy.simulation.terrain import GIVEN, Ground, inside, spread
from musatpy.simulation.true_images import Images
from musatpy.simulation.world import ATTITUDE_DECIMALS, World, on_grid
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
    gross: FloatArray  # (n, 6) gross errors east, north, up m, of the angles rad


def choose_control(
    spec: SimulationSpec, ground: Ground, images: Images, world: World, draws: Draws
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


def _control_points(table: ControlKeys, ground: Ground, free: BoolArray, where: str) -> IntArray:
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
    ground: Ground,
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
    gross = gross_control(spec, [names[row] for row in point], known, on_card, draws)
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

    The attitude is turned to the vertical frame of the given position, which is not that of the true one. Raises
    `SpecError` where a [[wrong_station]] is of no photo.
    """
    keys, n = spec.stations, len(flight.ids)
    gross = _wrong_stations(spec, flight)
    draw = draws.normal if keys.error_kind == "normal" else draws.signs
    shift = draw("station errors", n, 3) * keys.position_error + gross[:, :3]
    turn = draw("attitude errors", n, 3) * keys.attitude_error * DEGREE + gross[:, 3:]
    true = flight.stations
    given = world.at_xyz(true.xyz + np.einsum("kji,kj->ki", true.vertical, shift))
    M = attitude_matrix(flight.attitude) @ true.vertical @ np.swapaxes(given.vertical, -1, -2)
    nan = (np.nan,) * 3
    attitude = on_grid(attitude_from_matrix(M) + turn, ATTITUDE_DECIMALS)
    return GivenStations(
        position=given.job if keys.given else np.full((n, 3), np.nan),
        attitude=attitude if keys.given else np.full((n, 3), np.nan),
        gross=gross,
        position_sigma=np.tile(keys.position_sigma or nan, (n, 1)),
        attitude_sigma=np.tile(keys.attitude_sigma or nan, (n, 1)) * (DEGREE / 3600.0),
    )


def _wrong_stations(spec: SimulationSpec, flight: TrueFlight) -> FloatArray:
    """Return the gross errors (n, 6) of stations, m, and attitudes, rad."""
    gross = np.zeros((len(flight.ids), 6))
    for i, wrong in enumerate(spec.wrong_station, start=1):
        if wrong.photo not in flight.ids:
            raise SpecError([Problem(field=f"wrong_station[{i}].photo", message=f"unknown photo: {wrong.photo}")])
        gross[flight.ids.index(wrong.photo)] += [*wrong.shift, *np.multiply(wrong.turn, DEGREE)]
    return gross


def measure_plates(
    spec: SimulationSpec, flight: TrueFlight, ground: Ground, control: GivenControl, images: Images, draws: Draws
) -> MeasuredPlates:
    """Return the measured plate coordinates: noise, then blunders, then the least count."""
    keys, m = spec.measurement, len(images.photo)
    submerged = ground.bathymetric[images.point]
    factor = np.where(submerged, keys.submerged_factor, 1.0)[:, None]
    noise = draws.normal("plate noise", m, 2) * (factor * keys.noise * MICROMETRE)
    added = _blunders(spec, flight, control.names, images, draws)
    ticks = np.rint((images.xy + noise + added) / (keys.least_count * MICROMETRE))
    hit = np.flatnonzero(np.any(added != 0.0, axis=1))
    on_card = (factor > 1.0) & np.full(2, keys.factor_on_cards)
    sigma = np.where(on_card, factor * keys.sigma * MICROMETRE, np.nan)
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


def _rows(flight: TrueFlight, names: tuple[str, ...], images: Images) -> dict[tuple[str, str], int]:
    """Return the row of each measurement by photo id and point id."""
    return {
        (flight.ids[photo], names[point]): row
        for row, (photo, point) in enumerate(zip(images.photo, images.point, strict=True))
    }


def _blunders(
    spec: SimulationSpec, flight: TrueFlight, names: tuple[str, ...], images: Images, draws: Draws
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
    spec: SimulationSpec, flight: TrueFlight, ground: Ground, control: GivenControl, images: Images, draws: Draws
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
