"""What an operator reads in the models of a simulated block, and soundings of the same bottom.

The bottom is a smooth surface of two waves. Its images are those of the simulation's ray tracer.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from io import StringIO
from itertools import pairwise

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.draws import Draws
from musatpy.errors import Problem, SpecError
from musatpy.model import CoordinateSystem
from musatpy.model.compilation import (
    IN_PROFILE,
    Compilation,
    ContourSpec,
    GridSpecs,
    ProfileSpecs,
    SoundingDatum,
    StageReadings,
    StereomodelSpecs,
)
from musatpy.model.tables import empty, stacked
from musatpy.simulation.compilation_keys import CompilationKeys
from musatpy.simulation.flight import FlightPlan, TrueFlight
from musatpy.simulation.simulation_spec import SimulationSpec
from musatpy.simulation.terrain import Ground
from musatpy.simulation.true_images import project
from musatpy.simulation.world import Places, World
from musatpy.units import DEGREE, MICROMETRE

_CANDIDATES = 20  # drawn for each point that is wanted: most of a model is in both formats
_UP = np.array([0.0, 0.0, 0.1])  # m, by which the direction of the x-parallax is found
_STREAM = "compilation "


@dataclass(frozen=True, kw_only=True)
class CompiledTruth:
    """A compilation deck, the true places (k, 3) of its readings in the job's system, and their true depths.

    depth (k,) is below the water of the photos, their mean, NaN of dry points. soundings is the text of a file.
    """

    deck: Compilation
    position: FloatArray
    depth: FloatArray
    soundings: str
    angular: bool  # positions are latitude, longitude (rad) and height

    def truth_csv(self) -> str:
        """Return the truth as comma-separated values: degrees and metres."""
        stages, out = self.deck.stages, StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(["model", "point", "class", "first", "second", "third", "depth"])
        unit = np.array([DEGREE, DEGREE, 1.0]) if self.angular else np.ones(3)
        models = self.deck.models.ids[stages.model].tolist()
        names = zip(models, stages.ids.tolist(), stages.kind.tolist(), strict=True)
        for name, place, depth in zip(names, self.position / unit, self.depth.tolist(), strict=True):
            texts = [f"{value:.11f}" if self.angular else f"{value:.4f}" for value in place[:2].tolist()]
            writer.writerow([*name, *texts, f"{place[2]:.4f}", "" if np.isnan(depth) else f"{depth:.4f}"])
        return out.getvalue()


def compile_models(
    spec: SimulationSpec, plan: FlightPlan, flight: TrueFlight, ground: Ground, world: World, draws: Draws
) -> CompiledTruth | None:
    """Return what is compiled in the models of a spec, None where it asks for nothing.

    Raises `SpecError` where models do not hold so many points, or the block has no water.
    """
    keys = spec.compilation
    if keys is None:
        return None
    if spec.water is None:
        raise SpecError([Problem(field="compilation", message="the block has no water")])
    scene = _Scene(spec=spec, keys=keys, plan=plan, flight=flight, ground=ground, world=world, draws=draws)
    return scene.compiled()


@dataclass(frozen=True, kw_only=True)
class _Read:
    """Readings of a model: names and classes (k,), true places, whether they are submerged, images (k, 2, 2) mm."""

    ids: TextArray
    kind: TextArray
    places: Places
    submerged: BoolArray
    xy: FloatArray


@dataclass(frozen=True, kw_only=True)
class _Scene:
    spec: SimulationSpec
    keys: CompilationKeys
    plan: FlightPlan
    flight: TrueFlight
    ground: Ground
    world: World
    draws: Draws

    def compiled(self) -> CompiledTruth:
        """Return the deck with its truth, and soundings."""
        pairs = self.pairs
        if not pairs:
            raise SpecError([Problem(field="compilation", message="no strip has two photos")])
        models = [self._model(number, *pair) for number, pair in enumerate(pairs)]
        names = np.array([f"M{number}" for number in range(1, len(pairs) + 1)])
        left, right = (np.array([self.flight.ids[pair[side]] for pair in pairs]) for side in (0, 1))
        places = [read.places for read in models]
        all_places = places[0]
        for more in places[1:]:
            all_places = all_places.with_more(more)
        deck = Compilation(
            titles=self.spec.title,
            models=StereomodelSpecs(
                ids=names,
                left=left,
                right=right,
                pointing=np.full(len(names), max(self.keys.pointing, 0.001) * MICROMETRE),
            ),
            stages=stacked([self._stages(number, read) for number, read in enumerate(models)]),
            profiles=self._profiles(len(pairs)),
            datum=SoundingDatum(name="LEVEL", height=self._level),
            contours=ContourSpec(interval=self.keys.contours),
            grids=self._grid(),
        )
        wet = np.concatenate([read.submerged for read in models])
        tide = np.concatenate(
            [
                np.full(len(read.ids), self.flight.tide[list(pair)].mean())
                for read, pair in zip(models, pairs, strict=True)
            ]
        )
        depth = np.where(wet, tide - all_places.natural[:, 2], np.nan)
        return CompiledTruth(
            deck=deck,
            position=all_places.job,
            depth=depth,
            soundings=self._soundings(all_places),
            angular=self.spec.job.system == CoordinateSystem.GEOGRAPHIC,
        )

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """The photos of each model: neighbours of a strip."""
        strips, photos = self.plan.nadirs.shape[:2]
        return [pair for strip in range(strips) for pair in pairwise(range(strip * photos, (strip + 1) * photos))]

    @property
    def _level(self) -> float:
        assert self.spec.water is not None  # asked before
        return float(self.spec.water.level)

    def bottom(self, plan: FloatArray) -> FloatArray:
        """Return the heights (k,) of the bottom at plan coordinates (k, 2)."""
        low, high = self.keys.depth
        phase = 2.0 * np.pi * plan / self.keys.wavelength
        return np.asarray(self._level - 0.5 * (low + high) - 0.25 * (high - low) * np.sin(phase).sum(axis=1))

    def _model(self, number: int, left: int, right: int) -> _Read:
        """Return the readings of a model, without errors."""
        keys, first = self.keys, 1000 * (number + 1)
        wet = self._seen(number, left, right, keys.points, submerged=True)
        dry = self._seen(number, left, right, keys.dry, submerged=False)
        ids = [f"{first + row}" for row in range(keys.points + keys.dry)]
        kinds, parts = ["G"] * len(ids), [wet, dry]
        for line in range(keys.profiles):
            parts.append(self._places(self._line(left, right, line), submerged=True))
            ids += [f"A{line + 1}", f"B{line + 1}", *[f"P{line + 1}"] * keys.readings]
            kinds += ["G", "G", *["P"] * keys.readings]
        places, submerged = parts[0]
        for more, flags in parts[1:]:
            places, submerged = places.with_more(more), np.concatenate([submerged, flags])
        xy = self._images(places, submerged, left, right)
        return _Read(ids=np.array(ids), kind=np.array(kinds), places=places, submerged=submerged, xy=xy)

    def _places(self, plan: FloatArray, *, submerged: bool) -> tuple[Places, BoolArray]:
        """Return places of the bottom, or of the land, at plan coordinates (k, 2), and that they are so."""
        height = self.bottom(plan) if submerged else np.full(len(plan), self.spec.terrain.level)
        return self.world.at_plan(plan, height), np.full(len(plan), submerged)

    def _seen(self, number: int, left: int, right: int, count: int, *, submerged: bool) -> tuple[Places, BoolArray]:
        """Return so many places that both photos of a model show. Raises `SpecError` where there are fewer."""
        nadirs = self.world.plan(self.flight.stations[np.array([left, right])])
        stream = f"{_STREAM}{number} {'wet' if submerged else 'dry'}"
        offset = (self.draws.uniform(stream, _CANDIDATES * max(count, 1), 2) - 0.5) * 2.0 * self.plan.reach
        plan = nadirs.mean(axis=0) + offset
        places, flags = self._places(plan, submerged=submerged)
        xy = self._images(places, flags, left, right)
        half = np.array(self.spec.camera.format) / 2.0 - self.spec.camera.margin
        inside = np.flatnonzero((np.abs(xy - self.spec.camera.principal_point) <= half).all(axis=(1, 2)))[:count]
        if len(inside) < count:
            photos = f"photos {self.flight.ids[left]} and {self.flight.ids[right]}"
            message = f"{photos} show {len(inside)} of {len(plan)} places, and {count} points are wanted"
            raise SpecError([Problem(field="compilation.points", message=message)])
        return places[inside], flags[inside]

    def _line(self, left: int, right: int, line: int) -> FloatArray:
        """Return plan coordinates (2 + readings, 2) of the ends of a line along the base, and of its readings."""
        first, second = self.world.plan(self.flight.stations[np.array([left, right])])
        along = second - first
        across = np.array([along[1], -along[0]]) * (line - 0.5 * (self.keys.profiles - 1)) * 0.25
        steps = np.concatenate([[0.05, 0.95], np.linspace(0.08, 0.92, self.keys.readings)])
        return np.asarray(first + across + steps[:, None] * along)

    def _images(self, places: Places, submerged: BoolArray, left: int, right: int) -> FloatArray:
        """Return the exact images (k, 2, 2) mm of places on two photos."""
        assert self.spec.water is not None
        ground = replace(self.ground, places=places, bathymetric=submerged)
        point: IntArray = np.arange(len(submerged))
        sides = [
            project(
                self.spec.camera, self.flight, ground, self.world, self.spec.water.index,
                np.full(len(point), photo), point,
            ).xy
            for photo in (left, right)
        ]  # fmt: skip
        return np.stack(sides, axis=1)

    def _stages(self, number: int, read: _Read) -> StageReadings:
        """Return the readings with the errors of the operator."""
        error = self.keys.pointing * MICROMETRE * self.draws.normal(f"{_STREAM}{number} pointing", len(read.ids), 4)
        xy = read.xy + error.reshape(-1, 2, 2)
        if self.keys.bias:
            xy[:, 1] += self.keys.bias * MICROMETRE * self._parallax(number, read)
        return StageReadings(
            model=np.full(len(read.ids), number),
            ids=read.ids,
            kind=read.kind,
            submerged=read.submerged,
            xy=np.round(xy, 6),
            time=self._times(read.kind),
        )

    def _times(self, kind: TextArray) -> FloatArray:
        """Return the times (k,) of readings, those of profiles one after the other; NaN of others."""
        in_profile = kind == IN_PROFILE
        count = np.cumsum(in_profile) - 1.0
        return np.where(in_profile & (self.keys.pace > 0.0), self.keys.pace * count, np.nan)

    def _grid(self) -> GridSpecs:
        """Return the grid of posts over all of the bottom, none where the spec asks for none."""
        if not self.keys.grid:
            return empty(GridSpecs)
        corner = np.full((1, 2), np.nan)
        return GridSpecs(
            ids=np.array(["POSTS"]),
            collocated=np.array([False]),
            spacing=np.array([self.keys.grid]),
            first=corner,
            second=corner,
        )

    def _parallax(self, number: int, read: _Read) -> FloatArray:
        """Return the direction (k, 2) in which the right image moves against the left one as a point rises."""
        higher = self.world.at_natural(read.places.natural + _UP)
        moved = self._images(higher, read.submerged, *self.pairs[number]) - read.xy
        parallax = moved[:, 1] - moved[:, 0]
        return np.asarray(parallax / np.linalg.norm(parallax, axis=1)[:, None])

    def _profiles(self, models: int) -> ProfileSpecs:
        count = self.keys.profiles
        if not count:
            return empty(ProfileSpecs)
        lines = [(model, line + 1) for model in range(models) for line in range(count)]
        return ProfileSpecs(
            ids=np.array([f"P{line}" for _, line in lines]),
            model=np.array([model for model, _ in lines]),
            start=np.array([f"A{line}" for _, line in lines]),
            end=np.array([f"B{line}" for _, line in lines]),
            step=np.full(len(lines), 50.0),
            spacing=np.full(len(lines), 50.0),
        )

    def _soundings(self, places: Places) -> str:
        """Return soundings within the extent of the compiled points, as the text of a file."""
        keys, plan = self.keys, self.world.plan(places)
        low, high = plan.min(axis=0), plan.max(axis=0)
        at = low + (high - low) * self.draws.uniform(f"{_STREAM}soundings", keys.soundings, 2)
        depth = self._level + keys.datum_offset - self.bottom(at)
        depth += keys.sounding_error * self.draws.normal(f"{_STREAM}sounding errors", keys.soundings)
        at = at + keys.place_error * self.draws.normal(f"{_STREAM}sounding places", keys.soundings, 2)
        angular = self.spec.job.system != CoordinateSystem.LOCAL
        plane = self.world.plane(at) / (DEGREE if angular else 1.0)
        lines = ["name,lat,lon,depth,sigma" if angular else "name,x,y,depth,sigma"]
        decimals = 8 if angular else 3
        rows = zip(plane.tolist(), depth.tolist(), strict=True)
        lines += [
            f"S{row:04d},{x:.{decimals}f},{y:.{decimals}f},{value:.3f},{keys.sounding_error:.3f}"
            for row, ((x, y), value) in enumerate(rows, 1)
        ]
        return "\n".join(lines) + "\n"
