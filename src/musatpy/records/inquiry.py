"""One photo or one point of a run: all that its record knows of it, and what would happen without its observations.

Nothing is adjusted anew. An observation that is left out stands where all others would have it: it changes by minus
its estimated error v / r (Baarda 1968), and its point by its influence times that. This is exact for one coordinate
of a linear adjustment; both coordinates of an image are taken one by one (docs/explain.md).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.errors import MusatError, nearest
from musatpy.geometry.geodesy import metric_differences
from musatpy.model import ObservationKind
from musatpy.model.tables import falling
from musatpy.records.run_tables import ellipsoid_spec
from musatpy.records.tables import NamedRows, Tables, array_of

_DECIMALS = 2  # of test values, as they are printed

TABLES = (  # of a record, that say what is known
    "titles", "options", "ellipsoid", "verdict", "solution", "stations", "points", "bathymetric_points", "control",
    "equal_elevations", "adjusted_water", "tests", "causes", "observations", "plates",
)  # fmt: skip
_AXES = ("x", "y")
_ENOUGH, _ENOUGH_HELD = 2, 1  # rays that give a position, and with a component that is known
_PLATE = ObservationKind.PLATE.name.lower()


@dataclass(frozen=True, kw_only=True, eq=False)
class InquiredImages:
    """The k images of a point, or on a photo; NaN of those that took no part, and of what nothing checks."""

    photo: TextArray  # (k,)
    point: TextArray  # (k,)
    submerged: BoolArray  # (k,)
    triangulated: BoolArray  # (k,)
    residual: FloatArray  # (k, 2) mm
    sigma: FloatArray  # (k, 2) mm, a priori
    refraction: FloatArray  # (k,) mm, by which refraction moves the image
    tide: FloatArray  # (k,) m, height of the water at the photo
    redundancy: FloatArray  # (k, 2)
    test: FloatArray  # (k, 2) of the verdict
    detectable: FloatArray  # (k, 2) mm
    hidden: FloatArray  # (k,) m, by which the larger detectable error moves the point
    change: FloatArray  # (k, 3) m, east north up, of the point without the image; NaN where it would have no place

    @property
    def worst_first(self) -> IntArray:
        """(k,) rows by falling test value, those without one last."""
        return falling(np.nan_to_num(np.abs(self.test), nan=-1.0).max(axis=1, initial=-1.0), _DECIMALS)


@dataclass(frozen=True, kw_only=True, eq=False)
class Others:
    """The o observations besides images, in the units of their kinds (m, rad); NaN as of `InquiredImages`."""

    kind: tuple[ObservationKind, ...]
    of: tuple[str, ...]
    component: tuple[str, ...]
    residual: FloatArray  # (o,)
    sigma: FloatArray  # (o,)
    redundancy: FloatArray  # (o,)
    test: FloatArray  # (o,)
    detectable: FloatArray  # (o,)
    change: FloatArray  # (o, 3) m, of the point or the station without it


@dataclass(frozen=True, kw_only=True, eq=False)
class Neighbours:
    """Points that are on the same photos, or photos that have the same points; the nearest first."""

    ids: TextArray  # (n,)
    distance: FloatArray  # (n,) m, in space
    common: IntArray  # (n,) photos, or points
    depth: FloatArray  # (n,) m, of points; NaN on land
    sigma: FloatArray  # (n,) m, of the height
    test: FloatArray  # (n,) largest |test value| of an image


@dataclass(frozen=True, kw_only=True, eq=False)
class About:
    """What is known of one point or one photo."""

    name: str
    is_photo: bool
    row: dict[str, Any]  # of `points` or `stations`
    images: InquiredImages
    others: Others
    neighbours: Neighbours
    control: dict[str, Any] | None  # row of the table of control
    water: dict[str, Any] | None  # row of the submerged points
    check: dict[str, Any] | None  # row of the test of check points
    hidden: dict[str, Any] | None  # row of the errors that stay hidden
    causes: tuple[dict[str, Any], ...]  # of what does not fit, that name it
    alone: tuple[str, ...]  # points that no other photo would give
    moved: float  # m, of a station from the given one


def inquire(record: Tables, name: str) -> tuple[About, ...]:
    """Return what a record knows of the point of a name, and of the photo of that name.

    Raises `MusatError` with the nearest name where there is neither.
    """
    run = _RecordedRun(record)
    found = tuple(run.about(name, photo) for photo in (False, True) if name in run.named[photo].rows)
    if not found:
        likely = nearest(name, (*run.named[False].rows, *run.named[True].rows))
        raise MusatError(f"no point and no photo '{name}'" + (f"; did you mean {likely}?" if likely else ""))
    return found


class _RecordedRun:
    """The tables of a record: its points and photos by names, the rows of observations of its images."""

    def __init__(self, record: Tables) -> None:
        self.record = record
        self.named = {False: NamedRows("point", record["points"]), True: NamedRows("photo", record["stations"])}
        self.plates = record["plates"]
        self.photo, self.point = (np.array(self.plates[key], dtype=np.str_) for key in ("photo", "point"))
        self.observed: dict[tuple[str, str], dict[str, int]] = {}  # rows of each image, by its coordinates
        columns = (record["observations"][field] for field in ("kind", "of", "component"))
        for row, (kind, of, component) in enumerate(zip(*columns, strict=True)):
            if kind == _PLATE:
                self.observed.setdefault((of[0], of[1]), {})[component] = row

    def about(self, name: str, is_photo: bool) -> About:
        """Return what is known of one of them."""
        record, tests = self.record, self.record["tests"] or {}
        row = self.named[is_photo].row(name)
        images = self._images(np.flatnonzero((self.photo if is_photo else self.point) == name))

        def of_point(table: Tables | None) -> dict[str, Any] | None:
            return None if is_photo or table is None else NamedRows("point", table).row(name)

        return About(
            name=name,
            is_photo=is_photo,
            row=row or {},
            images=images,
            others=self._others(name, is_photo),
            neighbours=self._neighbours(name, is_photo, images),
            control=of_point(record["control"]),
            water=of_point(record["bathymetric_points"]),
            check=of_point(tests.get("check_points")),
            hidden=of_point(tests.get("hidden_errors")),
            causes=tuple(one for one in record["causes"] if name in one["photos" if is_photo else "points"]),
            alone=tuple(images.point[images.triangulated & ~self._stay(images.point)].tolist()) if is_photo else (),
            moved=self._moved(name) if is_photo else float("nan"),
        )

    def _images(self, rows: IntArray) -> InquiredImages:
        photo, point = self.photo[rows], self.point[rows]
        observations = [self.observed.get(key, {}) for key in zip(photo, point, strict=True)]

        def measured(field: str, *shape: int) -> FloatArray:
            return array_of([self.plates[field][row] for row in rows.tolist()], *shape)

        def both(field: str, *shape: int) -> FloatArray:
            column = self.record["observations"][field]
            values = [column[of[axis]] if axis in of else None for of in observations for axis in _AXES]
            return array_of(values, *shape).reshape(len(rows), 2, *shape)

        tides = array_of((self.record["adjusted_water"] or {}).get("tide") or [None] * len(self.named[True].rows))
        effect, detectable, error = both("effect", 3), both("detectable"), both("estimated_error")
        change = _without(effect, detectable, error).sum(axis=1)
        taken = measured("triangulated").astype(bool)
        change[~taken | ~self._stay(point)] = np.nan
        return InquiredImages(
            photo=photo,
            point=point,
            submerged=self.named[False].array(point, "bathymetric").astype(bool),
            triangulated=taken,
            residual=measured("residual", 2),
            sigma=measured("sigma", 2),
            refraction=np.linalg.norm(measured("refraction", 2), axis=1),
            tide=tides[[self.named[True].rows[name] for name in photo]] if len(rows) else np.zeros(0),
            redundancy=both("redundancy"),
            test=both("normal_test"),
            detectable=detectable,
            hidden=np.linalg.norm(effect, axis=2).max(axis=1, initial=0.0),  # NaN where one is
            change=change,
        )

    def _stay(self, points: Iterable[str]) -> BoolArray:
        """Return (k,) True for points that keep a position without one of their rays."""
        control = self.record["control"]
        held = {name for name, used in zip(control["point"], control["used"], strict=True) if any(used)}
        held.update(chain.from_iterable(self.record["equal_elevations"]["points"]))
        needed = [_ENOUGH_HELD if name in held else _ENOUGH for name in points]
        return np.asarray(self.named[False].array(points, "rays") > np.array(needed))

    def _others(self, name: str, is_photo: bool) -> Others:
        table = self.record["observations"]
        of_photos = {kind.name.lower() for kind in ObservationKind if kind.attribute in ("photos", "air_bases", "")}
        rows = [  # without an attribute: a tide of its own
            row
            for row, (kind, of) in enumerate(zip(table["kind"], table["of"], strict=True))
            if name in of and kind != _PLATE and (kind in of_photos) == is_photo
        ]

        def values(field: str, *shape: int) -> FloatArray:
            return array_of([table[field][row] for row in rows], *shape)

        change = _without(values("effect", 3), values("detectable"), values("estimated_error"))
        change[[table["of"][row][-1] != name for row in rows]] = np.nan  # the influence is on the second end
        return Others(
            kind=tuple(ObservationKind[table["kind"][row].upper()] for row in rows),
            of=tuple(" ".join(table["of"][row]) for row in rows),
            component=tuple(table["component"][row] for row in rows),
            residual=values("residual"),
            sigma=values("sigma"),
            redundancy=values("redundancy"),
            test=values("normal_test"),
            detectable=values("detectable"),
            change=change,
        )

    def _neighbours(self, name: str, is_photo: bool, images: InquiredImages) -> Neighbours:
        """Return the photos that have points of a photo, or the points that are on the photos of a point."""
        here, there = (self.photo, self.point) if is_photo else (self.point, self.photo)
        shared = np.isin(there, images.point if is_photo else images.photo) & (here != name)
        ids, common = np.unique(here[shared], return_counts=True)
        table = self.named[is_photo]
        place = table.array([name, *ids], "position", 3)
        distance = self._distances(np.repeat(place[:1], len(ids), axis=0), place[1:])
        order = np.lexsort((np.arange(len(ids)), np.round(distance, 6)))
        sigma = table.array(ids, "position_sigma" if is_photo else "sigma", 3)[:, 2]
        wet = self.record["bathymetric_points"]
        depths = {} if is_photo else dict(zip(wet["point"], wet["depth"], strict=True))
        tests = self._tests(is_photo, set(ids.tolist()))
        return Neighbours(
            ids=ids[order],
            distance=distance[order],
            common=common[order],
            depth=array_of(map(depths.get, ids))[order],
            sigma=sigma[order],
            test=array_of(map(tests.get, ids))[order],
        )

    def _tests(self, is_photo: bool, names: set[str]) -> dict[str, float]:
        """Return the largest |test value| of an image of each of these points or photos, where it has one."""
        tests: dict[str, float] = {}
        column = self.record["observations"]["normal_test"]
        for key, rows in self.observed.items():
            one = key[0 if is_photo else 1]
            if one in names:
                sizes = [abs(column[row]) for row in rows.values() if column[row] is not None]
                tests |= {one: max(tests.get(one, 0.0), *sizes)} if sizes else {}
        return tests

    def _moved(self, photo: str) -> float:
        given, place = (self.named[True].array([photo], field, 3) for field in ("given_position", "position"))
        return float(self._distances(given, place)[0])

    def _distances(self, first: FloatArray, second: FloatArray) -> FloatArray:
        """Return how far positions (r, 3) of the record are apart (r,) m."""
        system, ellipsoid = self.record["options"]["system"], ellipsoid_spec(self.record)
        return np.linalg.norm(metric_differences(system, ellipsoid, first, second), axis=1)


def _without(effect: FloatArray, detectable: FloatArray, error: FloatArray) -> FloatArray:
    """Return (..., 3) m how a position changes where an observation is left out: influence times v / r."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return -effect * (error / detectable)[..., np.newaxis]
