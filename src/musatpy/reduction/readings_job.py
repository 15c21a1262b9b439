"""A job that starts from comparator readings: reduced as its deck says, and the block comes back refined.

The parameters of the steps as named numbers with sigmas, for a listing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model import Block, CrossMeasurements, FiducialMeasurements, ReductionOptions, Refused
from musatpy.model.block import with_rows
from musatpy.model.reduction import Quantity, Reduced, ReducedPlate, ReductionStep, Spread, Unit
from musatpy.model.tables import empty
from musatpy.reduction import distortion, planar
from musatpy.reduction.displacements import Curvature, Refraction
from musatpy.reduction.distortion import Lens
from musatpy.reduction.planar import Comparator, PlanarTransformation
from musatpy.reduction.plate_steps import PlateReduction
from musatpy.reduction.readings import Means
from musatpy.reduction.refined_block import reduction_of, refined
from musatpy.reduction.reseau import Reseau


def reduce(block: Block) -> tuple[Block, Reduced]:
    """Return a block of raw plates with their refined coordinates, and what the reduction did.

    Photos whose plates are refused are not in it, nor the air bases to them. Nor are comparator, readings of marks
    and crosses, and options of the reduction, which mean nothing beside refined coordinates.
    Raises `DeckError` where the calibrations of a camera contradict each other or the options ask for what the job
    cannot have, and `PlatesError` with every refusal where the job is to stop then, or no plate is left.
    """
    options = block.reduction or ReductionOptions()
    reductions = reduction_of(block)
    measured = [plate for plate in reductions if len(plate.ids)]
    some = any(plate.refusal is None for plate in measured)
    done = refined(block, reductions, go_on=some and options.refused is Refused.GO_ON)
    done = replace(done, reduction=None, comparator=None, cross_measurements=empty(CrossMeasurements))
    done = replace(done, fiducial_measurements=empty(FiducialMeasurements))
    good = np.array([plate.refusal is None or not len(plate.ids) for plate in reductions], dtype=bool)
    told = [plate for plate in reductions if len(plate.ids) or len(plate.mark_means.ids)]
    done = done if good.all() else with_rows(done, {"photos": good})
    return done, Reduced(given=block, plates=tuple(_plate(plate) for plate in told))


def _plate(plate: PlateReduction) -> ReducedPlate:
    """Return what a listing says of a plate."""
    marks, by_distances, refusal = plate.marks, plate.mark_distances, plate.refusal
    fit = marks.fit if marks is not None else None
    known = fit or by_distances
    none = np.zeros((0, 2))
    residuals = marks.residuals if marks is not None else none
    return ReducedPlate(
        photo=plate.photo,
        steps=tuple(
            ReductionStep(name=step.name, parameters=quantities(plate, step.name), largest=step.largest)
            for step in plate.steps
        ),
        marks=marks.ids if marks is not None else np.zeros(0, dtype=np.str_),
        residuals=residuals,
        normalized=fit.normalized if fit is not None else np.full_like(residuals, np.nan),
        ends=plate.ends,
        distance_residuals=by_distances.residuals if by_distances is not None else np.zeros(0),
        sigma0=known.sigma0 if known is not None else float("nan"),
        freedom=known.freedom if known is not None else 0,
        missing=marks.missing if marks is not None else (),
        spreads=tuple(_spreads(plate)),
        beyond_reseau=plate.beyond_reseau,
        beyond_table=plate.beyond_table,
        refusal=refusal.message if refusal is not None else "",
        reason=refusal.reason.value if refusal is not None else "",
        suspects=marks.suspects if marks is not None else (),
    )


def _spreads(plate: PlateReduction) -> Iterator[Spread]:
    """Yield the spread of what was read more than once."""
    targets: tuple[tuple[str, Means], ...] = (
        ("marks", plate.mark_means),
        ("points", plate.point_means),
        ("crosses", plate.cross_means),
    )
    for what, means in targets:
        if means.freedom:
            beyond = dict.fromkeys(means.ids[means.target[means.beyond]].tolist())
            yield Spread(
                what=what,
                freedom=means.freedom,
                pooled=(float(means.pooled[0]), float(means.pooled[1])),
                probability=(float(means.probability[0]), float(means.probability[1])),
                largest=means.largest,
                beyond=tuple(beyond),
            )


def quantities(plate: PlateReduction, name: str) -> tuple[Quantity, ...]:
    """Return the parameters of a step of a plate; none where the step was not taken."""
    applied = plate.step(name)
    if applied is None:
        return ()
    step = applied.step
    if isinstance(step, Comparator):
        return _comparator(step)
    if isinstance(step, PlanarTransformation):
        return _plane_quantities(step, plate)
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
        for name, value, unit, spread in zip(
            planar.COMPARATOR_PARAMETERS, step.parameters(), units, sigma, strict=True
        )
    )


def _plane_quantities(step: PlanarTransformation, plate: PlateReduction) -> tuple[Quantity, ...]:
    """Return the parameters with their sigmas, and scales and angles of the linear part."""
    fit = plate.marks.fit if plate.marks is not None else None
    sigma = np.full(len(step.parameters), np.nan) if fit is None else np.sqrt(np.diagonal(fit.covariance))
    parameters = tuple(
        Quantity(name=name, value=float(value), sigma=float(spread), unit="mm" if name in _SHIFTS else "")
        for name, value, spread in zip(planar.parameter_names(step.kind), step.parameters, sigma, strict=True)
    )
    linear = planar.from_matrix(step.matrix()[:2, :2])
    covariance = None if fit is None else planar.parameter_covariance(linear, fit.linear_covariance)
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
