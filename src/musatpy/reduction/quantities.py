"""The parameters of the steps as named numbers with sigmas, for a listing."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model.reduction import Quantity, Unit
from musatpy.reduction import comparator, distortion, planar
from musatpy.reduction.atmosphere import Refraction
from musatpy.reduction.comparator import Comparator
from musatpy.reduction.curvature import Curvature
from musatpy.reduction.distortion import Lens
from musatpy.reduction.planar import Plane
from musatpy.reduction.plate_steps import PlateReduction
from musatpy.reduction.reseau import Reseau


def quantities(plate: PlateReduction, name: str) -> tuple[Quantity, ...]:
    """Return the parameters of a step of a plate; none where the step was not taken."""
    applied = plate.step(name)
    if applied is None:
        return ()
    step = applied.step
    if isinstance(step, Comparator):
        return _comparator(step)
    if isinstance(step, Plane):
        return _plane(step, plate)
    if isinstance(step, Reseau):
        return _reseau(step)
    if isinstance(step, Lens):
        return _lens(step)
    if isinstance(step, Refraction):
        return (Quantity(name="K", value=step.K, unit="rad"),)
    if isinstance(step, Curvature):
        height = Quantity(name="height above ground", value=step.height, unit="m")
        return (height, Quantity(name="radius of the earth", value=step.radius, unit="m"))
    raise TypeError(f"{type(step).__name__} is no step of a plate reduction")


def _comparator(step: Comparator, covariance: FloatArray | None = None) -> tuple[Quantity, ...]:
    """Return scales and angles, with sigmas where they were estimated."""
    units: tuple[Unit, ...] = ("mm/unit", "mm/unit", "rad", "rad")
    variance = np.full(4, np.nan) if covariance is None else np.diagonal(covariance)
    sigma = np.sqrt(np.maximum(variance, 0.0))  # that of a similarity's lean is zero but for rounding errors
    return tuple(
        Quantity(name=name, value=float(value), unit=unit, sigma=float(spread))
        for name, value, unit, spread in zip(comparator.PARAMETERS, step.parameters(), units, sigma, strict=True)
    )


def _plane(step: Plane, plate: PlateReduction) -> tuple[Quantity, ...]:
    """Return the parameters with their sigmas, and scales and angles of the linear part."""
    fit = plate.marks.fit if plate.marks is not None else None
    sigma = np.full(len(step.parameters), np.nan) if fit is None else np.sqrt(np.diagonal(fit.covariance))
    parameters = tuple(
        Quantity(name=name, value=float(value), sigma=float(spread), unit="mm" if name in _SHIFTS else "")
        for name, value, spread in zip(planar.parameter_names(step.kind), step.parameters, sigma, strict=True)
    )
    linear = comparator.from_matrix(step.matrix()[:2, :2])
    covariance = None if fit is None else comparator.parameter_covariance(linear, fit.linear_covariance)
    return parameters + _comparator(linear, covariance)


_SHIFTS = ("tx", "ty", "a3", "b3")


def _reseau(step: Reseau) -> tuple[Quantity, ...]:
    known = np.isfinite(step.measured).all(axis=-1)
    gap = step.deformation()[known]
    return (
        Quantity(name="crosses measured", value=float(known.sum()), unit="count"),
        Quantity(name="crosses calibrated", value=float(known.size), unit="count"),
        Quantity(name="rms deformation x", value=float(np.sqrt(np.square(gap[:, 0]).mean())), unit="mm"),
        Quantity(name="rms deformation y", value=float(np.sqrt(np.square(gap[:, 1]).mean())), unit="mm"),
        Quantity(name="largest deformation", value=float(np.linalg.norm(gap, axis=1).max()), unit="mm"),
    )


def _lens(step: Lens) -> tuple[Quantity, ...]:
    """Return the centre and what is not zero of the coefficients, and the table."""
    values = np.concatenate([step.centre, step.k, step.p])
    named = [
        Quantity(name=name, value=float(value), unit="mm" if name in ("xs", "ys") else "")
        for name, value in zip(distortion.PARAMETERS, values, strict=True)
        if value != 0.0 or name in ("xs", "ys")
    ]
    table = [
        Quantity(name=f"distortion at {radius:.3f} mm", value=float(radial), unit="mm")
        for radius, radial in zip(step.radius, step.radial, strict=True)
    ]
    return (*named, *table)
