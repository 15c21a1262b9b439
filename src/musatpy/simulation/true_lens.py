"""The lens of a simulation, and a flat port: true parameters, images through the lens, what CAL and PRT cards say.

The formulas are those of the adjustment in other words, and share no code with them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import SpecError
from musatpy.model import (
    LENS_PARAMETERS,
    PORT_PARAMETERS,
    PORT_SIZES,
    DistortionSide,
    LensUnknowns,
    ObservationKind,
    Polynomials,
    Ports,
    ReductionOptions,
)
from musatpy.model.tables import Table
from musatpy.simulation.scene_keys import KindKeys, TrueParameter
from musatpy.specs import Pair, key, require
from musatpy.units import DEGREE

if TYPE_CHECKING:
    from musatpy.simulation.simulation_spec import SimulationSpec
    from musatpy.simulation.terrain import Scene

_REACH = 1.2  # half diagonals of the plate: polynomials say nothing of what lies beyond
_MOST = 0.3  # of its distance from the principal point, that an image is displaced at most
_STEPS, _REST = 100, 1e-11  # mm


@dataclass(frozen=True, kw_only=True)
class LensParameterKeys:
    """[[lens.parameter]]: a parameter of the true lens, and its CAL card; mm and powers of them."""

    name: str = key(doc="as on the card", choices=LENS_PARAMETERS)
    change: float = key(0.0, "true value minus that of [camera], minus zero where that has none")
    unknown: bool = key(True, "it has a CAL card; else the deck does not know of the change")
    sigma: float | None = key(
        None, "on the card, with a value; absent: free, starting from that of [camera]", low=0.0
    )
    error: float | None = key(None, "actual error of the value on the card, 1 sigma; absent: as sigma", low=0.0)

    def __post_init__(self) -> None:
        require(self.sigma != 0.0, "sigma must be greater than zero")
        require(self.sigma is not None or self.error is None, "error is that of a value with a sigma")


@dataclass(frozen=True, kw_only=True)
class LensKeys(KindKeys):
    """[lens]: the true lens, where it is not that of [camera] without distortion."""

    side: str = key("MEASURED", "of whose place the polynomials are, as on RED", choices=tuple(DistortionSide))
    polynomials: str = key("DIST", "what they give, as on RED", choices=tuple(Polynomials))
    parameter: tuple[LensParameterKeys, ...] = key(())

    def __post_init__(self) -> None:
        require_once(self.parameter)

    def stated(self, scene: Scene) -> tuple[dict[str, Any], tuple[TrueParameter, ...]]:
        """Return what CAL and RED cards of the deck say, and the truth of all parameters."""
        unknown, true = [given for given in self.parameter if given.unknown], true_lens(scene.spec)
        side, polynomials = DistortionSide(self.side), Polynomials(self.polynomials)
        parts = {
            "lens_unknowns": state_unknowns(true, unknown, scene.draws.normal("lens", len(unknown))),
            "reduction": ReductionOptions(side=side, polynomials=polynomials),
        }
        return parts, TrueParameter.of(ObservationKind.LENS, scene.spec.camera.id, true, true.values())


def require_once(given: Sequence[LensParameterKeys | PortUnknownKeys]) -> None:
    """Raise `ValueError` where a parameter is given twice."""
    require(len({parameter.name for parameter in given}) == len(given), "a parameter is given twice")


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


def true_lens(spec: SimulationSpec) -> dict[str, float]:
    """Return the true parameters of the camera of a spec by their names on CAL cards."""
    camera = spec.camera
    values = dict.fromkeys(LENS_PARAMETERS, 0.0)
    values |= {"F": camera.focal_length, "XP": camera.principal_point[0], "YP": camera.principal_point[1]}
    for given in spec.lens.parameter if spec.lens else ():
        values[given.name] += given.change
    return values


def through_lens(spec: SimulationSpec, ideal: FloatArray) -> FloatArray:
    """Return the images (k, 2) mm of ideal places (k, 2) about the principal point; NaN far beyond the plate.

    Raises `SpecError` where the distortion is no small part of a place.
    """
    values, lens = true_lens(spec), spec.lens or LensKeys()
    sign = -1.0 if lens.polynomials == Polynomials.CORRECTION else 1.0
    k1, k2, k3, p1, p2 = (sign * values[name] for name in ("K1", "K2", "K3", "P1", "P2"))
    reach = np.hypot(*ideal.T)
    ideal = np.where((reach <= _REACH * np.hypot(*spec.camera.format) / 2.0)[:, None], ideal, np.nan)

    def displaced(place: FloatArray) -> FloatArray:  # ideal place + what the lens does at another one
        x, y = place.T
        r2 = x**2 + y**2
        radial = r2 * (k1 + r2 * (k2 + r2 * k3))
        dx = x * radial + p1 * (r2 + 2.0 * x**2) + 2.0 * p2 * x * y
        dy = y * radial + p2 * (r2 + 2.0 * y**2) + 2.0 * p1 * x * y
        if np.any(np.hypot(dx, dy) > _MOST * np.sqrt(r2)):
            message = f"images are displaced by more than {_MOST:g} of their distance from the principal point"
            raise SpecError.of(message, field="lens")
        return ideal + np.column_stack([dx, dy])

    b1, b2 = 1.0 + values["B1"], values["B2"]
    principal = [values["XP"], values["YP"]]
    if lens.side == DistortionSide.IDEAL:
        x, y = displaced(ideal).T
        return np.column_stack([b1 * x + b2 * y, y]) + principal
    place = ideal
    for _ in range(_STEPS):
        before, place = place, displaced(place)
        if not np.any(np.abs(place - before) > _REST):
            break
    x, y = place.T
    return np.column_stack([(x - b2 * y) / b1, y]) + principal


def state_unknowns(
    true: Mapping[str, float], unknown: Sequence[LensParameterKeys | PortUnknownKeys], deviate: FloatArray
) -> LensUnknowns:
    """Return what CAL cards say of true parameters that are unknown (k); `deviate` (k,) are normal deviates."""
    value, sigma = (np.full(len(unknown), np.nan) for _ in range(2))
    for row, given in enumerate(unknown):
        error = given.sigma if given.error is None else given.error
        if error is not None:
            value[row] = float(f"{true[given.name] + error * deviate[row]:.9e}")
        sigma[row] = np.nan if given.sigma is None else given.sigma
    return LensUnknowns(
        camera=np.zeros(len(unknown), dtype=int),
        parameter=np.array([given.name for given in unknown], dtype=np.str_),
        value=value,
        sigma=sigma,
    )
