"""The inertial unit of a simulation: its true attitudes and misalignment, and what INO, INS and MIS cards say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.geometry.body import BodyAngles, body_angles
from musatpy.geometry.collinearity import attitude_matrix, turn
from musatpy.model import MISALIGNMENT_ANGLES as ANGLES
from musatpy.model import InertialAttitudes, InertialConvention, Misalignments, ObservationKind
from musatpy.simulation.scene_keys import KindKeys, TrueParameter
from musatpy.specs import Triple, key
from musatpy.units import ARC_SECOND, DEGREE

if TYPE_CHECKING:
    from musatpy.simulation.terrain import Scene

_DECIMALS = 8  # of the degrees on cards


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
            "inertial_convention": InertialConvention(angles=self.angles),
            "inertial_attitudes": InertialAttitudes(
                photo=np.arange(n),
                angles=np.round(angles, _DECIMALS) * DEGREE,
                sigma=np.tile(self.sigma, (n, 1)) * ARC_SECOND,
            ),
            "misalignments": Misalignments(
                camera=np.zeros(1, dtype=int),
                angles=np.round(on_card, _DECIMALS)[None] * DEGREE,
                sigma=np.array([sigma or (np.nan,) * 3]) * ARC_SECOND,
                free=np.array([self.free and sigma is None]),
            ),
        }
        kind, owner = ObservationKind.MISALIGNMENT, scene.spec.camera.id
        return parts, TrueParameter.of(kind, owner, ANGLES, self.misalignment)
