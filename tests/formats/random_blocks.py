"""Blocks with random values in every field, of any coordinate system: they mean nothing, but fit a deck."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np

from musatpy import model
from musatpy.formats.refractive_index import index_of
from musatpy.model.block import in_order
from musatpy.model.tables import columns
from musatpy.units import ARC_SECOND, DEGREE

_LETTERS = np.array(list("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-+.*/"))


def random_block(seed: int, system: model.CoordinateSystem) -> model.Block:
    """Return a block with up to a few rows in every table, values blank here and there, and links everywhere."""
    return _Random(np.random.default_rng(seed), system).block()


class _Random:
    def __init__(self, rng: np.random.Generator, system: model.CoordinateSystem) -> None:
        self.rng = rng
        self.system = system

    def ids(self, count: int, width: int) -> np.ndarray:
        """Return different texts of one character to `width`."""
        texts: dict[str, None] = {}
        while len(texts) < count:
            texts["".join(self.rng.choice(_LETTERS, self.rng.integers(1, width + 1)))] = None
        return np.array(list(texts), dtype=str)

    def normal(self, scale: float, *shape: int) -> np.ndarray:
        """Return numbers of very different sizes, of either sign, up to a few times `scale`."""
        return self.rng.normal(0, scale, shape) * 10.0 ** self.rng.uniform(-6, 0, shape)

    def sigma(self, scale: float, *shape: int) -> np.ndarray:
        """Return standard deviations, a third of them not given."""
        values = scale * self.rng.uniform(0.01, 1, shape)
        return np.where(self.rng.random(shape) < 1 / 3, np.nan, values)

    def angle(self, limit: float, *shape: int) -> np.ndarray:
        """Return angles up to `limit`: any, around zero, and just below whole minutes and degrees."""
        angle = self.rng.uniform(-limit, limit, shape)
        near = np.rint(angle / DEGREE * 60) / 60 * DEGREE + self.rng.uniform(-1e-4, 1e-4, shape) * ARC_SECOND
        tiny = self.rng.uniform(-1, 1, shape) * ARC_SECOND
        return np.choose(self.rng.integers(0, 3, shape), [angle, near, tiny])

    def position(self, count: int) -> np.ndarray:
        if self.system is model.CoordinateSystem.GEOGRAPHIC:
            latitude, longitude = self.angle(np.pi / 2, count), self.angle(np.pi, count)
            return np.stack([latitude, longitude, self.normal(900, count)], axis=1)
        return self.normal(2e6, count, 3)  # beyond 1e7 the fields would drop a decimal

    def table(self, kind: Any, most: int, least: int = 0, /, **given: Callable[[int], object]) -> Any:
        """Return a table of random rows; `given` make some columns, the others go by their meaning."""
        count = int(self.rng.integers(least, most))
        values: dict[str, object] = {name: make(count) for name, make in given.items()}
        for name, about in columns(kind).items():
            shape = (count, *about.components)
            if name in given:
                continue
            if about.link:
                values[name] = self.rng.integers(0, self.sizes[about.link], shape)
            elif about.codes:
                values[name] = self.rng.choice(list(about.codes.values()), shape)
            elif name == "ids":
                values[name] = self.ids(count, 4)
            else:
                values[name] = self.sigma(0.05, *shape) if name == "sigma" else self.normal(110, *shape)
        return kind(**values)

    def between(self, low: float, high: float) -> Callable[[int], np.ndarray]:
        """Return what makes so many values between two."""
        return lambda count: self.rng.uniform(low, high, count)

    def one_of(self, *texts: str) -> Callable[[int], np.ndarray]:
        """Return what makes so many of these texts."""
        return lambda count: self.rng.choice(texts, count)

    def points(self, count: int) -> model.Points:
        ids, wet = self.ids(count, 8), self.rng.random(count) < 0.4
        return model.Points(ids=ids, bathymetric=wet, dry=~wet & (np.arange(count) % 4 == 1))

    def block(self) -> model.Block:
        rng, table, value, sigma = self.rng, self.table, self.between(1, 9000), self.between(0.01, 1)
        cameras, photos, points = rng.integers(1, 4), rng.integers(1, 6), rng.integers(1, 30)
        self.sizes = {"cameras": cameras, "photos": photos, "points": points}
        block = model.Block(
            titles=tuple(f"TITLE {number}" for number in range(rng.integers(0, 3))),
            options=self.options(),
            ellipsoid=self.ellipsoid(),
            water=self.water(),
            cameras=self.cameras(cameras),
            distortion=table(model.Distortion, 4, kind=self.one_of("RADL", "DCEN", "TABL"), values=self.distortion),
            fiducials=table(model.Fiducials, 5),
            photos=self.photos(photos, cameras),
            fiducial_measurements=table(model.FiducialMeasurements, 5),
            points=self.points(points),
            plates=table(model.PlateMeasurements, 40, 1),
            control=table(model.Control, 6, position=self.control_positions),
            equal_elevations=self.equal_elevations(points),
            air_bases=table(model.AirBases, 4, length=value, sigma=sigma),
            distances=table(model.Distances, 4, length=value, sigma=sigma),
            height_differences=table(model.HeightDifferences, 4, difference=value, sigma=sigma),
            reduction=self.reduction(),
            comparator=self.comparator(),
            lenses=table(model.Lenses, 3, k0=lambda count: self.normal(1e-4, count)),
            mark_distances=table(
                model.MarkDistances,
                5,
                marks=lambda count: np.array([self.ids(2, 4) for _ in range(count)], dtype=str).reshape(count, 2),
                distance=self.between(10, 400),
                sigma=self.between(0.001, 0.01),
                axis=self.one_of("", "X", "Y", "D1", "D2"),
            ),
            reseau=table(
                model.ReseauCrosses,
                8,
                row=lambda count: rng.integers(1, 100, count),
                column=lambda count: rng.integers(1, 100, count),
            ),
            cross_measurements=table(model.CrossMeasurements, 8),
            **self.waves(),
        )
        return _in_order_of_appearance(block)

    def distortion(self, count: int) -> np.ndarray:
        values = self.normal(1e-3, count, 3)
        values[self.rng.random(count) < 0.5, 2] = np.nan
        return values

    def control_positions(self, count: int) -> np.ndarray:
        position = self.position(count)
        return np.where(self.rng.random(position.shape) < 0.2, np.nan, position)

    def options(self) -> model.Options:
        rng = self.rng
        return model.Options(
            system=self.system,
            refraction=list(model.Refraction)[rng.integers(4)],
            weights=list(model.Weights)[rng.integers(3)],
            max_iterations=int(rng.integers(1, 1000)),
            rotation_limit=rng.uniform(0.01, 10) * ARC_SECOND,
            plate_sigma=rng.uniform(0.001, 0.05),
            submerged_factor=round(rng.uniform(1.0, 3.0), 2),
            sigma0_limit=round(rng.uniform(1.1, 30.0), 1),
            station_limit=round(rng.uniform(0.1, 9.0), 1),
            **{
                name: list(kind)[rng.integers(len(kind))]
                for name, kind in (
                    ("program", model.Program),
                    ("water_level", model.WaterLevel),
                    ("water_tilt", model.Treatment),
                    ("water_index", model.Treatment),
                    ("datum", model.Datum),
                    ("editing", model.Editing),
                    ("order", model.Order),
                    ("plate_sigma_is", model.PlateSigma),
                )
            },
        )

    def water(self) -> model.Water | None:
        tilted = model.Water(
            index=1.34,
            sigma=0.002,
            tilt_east=self.rng.normal(0.0, 20.0) * ARC_SECOND,
            tilt_north=-3.0 * ARC_SECOND,
            tilt_sigma=10.0 * ARC_SECOND,
        )
        known = model.WaterConditions(temperature=12.5, wavelength=550.0, salinity=35.0)
        of_known = model.Water(index=index_of(known), conditions=known, sigma=self.rng.choice([None, 0.002]))
        waters = [None, model.Water(index=1.334), model.Water(index=1.34, sigma=0.002), tilted, of_known]
        return self.rng.choice(waters)

    def waves(self) -> dict[str, object]:
        """Return waves with and without sigmas, and their origin."""
        count = int(self.rng.integers(0, 4))
        if not count:
            return {}
        either = self.rng.random(count) < 0.5
        parameters = {name: self.sigma(20.0, count) for name in ("period", "depth", "speed", "height_sigma")}
        waves = model.Waves(
            ids=self.ids(count, 4),
            shape=self.rng.choice(["", *model.WaveShape], count),
            length=np.where(either, np.nan, self.rng.uniform(1, 200, count)),
            height=self.rng.uniform(0, 5, count),
            azimuth=self.angle(2 * np.pi, count),
            crest=self.normal(100, count),
            length_sigma=self.sigma(5.0, count),
            azimuth_sigma=self.sigma(20 * DEGREE, count),
            crest_sigma=self.sigma(20.0, count),
            **parameters,
        )
        return {"waves": waves, "wave_origin": model.WaveOrigin(position=tuple(self.position(1)[0].tolist()))}

    def ellipsoid(self) -> model.EllipsoidSpec | None:
        if self.system is model.CoordinateSystem.LOCAL:
            return None
        if self.rng.random() < 0.5:
            return model.EllipsoidSpec(name="clrk66")
        return model.EllipsoidSpec(semi_major_axis=6378206.4, inverse_flattening=294.9786982138982)

    def cameras(self, count: int) -> model.Cameras:
        return model.Cameras(
            ids=self.ids(count, 4),
            focal_length=self.rng.uniform(20, 900, count),
            principal_point=self.normal(1, count, 2),
            format_size=self.sigma(300, count, 2),
        )

    def reduction(self) -> model.ReductionOptions | None:
        if self.rng.random() < 1 / 3:
            return None
        options = {one.name: one.default for one in fields(model.ReductionOptions)}
        kinds = {name: type(value) for name, value in options.items() if not isinstance(value, float)}
        chosen = {name: list(kind)[self.rng.integers(len(kind))] for name, kind in kinds.items()}
        limit, ground = self.sigma(0.5, 1).item(), self.sigma(3000, 1).item()
        return model.ReductionOptions(residual_limit=limit, ground_height=ground, **chosen)

    def comparator(self) -> model.ComparatorSpec | None:
        if self.rng.random() < 1 / 3:
            return None
        return model.ComparatorSpec(
            scale_u=self.rng.uniform(0.5, 1.5),
            scale_v=self.rng.uniform(0.5, 1.5),
            non_orthogonality=self.rng.normal(0, 100) * ARC_SECOND,
            rotation=self.rng.uniform(-180, 180) * DEGREE,
            left_handed=bool(self.rng.random() < 0.5),
            reading_sigma=self.rng.uniform(0.001, 5),
            repeat_limit=self.sigma(5, 1).item(),
        )

    def photos(self, count: int, cameras: int) -> model.Photos:
        tide = np.where(self.rng.random(count) < 0.3, np.nan, self.normal(2, count))
        return model.Photos(
            ids=self.ids(count, 8),
            camera=self.rng.integers(0, cameras, count),
            position=self.position(count),
            position_sigma=self.sigma(50, count, 3),
            attitude=self.angle(2 * np.pi, count, 3),
            attitude_sigma=self.sigma(1000 * ARC_SECOND, count, 3),
            tide=tide,
            tide_sigma=np.where(np.isnan(tide), np.nan, self.sigma(0.5, count)),
            tide_group=np.where(np.isnan(tide), "", self.rng.choice(["", "STRIP1", "STRIP2"], count)),
            tide_day=np.where(np.isnan(tide), "", self.rng.choice(["", "760412"], count)),
            time=np.where(np.isnan(tide), np.nan, self.sigma(86400.0, count)),
        )

    def equal_elevations(self, points: int) -> model.EqualElevations:
        groups = self.rng.integers(0, 4)
        members = self.rng.integers(0, 15) if groups else 0
        return model.EqualElevations(
            ids=self.ids(groups, 8),
            sigma=self.rng.uniform(0.01, 1, groups),
            group=np.sort(self.rng.integers(0, max(groups, 1), members)),
            point=self.rng.integers(0, points, members),
        )


def _in_order_of_appearance(block: model.Block) -> model.Block:
    """Return the block with its points in the order in which a deck names them; a flag needs a plate or control."""
    flagged = np.isin(np.arange(len(block.points.ids)), np.concatenate([block.plates.point, block.control.point]))
    points = replace(block.points, bathymetric=block.points.bathymetric & flagged, dry=block.points.dry & flagged)
    return in_order(replace(block, points=points))
