"""What a compilation is worth: as the verdict on a run, with its reasons."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.compilation.against_run import AgainstRun
from musatpy.compilation.compiled import Compiled
from musatpy.compilation.triangulation import PUNCHED, Triangulation
from musatpy.model import Concern, Grade, Reason, Verdict
from musatpy.model.findings import GRADES
from musatpy.probability import test_limit

_HALF = 5.0  # sigmas that half of the y-parallaxes of a model are beyond: no errors of run and pointing do that
_POINTS = "Point Compilation"  # beginning of titles of the listing


def verdict_of(compiled: Compiled, against: Sequence[AgainstRun]) -> Verdict:
    """Return what the points of a compilation are worth; `against` as its models are held against the run.

    Plates whose y-parallaxes are impossible reject it, as does a deck none of whose readings makes a point. What is
    wrong with some of the points, or with the run, makes it doubtful.
    """
    recovery = (text for part in against for text in part.warnings())
    reasons = [
        *_of_run(compiled.run),
        *_parallaxes(compiled),
        *_positions(compiled),
        *_heights(compiled),
        *(_doubt(Concern.GIVEN_STATIONS, text, "Recoverability") for text in recovery),
    ]
    return _ranked(reasons, compiled.run)


def _of_run(run: Triangulation) -> Iterator[Reason]:
    """Yield what speaks against the run; that it is a punched deck does not: its points are the same."""
    if run.caution and run.caution != PUNCHED:
        yield _doubt(Concern.CONVERGENCE, f"{run.caution}: {run.because}" if run.because else run.caution)


def _parallaxes(compiled: Compiled) -> Iterator[Reason]:
    """Yield the y-parallaxes that errors of pointing, stations and water do not make."""
    test = np.abs(compiled.parallax_test)
    known, gross = np.isfinite(test), np.zeros(len(test), dtype=bool)
    for model in compiled.models:
        here = known & (compiled.model_ids == model.name)
        if here.any() and (half := float(np.median(test[here]))) > _HALF:
            gross |= here
            text = (
                f"model {model.name}: half of its y-parallaxes are beyond {half:.1f} sigmas: are its plates "
                "mirrored, or of another photo, camera or interior orientation than in the run?"
            )
            yield _rejection(Concern.OBSERVATION, text, _POINTS)
    limit = test_limit(int(known.sum()))
    beyond = known & ~gross & (np.nan_to_num(test) > limit)
    if beyond.any():
        worst = _worst(compiled, beyond, test)
        text = (
            f"{_counted(beyond, 'y-parallax', 'y-parallaxes')} beyond the test (limit {limit:.1f}): {worst} sigmas"
        )
        yield _doubt(Concern.OBSERVATION, text, _POINTS)


def _positions(compiled: Compiled) -> Iterator[Reason]:
    """Yield that most readings make no points."""
    lost = np.array([reason is not None for reason in compiled.reasons])
    first = next((reason for reason in compiled.reasons if reason is not None), "")
    if lost.all():
        text = f"none of {len(lost)} readings makes a point: nothing is compiled ({first})"
        yield _rejection(Concern.DISTANCE, text, "Points Without Coordinates")
        return
    for model in compiled.models:
        without = lost[compiled.model_ids == model.name]
        if 2 * without.sum() > len(without):
            text = f"model {model.name}: {without.sum()} of {len(without)} readings make no points"
            yield _doubt(Concern.DISTANCE, text, "Points Without Coordinates")


def _heights(compiled: Compiled) -> Iterator[Reason]:
    """Yield the points on the other side of the water than their flags say, and a shoreline that is off it."""
    over = compiled.over_water / compiled.sigma[:, 2]
    submerged, shore = compiled.submerged, compiled.on_shore
    limit = test_limit(int(np.isfinite(over).sum()))
    with np.errstate(invalid="ignore"):
        kinds = (
            (submerged & (over > limit), "flagged as submerged, above the water"),
            (~submerged & ~shore & (over < -limit), "not flagged as submerged, below the water"),
            (shore & (np.abs(over) > limit), "on the shoreline, off the water"),
        )
    for rows, words in kinds:
        if rows.any():
            worst = _worst(compiled, rows, np.abs(compiled.over_water), ".2f")
            yield _doubt(Concern.STATION, f"{_counted(rows, 'point', 'points')} {words}: {worst} m", _POINTS)


def _worst(compiled: Compiled, rows: BoolArray, size: FloatArray, form: str = ".1f") -> str:
    """Return the largest of some points in words."""
    row = int(np.argmax(np.where(rows, size, -np.inf)))
    point = compiled.deck.stages.ids[compiled.rows[row]]
    return f"point {point} of model {compiled.model_ids[row]} by {size[row]:{form}}"


def _counted(rows: BoolArray, one: str, many: str) -> str:
    count = int(rows.sum())
    return f"{count} {one if count == 1 else many}"


def _doubt(concern: Concern, text: str, section: str = "") -> Reason:
    return Reason(grade=Grade.DOUBTFUL, concern=concern, text=text, section=section)


def _rejection(concern: Concern, text: str, section: str = "") -> Reason:
    return Reason(grade=Grade.REJECTED, concern=concern, text=text, section=section)


def _ranked(reasons: list[Reason], run: Triangulation) -> Verdict:
    ranked = sorted(reasons, key=lambda reason: -GRADES.index(reason.grade))
    return Verdict(reasons=tuple(ranked), notes=(run.caution,) if run.caution == PUNCHED else ())
