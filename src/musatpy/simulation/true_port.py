"""The flat port of a simulation: its truth, and what PRT and CAL cards say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from musatpy.model import PORT_PARAMETERS, PORT_SIZES, ObservationKind, Ports
from musatpy.model.tables import Table
from musatpy.simulation.scene_keys import KindKeys, TrueParameter
from musatpy.simulation.true_lens import require_once, state_unknowns
from musatpy.specs import Pair, key, require
from musatpy.units import DEGREE

if TYPE_CHECKING:
    from musatpy.simulation.terrain import Scene


@dataclass(frozen=True, kw_only=True)
class PortUnknownKeys:
    """[[port.unknown]]: a parameter of the port, and its CAL card."""

    name: str = key(doc="as on the card", choices=PORT_PARAMETERS)
    sigma: float | None = key(None, "on the card; absent: free", low=0.0)
    error: float | None = key(None, "actual error of the value on the card, 1 sigma; absent: as sigma", low=0.0)

    def __post_init__(self) -> None:
        require(self.sigma != 0.0, "sigma must be greater than zero")


@dataclass(frozen=True, kw_only=True)
class PortKeys(KindKeys):
    """[port]: the camera is behind a flat port; its true values, which its PRT card has too."""

    distance: float = key(
        doc="of the inner face of the glass from the projection centre", unit="mm", low=0.0, high=1000.0
    )
    thickness: float = key(10.0, "of the glass", unit="mm", low=0.0, high=1000.0)
    glass: float = key(1.52, "its refractive index", low=1.0, high=2.0)
    water: float = key(1.335, "refractive index of the water outside; 1: air, over [water]", low=1.0, high=2.0)
    tilt: Pair = key((0.0, 0.0), "of the glass about image x, then y", unit="deg", low=-30.0, high=30.0)
    unknown: tuple[PortUnknownKeys, ...] = key(())

    def __post_init__(self) -> None:
        require_once(self.unknown)

    @property
    def values(self) -> tuple[float, ...]:
        """In the order of `PORT_PARAMETERS`."""
        return (self.distance, self.thickness, self.glass, self.water, *self.tilt)

    def stated(self, scene: Scene) -> tuple[dict[str, Table], tuple[TrueParameter, ...]]:
        """Return what PRT and CAL cards of the deck say, and the truth of the port."""
        true = dict(zip(PORT_PARAMETERS, self.values, strict=True))
        cards = state_unknowns(true, self.unknown, scene.draws.normal("port", len(self.unknown)))
        sizes = {name: np.array([value]) for name, value in zip(PORT_SIZES, self.values, strict=False)}
        ports = Ports(camera=np.zeros(1, dtype=int), **sizes, tilt=np.array([self.tilt]) * DEGREE)
        parts: dict[str, Table] = {"ports": ports, "lens_unknowns": cards}
        return parts, TrueParameter.of(ObservationKind.PORT, scene.spec.camera.id, true, self.values)
