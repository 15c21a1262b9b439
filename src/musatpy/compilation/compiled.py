"""A compilation deck on a run: every model set up, every reading a point with its sigma, or the reason why not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray, rows_of
from musatpy.compilation.loop import Drive, stages_of
from musatpy.compilation.printed import Shortcuts, printed_points
from musatpy.compilation.stereomodels import Stereomodel, off_plate, set_up
from musatpy.compilation.triangulation import AdjustedRun
from musatpy.compilation.true_points import CompiledPoints, Readings, true_points
from musatpy.errors import CompilationError, Problem, ProblemsError
from musatpy.geometry.geodesy import Frame
from musatpy.model.compilation import RECOVERABLE, SHORE, Compilation, Mode, SoundingDatum
from musatpy.probability import student_as_normal
from musatpy.soundings.s44 import order_names, orders_met

if TYPE_CHECKING:
    from musatpy.geometry.projected import Geoid

OFF_PLATE = "its image lies off the plate"
NEARLY_PARALLEL = "its rays are nearly parallel: the sigma of its height is more than the flying height"
NO_TIDE = "it is submerged, and the tide of a photo is not given"
ABOVE = 3.0  # sigmas of the height of a submerged point over the water that say it is flagged in error
MISSED = 3.29  # sigmas of a y-parallax, of 99.9 %
_SAME = 1e-6  # mm, of readings that are plate measurements of the run
_CHECKED = 1e-3  # of the variance of pointing that the stations must leave of a y-parallax that made them


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthDatum:
    """A sounding datum: heights of the job, m; with a grid, those above its surface."""

    name: str = ""
    height: float = 0.0
    sigma: float = 0.0
    geoid: Geoid | None = None
    frame: Frame | None = None  # of the job, where there is a grid

    @property
    def title(self) -> str:
        """What depths are below."""
        return self.name or "the height 0 of the job"

    def over(self, position: FloatArray) -> FloatArray:
        """Return the heights (k,) of the datum at positions (k, 3) of the job, NaN outside its grid."""
        height = np.full(len(position), self.height)
        if self.geoid is None or self.frame is None:
            return height
        known = np.isfinite(position).all(axis=1)
        level = self.frame.level(self.frame.working(position[known]))
        height[known] += self.geoid.undulation(level[:, 0], level[:, 1])
        height[~known] = np.nan
        return height


def datum_of(spec: SoundingDatum | None, run: AdjustedRun) -> DepthDatum:
    """Return the datum of a deck on a run, the height 0 without one. Raises `CompilationError` for a bad grid."""
    if spec is None:
        return DepthDatum()
    plain = DepthDatum(name=spec.name, height=spec.height, sigma=spec.sigma)
    if not spec.geoid:
        return plain
    if run.map_system is None:
        raise CompilationError.of("VDT: the run is a local job: no grid of heights applies to it")
    from musatpy.geometry.projected import Geoid  # PROJ, for few decks

    try:
        geoid = Geoid(spec.geoid)
    except ProblemsError as error:
        raise CompilationError(error.problems) from error
    return DepthDatum(name=spec.name, height=spec.height, sigma=spec.sigma, geoid=geoid, frame=run.frame)


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledModel:
    """A stereomodel with its k readings, `rows` of those of the deck, and points; pointing and limit in mm."""

    name: str
    stereo: Stereomodel
    mode: Mode
    printed: Shortcuts
    pointing: float
    limit: float
    rows: IntArray
    readings: Readings
    points: CompiledPoints
    drive: Drive = Drive.AIR  # of the plotter that its model points come from


@dataclass(frozen=True, kw_only=True, eq=False)
class Compiled:
    """The models of a compilation deck, and the table of their k readings, model by model; NaN: there is none.

    `rows` (k,) of the readings of the deck, with their `ids`, classes, flags, and the names of their models.
    Positions (k, 3) are in the system of the job, true ones in `points`; apparent ones are where straight rays
    meet, of dry points their position; both in their models (m) too. sigma (k, 3) m along east, north, up; heights
    (k,) m of the job, depths below the sounding datum with their sigmas, heights over the mean tide of both photos;
    y-parallaxes over their sigmas, as normal variables. `reasons`: why points have no position; `remarks`: why they
    have no depth, and whether their y-parallax is beyond its limit; `orders` of S-44 that submerged points meet by
    their sigmas and that of the datum, empty where there is no depth.
    """

    deck: Compilation
    run: AdjustedRun
    models: tuple[CompiledModel, ...]
    datum: DepthDatum
    rows: IntArray
    ids: TextArray
    kind: TextArray
    model_ids: TextArray
    submerged: BoolArray
    points: CompiledPoints
    apparent: FloatArray
    model_position: FloatArray
    model_apparent: FloatArray
    sigma: FloatArray
    height: FloatArray
    datum_depth: FloatArray
    datum_depth_sigma: FloatArray
    over_water: FloatArray
    on_shore: BoolArray  # of the shoreline, with a position
    too_high: BoolArray  # flagged as submerged, above the water by their sigmas
    y_parallax_test: FloatArray
    reasons: list[str | None]
    remarks: list[str | None]
    orders: TextArray


def compiled(run: AdjustedRun, deck: Compilation) -> Compiled:
    """Return the points of a compilation deck.

    Raises `CompilationError` with every model that cannot be set up and for a datum that is none.
    """
    datum = datum_of(deck.datum, run)
    problems: list[Problem] = []
    models = []
    for row, name in enumerate(deck.models.ids.tolist()):
        try:
            stereo = set_up(run, str(deck.models.left[row]), str(deck.models.right[row]))
            models.append(_compiled_model(run, deck, row, stereo))
        except CompilationError as error:
            problems += [replace(problem, message=f"model {name}: {problem.message}") for problem in error.problems]
    if problems:
        raise CompilationError(problems)
    return _table(run, deck, datum, models)


def _table(run: AdjustedRun, deck: Compilation, datum: DepthDatum, models: Sequence[CompiledModel]) -> Compiled:
    rows, points = np.concatenate([m.rows for m in models]), CompiledPoints.joined([m.points for m in models])
    numbers, frame, position = [len(m.rows) for m in models], run.frame, points.position
    kind, submerged = deck.stages.kind[rows], np.concatenate([m.readings.submerged for m in models])
    dry = np.asarray(~points.wet.any(axis=1))
    apparent = np.where(np.isnan(points.apparent) & dry[:, None], position, points.apparent)
    height = frame.height(frame.working(position))
    sigma = np.sqrt(np.diagonal(points.covariance, axis1=1, axis2=2))
    depth, tide = datum.over(position) - height, np.repeat([m.stereo.tides.mean() for m in models], numbers)
    over_water = height - tide
    on_shore = (kind == SHORE) & np.isfinite(over_water)
    test = np.concatenate(
        [
            parallax_tests(model.points, _pointing_of_run(model), run.freedom, sigma_of_run=bool(np.isnan(given)))
            for model, given in zip(models, deck.models.pointing, strict=True)
        ]
    )
    return Compiled(
        deck=deck,
        run=run,
        models=tuple(models),
        datum=datum,
        rows=rows,
        ids=deck.stages.ids[rows],
        kind=kind,
        model_ids=np.repeat([m.name for m in models], numbers),
        submerged=submerged,
        points=points,
        apparent=apparent,
        model_position=_in_models(models, position),
        model_apparent=_in_models(models, apparent),
        sigma=sigma,
        height=height,
        datum_depth=depth,
        datum_depth_sigma=np.hypot(sigma[:, 2], datum.sigma),
        over_water=over_water,
        on_shore=on_shore,
        too_high=submerged & (over_water > ABOVE * sigma[:, 2]),
        y_parallax_test=test,
        reasons=[points.reasons.get(row) for row in range(len(rows))],
        remarks=_remarks(points, submerged, on_shore, np.abs(test) > MISSED),
        orders=_orders(np.where(submerged, depth, np.nan), points.covariance, datum),
    )


def _compiled_model(run: AdjustedRun, deck: Compilation, row: int, stereo: Stereomodel) -> CompiledModel:
    models, stages = deck.models, deck.stages
    pointing, limit = float(models.pointing[row]), float(models.limit[row])
    if not np.isfinite(pointing):
        pointing = run.block.options.plate_sigma * run.unit_sigma
    rows = stages.of_model(row)
    sigma = np.where(np.isfinite(stages.sigma[rows]), stages.sigma[rows], pointing)
    xy, marks = stages.xy[rows], np.flatnonzero(stages.as_points[rows])
    drive = Drive.TRUE if models.true_marks[row] and len(marks) else Drive.AIR
    xy[marks] = stages_of(stereo, stages.place[rows[marks]], stages.parallax[rows[marks]], drive)
    readings = Readings.of(xy, stages.submerged[rows], sigma[:, None, None], stages.ids[rows])
    printed = Shortcuts(
        shared_point=models.rays[row] == "SHARED",
        model_vertical=models.vertical[row] == "MODEL",
        mean_tide=models.tide[row] == "MEAN",
    )
    mode = Mode(str(models.mode[row]) or Mode.IMAGE)
    if mode is Mode.PRINTED and run.sea is not None:
        raise CompilationError.of("the run has waves, and PRINTED is of still water: IMAGE goes through them")
    points = _points(stereo, readings)
    unread = stages.without_parallax[rows]
    points = replace(points, y_parallax=np.where(unread, np.nan, points.y_parallax))
    if mode is Mode.PRINTED:
        points = _as_printed(stereo, readings, points, printed)
    return CompiledModel(
        name=str(models.ids[row]),
        stereo=stereo,
        mode=mode,
        printed=printed,
        pointing=pointing,
        limit=limit if np.isfinite(limit) else RECOVERABLE,
        rows=rows,
        readings=readings,
        points=points,
        drive=drive,
    )


def _points(stereo: Stereomodel, readings: Readings) -> CompiledPoints:
    """Return the points, without those whose images or water do not allow one."""
    off = np.flatnonzero(off_plate(stereo, readings.xy).any(axis=1))
    without = dict.fromkeys(off.tolist(), OFF_PLATE)
    if not np.isfinite(stereo.tides).all() or stereo.run.block.water is None:
        without |= dict.fromkeys(np.flatnonzero(readings.submerged).tolist(), NO_TIDE)
    kept = np.setdiff1d(np.arange(len(readings.ids)), list(without))
    points = CompiledPoints.nothing(len(readings.ids))
    points.put(kept, true_points(stereo.run, stereo.photos, readings[kept]))
    vague = np.flatnonzero(points.covariance[:, 2, 2] > np.square(stereo.height))
    points.take_out(without | dict.fromkeys(vague.tolist(), NEARLY_PARALLEL))
    return points


def _as_printed(
    stereo: Stereomodel, readings: Readings, points: CompiledPoints, printed: Shortcuts
) -> CompiledPoints:
    """Return the points with submerged ones by the formulas of ETL-0306; what is known of their errors stays."""
    frame = stereo.run.frame
    wet = np.flatnonzero(readings.submerged & points.wet.all(axis=1) & np.isfinite(points.depth))
    working = stereo.working(printed_points(stereo, readings.xy[wet], printed))
    position, depth = points.position.copy(), points.depth.copy()
    position[wet] = frame.system(working)
    depth[wet] = points.water_level[wet] - frame.height(working)
    return replace(points, position=position, depth=depth)


def _in_models(models: Sequence[CompiledModel], position: FloatArray) -> FloatArray:
    """Return positions (k, 3) of all points as coordinates of their models, m."""
    out, first = np.full(position.shape, np.nan), 0
    for model in models:
        here = position[first : first + len(model.rows)]
        known = np.isfinite(here).all(axis=1)
        out[first : first + len(here)][known] = model.stereo.model(model.stereo.run.frame.working(here[known]))
        first += len(here)
    return out


def _remarks(points: CompiledPoints, submerged: BoolArray, on_shore: BoolArray, off: BoolArray) -> list[str | None]:
    """Return why points have no depth, and whether their y-parallax is `off`; None where all is well."""
    columns = (
        (submerged & (points.wet.sum(axis=1) == 1), "between the tides"),
        (submerged & ~points.wet.any(axis=1), "above the water"),
        (~submerged & on_shore, "shoreline"),
        (~submerged & ~on_shore, "dry"),
        (off, "y-parallax"),
    )
    texts = [", ".join(words for rows, words in columns if rows[row]) for row in range(len(off))]
    return [None if row in points.reasons or not text else text for row, text in enumerate(texts)]


def _orders(depth: FloatArray, covariance: FloatArray, datum: DepthDatum) -> TextArray:
    """Return the strictest order (k,) of S-44 that each point with a depth meets; the datum has a sigma too."""
    covariance = covariance.copy()
    covariance[:, 2, 2] += datum.sigma**2
    known, names = np.isfinite(depth), np.array(order_names(), dtype=np.str_)
    orders = np.full(len(depth), "", dtype=names.dtype)
    orders[known] = names[orders_met(depth[known], covariance[known])]
    return orders


def parallax_tests(
    points: CompiledPoints, of_run: FloatArray, freedom_of_run: float, *, sigma_of_run: bool
) -> FloatArray:
    """Return y-parallaxes (k,) over their sigmas, as normal variables; NaN where nothing checks them.

    The share of the stations is known as well as the sigma0 of the run that scales it: with few degrees of freedom
    f that may be much too small, and all points of a model with it. By Welch (1947) and Satterthwaite (1946) the
    test value is Student's t of f / s^2 degrees, s the share in the variance, and of f where the sigma of pointing
    comes from the run too (`sigma_of_run`). The y-parallaxes of readings that made the stations are residuals of
    the adjustment: of the variance of pointing less the share of the stations; `of_run` (k,) is the variance of
    their pointing in the run over that of the model, NaN of all others.
    """
    share, pointing = 1.0 - points.pointing_share, of_run * points.pointing_share
    variance, made = np.square(points.y_parallax_sigma), np.isfinite(of_run)
    freedom = np.full(len(variance), freedom_of_run)
    if not sigma_of_run:
        with np.errstate(divide="ignore"):
            freedom = freedom / np.square(np.maximum(share, 0.0))
    left = pointing - share
    variance *= np.where(made, np.where(left > _CHECKED * pointing, left, np.nan), 1.0)
    freedom = np.where(made, freedom_of_run, freedom)
    return student_as_normal(points.y_parallax / np.sqrt(variance), freedom)


def _pointing_of_run(model: CompiledModel) -> FloatArray:
    """Return (k,) the variance of pointing of readings that made the stations, in the run over that of the model.

    NaN for others, and for all where errors of known water are allowed for.
    """
    run, readings = model.stereo.run, model.readings
    at, rows = plates_of_run(model, rows_of(run.block.points.ids, readings.ids)), np.arange(len(readings.ids))
    out = np.full(len(at), np.nan)
    if not run.considered:
        made = rows[same_readings(model, rows, at)]
        made = made[run.triangulated[at[made]].all(axis=1)]
        of_run = np.square(run.block.plates.sigma[at[made]] * run.unit_sigma).mean(axis=(1, 2))
        out[made] = of_run / np.square(readings.sigma[made]).mean(axis=(1, 2))
    return out


def plates_of_run(model: CompiledModel, points: IntArray) -> IntArray:
    """Return the measurements (r, 2) of points (r,) of the run on both photos, rows of its plates, -1 for none."""
    run = model.stereo.run
    rows = np.full((len(run.block.points.ids) + 1, 2), -1)  # the last of no point
    for side, photo in enumerate(model.stereo.photos):
        here = np.flatnonzero(run.block.plates.photo == photo)
        rows[run.block.plates.point[here], side] = here
    return rows[points]


def same_readings(model: CompiledModel, rows: IntArray, plates: IntArray) -> BoolArray:
    """Return which readings `rows` (r,) are the measurements `plates` (r, 2) of the run."""
    same: BoolArray = np.asarray((plates >= 0).all(axis=1))
    gap = model.readings.xy[rows[same]] - model.stereo.run.block.plates.xy[plates[same]]
    same[same] = np.abs(gap).max(axis=(1, 2)) <= _SAME
    return same
