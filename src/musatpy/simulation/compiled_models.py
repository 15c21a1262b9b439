"""What an operator reads in the models of a simulated block, and soundings of the same bottom.

The bottom is a smooth surface of two waves. Its images are those of the simulation's ray tracer.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from io import StringIO
from itertools import pairwise

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.errors import SpecError
from musatpy.model import CoordinateSystem, compilation
from musatpy.model.tables import empty, stacked
from musatpy.simulation.scene_keys import CompilationKeys, SurfaceKeys
from musatpy.simulation.terrain import Scene
from musatpy.simulation.true_images import project
from musatpy.simulation.world import TruePlaces
from musatpy.units import DEGREE, MICROMETRE

_CANDIDATES = 20  # drawn for each point that is wanted: most of a model is in both formats
_CONTOURS = 2.0  # m, their interval
_STREAM = "compilation "


@dataclass(frozen=True, kw_only=True)
class CompiledTruth:
    """A compilation deck, the true places (k, 3) of its readings in the job's system, and their true depths.

    depth (k,) is below the water of the photos, their mean, NaN of dry points. soundings is the text of a file.
    """

    deck: compilation.Compilation
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


def compile_models(scene: Scene) -> CompiledTruth | None:
    """Return what is compiled in the models of a spec, None where it asks for nothing.

    Raises `SpecError` where models do not hold so many points, or the block has no water.
    """
    keys, water = scene.spec.compilation, scene.spec.water
    if keys is None:
        return None
    if water is None:
        raise SpecError.of("the block has no water", field="compilation")
    return _Models(scene=scene, keys=keys, water=water).compiled()


@dataclass(frozen=True, kw_only=True)
class _Models:
    """The models of a scene, over water, as keys say it."""

    scene: Scene
    keys: CompilationKeys
    water: SurfaceKeys

    def compiled(self) -> CompiledTruth:
        """Return the deck with its truth, and soundings. The photos of a model are neighbours of a strip."""
        strips, photos = self.scene.plan.nadirs.shape[:2]
        pairs = [pair for strip in range(strips) for pair in pairwise(range(strip * photos, (strip + 1) * photos))]
        if not pairs:
            raise SpecError.of("no strip has two photos", field="compilation")
        pair = np.array(pairs)
        read = [self._model(number, pair[number]) for number in range(len(pair))]
        stages, places = stacked([readings for readings, _ in read]), read[0][1]
        for _, more in read[1:]:
            places = places.then(more)
        names, ids = np.array([f"M{number}" for number in range(1, len(pair) + 1)]), np.array(self.scene.flight.ids)
        deck = compilation.Compilation(
            titles=self.scene.spec.title,
            models=compilation.StereomodelSpecs(
                ids=names,
                left=ids[pair[:, 0]],
                right=ids[pair[:, 1]],
                pointing=np.full(len(names), max(self.keys.pointing, 0.001) * MICROMETRE),
            ),
            stages=stages,
            profiles=self._profiles(len(pair)),
            datum=compilation.SoundingDatum(name="LEVEL", height=self.water.level),
            contours=compilation.ContourSpec(interval=_CONTOURS),
            grids=empty(compilation.GridSpecs),
        )
        tide = self.scene.flight.tide[pair].mean(axis=1)[stages.model]
        return CompiledTruth(
            deck=deck,
            position=places.job,
            depth=np.where(stages.submerged, tide - places.natural[:, 2], np.nan),
            soundings=self._soundings(places),
            angular=self.scene.spec.job.system == CoordinateSystem.GEOGRAPHIC,
        )

    def bottom(self, plan: FloatArray) -> FloatArray:
        """Return the heights (k,) of the bottom at plan coordinates (k, 2)."""
        low, high = self.keys.depth
        phase = 2.0 * np.pi * plan / self.keys.wavelength
        return np.asarray(self.water.level - 0.5 * (low + high) - 0.25 * (high - low) * np.sin(phase).sum(axis=1))

    def _model(self, number: int, pair: IntArray) -> tuple[compilation.StageReadings, TruePlaces]:
        """Return the readings of a model with the errors of the operator, and their true places."""
        keys, generated = self.keys, self.keys.points + self.keys.dry
        plan = [self._shown(number, pair, keys.points, wet=True), self._shown(number, pair, keys.dry, wet=False)]
        ids, kinds = [f"{1000 * (number + 1) + row}" for row in range(generated)], ["G"] * generated
        for line in range(keys.profiles):
            plan.append(self._line(pair, line))
            ids += [f"A{line + 1}", f"B{line + 1}", *[f"P{line + 1}"] * keys.readings]
            kinds += ["G", "G", *["P"] * keys.readings]
        submerged = np.ones(len(ids), dtype=bool)
        submerged[keys.points : generated] = False
        places = self._places(np.concatenate(plan), submerged)
        error = keys.pointing * MICROMETRE * self.scene.draws.normal(f"{_STREAM}{number} pointing", len(ids), 4)
        readings = compilation.StageReadings(
            model=np.full(len(ids), number),
            ids=np.array(ids),
            kind=np.array(kinds),
            submerged=submerged,
            xy=np.round(self._images(places, submerged, pair) + error.reshape(-1, 2, 2), 6),
            time=np.full(len(ids), np.nan),
        )
        return readings, places

    def _places(self, plan: FloatArray, submerged: BoolArray) -> TruePlaces:
        """Return places of the bottom, or of the land, at plan coordinates (k, 2)."""
        return self.scene.world.at_plan(plan, np.where(submerged, self.bottom(plan), self.scene.spec.terrain.level))

    def _shown(self, number: int, pair: IntArray, count: int, *, wet: bool) -> FloatArray:
        """Return plan coordinates (count, 2) that both photos of a model show. Raises `SpecError` for too few."""
        stream, camera = f"{_STREAM}{number} {'wet' if wet else 'dry'}", self.scene.spec.camera
        offset = (
            (self.scene.draws.uniform(stream, _CANDIDATES * max(count, 1), 2) - 0.5) * 2.0 * self.scene.plan.reach
        )
        plan = self.scene.world.plan(self.scene.flight.stations[pair]).mean(axis=0) + offset
        submerged = np.full(len(plan), wet)
        xy = self._images(self._places(plan, submerged), submerged, pair)
        half = np.array(camera.format) / 2.0 - camera.margin
        inside = np.flatnonzero((np.abs(xy - camera.principal_point) <= half).all(axis=(1, 2)))[:count]
        if len(inside) < count:
            photos = " and ".join(self.scene.flight.ids[photo] for photo in pair)
            message = f"photos {photos} show {len(inside)} of {len(plan)} places, and {count} points are wanted"
            raise SpecError.of(message, field="compilation.points")
        return plan[inside]

    def _line(self, pair: IntArray, line: int) -> FloatArray:
        """Return plan coordinates (2 + readings, 2) of the ends of a line along the base, and of its readings."""
        first, second = self.scene.world.plan(self.scene.flight.stations[pair])
        along = second - first
        across = np.array([along[1], -along[0]]) * (line - 0.5 * (self.keys.profiles - 1)) * 0.25
        steps = np.concatenate([[0.05, 0.95], np.linspace(0.08, 0.92, self.keys.readings)])
        return np.asarray(first + across + steps[:, None] * along)

    def _images(self, places: TruePlaces, submerged: BoolArray, pair: IntArray) -> FloatArray:
        """Return the exact images (k, 2, 2) mm of places on two photos."""
        ground, point = replace(self.scene.ground, places=places, bathymetric=submerged), np.arange(len(submerged))
        scene = replace(self.scene, ground=ground)
        return np.stack([project(scene, np.full(len(point), photo), point).xy for photo in pair], axis=1)

    def _profiles(self, models: int) -> compilation.ProfileSpecs:
        count = self.keys.profiles
        if not count:
            return empty(compilation.ProfileSpecs)
        lines = [(model, line + 1) for model in range(models) for line in range(count)]
        return compilation.ProfileSpecs(
            ids=np.array([f"P{line}" for _, line in lines]),
            model=np.array([model for model, _ in lines]),
            start=np.array([f"A{line}" for _, line in lines]),
            end=np.array([f"B{line}" for _, line in lines]),
            step=np.full(len(lines), 50.0),
            spacing=np.full(len(lines), 50.0),
        )

    def _soundings(self, places: TruePlaces) -> str:
        """Return soundings within the extent of the compiled points, as the text of a file."""
        keys, plan = self.keys, self.scene.world.plan(places)
        low, high = plan.min(axis=0), plan.max(axis=0)
        at = low + (high - low) * self.scene.draws.uniform(f"{_STREAM}soundings", keys.soundings, 2)
        depth = self.water.level - self.bottom(at)
        depth += keys.sounding_error * self.scene.draws.normal(f"{_STREAM}sounding errors", keys.soundings)
        angular = self.scene.spec.job.system != CoordinateSystem.LOCAL
        plane = self.scene.world.plane(at) / (DEGREE if angular else 1.0)
        lines = ["name,lat,lon,depth,sigma" if angular else "name,x,y,depth,sigma"]
        decimals = 8 if angular else 3
        rows = zip(plane.tolist(), depth.tolist(), strict=True)
        lines += [
            f"S{row:04d},{x:.{decimals}f},{y:.{decimals}f},{value:.3f},{keys.sounding_error:.3f}"
            for row, ((x, y), value) in enumerate(rows, 1)
        ]
        return "\n".join(lines) + "\n"
