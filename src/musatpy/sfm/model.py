"""A model of structure from motion, as its file has it: lenses, photos, points, and where these were seen.

One convention for all formats: a ray in the axes of a camera is R (X - C), x right, y down, z forward; pixels count
from the corner of the image. Coordinates are those of the file, of any scale.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.errors import Problem, ProblemsError
from musatpy.formats.records.fields import LONGEST
from musatpy.reduction.pixel_lens import PixelLens

LOCAL = "local"  # in the place of a system: metres, Z up
NO_TURN = 1e-6  # by which the determinant of a rotation may miss 1
_AT_A_TIME = 2**15  # images, that stay in the fast memory


class ModelError(ProblemsError):
    """A model that cannot be read: `problems` says why, with file and place."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """c cameras, n photos, p points, m images of these."""

    program: str  # that has written it: `colmap`
    cameras: tuple[str, ...]  # (c,) ids
    lenses: tuple[PixelLens, ...]  # (c,)
    photos: TextArray  # (n,) ids, as in the file
    camera: IntArray  # (n,)
    rotation: FloatArray  # (n, 3, 3) R
    centre: FloatArray  # (n, 3) C
    points: TextArray  # (p,) ids
    position: FloatArray  # (p, 3)
    photo: IntArray  # (m,) of the images
    point: IntArray  # (m,)
    pixel: FloatArray  # (m, 2)
    to_geocentric: FloatArray | None = None  # (4, 4) from the coordinates to geocentric metres; None: no scale
    reference: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))  # (n, 3) given, as stated
    reference_system: str = ""  # of these; empty: not stated
    pixel_size: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))  # (c, 2) mm, NaN: not stated
    initial: tuple[PixelLens, ...] = ()  # (c,) lenses before the adjustment, where these are stated
    colour: IntArray | None = None  # (p, 3)
    notes: tuple[str, ...] = ()  # what was left out: photos that are not placed, ...
    stored: FloatArray = field(default_factory=lambda: np.zeros(0))  # (p,) px, mean residual as the file has it

    def residuals(self, rows: IntArray | slice = slice(None)) -> FloatArray:
        """Return computed minus measured pixels (r, 2) of straight rays; NaN of points behind their cameras."""
        return self.gaps(self.position, self.photo[rows], self.point[rows], self.pixel[rows])

    def gaps(self, position: FloatArray, photo: IntArray, point: IntArray, pixel: FloatArray) -> FloatArray:
        """Return the same of images (r,) of points at positions (p, 3) of the model's coordinates."""
        computed, camera = np.full(pixel.shape, np.nan), self.camera[photo]
        for number, lens in enumerate(self.lenses):
            every = np.flatnonzero(camera == number)
            for of in np.array_split(every, 1 + len(every) // _AT_A_TIME):
                away = position[point[of]] - self.centre[photo[of]]
                rays = np.einsum("rij,rj->ri", self.rotation[photo[of]], away)
                ahead = rays[:, 2] > 0.0
                computed[of[ahead]] = lens.pixels(rays[ahead, :2] / rays[ahead, 2:])
        return computed - pixel

    @cached_property
    def misses(self) -> FloatArray:
        """(m,) px, lengths of residuals."""
        return np.linalg.norm(self.residuals(), axis=1)

    @cached_property
    def counts(self) -> IntArray:
        """(p,) images of each point."""
        return np.bincount(self.point, minlength=len(self.points))

    def of_points(self, chosen: IntArray) -> Model:
        """Return a model of some of the points (k,), in ascending order, and their images."""
        number = np.full(len(self.points), -1, dtype=np.int64)
        number[chosen] = np.arange(len(chosen))
        rows = np.flatnonzero(number[self.point] >= 0)
        return replace(
            self,
            points=self.points[chosen],
            position=self.position[chosen],
            photo=self.photo[rows],
            point=number[self.point[rows]],
            pixel=self.pixel[rows],
            stored=self.stored[chosen] if len(self.stored) else self.stored,
            colour=None if self.colour is None else self.colour[chosen],
        )


def checked(model: Model, source: str) -> Model:
    """Return a model that can be used. Raises `ModelError` that names what cannot, by its id."""
    problems = [] if len(model.photos) else [Problem(message="it has no photo that is placed", file=source)]
    for what, names in (("photos", model.photos), ("points", model.points)):
        twice = sorted(name for name, count in Counter(names.tolist()).items() if count > 1)
        problems += [Problem(message=f"two {what} are called {name}", file=source) for name in twice]
    for name in model.photos.tolist():
        if not name or not name.isprintable() or len(name.encode("utf-8", "replace")) > LONGEST:
            message = f"the name of a photo, {name[:40]!r}, is not text of 1 to {LONGEST} letters"
            problems.append(Problem(message=message, file=source))
        elif ".." in name.replace("\\", "/").split("/") or name[:1] in ("/", "\\") or name[1:2] == ":":
            problems.append(Problem(message=f"photo {name}: its name leads out of the folder", file=source))
    lost = ~np.isfinite(model.pixel).all(axis=1)
    with np.errstate(invalid="ignore"):
        turned = np.abs(np.linalg.det(model.rotation) - 1.0) < NO_TURN
    good = turned & np.isfinite(model.centre).all(axis=1)
    for message, names in (
        ("an image on photo {} is no number", model.photos[np.unique(model.photo[lost])]),
        ("place or rotation of photo {} is none", model.photos[~good]),
        ("a coordinate of point {} is no number", model.points[~np.isfinite(model.position).all(axis=1)]),
    ):
        problems += [Problem(message=message.format(name), file=source) for name in names.tolist()]
    refused(problems)
    return model


def spread(count: int, most: int) -> IntArray:
    """Return at most so many of `count` rows, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).astype(np.int64)) if count else np.zeros(0, int)


def links(names: Sequence[str], of: Sequence[str]) -> tuple[IntArray, BoolArray]:
    """Return the rows of names (n,) in `of`, -1 for none, and which have one."""
    row = {name: number for number, name in enumerate(of)}
    number = np.array([row.get(name, -1) for name in names], dtype=np.int64)
    return number, number >= 0


def refused(problems: Sequence[Problem]) -> None:
    """Raise `ModelError` where there are problems."""
    if problems:
        raise ModelError(list(problems))


def chosen_component(sizes: Sequence[int], component: int, source: str) -> int:
    """Return the row of a component, which counts from 1; 0: the only one with photos, `sizes` of them.

    Raises `ModelError` where there is none of that number, or several and it is not said which.
    """
    message, some = f"it has {len(sizes)} components", [row for row, size in enumerate(sizes) if size] or [0]
    if component > len(sizes):
        raise ModelError([Problem(message=f"{message}, and no number {component}", file=source)])
    if not component and len(some) > 1:
        raise ModelError.of(f"{message}, of {', '.join(map(str, sizes))} photos: choose one by --component", source)
    return component - 1 if component else some[0]
