"""Antenna positions of a satellite receiver on board: lever arm, shifts and drifts of strips, times."""

from __future__ import annotations

import numpy as np

from musatpy import model
from musatpy.arrays import FloatArray
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.model.correlations import correlations_of
from musatpy.model.gnss import AXES, DIRECTIONS
from musatpy.model.tables import Table
from musatpy.simulation.scene_keys import AntennaKeys
from musatpy.simulation.terrain import Scene
from musatpy.simulation.true_lens import TrueParameter

_NONE = (np.nan, np.nan, np.nan)
_TURN = 10  # exposures that a turn from strip to strip takes as long as
_ARM, _SHIFT, _DRIFT, _TIME = 4, 4, 6, 4  # decimals on the cards


def state_antennas(scene: Scene) -> tuple[dict[str, Table], tuple[TrueParameter, ...]]:
    """Return the tables of the block, by name, and the truth of what runs may adjust; nothing without antennas."""
    keys, flight, draws = scene.spec.antenna, scene.spec.flight, scene.draws
    if keys is None:
        return {}, ()
    strips, of_strip = flight.strips, flight.photos
    n, stations = strips * of_strip, scene.flight.stations
    names = [f"L{strip + 1}" for strip in range(strips)]
    line, number = np.divmod(np.arange(n), of_strip)
    time = np.round((line * (of_strip + _TURN) + number) * keys.interval, _TIME)
    since = time - time.reshape(strips, of_strip).mean(axis=1)[line]
    shift = np.round(draws.normal("antenna shifts", strips, 3) * keys.shift, _SHIFT)
    drift = np.round(draws.normal("antenna drifts", strips, 3) * keys.drift, _DRIFT)
    arm_error = np.round(draws.normal("lever arm errors", 3) * keys.lever_arm_error, _ARM)
    R = correlations_of(np.array([keys.correlation]))[0]
    error = draws.normal("antenna errors", n, 3) @ np.linalg.cholesky(R).T * keys.error
    local = error + shift[line] + drift[line] * since[:, None]
    local += np.einsum("nji,j->ni", attitude_matrix(scene.flight.attitude), np.array(keys.lever_arm))
    places = scene.world.at_xyz(stations.xyz + np.einsum("nji,nj->ni", stations.vertical, local))
    tables: dict[str, Table] = {
        "antenna_positions": model.AntennaPositions(
            photo=np.arange(n),
            line=np.array(names)[line],
            position=places.job,
            sigma=np.tile(keys.sigma, (n, 1)),
            correlation=np.tile(keys.correlation if any(keys.correlation) else _NONE, (n, 1)),
        ),
        "exposure_times": model.ExposureTimes(photo=np.arange(n), time=time),
    }
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
    return tables, _true(scene.spec.camera.id, names, keys, shift, drift)


def _true(
    camera: str, names: list[str], keys: AntennaKeys, shift: FloatArray, drift: FloatArray
) -> tuple[TrueParameter, ...]:
    kinds = model.ObservationKind
    owned = [(kinds.LEVER_ARM, camera, "ARM", AXES, keys.lever_arm)]
    for kind, what, of_lines in ((kinds.ANTENNA_SHIFT, "SHIFT", shift), (kinds.ANTENNA_DRIFT, "DRIFT", drift)):
        owned += [
            (kind, name, what, DIRECTIONS, tuple(row)) for name, row in zip(names, of_lines.tolist(), strict=True)
        ]
    return tuple(
        TrueParameter(kind=kind, owner=owner, name=f"{what} {axis}", value=value)
        for kind, owner, what, axes, values in owned
        for axis, value in zip(axes, values, strict=True)
    )
