"""Sensors on board of a simulation, a satellite antenna and an inertial unit: what is true, what cards say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy import model
from musatpy.geometry.body import BodyAngles, body_angles
from musatpy.geometry.collinearity import attitude_matrix, turn
from musatpy.model.correlations import correlations_of
from musatpy.model.gnss import AXES, DIRECTIONS
from musatpy.model.tables import Table
from musatpy.simulation.scene_keys import KindKeys, TrueParameter, require_positive
from musatpy.specs import Triple, key
from musatpy.units import ARC_SECOND, DEGREE

if TYPE_CHECKING:
    from musatpy.simulation.terrain import Scene

_NONE = (np.nan, np.nan, np.nan)
_TURN = 10  # exposures that a turn from strip to strip takes as long as
_ARM, _SHIFT, _DRIFT, _TIME = 4, 4, 6, 4  # decimals on the cards


@dataclass(frozen=True, kw_only=True)
class AntennaKeys(KindKeys):
    """[antenna]: positions of a satellite antenna at the exposures, each strip a line; none without it."""

    error: Triple = key((0.0, 0.0, 0.0), "actual error east, north, up, 1 sigma", unit="m", low=0.0)
    sigma: Triple = key((0.05, 0.05, 0.1), "on the cards", unit="m", low=0.0001)
    correlation: Triple = key(
        (0.0, 0.0, 0.0),
        "of the errors, east-north, east-up, north-up: then on GNC cards",
        low=-0.99,
        high=0.99,
        quiet=True,
    )
    lever_arm: Triple = key((0.0, 0.0, 0.0), "true, along the axes of the photo", unit="m")
    lever_arm_error: Triple = key((0.0, 0.0, 0.0), "actual error on its card, 1 sigma", unit="m", low=0.0)
    lever_arm_sigma: Triple | None = key(None, "on its card; absent: held, or free", unit="m", low=0.0001)
    lever_arm_free: bool = key(False, "free, where it has no sigma")
    shift: Triple = key((0.0, 0.0, 0.0), "actual shift of each strip, 1 sigma", unit="m", low=0.0)
    shift_sigma: Triple | None = key(None, "on its card; absent: held, or free", unit="m", low=0.0001)
    shift_free: bool = key(False, "free, where it has no sigma")
    drift: Triple = key((0.0, 0.0, 0.0), "actual drift of each strip, 1 sigma", unit="m/s", low=0.0)
    drift_sigma: Triple | None = key(None, "on its card; absent: held, or free", unit="m/s", low=0.000001)
    drift_free: bool = key(False, "free, where it has no sigma")
    interval: float = key(5.0, "from exposure to exposure", unit="s", low=0.001)

    def __post_init__(self) -> None:
        require_positive(self.correlation)

    def stated(self, scene: Scene) -> tuple[dict[str, Table], tuple[TrueParameter, ...]]:
        """Return the tables of the block, and the truth of lever arm, shifts and drifts."""
        flight, draws = scene.spec.flight, scene.draws
        strips, of_strip = flight.strips, flight.photos
        n, stations = strips * of_strip, scene.flight.stations
        names = [f"L{strip + 1}" for strip in range(strips)]
        line, number = np.divmod(np.arange(n), of_strip)
        time = np.round((line * (of_strip + _TURN) + number) * self.interval, _TIME)
        since = time - time.reshape(strips, of_strip).mean(axis=1)[line]
        shift = np.round(draws.normal("antenna shifts", strips, 3) * self.shift, _SHIFT)
        drift = np.round(draws.normal("antenna drifts", strips, 3) * self.drift, _DRIFT)
        arm_error = np.round(draws.normal("lever arm errors", 3) * self.lever_arm_error, _ARM)
        R = correlations_of(np.array([self.correlation]))[0]
        error = draws.normal("antenna errors", n, 3) @ np.linalg.cholesky(R).T * self.error
        local = error + shift[line] + drift[line] * since[:, None]
        local += np.einsum("nji,j->ni", attitude_matrix(scene.flight.attitude), np.array(self.lever_arm))
        places = scene.world.at_xyz(stations.xyz + np.einsum("nji,nj->ni", stations.vertical, local))
        tables: dict[str, Table] = {
            "antenna_positions": model.AntennaPositions(
                photo=np.arange(n),
                line=np.array(names)[line],
                position=places.job,
                sigma=np.tile(self.sigma, (n, 1)),
                correlation=np.tile(self.correlation if any(self.correlation) else _NONE, (n, 1)),
            ),
            "exposure_times": model.ExposureTimes(photo=np.arange(n), time=time),
        }
        if any(self.lever_arm) or any(arm_error) or self.lever_arm_sigma or self.lever_arm_free:
            tables["lever_arms"] = model.LeverArms(
                camera=np.zeros(1, dtype=int),
                offset=np.array([self.lever_arm]) + arm_error,
                sigma=np.array([self.lever_arm_sigma or _NONE]),
                free=np.array([self.lever_arm_free]),
            )
        if self.shift_sigma or self.shift_free or self.drift_sigma or self.drift_free:
            tables["antenna_lines"] = model.AntennaLines(
                line=np.array(names),
                shift_sigma=np.tile(self.shift_sigma or _NONE, (strips, 1)),
                shift_free=np.full(strips, self.shift_free),
                drift_sigma=np.tile(self.drift_sigma or _NONE, (strips, 1)),
                drift_free=np.full(strips, self.drift_free),
            )
        kinds, camera = model.ObservationKind, scene.spec.camera.id
        true = TrueParameter.of(kinds.LEVER_ARM, camera, (f"ARM {axis}" for axis in AXES), self.lever_arm)
        for kind, what, of_lines in ((kinds.ANTENNA_SHIFT, "SHIFT", shift), (kinds.ANTENNA_DRIFT, "DRIFT", drift)):
            for name, values in zip(names, of_lines.tolist(), strict=True):
                true += TrueParameter.of(kind, name, (f"{what} {axis}" for axis in DIRECTIONS), values)
        return tables, true


_ANGLE = 8  # of the degrees on cards


@dataclass(frozen=True, kw_only=True)
class InertialKeys(KindKeys):
    """[inertial]: an inertial unit on the camera; errors and sigmas about x forward, y left, z up of the body."""

    angles: str = key("RPY", "of the INS cards, as on INO", choices=("OPK", "POK", "RPY"))
    error: Triple = key((0.0, 0.0, 0.0), "actual errors of attitudes, 1 sigma", unit="arcsec", low=0.0)
    sigma: Triple = key((10.0, 10.0, 20.0), "on the INS cards", unit="arcsec", low=0.1)
    misalignment: Triple = key((0.0, 0.0, 0.0), "true omega, phi, kappa from camera to body", unit="deg")
    misalignment_error: Triple = key((0.0, 0.0, 0.0), "actual errors on the MIS card", unit="arcsec", low=0.0)
    misalignment_sigma: Triple | None = key(None, "on the MIS card; absent: held, or free", unit="arcsec", low=0.1)
    free: bool = key(False, "it is free, where it has no misalignment_sigma")

    def stated(self, scene: Scene) -> tuple[dict[str, Any], tuple[TrueParameter, ...]]:
        """Return the parts of the block that the cards make, and the truth of the misalignment, degrees.

        P = exp([e]x) B M with the errors e: attitudes are those in the true vertical of the true station.
        """
        n, draws, sigma = len(scene.flight.ids), scene.draws, self.misalignment_sigma
        error, off = draws.normal("inertial errors", n, 3) * self.error, draws.normal("misalignment errors", 3)
        B = attitude_matrix(np.multiply(self.misalignment, DEGREE)) @ attitude_matrix(scene.flight.attitude)
        angles = body_angles(turn(error * ARC_SECOND) @ B, BodyAngles(self.angles)) / DEGREE
        on_card = self.misalignment + off * self.misalignment_error * (ARC_SECOND / DEGREE)
        parts = {
            "inertial_convention": model.InertialConvention(angles=self.angles),
            "inertial_attitudes": model.InertialAttitudes(
                photo=np.arange(n),
                angles=np.round(angles, _ANGLE) * DEGREE,
                sigma=np.tile(self.sigma, (n, 1)) * ARC_SECOND,
            ),
            "misalignments": model.Misalignments(
                camera=np.zeros(1, dtype=int),
                angles=np.round(on_card, _ANGLE)[None] * DEGREE,
                sigma=np.array([sigma or _NONE]) * ARC_SECOND,
                free=np.array([self.free and sigma is None]),
            ),
        }
        kind, owner = model.ObservationKind.MISALIGNMENT, scene.spec.camera.id
        return parts, TrueParameter.of(kind, owner, model.MISALIGNMENT_ANGLES, self.misalignment)
