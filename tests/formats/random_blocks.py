"""Blocks with random values in every field, of any coordinate system: they mean nothing, but fit a deck."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from musatpy import model
from musatpy.formats.conditions import index_of
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

    def block(self) -> model.Block:
        rng = self.rng
        cameras, photos, points = rng.integers(1, 4), rng.integers(1, 6), rng.integers(1, 30)
        block = model.Block(
            titles=tuple(f"TITLE {number}" for number in range(rng.integers(0, 3))),
            options=self.options(),
            ellipsoid=self.ellipsoid(),
            water=self.water(),
            cameras=self.cameras(cameras),
            distortion=self.distortion(cameras),
            fiducials=self.fiducials(cameras),
            photos=self.photos(photos, cameras),
            fiducial_measurements=self.fiducial_measurements(photos),
            points=model.Points(ids=self.ids(points, 8), bathymetric=rng.random(points) < 0.4),
            plates=self.plates(photos, points),
            control=self.control(points),
            equal_elevations=self.equal_elevations(points),
            air_bases=self.air_bases(photos),
            distances=model.Distances(**self.between(points, "length")),
            height_differences=model.HeightDifferences(**self.between(points, "difference")),
            reduction=self.reduction(),
            comparator=self.comparator(),
            lenses=self.lenses(cameras),
            mark_distances=self.mark_distances(cameras),
            reseau=self.reseau(cameras),
            cross_measurements=self.cross_measurements(photos),
            **self.waves(),
        )
        return _in_order_of_appearance(block)

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

    def between(self, points: int, value: str) -> dict[str, np.ndarray]:
        count = self.rng.integers(0, 4)
        return {
            "point": self.rng.integers(0, points, (count, 2)),
            value: self.rng.uniform(1, 9000, count),
            "sigma": self.rng.uniform(0.01, 1, count),
        }

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

    def distortion(self, cameras: int) -> model.Distortion:
        count = self.rng.integers(0, 4)
        values = self.normal(1e-3, count, 3)
        values[self.rng.random(count) < 0.5, 2] = np.nan
        return model.Distortion(
            camera=self.rng.integers(0, cameras, count),
            kind=self.rng.choice(["RADL", "DCEN", "TABL"], count),
            values=values,
        )

    def fiducials(self, cameras: int) -> model.Fiducials:
        count = self.rng.integers(0, 5)
        return model.Fiducials(
            camera=self.rng.integers(0, cameras, count),
            ids=self.ids(count, 4),
            xy=self.normal(110, count, 2),
            sigma=self.sigma(0.01, count, 2),
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

    def lenses(self, cameras: int) -> model.Lenses:
        count = self.rng.integers(0, 3)
        return model.Lenses(
            camera=self.rng.integers(0, cameras, count),
            centre=self.sigma(1, count, 2),
            k0=np.where(self.rng.random(count) < 0.3, np.nan, self.normal(1e-4, count)),
        )

    def mark_distances(self, cameras: int) -> model.MarkDistances:
        count = self.rng.integers(0, 5)
        return model.MarkDistances(
            camera=self.rng.integers(0, cameras, count),
            marks=np.array([self.ids(2, 4) for _ in range(count)], dtype=str).reshape(count, 2),
            distance=self.rng.uniform(10, 400, count),
            sigma=self.rng.uniform(0.001, 0.01, count),
            axis=self.rng.choice(["", "X", "Y", "D1", "D2"], count),
        )

    def reseau(self, cameras: int) -> model.ReseauCrosses:
        count = self.rng.integers(0, 8)
        return model.ReseauCrosses(
            camera=self.rng.integers(0, cameras, count),
            ids=self.ids(count, 8),
            row=self.rng.integers(1, 100, count),
            column=self.rng.integers(1, 100, count),
            xy=self.normal(110, count, 2),
        )

    def cross_measurements(self, photos: int) -> model.CrossMeasurements:
        count = self.rng.integers(0, 8)
        return model.CrossMeasurements(
            photo=self.rng.integers(0, photos, count), ids=self.ids(count, 8), xy=self.normal(110, count, 2)
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

    def fiducial_measurements(self, photos: int) -> model.FiducialMeasurements:
        count = self.rng.integers(0, 5)
        return model.FiducialMeasurements(
            photo=self.rng.integers(0, photos, count),
            ids=self.ids(count, 4),
            xy=self.normal(110, count, 2),
            sigma=self.sigma(0.01, count, 2),
        )

    def plates(self, photos: int, points: int) -> model.PlateMeasurements:
        count = self.rng.integers(1, 40)
        return model.PlateMeasurements(
            photo=self.rng.integers(0, photos, count),
            point=self.rng.integers(0, points, count),
            xy=self.normal(110, count, 2),
            sigma=self.sigma(0.05, count, 2),
            triangulated=self.rng.random(count) < 0.8,
        )

    def control(self, points: int) -> model.Control:
        count = self.rng.integers(0, 6)
        position = self.position(count)
        missing = self.rng.random(position.shape) < 0.2
        return model.Control(
            point=self.rng.integers(0, points, count),
            kind=self.rng.integers(0, 4, count),
            fixed=self.rng.random(count) < 0.3,
            position=np.where(missing, np.nan, position),
            sigma=self.sigma(5, count, 3),
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

    def air_bases(self, photos: int) -> model.AirBases:
        count = self.rng.integers(0, 4)
        return model.AirBases(
            photo=self.rng.integers(0, photos, (count, 2)),
            length=self.rng.uniform(1, 9000, count),
            sigma=self.rng.uniform(0.01, 1, count),
        )


def _in_order_of_appearance(block: model.Block) -> model.Block:
    """Return the block with its points in the order in which a deck names them; a flag needs a plate or control."""
    parts = (block.plates, block.control, block.equal_elevations, block.distances, block.height_differences)
    links = np.concatenate([part.point.reshape(-1) for part in parts])
    order = np.array(list(dict.fromkeys(links.tolist())))
    rank = np.full(len(block.points.ids), -1)
    rank[order] = np.arange(len(order))
    flagged = np.isin(order, np.concatenate([block.plates.point, block.control.point]))
    plates, control, groups, distances, heights = (replace(part, point=rank[part.point]) for part in parts)
    points = model.Points(ids=block.points.ids[order], bathymetric=block.points.bathymetric[order] & flagged)
    return replace(
        block,
        points=points,
        plates=plates,
        control=control,
        equal_elevations=groups,
        distances=distances,
        height_differences=heights,
    )
