"""The lens of a simulation: its true parameters, images through it, and what CAL cards say.

The formulas are those of the adjustment in other words, and share no code with them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from musatpy import model
from musatpy.arrays import FloatArray
from musatpy.draws import Draws
from musatpy.errors import SpecError
from musatpy.model.tables import empty
from musatpy.simulation.scene_keys import LensKeys, LensParameterKeys, PortUnknownKeys
from musatpy.simulation.simulation_spec import SimulationSpec

_REACH = 1.2  # half diagonals of the plate: polynomials say nothing of what lies beyond
_MOST = 0.3  # of its distance from the principal point, that an image is displaced at most
_STEPS, _REST = 100, 1e-11  # mm


@dataclass(frozen=True, kw_only=True)
class TrueParameter:
    """The truth of a parameter that a run may adjust, by the names of its record (`adjusted_parameters`)."""

    kind: model.ObservationKind
    owner: str
    name: str
    value: float


def true_lens(spec: SimulationSpec) -> dict[str, float]:
    """Return the true parameters of the camera of a spec by their names on CAL cards."""
    camera = spec.camera
    values = dict.fromkeys(model.LENS_PARAMETERS, 0.0)
    values |= {"F": camera.focal_length, "XP": camera.principal_point[0], "YP": camera.principal_point[1]}
    for given in spec.lens.parameter if spec.lens else ():
        values[given.name] += given.change
    return values


def true_parameters(spec: SimulationSpec) -> tuple[TrueParameter, ...]:
    """Return the truth of a lens, nothing where the spec has none."""
    values, owner = true_lens(spec) if spec.lens else {}, spec.camera.id
    return tuple(
        TrueParameter(kind=model.ObservationKind.LENS, owner=owner, name=name, value=value)
        for name, value in values.items()
    )


def through_lens(spec: SimulationSpec, ideal: FloatArray) -> FloatArray:
    """Return the images (k, 2) mm of ideal places (k, 2) about the principal point; NaN far beyond the plate.

    Raises `SpecError` where the distortion is no small part of a place.
    """
    values, lens = true_lens(spec), spec.lens or LensKeys()
    sign = -1.0 if lens.polynomials == model.Polynomials.CORRECTION else 1.0
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
    if lens.side == model.DistortionSide.IDEAL:
        x, y = displaced(ideal).T
        return np.column_stack([b1 * x + b2 * y, y]) + principal
    place = ideal
    for _ in range(_STEPS):
        before, place = place, displaced(place)
        if not np.any(np.abs(place - before) > _REST):
            break
    x, y = place.T
    return np.column_stack([(x - b2 * y) / b1, y]) + principal


def state_lens(spec: SimulationSpec, draws: Draws) -> tuple[model.LensUnknowns, model.ReductionOptions | None]:
    """Return what CAL and RED cards of the deck say."""
    if spec.lens is None:
        return empty(model.LensUnknowns), None
    unknown = [given for given in spec.lens.parameter if given.unknown]
    cards = state_unknowns(true_lens(spec), unknown, draws.normal("lens", len(unknown)))
    side, polynomials = model.DistortionSide(spec.lens.side), model.Polynomials(spec.lens.polynomials)
    return cards, model.ReductionOptions(side=side, polynomials=polynomials)


def state_unknowns(
    true: Mapping[str, float], unknown: Sequence[LensParameterKeys | PortUnknownKeys], deviate: FloatArray
) -> model.LensUnknowns:
    """Return what CAL cards say of true parameters that are unknown (k); `deviate` (k,) are normal deviates."""
    value, sigma = (np.full(len(unknown), np.nan) for _ in range(2))
    for row, given in enumerate(unknown):
        error = given.sigma if given.error is None else given.error
        if error is not None:
            value[row] = float(f"{true[given.name] + error * deviate[row]:.9e}")
        sigma[row] = np.nan if given.sigma is None else given.sigma
    return model.LensUnknowns(
        camera=np.zeros(len(unknown), dtype=int),
        parameter=np.array([given.name for given in unknown], dtype=np.str_),
        value=value,
        sigma=sigma,
    )
