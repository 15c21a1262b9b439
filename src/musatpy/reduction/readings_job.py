"""A job that starts from comparator readings: reduced as its deck says, and the block comes back refined."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from musatpy.arrays import BoolArray
from musatpy.model import Block, CrossMeasurements, FiducialMeasurements, ReductionOptions, Refused
from musatpy.model.reduction import Reduced, ReducedPlate, ReductionStep, Spread
from musatpy.model.tables import empty, renumbered, taken
from musatpy.reduction.plate_steps import PlateReduction
from musatpy.reduction.quantities import quantities
from musatpy.reduction.refined_block import reduction_of, refined
from musatpy.reduction.repeats import Means


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
    return _with_photos(done, good), Reduced(given=block, plates=tuple(_plate(plate) for plate in told))


def _with_photos(block: Block, wanted: BoolArray) -> Block:
    """Return the block with the photos that are `wanted` (n,), and with what belongs to them only."""
    if wanted.all():
        return block
    number, tables = np.cumsum(wanted) - 1, {}
    for name in ("plates", "air_bases"):
        table = getattr(block, name)
        kept = wanted[table.photo]
        kept = kept.all(axis=tuple(range(1, kept.ndim)))
        tables[name] = renumbered(taken(table, kept), {"photos": number})
    return replace(block, photos=taken(block.photos, wanted), **tables)


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
