"""What an orientation is made from: images of points on photos, control, and what is known of the water."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.model.options import PlaneTreatment
from musatpy.orientation.twomedia.helmert import HelmertProblem
from musatpy.orientation.twomedia.rays import PHOTO, WATER, ConditionGroup, Orientation


@dataclass(frozen=True, kw_only=True, eq=False)
class WaterPlane:
    """What is known of the water: slopes towards X and Y and the level, with prior sigmas, None for none.

    rise (m,) of the water under each photo over that level, as tides differ; `level` None where nothing is known.
    """

    treatment: PlaneTreatment = PlaneTreatment.ADJUST
    slope: tuple[float, float] = (0.0, 0.0)
    slope_sigma: float | None = None
    level: float | None = None
    level_sigma: float | None = None
    rise: FloatArray | None = None
    index: float = 1.34
    index_sigma: float | None = None
    index_unknown: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Sights:
    """n images of p points on m photos, in the order in which a method takes the photos.

    image and its sigmas (n, 2) in tangents, refined; of photo and point (n,). wet (p,). control (p, 3) of which
    components may be missing (NaN), with sigmas (p, 3), 0 for one without error.
    """

    photos: TextArray
    points: TextArray
    photo: IntArray
    point: IntArray
    image: FloatArray
    image_sigma: FloatArray
    wet: BoolArray
    control: FloatArray
    control_sigma: FloatArray

    @property
    def is_control(self) -> BoolArray:
        """(p,) at least two components are known."""
        return np.isfinite(self.control).sum(axis=1) >= 2

    @cached_property
    def rows(self) -> IntArray:
        """(p, m) images of the points on the photos, -1 where there is none."""
        table = np.full((len(self.points), len(self.photos)), -1)
        table[self.point, self.photo] = np.arange(len(self.photo))
        return table

    @property
    def seen(self) -> BoolArray:
        """(p, m) where there is one."""
        return self.rows >= 0

    def on_all(self, photos: tuple[int, ...]) -> BoolArray:
        """Return which points (p,) all of these photos show."""
        return np.asarray(self.seen[:, photos].all(axis=1))

    def common(self, photos: tuple[int, ...]) -> tuple[IntArray, FloatArray]:
        """Return the points (k,) that all of these photos show, and their images (r, k, 2)."""
        points = np.flatnonzero(self.on_all(photos))
        return points, self.image[self.rows[points][:, photos].T]

    def rows_by_count(self) -> list[IntArray]:
        """Return the images (k, r) of the points that r = 2, 3, ... photos show."""
        count = np.bincount(self.point, minlength=len(self.points))
        order = np.argsort(self.point, kind="stable")
        first = np.cumsum(count) - count
        return [order[first[count == r][:, None] + np.arange(r)] for r in range(2, len(self.photos) + 1)]


@dataclass(frozen=True, kw_only=True, eq=False)
class Method:
    """A method of orientation: its name, number of photos, conditions, unknowns of the photos and starts.

    groups and starts are made of sights and plane, starts of the base of a model too; `approach` are conditions
    that lead to those of the method from farther away. `unknown` (6 m,) of attitudes and stations; what is not
    unknown fixes the axes and the scale of the model. `shared` points that all photos show are needed to start.
    """

    name: str
    photos: int
    groups: Callable[[Sights], tuple[ConditionGroup, ...]]
    unknown: tuple[bool, ...]
    starts: Callable[[Sights, WaterPlane, float], Orientation]
    approach: Callable[[Sights], tuple[ConditionGroup, ...]] | None = None
    shared: int = 0

    @property
    def in_model(self) -> bool:
        """Whether the result stands in axes of its own, at a scale of its own."""
        return not all(self.unknown)


def problem_of(sights: Sights, method: Method, plane: WaterPlane, equal: bool = False) -> HelmertProblem:
    """Return the adjustment of a method."""
    treatment = plane.treatment
    water = [treatment is PlaneTreatment.ADJUST] * 2 + [treatment is not PlaneTreatment.KNOWN, plane.index_unknown]
    size = PHOTO * method.photos
    centre, prior = np.zeros(size + WATER), np.full(size + WATER, np.inf)
    centre[size:] = [*plane.slope, plane.level or 0.0, plane.index]
    sigmas = [plane.slope_sigma, plane.slope_sigma, plane.level_sigma, plane.index_sigma]
    prior[size:] = [sigma or np.inf for sigma in sigmas]
    control = sights.control[sights.is_control]
    rise = np.zeros(method.photos) if plane.rise is None else plane.rise
    return HelmertProblem(
        photo=sights.photo,
        point=sights.point,
        image=sights.image,
        image_sigma=sights.image_sigma,
        wet=sights.wet[sights.point],
        rise=rise[sights.photo],
        control=np.where(
            np.isfinite(sights.control), sights.control, np.nanmean(control, axis=0) if len(control) else 0.0
        ),
        control_sigma=np.where(np.isfinite(sights.control), sights.control_sigma, np.inf),
        groups=method.groups(sights),
        approach=method.approach(sights) if method.approach else (),
        unknown=np.array([*method.unknown, *water]),
        centre=centre,
        prior=prior,
        bottom=None if method.in_model else np.nanmean(control, axis=0),
        equal=equal,
    )


def redundancy_of(problem: HelmertProblem) -> int:
    """Return the number of conditions and priors less that of the unknowns."""
    unknowns = int(problem.unknown.sum()) - int((np.isfinite(problem.prior) & problem.unknown).sum())
    return conditions_of(problem) - unknowns


def conditions_of(problem: HelmertProblem) -> int:
    """Return the number of conditions; components of control that are not known take one each."""
    count = 0
    for group in problem.groups:
        each = 2 * len(group.photos) if group.control is not None else 2 * len(group.photos) - 3
        count += each * len(group.images)
        if group.control is not None:
            count -= int(np.isinf(problem.control_sigma[group.control]).sum())
    return count


def without(sights: Sights, points: BoolArray) -> Sights:
    """Return the sights without some points (p,); these stay in the lists, unseen."""
    kept = ~points[sights.point]
    return replace(
        sights,
        photo=sights.photo[kept],
        point=sights.point[kept],
        image=sights.image[kept],
        image_sigma=sights.image_sigma[kept],
    )
