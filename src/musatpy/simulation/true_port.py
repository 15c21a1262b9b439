"""The flat port of a simulation: its truth, and what PRT and CAL cards say."""

from __future__ import annotations

import numpy as np

from musatpy.draws import Draws
from musatpy.model import PORT_PARAMETERS, LensUnknowns, ObservationKind, Ports
from musatpy.model.tables import empty
from musatpy.simulation.scene_keys import PortKeys
from musatpy.simulation.simulation_spec import SimulationSpec
from musatpy.simulation.true_lens import TrueParameter
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
    true, unknown = dict(zip(PORT_PARAMETERS, port.values, strict=True)), port.unknown
    sigma = np.array([np.nan if given.sigma is None else given.sigma for given in unknown])
    error = np.array([(given.sigma or 0.0) if given.error is None else given.error for given in unknown])
    value = np.array([true[given.name] for given in unknown]) + error * draws.normal("port", len(unknown))
    cards = LensUnknowns(
        camera=np.zeros(len(unknown), dtype=int),
        parameter=np.array([given.name for given in unknown], dtype=np.str_),
        value=np.array([float(f"{one:.9e}") for one in value.tolist()]),
        sigma=sigma,
    )
    distance, thickness, glass, water, *tilt = (np.array([one]) for one in port.values)
    ports = Ports(
        camera=np.zeros(1, dtype=int),
        distance=distance,
        thickness=thickness,
        glass_index=glass,
        water_index=water,
        tilt=np.column_stack(tilt) * DEGREE,
    )
    return ports, cards
