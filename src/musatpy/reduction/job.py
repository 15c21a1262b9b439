"""A job that starts from comparator readings: reduced as its deck says, and the block comes back refined."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace

import numpy as np

from musatpy.arrays import BoolArray
from musatpy.errors import DeckError, Problem
from musatpy.model import (
    Atmosphere,
    Block,
    ComparatorSpec,
    CrossMeasurements,
    Curvature,
    FiducialMeasurements,
    Polynomials,
    ReductionOptions,
    Refused,
    Transformation,
)
from musatpy.model.reduced import Reduced, ReducedPlate, ReductionStep, Spread
from musatpy.model.tables import empty
from musatpy.reduction.atmosphere import Model
from musatpy.reduction.block import reduce_plates, refined
from musatpy.reduction.comparator import Comparator
from musatpy.reduction.distortion import Side
from musatpy.reduction.fiducials import Limits
from musatpy.reduction.pipeline import BlockReduction, PlateReduction
from musatpy.reduction.planar import Kind
from musatpy.reduction.quantities import quantities
from musatpy.reduction.readings import Grid, MarkDistances, Plan
from musatpy.reduction.repeats import Means

_AXES = {False: ("X", "Y"), True: ("D1", "D2")}  # of side marks, of corner marks


def reduce(block: Block) -> tuple[Block, Reduced]:
    """Return a block of raw plates with their refined coordinates, and what the reduction did.

    Photos whose plates are refused are not in it, nor the air bases to them. Nor are comparator, readings of marks
    and crosses, and options of the reduction, which mean nothing beside refined coordinates.
    Raises `DeckError` where the calibrations of a camera contradict each other or the options ask for what the job
    cannot have, and `PlatesError` with every refusal where the job is to stop then, or no plate is left.
    """
    options = block.reduction or ReductionOptions()
    reduction = reduction_of(block)
    measured = [plate for plate in reduction.plates if len(plate.ids)]
    some = any(plate.refusal is None for plate in measured)
    done = refined(block, reduction, go_on=some and options.refused is Refused.GO_ON)
    done = replace(done, reduction=None, comparator=None, cross_measurements=empty(CrossMeasurements))
    done = replace(done, fiducial_measurements=empty(FiducialMeasurements))
    good = np.array([plate.refusal is None or not len(plate.ids) for plate in reduction.plates], dtype=bool)
    return _with_photos(done, good), _reduced(block, measured)


def _with_photos(block: Block, wanted: BoolArray) -> Block:
    """Return the block with the photos that are `wanted` (n,), and with what belongs to them only."""
    if wanted.all():
        return block
    number = np.cumsum(wanted) - 1
    tables = {}
    for name in ("plates", "air_bases"):
        table = getattr(block, name)
        kept = wanted[table.photo]
        kept = kept if kept.ndim == 1 else kept.all(axis=1)
        rows = {one.name: getattr(table, one.name)[kept] for one in fields(table)}
        tables[name] = replace(table, **(rows | {"photo": number[rows["photo"]]}))
    photos = {one.name: getattr(block.photos, one.name)[wanted] for one in fields(block.photos)}
    return replace(block, photos=replace(block.photos, **photos), **tables)


def reduction_of(block: Block) -> BlockReduction:
    """Return the reduction of all plates of a block as its cards ask for it; raises `DeckError` as `reduce`."""
    options = block.reduction or ReductionOptions()
    by_distances = options.transformation is Transformation.DISTANCES
    lenses = block.lenses
    names: list[str] = block.cameras.ids[lenses.camera].tolist()
    centred = np.isfinite(lenses.centre).all(axis=1).astype(bool)
    return reduce_plates(
        block,
        _plan(options, block.comparator),
        ground_height=options.ground_height,
        side=Side(options.side.value),
        correction=options.polynomials is Polynomials.CORRECTION,
        symmetry={name: lenses.centre[row] for row, name in enumerate(names) if centred.item(row)},
        k0={name: float(np.nan_to_num(lenses.k0[row])) for row, name in enumerate(names)},
        distances=dict(_distances(block)) if by_distances else {},
        reseaux=dict(_reseaux(block)),
    )


def _plan(options: ReductionOptions, spec: ComparatorSpec | None) -> Plan:
    kinds = {Transformation.NONE: None, Transformation.DISTANCES: Kind.AFFINE}
    kind = kinds[options.transformation] if options.transformation in kinds else Kind(options.transformation.value)
    model = None if options.atmosphere is Atmosphere.NONE else Model(options.atmosphere.value)
    limit = options.residual_limit
    plan = Plan(
        fiducials=kind,
        limits=Limits(residual=limit if np.isfinite(limit) else float("inf")),
        refraction=model,
        curvature=options.curvature is Curvature.YES,
    )
    if spec is None:
        return plan
    comparator = Comparator(
        scale=(spec.scale_u, spec.scale_v),
        non_orthogonality=spec.non_orthogonality,
        rotation=spec.rotation,
        left_handed=spec.left_handed,
    )
    repeat = spec.repeat_limit if np.isfinite(spec.repeat_limit) else float("inf")
    return replace(plan, comparator=comparator, reading_sigma=spec.reading_sigma, repeat_limit=repeat)


def _distances(block: Block) -> Iterator[tuple[str, MarkDistances]]:
    """Yield the calibrated distances of every camera with plates; raises `DeckError` for one without its axes."""
    table = block.mark_distances
    for camera in np.unique(block.photos.camera[block.plates.photo]).tolist():
        name = str(block.cameras.ids[camera])
        own = np.flatnonzero(table.camera == camera)
        pairs = {table.axis[row]: tuple(table.marks[row].tolist()) for row in own.tolist()}
        corners = next((corners for corners, axes in _AXES.items() if set(axes) <= set(pairs)), None)
        if corners is None:
            message = "no distances along both axes (X and Y), or along both diagonals (D1 and D2)"
            raise DeckError([Problem(message=f"camera {name} has {message}")])
        first, second = (pairs[axis] for axis in _AXES[corners])
        yield (
            name,
            MarkDistances(
                ends=table.marks[own],
                distance=table.distance[own],
                sigma=table.sigma[own],
                first=first,
                second=second,
                corners=corners,
            ),
        )


def _reseaux(block: Block) -> Iterator[tuple[str, Grid]]:
    """Yield the calibrated reseau of every camera that has one, in the grid of its rows and columns."""
    table = block.reseau
    for camera in np.unique(table.camera).tolist():
        own = np.flatnonzero(table.camera == camera)
        row, column = ((places[own] - places[own].min()).astype(int) for places in (table.row, table.column))
        shape = (int(row.max()) + 1, int(column.max()) + 1)
        ids, xy = np.full(shape, "", dtype=table.ids.dtype), np.full((*shape, 2), np.nan)
        ids[row, column], xy[row, column] = table.ids[own], table.xy[own]
        yield str(block.cameras.ids[camera]), Grid(ids=ids, xy=xy)


def _reduced(block: Block, plates: Sequence[PlateReduction]) -> Reduced:
    return Reduced(given=block, plates=tuple(_plate(plate) for plate in plates))


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
            ReductionStep(name=one.name, parameters=quantities(plate, one.name), largest=one.largest)
            for one in plate.steps
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
