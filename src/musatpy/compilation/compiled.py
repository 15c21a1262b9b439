"""A compilation deck on a run: every model set up, every reading a point with its sigma, or the reason why not."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.compilation.datums import Datum, datum_of
from musatpy.compilation.loop import Drive, Loop
from musatpy.compilation.model_points import lost_without_parallax, stages_of
from musatpy.compilation.parallax_tests import parallax_tests
from musatpy.compilation.printed import Printed, printed_points
from musatpy.compilation.slips_of_stages import slip_of
from musatpy.compilation.stereomodels import Stereomodel, off_plate, set_up
from musatpy.compilation.triangulation import Triangulation
from musatpy.compilation.true_points import Readings, TruePoints, true_points
from musatpy.compilation.views_of_points import MISSED, in_models, incidences, remarks
from musatpy.errors import CompilationError, Problem
from musatpy.model import CoordinateSystem
from musatpy.model.compilation import RECOVERABLE, SHORE, Compilation, Mode, StageReadings

if TYPE_CHECKING:
    from musatpy.compilation.answers import StatedPoints

OFF_PLATE = "its image lies off the plate"
NEARLY_PARALLEL = "its rays are nearly parallel: the sigma of its height is more than the flying height"
NO_TIDE = "it is submerged, and the tide of a photo is not given"
_ABOVE = 3.0  # sigmas of the height of a submerged point over the water that say it is flagged in error
_NAMED = 10  # points of a kind of warning that are named, the worst
_FARTHEST, _PART_OF_HEIGHT = 20.0, 0.1  # m, or of the flying height in local jobs, of a datum from the water
_OFF = 0.001  # m by which points without y-parallax may be off before it is told


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledModel:
    """A stereomodel with its k readings, `rows` of those of the deck, and points; pointing and limit in mm."""

    name: str
    stereo: Stereomodel
    mode: Mode
    printed: Printed
    pointing: float
    limit: float
    rows: IntArray
    readings: Readings
    points: TruePoints
    drive: Drive = Drive.AIR  # of the plotter that its model points come from

    def lost_without_parallax(self, stages: StageReadings) -> float:
        """Return by how much (m) submerged points are off at most whose y-parallax was not read; 0 without any."""
        if self.drive is Drive.TRUE:
            return 0.0
        rows = np.flatnonzero(stages.without_parallax[self.rows] & self.points.wet.all(axis=1))
        position = self.points.position[rows]
        position = position[np.isfinite(position).all(axis=1)]
        frame = self.stereo.run.frame
        return (
            lost_without_parallax(self.stereo, self.stereo.model(frame.working(position))) if len(position) else 0.0
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Compiled:
    """All models of a compilation deck."""

    deck: Compilation
    run: Triangulation
    models: tuple[CompiledModel, ...]

    @property
    def rows(self) -> IntArray:
        """(k,) the readings of the deck, model by model."""
        return np.concatenate([model.rows for model in self.models])

    def gathered(self, name: str) -> FloatArray:
        """Return a column of the points of all models."""
        return np.concatenate([getattr(model.points, name) for model in self.models])

    @property
    def model_ids(self) -> TextArray:
        """(k,) the model of each point."""
        return np.repeat([model.name for model in self.models], [len(model.rows) for model in self.models])

    @cached_property
    def reasons(self) -> list[str | None]:
        """(k,) why points have no position."""
        return [model.points.reasons.get(row) for model in self.models for row in range(len(model.rows))]

    @cached_property
    def apparent(self) -> FloatArray:
        """(k, 3) where the straight rays of points meet, in the system of the job: of dry ones their position."""
        apparent, position = self.gathered("apparent"), self.gathered("position")
        dry = np.asarray(~self.gathered("wet").any(axis=1))
        return np.where(np.isnan(apparent) & dry[:, None], position, apparent)

    @cached_property
    def in_models(self) -> tuple[FloatArray, FloatArray]:
        """(k, 3) m, true and apparent points in their models."""
        return in_models(self, self.gathered("position")), in_models(self, self.apparent)

    @cached_property
    def incidences(self) -> FloatArray:
        """(k, 2) rad, in air, of the rays that go through the water; NaN of dry ones."""
        return incidences(self)

    @cached_property
    def remarks(self) -> list[str | None]:
        """(k,) why points have no depth, and what else is to be said of them."""
        return remarks(self)

    @cached_property
    def answer(self) -> StatedPoints | None:
        """The points as the run states its answer, None where that is in the system of the job."""
        from musatpy.compilation.answers import stated_points  # few runs do

        return stated_points(self)

    @property
    def sigma(self) -> FloatArray:
        """(k, 3) m, east, north, up."""
        return np.sqrt(np.diagonal(self.gathered("covariance"), axis1=1, axis2=2))

    @cached_property
    def parallax_test(self) -> FloatArray:
        """(k,) y-parallaxes over their sigmas, as normal variables."""
        of_run = np.isnan(self.deck.models.pointing)
        return np.concatenate([parallax_tests(model, bool(of_run[row])) for row, model in enumerate(self.models)])

    @property
    def submerged(self) -> BoolArray:
        """(k,) flagged so."""
        return np.concatenate([model.readings.submerged for model in self.models])

    @cached_property
    def datum(self) -> Datum:
        """The sounding datum of the deck, or the height 0."""
        return datum_of(self.deck.datum, self.run)

    @cached_property
    def height(self) -> FloatArray:
        """(k,) m, heights of the points, those of the job."""
        frame, position = self.run.frame, self.gathered("position")
        known, height = np.isfinite(position).all(axis=1), np.full(len(position), np.nan)
        height[known] = frame.height(frame.working(position[known]))
        return height

    @cached_property
    def datum_depth(self) -> tuple[FloatArray, FloatArray]:
        """(k,) depths below the sounding datum, m, and their sigmas."""
        depth = self.datum.over(self.gathered("position")) - self.height
        return depth, np.hypot(self.sigma[:, 2], self.datum.sigma)

    @cached_property
    def over_water(self) -> FloatArray:
        """(k,) m, heights of points over the mean tide of both photos."""
        return self.height - np.repeat(
            [model.stereo.tides.mean() for model in self.models], [len(m.rows) for m in self.models]
        )

    @property
    def on_shore(self) -> BoolArray:
        """(k,) points of the shoreline with a position."""
        return np.asarray((self.deck.stages.kind[self.rows] == SHORE) & np.isfinite(self.over_water))

    @cached_property
    def too_high(self) -> BoolArray:
        """(k,) points that are flagged as submerged and stand above the water, by their sigmas."""
        return np.asarray(self.submerged & (self.over_water > _ABOVE * self.sigma[:, 2]))

    def warnings(self) -> Iterator[str]:
        """Yield what is odd about the run and the readings."""
        if self.run.caution:
            yield f"{self.run.caution}: {self.run.because}" if self.run.because else self.run.caution
        yield from (text for _, text in self.slips())
        for model in self.models:
            lost = model.lost_without_parallax(self.deck.stages)
            if lost > _OFF:
                yield f"model {model.name} has model points without y-parallax: up to {lost:.3f} m in this model"
        parallax, test = 1e3 * self.gathered("y_parallax"), np.abs(self.parallax_test)
        over = self.over_water / self.sigma[:, 2]
        land = ~self.submerged & ~self.on_shore
        beyond = np.isfinite(self.height) & np.isnan(self.datum_depth[0])
        if beyond.any():
            yield f"{np.count_nonzero(beyond)} points lie outside the grid of the datum {self.datum.name}"
        if self.deck.datum is not None:
            yield from self.far_datum()
        yield from self._worst(
            np.where(test > MISSED, test, np.nan),
            lambda row: f"has a y-parallax of {parallax[row]:.1f} um, {test[row]:.1f} sigmas",
        )
        yield from self._worst(
            np.where(self.too_high, over, np.nan),
            lambda row: f"is flagged as submerged and stands {self.over_water[row]:.2f} m above the water",
        )
        yield from self._worst(
            np.where(land & (over < -_ABOVE), -over, np.nan),
            lambda row: f"is not flagged as submerged and lies {-self.over_water[row]:.2f} m below the water",
        )
        yield from self._worst(
            np.where(self.on_shore & (np.abs(over) > MISSED), np.abs(over), np.nan),
            lambda row: f"is on the shoreline and {self.over_water[row]:+.2f} m off the water",
        )

    def far_datum(self, below: float = 0.0) -> Iterator[str]:
        """Yield that a datum so far (m) `below` that of the bottom is farther from the water than any tide."""
        gap = self.datum_depth[0] - below + self.over_water
        if not np.isfinite(gap).any():
            return
        middle, farthest = float(np.nanmedian(gap)), _FARTHEST
        if self.run.block.options.system is CoordinateSystem.LOCAL:
            farthest = _PART_OF_HEIGHT * float(np.median([model.stereo.height for model in self.models]))
        if abs(middle) > farthest:
            side = "above" if middle > 0.0 else "below"
            yield (
                f"the sounding datum is {abs(middle):.1f} m {side} the water, more than {farthest:.3g} m: "
                "one of both may be a height above the ellipsoid, and the other above mean sea level"
            )

    def slips(self) -> Iterator[tuple[int, str]]:
        """Yield the models (rows) most of whose readings make no points, and what would."""
        for row, model in enumerate(self.models):
            if slip := slip_of(model.stereo, model.readings.xy):
                yield row, f"model {model.name}: most of its readings make no points, and would if {slip}"

    def lost(self) -> Iterator[tuple[int, str]]:
        """Yield the readings of the deck (rows) that give no position, and why."""
        for row, model, reason in zip(self.rows.tolist(), self.model_ids.tolist(), self.reasons, strict=True):
            if reason is not None:
                yield row, f"point {self.deck.stages.ids[row]} of model {model} has no position: {reason}"

    def _worst(self, size: FloatArray, words: Callable[[int], str]) -> Iterator[str]:
        """Yield what is odd about the worst points, in their order; `size` (k,) is NaN where nothing is odd."""
        odd = np.flatnonzero(np.isfinite(size))
        worst = odd[np.argsort(-size[odd], kind="stable")[:_NAMED]]
        for row in np.sort(worst).tolist():
            yield f"point {self.deck.stages.ids[self.rows[row]]} of model {self.model_ids[row]} {words(row)}"
        if len(odd) > _NAMED:
            yield f"and {len(odd) - _NAMED} points more, less so: the table of points has them"


def compiled(run: Triangulation, deck: Compilation) -> Compiled:
    """Return the points of a compilation deck.

    Raises `CompilationError` with every model that cannot be set up and for a datum that is none.
    """
    datum_of(deck.datum, run)
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
    return Compiled(deck=deck, run=run, models=tuple(models))


def _compiled_model(run: Triangulation, deck: Compilation, row: int, stereo: Stereomodel) -> CompiledModel:
    models, stages = deck.models, deck.stages
    pointing, limit = float(models.pointing[row]), float(models.limit[row])
    if not np.isfinite(pointing):
        pointing = run.block.options.plate_sigma * run.unit_sigma
    rows = stages.of_model(row)
    sigma = np.where(np.isfinite(stages.sigma[rows]), stages.sigma[rows], pointing)
    xy, marks = stages.xy[rows], np.flatnonzero(stages.as_points[rows])
    drive = Drive.TRUE if models.true_marks[row] and len(marks) else Drive.AIR
    xy[marks] = stages_of(Loop(stereo=stereo, drive=drive), stages.place[rows[marks]], stages.parallax[rows[marks]])
    readings = Readings(
        ids=stages.ids[rows],
        submerged=stages.submerged[rows],
        xy=xy,
        sigma=np.broadcast_to(sigma[:, None, None], (len(rows), 2, 2)),
    )
    printed = Printed(
        shared_point=models.rays[row] == "SHARED",
        model_vertical=models.vertical[row] == "MODEL",
        mean_tide=models.tide[row] == "MEAN",
    )
    mode = Mode(str(models.mode[row]) or Mode.IMAGE)
    if mode is Mode.PRINTED and run.sea is not None:
        message = "the run has waves, and PRINTED is of still water: IMAGE goes through them"
        raise CompilationError([Problem(message=message)])
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


def _points(stereo: Stereomodel, readings: Readings) -> TruePoints:
    """Return the points, without those whose images or water do not allow one."""
    off = np.flatnonzero(off_plate(stereo, readings.xy).any(axis=1))
    without = dict.fromkeys(off.tolist(), OFF_PLATE)
    if not np.isfinite(stereo.tides).all() or stereo.run.block.water is None:
        without |= dict.fromkeys(np.flatnonzero(readings.submerged).tolist(), NO_TIDE)
    kept = np.setdiff1d(np.arange(len(readings.ids)), list(without))
    points = true_points(stereo.run, stereo.photos, readings.part(kept))
    points = points.among(kept, len(readings.ids), without)
    vague = np.flatnonzero(points.covariance[:, 2, 2] > np.square(stereo.height))
    return points.without(dict.fromkeys(vague.tolist(), NEARLY_PARALLEL)) if len(vague) else points


def _as_printed(stereo: Stereomodel, readings: Readings, points: TruePoints, printed: Printed) -> TruePoints:
    """Return the points with submerged ones by the formulas of ETL-0306; what is known of their errors stays."""
    frame = stereo.run.frame
    wet = np.flatnonzero(readings.submerged & points.wet.all(axis=1) & np.isfinite(points.depth))
    working = stereo.working(printed_points(stereo, readings.xy[wet], printed))
    position, depth = points.position.copy(), points.depth.copy()
    position[wet] = frame.system(working)
    depth[wet] = points.water_level[wet] - frame.height(working)
    return replace(points, position=position, depth=depth)
