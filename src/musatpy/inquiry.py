"""One photo or one point of a run: all that its record knows of it, and what would happen without its observations.

Nothing is adjusted anew. An observation that is left out stands where all others would have it: it changes by minus
its estimated error v / r (Baarda 1968), and its point by its influence times that. This is exact for one coordinate
of a linear adjustment; both coordinates of an image are taken one by one (docs/explain.md).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray, falling
from musatpy.comparison import metric_differences
from musatpy.errors import MusatError, nearest
from musatpy.model import ObservationKind

_DECIMALS = 2  # of test values, as they are printed

Record = Mapping[str, Any]
Table = Mapping[str, Any]

NEEDS: Mapping[str, Sequence[str]] = {
    "titles": (),
    "options": ("program", "system", "refraction"),
    "ellipsoid": (),
    "verdict": ("grade",),
    "solution": ("converged", "sigma0"),
    "stations": ("photo", "camera", "position", "position_sigma", "attitude", "attitude_sigma", "given_position"),
    "points": ("point", "bathymetric", "status", "reason", "rays", "position", "sigma"),
    "bathymetric_points": (),
    "control": ("point", "kind", "fixed", "difference", "used"),
    "equal_elevations": ("points",),
    "adjusted_water": ("tide",),
    "tests": ("check_points", "hidden_errors"),
    "causes": ("cause", "photos", "points", "component", "size", "unit", "advice"),
    "observations": (),
    "plates": (),
}
_AXES = ("x", "y")
_ENOUGH, _ENOUGH_HELD = 2, 1  # rays that give a position, and with a component that is known
_PLATE = ObservationKind.PLATE.name.lower()


@dataclass(frozen=True, kw_only=True, eq=False)
class Images:
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
    """The o observations besides images, in the units of their kinds (m, rad); NaN as of `Images`."""

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
    images: Images
    others: Others
    neighbours: Neighbours
    control: dict[str, Any] | None  # row of the table of control
    water: dict[str, Any] | None  # row of the submerged points
    check: dict[str, Any] | None  # row of the test of check points
    hidden: dict[str, Any] | None  # row of the errors that stay hidden
    causes: tuple[dict[str, Any], ...]  # of what does not fit, that name it
    alone: tuple[str, ...]  # points that no other photo would give
    moved: float  # m, of a station from the given one


def inquire(record: Record, name: str) -> tuple[About, ...]:
    """Return what a record knows of the point of a name, and of the photo of that name.

    Raises `MusatError` with the nearest name where there is neither.
    """
    run = _Run(record)
    found = tuple(run.about(name, photo) for photo in (False, True) if name in run.numbers[photo])
    if not found:
        likely = nearest(name, (*run.numbers[False], *run.numbers[True]))
        raise MusatError(f"no point and no photo '{name}'" + (f"; did you mean {likely}?" if likely else ""))
    return found


class _Run:
    """The tables of a record with the numbers of their rows by names."""

    def __init__(self, record: Record) -> None:
        self.record = record
        self.tables: dict[bool, Table] = {False: record["points"], True: record["stations"]}
        names = {False: self.tables[False]["point"], True: self.tables[True]["photo"]}
        self.numbers = {key: {str(name): row for row, name in enumerate(ids)} for key, ids in names.items()}
        self.plates = record["plates"]
        self.photo, self.point = (np.array(self.plates[key], dtype=np.str_) for key in ("photo", "point"))
        self.observed = _by_image(record["observations"])

    def about(self, name: str, is_photo: bool) -> About:
        """Return what is known of one of them."""
        record, row = self.record, self.numbers[is_photo][name]
        images = self._images(np.flatnonzero((self.photo if is_photo else self.point) == name))
        of_point = not is_photo
        station = _row(self.tables[True], row) if is_photo else None
        return About(
            name=name,
            is_photo=is_photo,
            row=_row(self.tables[is_photo], row),
            images=images,
            others=self._others(name, is_photo),
            neighbours=self._photos(name, images) if is_photo else self._points(name, images),
            control=_named(record["control"], name) if of_point else None,
            water=_named(record["bathymetric_points"], name) if of_point else None,
            check=_named((record["tests"] or {}).get("check_points"), name) if of_point else None,
            hidden=_named((record["tests"] or {}).get("hidden_errors"), name) if of_point else None,
            causes=tuple(one for one in record["causes"] if name in one["photos" if is_photo else "points"]),
            alone=self._alone(images) if is_photo else (),
            moved=self._moved(station) if station else float("nan"),
        )

    def _images(self, rows: IntArray) -> Images:
        plates, points = self.plates, self.tables[False]
        point = [self.numbers[False][name] for name in self.point[rows].tolist()]
        water, photo = (
            self.record["adjusted_water"],
            [self.numbers[True][name] for name in self.photo[rows].tolist()],
        )
        tides = _numbers((water or {}).get("tide") or [None] * len(self.numbers[True]))
        observations = [self.observed.get(key, {}) for key in zip(self.photo[rows], self.point[rows], strict=True)]

        def both(field: str, *shape: int) -> FloatArray:
            column = self.record["observations"][field]
            nothing = np.full(shape, np.nan)
            parts = [_numbers(column[of[axis]]) if axis in of else nothing for of in observations for axis in _AXES]
            return np.array(parts).reshape(len(rows), 2, *shape)

        effect, detectable, error = both("effect", 3), both("detectable"), both("estimated_error")
        change = _without(effect, detectable, error).sum(axis=1)
        taken = np.array(plates["triangulated"], dtype=bool)[rows]
        change[~taken | ~self._stay(point)] = np.nan
        return Images(
            photo=self.photo[rows],
            point=self.point[rows],
            submerged=np.array([points["bathymetric"][row] for row in point], dtype=bool),
            triangulated=taken,
            residual=_numbers([plates["residual"][row] for row in rows.tolist()], 2),
            sigma=_numbers([plates["sigma"][row] for row in rows.tolist()], 2),
            refraction=np.linalg.norm(_numbers([plates["refraction"][row] for row in rows.tolist()], 2), axis=1),
            tide=tides[photo] if len(rows) else np.zeros(0),
            redundancy=both("redundancy"),
            test=both("normal_test"),
            detectable=detectable,
            hidden=_largest(np.linalg.norm(effect, axis=2)),
            change=change,
        )

    def _stay(self, points: Sequence[int]) -> BoolArray:
        """Return (k,) True for points with these numbers that keep a position without one of their rays."""
        control, ids = self.record["control"], self.tables[False]["point"]
        held = {name for name, used in zip(control["point"], control["used"], strict=True) if any(used)}
        held.update(chain.from_iterable(self.record["equal_elevations"]["points"]))
        needed = [_ENOUGH_HELD if ids[row] in held else _ENOUGH for row in points]
        rays = [self.tables[False]["rays"][row] for row in points]
        return np.array(rays, dtype=int) > np.array(needed, dtype=int)

    def _others(self, name: str, is_photo: bool) -> Others:
        table = self.record["observations"]
        rows = [
            row
            for row, (kind, of) in enumerate(zip(table["kind"], table["of"], strict=True))
            if name in of and kind != _PLATE and _is_of_photos(kind) == is_photo
        ]

        def values(field: str, *shape: int) -> FloatArray:
            return _numbers([table[field][row] for row in rows], *shape)

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

    def _points(self, name: str, images: Images) -> Neighbours:
        """Return the points that are on the photos of a point."""
        on = np.isin(self.photo, images.photo) & (self.point != name)
        return self._neighbours(name, False, self.point[on])

    def _photos(self, name: str, images: Images) -> Neighbours:
        """Return the photos that have points of a photo."""
        same = np.isin(self.point, images.point) & (self.photo != name)
        return self._neighbours(name, True, self.photo[same])

    def _neighbours(self, name: str, is_photo: bool, named: TextArray) -> Neighbours:
        table = self.tables[is_photo]
        ids, common = np.unique(named, return_counts=True)
        numbers = self.numbers[is_photo]
        rows = [numbers[one] for one in ids.tolist()]
        place = _numbers([table["position"][row] for row in [numbers[name], *rows]], 3)
        here = place[:1].repeat(len(rows), axis=0)
        distance = np.linalg.norm(metric_differences(self.record, here, place[1:]), axis=1)
        order = np.lexsort((np.arange(len(ids)), np.round(distance, 6)))
        sigma = _numbers([table["position_sigma" if is_photo else "sigma"][row] for row in rows], 3)[:, 2]
        depths = {} if is_photo else self._depths()
        tests = self._tests(is_photo, set(ids.tolist()))
        return Neighbours(
            ids=ids[order],
            distance=distance[order],
            common=common[order],
            depth=_numbers([depths.get(one) for one in ids.tolist()])[order],
            sigma=sigma[order],
            test=_numbers([tests.get(one) for one in ids.tolist()])[order],
        )

    def _depths(self) -> dict[str, float | None]:
        table = self.record["bathymetric_points"]
        return dict(zip(table["point"], table["depth"], strict=True))

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

    def _alone(self, images: Images) -> tuple[str, ...]:
        """Return the points of a photo that have a position, and would have none without the photo."""
        stay = self._stay([self.numbers[False][name] for name in images.point.tolist()])
        lost = images.triangulated & ~stay
        return tuple(images.point[lost].tolist())

    def _moved(self, station: Mapping[str, Any]) -> float:
        given, place = (_numbers([station[field]], 3) for field in ("given_position", "position"))
        return float(np.linalg.norm(metric_differences(self.record, given, place)))


def _by_image(observations: Table) -> dict[tuple[str, str], dict[str, int]]:
    """Return the rows of the coordinates of each image, by photo and point."""
    rows: dict[tuple[str, str], dict[str, int]] = {}
    columns = (observations[field] for field in ("kind", "of", "component"))
    for row, (kind, of, component) in enumerate(zip(*columns, strict=True)):
        if kind == _PLATE:
            rows.setdefault((of[0], of[1]), {})[component] = row
    return rows


def _without(effect: FloatArray, detectable: FloatArray, error: FloatArray) -> FloatArray:
    """Return (..., 3) m how a position changes where an observation is left out: influence times v / r."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return -effect * (error / detectable)[..., np.newaxis]


def _is_of_photos(kind: str) -> bool:
    return ObservationKind[kind.upper()].attribute in ("photos", "air_bases", "")  # the last: a tide of its own


def _largest(values: FloatArray) -> FloatArray:
    """Return the largest of each row (k, 2); NaN where one is."""
    return np.where(np.isnan(values).any(axis=1), np.nan, values.max(axis=1, initial=0.0))


def _numbers(values: Any, *shape: int) -> FloatArray:
    """Return values (n, *shape) as numbers, NaN for null."""
    if shape:
        nothing = np.full(shape, np.nan).tolist()
        values = [nothing if value is None else value for value in values]
        return np.array(values, dtype=float).reshape(-1, *shape)
    return np.array(values, dtype=float)


def _row(table: Table, row: int) -> dict[str, Any]:
    return {field: column[row] for field, column in table.items()}


def _named(table: Table | None, name: str) -> dict[str, Any] | None:
    """Return the row of a point, None where there is none."""
    names: Iterable[str] = [] if table is None else table["point"]
    number = next((row for row, point in enumerate(names) if point == name), None)
    return None if table is None or number is None else _row(table, number)
