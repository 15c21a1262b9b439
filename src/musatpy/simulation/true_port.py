"""The flat port of a simulation: its truth, and what PRT and CAL cards say."""

from __future__ import annotations

import numpy as np

from musatpy.draws import Draws
from musatpy.model import PORT_PARAMETERS, PORT_SIZES, LensUnknowns, ObservationKind, Ports
from musatpy.model.tables import empty
from musatpy.simulation.scene_keys import PortKeys
from musatpy.simulation.simulation_spec import SimulationSpec
from musatpy.simulation.true_lens import TrueParameter, state_unknowns
from musatpy.units import DEGREE


def true_port(spec: SimulationSpec) -> tuple[TrueParameter, ...]:
    """Return the truth of a port, nothing where the spec has none."""
    values = zip(PORT_PARAMETERS, spec.port.values, strict=True) if spec.port else ()
    return tuple(
        TrueParameter(kind=ObservationKind.PORT, owner=spec.camera.id, name=name, value=value)
        for name, value in values
    )


def state_port(port: PortKeys | None, draws: Draws) -> tuple[Ports, LensUnknowns]:
    """Return what PRT and CAL cards of the deck say."""
    if port is None:
        return empty(Ports), empty(LensUnknowns)
    true = dict(zip(PORT_PARAMETERS, port.values, strict=True))
    cards = state_unknowns(true, port.unknown, draws.normal("port", len(port.unknown)))
    sizes = {name: np.array([value]) for name, value in zip(PORT_SIZES, port.values, strict=False)}
    return Ports(camera=np.zeros(1, dtype=int), **sizes, tilt=np.array([port.tilt]) * DEGREE), cards
