"""The part of the JSON record that says what raw plates were reduced from, how, and with which residuals."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from musatpy.model import Block, ReductionOptions
from musatpy.reports.encoding import Json, Rows, number, plain, rows
from musatpy.statistics import Statistics

if TYPE_CHECKING:
    from musatpy.model.reduced import Reduced, ReducedPlate, ReductionStep, Spread


def calibrations(block: Block) -> dict[str, Json]:
    """Return what a block says of the reduction of its plates besides distortion and fiducial marks."""
    lenses, distances, reseau, crosses = (
        block.lenses,
        block.mark_distances,
        block.reseau,
        block.cross_measurements,
    )
    ids = block.cameras.ids
    return {
        "comparator": _comparator(block),
        "lenses": rows(camera=ids[lenses.camera], centre=lenses.centre, k0=lenses.k0),
        "mark_distances": rows(
            camera=ids[distances.camera],
            marks=distances.marks,
            distance=distances.distance,
            sigma=distances.sigma,
            axis=distances.axis,
        ),
        "reseau": rows(
            camera=ids[reseau.camera],
            cross=reseau.ids,
            row=reseau.row.astype(int),
            column=reseau.column.astype(int),
            xy=reseau.xy,
        ),
        "cross_measurements": rows(photo=block.photos.ids[crosses.photo], cross=crosses.ids, xy=crosses.xy),
    }


def reduction(statistics: Statistics) -> dict[str, Json] | None:
    """Return how the plates were reduced, None where they came refined."""
    reduced = statistics.solution.reduced
    if reduced is None:
        return None
    return {
        "options": _options(reduced.given.reduction or ReductionOptions()),
        "readings": _readings(reduced),
        "plates": [_plate(plate) for plate in reduced.plates],
    }


def _comparator(block: Block) -> dict[str, Json] | None:
    if block.comparator is None:
        return None
    values = dataclasses.asdict(block.comparator)
    return {name: value if isinstance(value, bool) else number(value) for name, value in values.items()}


def _options(options: ReductionOptions) -> dict[str, Json]:
    return {
        "transformation": options.transformation.value,
        "residual_limit": number(options.residual_limit),
        "side": options.side.value,
        "polynomials": options.polynomials.value,
        "atmosphere": options.atmosphere.value,
        "curvature": options.curvature.value,
        "ground_height": number(options.ground_height),
        "refused": options.refused.value,
    }


def _readings(reduced: Reduced) -> Rows:
    given = reduced.given
    return rows(
        photo=given.photos.ids[given.plates.photo],
        point=given.points.ids[given.plates.point],
        xy=given.plates.xy,
        sigma=given.plates.sigma,
    )


def _plate(plate: ReducedPlate) -> dict[str, Json]:
    return {
        "photo": plate.photo,
        "refusal": plate.refusal or None,
        "reason": plate.reason or None,
        "sigma0": number(plate.sigma0),
        "freedom": plate.freedom,
        "rms": plain(plate.rms),
        "marks": rows(mark=plate.marks, residual=plate.residuals, normalized=plate.normalized),
        "distances": rows(marks=plate.ends, residual=plate.distance_residuals),
        "missing": list(plate.missing),
        "suspects": list(plate.suspects),
        "steps": [_step(step) for step in plate.steps],
        "spreads": [_spread(spread) for spread in plate.spreads],
        "beyond_reseau": list(plate.beyond_reseau),
        "beyond_table": list(plate.beyond_table),
    }


def _step(step: ReductionStep) -> dict[str, Json]:
    return {
        "step": step.name,
        "largest": number(step.largest),
        "parameters": [
            {"parameter": one.name, "value": number(one.value), "sigma": number(one.sigma), "unit": one.unit}
            for one in step.parameters
        ],
    }


def _spread(spread: Spread) -> dict[str, Json]:
    return {
        "of": spread.what,
        "freedom": spread.freedom,
        "sigma": plain(np.array(spread.pooled)),
        "probability": plain(np.array(spread.probability)),
        "unlikely": spread.unlikely,
        "largest": number(spread.largest),
        "beyond": list(spread.beyond),
    }
