"""What an adjustment found, as a statement has it, with its covariances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.errors import SystemsError
from musatpy.geometry.systems import MapFactors
from musatpy.model import Solution
from musatpy.systems.blocks import coordinates_of, level_of, rates_at
from musatpy.systems.statement import Statement, attitudes_out, own_statement, require_same_earth


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
