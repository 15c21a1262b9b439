"""What was measured between two places: air bases, distances, height differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.draws import Draws
from musatpy.errors import Problem, SpecError
from musatpy.model import AirBases
from musatpy.simulation.flight import TrueFlight
from musatpy.simulation.simulation_spec import DistanceKeys, SimulationSpec
from musatpy.simulation.terrain import Ground
from musatpy.simulation.world import METRE_DECIMALS


@dataclass(frozen=True, kw_only=True)
class Tied:
    """Measurements (d,) between two points: as the deck gives them, and as they are."""

    point: IntArray  # (d, 2) rows of the ground
    given: FloatArray  # (d,) m
    true: FloatArray  # (d,) m
    sigma: FloatArray  # (d,) m
    gross: FloatArray  # (d,) m, the gross errors in what is given


def air_bases(spec: SimulationSpec, flight: TrueFlight, draws: Draws) -> tuple[AirBases, FloatArray]:
    """Return the given air bases and the true lengths (b,). Raises `SpecError` where a photo is unknown."""
    rows = {name: row for row, name in enumerate(flight.ids)}
    unknown = [name for base in spec.air_base for name in base.photos if name not in rows]
    if unknown:
        raise SpecError([Problem(field="air_base", message=f"unknown photos: {', '.join(unknown)}")])
    photo = np.array([[rows[name] for name in base.photos] for base in spec.air_base], dtype=int).reshape(-1, 2)
    ends = flight.stations.xyz[photo]
    true = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    error = draws.normal("air bases", len(photo)) * np.array([base.error for base in spec.air_base])
    error += np.array([base.blunder for base in spec.air_base])
    bases = AirBases(
        photo=photo,
        length=np.round(true + error, METRE_DECIMALS),
        sigma=np.array([base.sigma for base in spec.air_base]),
    )
    return bases, true


def distances(spec: SimulationSpec, ground: Ground, names: tuple[str, ...], usable: IntArray, draws: Draws) -> Tied:
    """Return the distances between points. Raises `SpecError` as `_pairs` does."""
    point, table = _pairs("distance", spec.distance, names, usable, draws)
    ends = ground.places.xyz[point]
    true = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return _measured("distance", spec.distance, point, table, true, draws)


def height_differences(
    spec: SimulationSpec, ground: Ground, names: tuple[str, ...], usable: IntArray, draws: Draws
) -> Tied:
    """Return the height differences, second point minus first. Raises `SpecError` as `_pairs` does."""
    point, table = _pairs("height_difference", spec.height_difference, names, usable, draws)
    height = ground.places.natural[point, 2]
    return _measured("height_difference", spec.height_difference, point, table, height[:, 1] - height[:, 0], draws)


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
    field: str, tables: Sequence[DistanceKeys], point: IntArray, table: IntArray, true: FloatArray, draws: Draws
) -> Tied:
    """Return measurements of the `true` values (d,), each with the errors of its table."""
    size, gross, sigma = (
        np.array([[keys.error, keys.blunder, keys.sigma] for keys in tables]).reshape(-1, 3)[table].T
    )
    given = np.round(true + draws.normal(f"{field} errors", len(point)) * size + gross, METRE_DECIMALS)
    return Tied(point=point, given=given, true=true, sigma=sigma, gross=gross)
