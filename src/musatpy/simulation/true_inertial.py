"""The inertial unit of a simulation: its true attitudes and misalignment, and what INO, INS and MIS cards say."""

from __future__ import annotations

from typing import Any

import numpy as np

from musatpy.geometry.body import BodyAngles, body_angles
from musatpy.geometry.collinearity import attitude_matrix, turn
from musatpy.model import MISALIGNMENT_ANGLES as ANGLES
from musatpy.model import InertialAttitudes, InertialConvention, Misalignments, ObservationKind
from musatpy.simulation.simulation_spec import SimulationSpec
from musatpy.simulation.terrain import Scene
from musatpy.simulation.true_lens import TrueParameter
from musatpy.units import ARC_SECOND, DEGREE

_DECIMALS = 8  # of the degrees on cards


def state_inertial(scene: Scene) -> dict[str, Any]:
    """Return the parts of the block that the cards make, none without an inertial unit.

    P = exp([e]x) B M with the errors e: attitudes are those in the true vertical of the true station.
    """
    keys, draws = scene.spec.inertial, scene.draws
    if keys is None:
        return {}
    n, sigma = len(scene.flight.ids), keys.misalignment_sigma
    error, off = draws.normal("inertial errors", n, 3) * keys.error, draws.normal("misalignment errors", 3)
    B = attitude_matrix(np.multiply(keys.misalignment, DEGREE)) @ attitude_matrix(scene.flight.attitude)
    angles = body_angles(turn(error * ARC_SECOND) @ B, BodyAngles(keys.angles)) / DEGREE
    on_card = keys.misalignment + off * keys.misalignment_error * (ARC_SECOND / DEGREE)
    return {
        "inertial_convention": InertialConvention(angles=keys.angles),
        "inertial_attitudes": InertialAttitudes(
            photo=np.arange(n),
            angles=np.round(angles, _DECIMALS) * DEGREE,
            sigma=np.tile(keys.sigma, (n, 1)) * ARC_SECOND,
        ),
        "misalignments": Misalignments(
            camera=np.zeros(1, dtype=int),
            angles=np.round(on_card, _DECIMALS)[None] * DEGREE,
            sigma=np.array([sigma or (np.nan,) * 3]) * ARC_SECOND,
            free=np.array([keys.free and sigma is None]),
        ),
    }


def true_misalignment(spec: SimulationSpec) -> tuple[TrueParameter, ...]:
    """Return the truth of a misalignment, degrees, nothing where the spec has none."""
    true = zip(ANGLES, spec.inertial.misalignment, strict=True) if spec.inertial else ()
    kind, owner = ObservationKind.MISALIGNMENT, spec.camera.id
    return tuple(TrueParameter(kind=kind, owner=owner, name=name, value=value) for name, value in true)
