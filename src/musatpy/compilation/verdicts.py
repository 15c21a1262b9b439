"""What is odd about a compilation, and what it is worth: as the verdict on a run, with its reasons."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from musatpy.arrays import BoolArray, FloatArray
from musatpy.compilation.against_run import AgainstRun
from musatpy.compilation.compiled import ABOVE, MISSED, Compiled, CompiledModel
from musatpy.compilation.loop import Drive, stages
from musatpy.compilation.stereomodels import slip_of
from musatpy.compilation.triangulation import PUNCHED
from musatpy.compilation.true_points import Readings, true_points
from musatpy.model import Concern, CoordinateSystem, Grade, Reason, Verdict
from musatpy.model.findings import GRADES
from musatpy.probability import test_limit

_HALF = 5.0  # sigmas that half of the y-parallaxes of a model are beyond: no errors of run and pointing do that
_NAMED = 10  # points of a kind of warning that are named, the worst
_FARTHEST, _PART_OF_HEIGHT = 20.0, 0.1  # m, or of the flying height in local jobs, of a datum from the water
_OFF = 0.001  # m by which points without y-parallax may be off before it is told
_POINTS = "Point Compilation"  # beginning of titles of the listing


def warnings_of(compiled: Compiled) -> Iterator[str]:
    """Yield what is odd about the run and the readings."""
    if compiled.run.caution:
        yield f"{compiled.run.caution}: {compiled.run.because}" if compiled.run.because else compiled.run.caution
    yield from (text for _, text in slips(compiled))
    for model in compiled.models:
        lost = _lost_without_parallax(compiled, model)
        if lost > _OFF:
            yield f"model {model.name} has model points without y-parallax: up to {lost:.3f} m in this model"
    parallax, test = 1e3 * compiled.points.y_parallax, np.abs(compiled.y_parallax_test)
    over = compiled.over_water / compiled.sigma[:, 2]
    land = ~compiled.submerged & ~compiled.on_shore
    beyond = np.isfinite(compiled.height) & np.isnan(compiled.datum_depth)
    if beyond.any():
        yield f"{np.count_nonzero(beyond)} points lie outside the grid of the datum {compiled.datum.name}"
    if compiled.deck.datum is not None:
        yield from far_datum(compiled)
    metres, size = compiled.over_water, np.abs(over)
    kinds: tuple[tuple[BoolArray, FloatArray, Callable[[int], str]], ...] = (
        (test > MISSED, test, lambda row: f"has a y-parallax of {parallax[row]:.1f} um, {test[row]:.1f} sigmas"),
        (compiled.too_high, size,
         lambda row: f"is flagged as submerged and stands {metres[row]:.2f} m above the water"),
        (land & (over < -ABOVE), size,
         lambda row: f"is not flagged as submerged and lies {-metres[row]:.2f} m below the water"),
        (compiled.on_shore & (size > MISSED), size,
         lambda row: f"is on the shoreline and {metres[row]:+.2f} m off the water"),
    )  # fmt: skip
    for odd, sigmas, words in kinds:
        rows = np.flatnonzero(odd)
        worst = rows[np.argsort(-sigmas[rows], kind="stable")[:_NAMED]]
        yield from (f"{_point(compiled, row)} {words(row)}" for row in np.sort(worst).tolist())
        if len(rows) > _NAMED:
            yield f"and {len(rows) - _NAMED} more points that are less off; see the table of points"


def _point(compiled: Compiled, row: int) -> str:
    return f"point {compiled.ids[row]} of model {compiled.model_ids[row]}"


def far_datum(compiled: Compiled, below: float = 0.0) -> Iterator[str]:
    """Yield that a datum so far (m) `below` that of the bottom is farther from the water than any tide."""
    gap = compiled.datum_depth - below + compiled.over_water
    if not np.isfinite(gap).any():
        return
    middle, farthest = float(np.nanmedian(gap)), _FARTHEST
    if compiled.run.block.options.system is CoordinateSystem.LOCAL:
        farthest = _PART_OF_HEIGHT * float(np.median([model.stereo.height for model in compiled.models]))
    if abs(middle) > farthest:
        side = "above" if middle > 0.0 else "below"
        yield (
            f"the sounding datum is {abs(middle):.1f} m {side} the water, more than {farthest:.3g} m: "
            "one of both may be a height above the ellipsoid, and the other above mean sea level"
        )


def slips(compiled: Compiled) -> Iterator[tuple[int, str]]:
    """Yield the models (rows) most of whose readings make no points, and what would."""
    for row, model in enumerate(compiled.models):
        if slip := slip_of(model.stereo, model.readings.xy):
            yield row, f"model {model.name}: most of its readings give no points, but would if {slip}"


def lost(compiled: Compiled) -> Iterator[tuple[int, str]]:
    """Yield the readings of the deck (rows) that give no position, and why."""
    for row, reason in enumerate(compiled.reasons):
        if reason is not None:
            yield int(compiled.rows[row]), f"{_point(compiled, row)} has no position: {reason}"


def _lost_without_parallax(compiled: Compiled, model: CompiledModel) -> float:
    """Return by how much (m) submerged points are off at most whose y-parallax was not read; 0 without any.

    By rays to a shared point, where they should have their own.
    """
    if model.drive is Drive.TRUE:
        return 0.0
    stereo, unread = model.stereo, compiled.deck.stages.without_parallax[model.rows]
    position = model.points.position[unread & model.points.wet.all(axis=1)]
    position = position[np.isfinite(position).all(axis=1)]
    if not len(position):
        return 0.0
    run, true = stereo.run, stereo.run.frame.working(position)
    shared = np.repeat(stereo.half_way(stages(stereo, stereo.model(true)))[:, None], 2, axis=1)
    readings = Readings.of(stereo.images(shared), np.ones(len(true), dtype=bool), model.pointing)
    again = true_points(run.without_errors, stereo.photos, readings).position
    return float(np.nanmax(np.linalg.norm(run.frame.working(again) - true, axis=1), initial=0.0))


def verdict_of(compiled: Compiled, against: Sequence[AgainstRun]) -> Verdict:
    """Return what the points of a compilation are worth; `against` as its models are held against the run.

    Plates whose y-parallaxes are impossible reject it, as does a deck none of whose readings makes a point. What is
    wrong with some of the points, or with the run, makes it doubtful; that it is a punched deck does not: its
    points are the same.
    """
    run, reasons = compiled.run, list[Reason]()
    if run.caution and run.caution != PUNCHED:
        text = f"{run.caution}: {run.because}" if run.because else run.caution
        reasons.append(Reason(Grade.DOUBTFUL, Concern.CONVERGENCE, text, ""))
    reasons += [*_parallaxes(compiled), *_positions(compiled), *_heights(compiled)]
    recovery = (text for part in against for text in part.warnings())
    reasons += [Reason(Grade.DOUBTFUL, Concern.GIVEN_STATIONS, text, "Recoverability") for text in recovery]
    ranked = sorted(reasons, key=lambda reason: -GRADES.index(reason.grade))
    return Verdict(reasons=tuple(ranked), notes=(run.caution,) if run.caution == PUNCHED else ())


def _parallaxes(compiled: Compiled) -> Iterator[Reason]:
    """Yield the y-parallaxes that errors of pointing, stations and water do not make."""
    test = np.abs(compiled.y_parallax_test)
    known, gross = np.isfinite(test), np.zeros(len(test), dtype=bool)
    for model in compiled.models:
        here = known & (compiled.model_ids == model.name)
        if here.any() and (half := float(np.median(test[here]))) > _HALF:
            gross |= here
            text = (
                f"model {model.name}: half of its y-parallaxes are beyond {half:.1f} sigmas: are its plates "
                "mirrored, or of another photo, camera or interior orientation than in the run?"
            )
            yield Reason(Grade.REJECTED, Concern.OBSERVATION, text, _POINTS)
    limit = test_limit(int(known.sum()))
    beyond = known & ~gross & (np.nan_to_num(test) > limit)
    if beyond.any():
        noun = "y-parallax" if beyond.sum() == 1 else "y-parallaxes"
        worst = _worst(compiled, beyond, test, ".1f")
        text = f"{beyond.sum()} {noun} beyond the test (limit {limit:.1f}): {worst} sigmas"
        yield Reason(Grade.DOUBTFUL, Concern.OBSERVATION, text, _POINTS)


def _positions(compiled: Compiled) -> Iterator[Reason]:
    """Yield that most readings make no points."""
    lost = np.array([reason is not None for reason in compiled.reasons])
    section = "Points Without Coordinates"
    if lost.all():
        first = next((reason for reason in compiled.reasons if reason is not None), "")
        text = f"none of {len(lost)} readings gives a point: nothing is compiled ({first})"
        yield Reason(Grade.REJECTED, Concern.DISTANCE, text, section)
        return
    for model in compiled.models:
        without = lost[compiled.model_ids == model.name]
        if 2 * without.sum() > len(without):
            text = f"model {model.name}: {without.sum()} of {len(without)} readings make no points"
            yield Reason(Grade.DOUBTFUL, Concern.DISTANCE, text, section)


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
            noun = "point" if rows.sum() == 1 else "points"
            worst = _worst(compiled, rows, np.abs(compiled.over_water), ".2f")
            yield Reason(Grade.DOUBTFUL, Concern.STATION, f"{rows.sum()} {noun} {words}: {worst} m", _POINTS)


def _worst(compiled: Compiled, rows: BoolArray, size: FloatArray, form: str) -> str:
    """Return the largest of some points in words."""
    row = int(np.argmax(np.where(rows, size, -np.inf)))
    return f"{_point(compiled, row)} by {size[row]:{form}}"
