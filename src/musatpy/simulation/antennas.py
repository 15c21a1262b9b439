"""Antenna positions of a satellite receiver on board: lever arm, shifts and drifts of strips, times; with errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from musatpy import model
from musatpy.arrays import FloatArray
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.model.gnss import AXES, DIRECTIONS
from musatpy.specs import Triple, key

if TYPE_CHECKING:
    from musatpy.simulation.terrain import Scene

_ZERO, _NONE = (0.0, 0.0, 0.0), (np.nan, np.nan, np.nan)
_TURN = 10  # exposures that a turn from strip to strip takes as long as
_ARM, _SHIFT, _DRIFT, _TIME = 4, 4, 6, 4  # decimals on the cards


@dataclass(frozen=True, kw_only=True)
class AntennaKeys:
    """[antenna]: positions of a satellite antenna at the exposures, each strip a line; without it there are none."""

    error: Triple = key(_ZERO, "actual error east, north, up, 1 sigma", unit="m", low=0.0)
    sigma: Triple = key((0.05, 0.05, 0.1), "on the cards", unit="m", low=0.0001)
    correlation: Triple = key(
        _ZERO, "of the errors, east-north, east-up, north-up: then on GNC cards", low=-0.99, high=0.99, quiet=True
    )
    lever_arm: Triple = key(_ZERO, "true, along the axes of the photo", unit="m")
    lever_arm_error: Triple = key(_ZERO, "actual error on its card, 1 sigma", unit="m", low=0.0)
    lever_arm_sigma: Triple | None = key(None, "on its card; absent: held, or free", unit="m", low=0.0001)
    lever_arm_free: bool = key(False, "free, where it has no sigma")
    shift: Triple = key(_ZERO, "actual shift of each strip, 1 sigma", unit="m", low=0.0)
    shift_sigma: Triple | None = key(None, "on its card; absent: held, or free", unit="m", low=0.0001)
    shift_free: bool = key(False, "free, where it has no sigma")
    drift: Triple = key(_ZERO, "actual drift of each strip, 1 sigma", unit="m/s", low=0.0)
    drift_sigma: Triple | None = key(None, "on its card; absent: held, or free", unit="m/s", low=0.000001)
    drift_free: bool = key(False, "free, where it has no sigma")
    interval: float = key(5.0, "from exposure to exposure", unit="s", low=0.001)


@dataclass(frozen=True, kw_only=True, eq=False)
class GivenAntennas:
    """Tables of the block, by name, and true values of what runs may adjust: kind, owner, parameter, value."""

    tables: dict[str, model.Table]
    parameters: tuple[tuple[model.ObservationKind, str, str, float], ...]


def state_antennas(scene: Scene) -> GivenAntennas:
    """Return the antenna positions of a spec as the deck gives them; nothing without."""
    keys, flight, draws = scene.spec.antenna, scene.spec.flight, scene.draws
    if keys is None:
        return GivenAntennas(tables={}, parameters=())
    strips, of_strip = flight.strips, flight.photos
    n, stations = strips * of_strip, scene.flight.stations
    names = [f"L{strip + 1}" for strip in range(strips)]
    line, number = np.divmod(np.arange(n), of_strip)
    time = np.round((line * (of_strip + _TURN) + number) * keys.interval, _TIME)
    since = time - time.reshape(strips, of_strip).mean(axis=1)[line]
    shift = np.round(draws.normal("antenna shifts", strips, 3) * keys.shift, _SHIFT)
    drift = np.round(draws.normal("antenna drifts", strips, 3) * keys.drift, _DRIFT)
    arm_error = np.round(draws.normal("lever arm errors", 3) * keys.lever_arm_error, _ARM)
    R = np.eye(3)
    R[[0, 0, 1], [1, 2, 2]] = R[[1, 2, 2], [0, 0, 1]] = keys.correlation
    error = draws.normal("antenna errors", n, 3) @ np.linalg.cholesky(R).T * keys.error
    local = error + shift[line] + drift[line] * since[:, None]
    local += np.einsum("nji,j->ni", attitude_matrix(scene.flight.attitude), np.array(keys.lever_arm))
    places = scene.world.at_xyz(stations.xyz + np.einsum("nji,nj->ni", stations.vertical, local))
    correlated = any(keys.correlation)
    tables: dict[str, model.Table] = {
        "antenna_positions": model.AntennaPositions(
            photo=np.arange(n),
            line=np.array(names)[line],
            position=places.job,
            sigma=np.tile(_NONE if correlated else keys.sigma, (n, 1)),
        ),
        "exposure_times": model.ExposureTimes(photo=np.arange(n), time=time),
    }
    if correlated:
        tables["antenna_covariances"] = model.AntennaCovariances(
            photo=np.arange(n), sigma=np.tile(keys.sigma, (n, 1)), correlation=np.tile(keys.correlation, (n, 1))
        )
    if any(keys.lever_arm) or any(arm_error) or keys.lever_arm_sigma or keys.lever_arm_free:
        tables["lever_arms"] = model.LeverArms(
            camera=np.zeros(1, dtype=int),
            offset=np.array([keys.lever_arm]) + arm_error,
            sigma=np.array([keys.lever_arm_sigma or _NONE]),
            free=np.array([keys.lever_arm_free]),
        )
    if keys.shift_sigma or keys.shift_free or keys.drift_sigma or keys.drift_free:
        tables["antenna_lines"] = model.AntennaLines(
            line=np.array(names),
            shift_sigma=np.tile(keys.shift_sigma or _NONE, (strips, 1)),
            shift_free=np.full(strips, keys.shift_free),
            drift_sigma=np.tile(keys.drift_sigma or _NONE, (strips, 1)),
            drift_free=np.full(strips, keys.drift_free),
        )
    return GivenAntennas(tables=tables, parameters=_true(scene.spec.camera.id, names, keys, shift, drift))


def _true(
    camera: str, names: list[str], keys: AntennaKeys, shift: FloatArray, drift: FloatArray
) -> tuple[tuple[model.ObservationKind, str, str, float], ...]:
    kinds = model.ObservationKind
    rows = [
        (kinds.LEVER_ARM, camera, f"ARM {axis}", value) for axis, value in zip(AXES, keys.lever_arm, strict=True)
    ]
    for kind, what, of_lines in ((kinds.ANTENNA_SHIFT, "SHIFT", shift), (kinds.ANTENNA_DRIFT, "DRIFT", drift)):
        for name, values in zip(names, of_lines.tolist(), strict=True):
            rows += [(kind, name, f"{what} {axis}", value) for axis, value in zip(DIRECTIONS, values, strict=True)]
    return tuple(rows)
