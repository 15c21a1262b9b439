"""The cameras of a model as its file left them, kept in the job for ever: what a cloud was made with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.errors import Problem
from musatpy.formats.job_folder import read_job
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.reduction.pixel_lens import PixelLens
from musatpy.sfm.block import Placement, ideal_coordinates, lens_of, lens_parameters
from musatpy.sfm.model import Model, ModelError

_PAIRS = 2**20  # of points and photos at a time
_LENS = ("width", "height", "fx", "fy", "cx", "cy", "shear", "k1", "k2", "k3", "k4", "d1", "d2", "d3", "p1", "p2")


@dataclass(frozen=True, kw_only=True, eq=False)
class FileCameras:
    """n photos with the cameras of a model, and where that was put; `size` is that of a pixel, mm."""

    program: str
    photos: TextArray  # (n,)
    camera: IntArray  # (n,)
    rotation: FloatArray  # (n, 3, 3)
    centre: FloatArray  # (n, 3)
    lenses: tuple[PixelLens, ...]
    extent: FloatArray  # (cameras, 2, 2) least and greatest pixels of the images of points on each camera
    placement: Placement
    to_geocentric: FloatArray | None  # (4, 4) as the file has it; None: it has none
    size: float
    held: bool  # images were made ideal by these lenses

    @classmethod
    def of(cls, model: Model, placement: Placement, size: float, held: bool) -> FileCameras:
        """Return the cameras of a model."""
        names = ("program", "photos", "camera", "rotation", "centre", "lenses", "to_geocentric")
        of_model = {name: getattr(model, name) for name in names}
        camera, extent = model.camera[model.photo], np.empty((len(model.lenses), 2, 2))
        for number in range(len(extent)):
            pixel = model.pixel[camera == number]
            extent[number] = np.stack([pixel.min(axis=0), pixel.max(axis=0)]) if len(pixel) else np.nan
        return cls(placement=placement, size=size, held=held, extent=extent, **of_model)

    def arrays(self) -> dict[str, Any]:
        """Return what is kept in a job folder."""
        rows = [
            [lens.width, lens.height, *lens.focal, *lens.centre, lens.shear, *_coefficients(lens)]
            for lens in self.lenses
        ]
        arrays = {
            "program": np.array([self.program]),
            "lenses": np.array(rows, dtype=float).reshape(-1, len(_LENS)),
            "fisheye": np.array([lens.fisheye for lens in self.lenses]),
            "placement": np.array([self.placement.scale, *self.placement.rotation.ravel(), *self.placement.shift]),
            "ellipsoid": np.array([ellipsoid.definition if (ellipsoid := self.placement.ellipsoid) else ""]),
            "pixel": np.array([self.size]),
            "held": np.array([self.held]),
            **{name: getattr(self, name) for name in ("photos", "camera", "rotation", "centre", "extent")},
        }
        return arrays | ({} if self.to_geocentric is None else {"to_geocentric": self.to_geocentric})

    @classmethod
    def read(cls, source: Mapping[str, Any], file: str) -> FileCameras:
        """Return the cameras in the `source` of a job folder. Raises `ModelError` where it has none."""
        try:
            scale, *rest = source["placement"].tolist()
            return cls(
                program=str(source["program"][0]),
                lenses=tuple(
                    _lens(row, bool(fisheye))
                    for row, fisheye in zip(source["lenses"].tolist(), source["fisheye"].tolist(), strict=True)
                ),
                placement=Placement(
                    scale=scale,
                    rotation=np.array(rest[:9]).reshape(3, 3),
                    shift=np.array(rest[9:]),
                    ellipsoid=_ellipsoid(str(source["ellipsoid"][0])),
                ),
                to_geocentric=source.get("to_geocentric"),
                size=float(source["pixel"][0]),
                held=bool(source["held"][0]),
                **{name: source[name] for name in ("photos", "camera", "rotation", "centre", "extent")},
            )
        except (KeyError, ValueError, IndexError):
            message = "it has no cameras of another program: it was not imported from a model"
            raise ModelError([Problem(message=message, file=file)]) from None

    def adjusted(self, camera: int, values: Mapping[str, float]) -> PixelLens:
        """Return the lens of a camera with the adjusted `values` of some of its parameters."""
        lens = self.lenses[camera]
        return lens_of(lens_parameters(lens, self.size) | dict(values), lens, self.size) if values else lens

    def in_model(self, geocentric: FloatArray) -> FloatArray:
        """Return the coordinates (n, 3) in the model of points in geocentric, or local, metres.

        By the matrix of the file where it has one, which its clouds go by, else as the model was put in place.
        """
        if self.to_geocentric is not None:
            matrix = self.to_geocentric
            return np.asarray((geocentric - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T, dtype=float)
        return (geocentric - self.placement.shift) @ self.placement.rotation / self.placement.scale

    def seen(self, x: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
        """Return which points (n, 3) of the model are in which photo: rows (r,), photos, pixels.

        A photo sees what is in the extent of its camera's images: rays beyond it, where straight ones miss most and
        matchers leave a margin, would pull a point away from where the rays that made it meet.
        """
        middle, axis = self.centre.mean(axis=0), self.rotation[:, 2]
        C, X = self.centre - middle, x - middle
        # products with these rows: distances along the axis, and squares of all distances, less in a wide format
        along = np.column_stack([axis, -np.einsum("ni,ni->n", axis, C)])
        square = np.column_stack([-2.0 * C, np.square(C).sum(axis=1), np.ones(len(C))]) * self._cosines[:, None]
        X = np.vstack([X.T, np.ones(len(X)), np.square(X).sum(axis=1)])
        parts = [(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros((0, 2)))]
        for photos in np.array_split(np.arange(len(C)), 1 + len(C) * len(x) // _PAIRS):
            depth = along[photos] @ X[:4]
            near, row = np.nonzero(np.abs(depth) * depth >= square[photos] @ X)
            photo = photos[near]
            for number, lens in enumerate(self.lenses):
                of = np.flatnonzero(self.camera[photo] == number)
                v = np.einsum("rij,rj->ri", self.rotation[photo[of]], x[row[of]] - self.centre[photo[of]])
                ahead = v[:, 2] > 0.0
                of, xy = of[ahead], v[ahead, :2] / v[ahead, 2:]
                pixel = lens.pixels(xy)
                least, greatest = self.extent[number]
                inside = ((pixel >= least) & (pixel <= greatest)).all(axis=1) & (np.hypot(*xy.T) < lens.reach)
                parts.append((row[of[inside]], photo[of[inside]], pixel[inside]))
        rows, photos, pixels = map(np.concatenate, zip(*parts, strict=True))
        return rows, photos, pixels

    @cached_property
    def _cosines(self) -> FloatArray:
        """(n,) squares of cosines of angles from the axes, beyond which nothing is in the extent of images."""
        out = []
        for lens, ((left, top), (right, bottom)) in zip(self.lenses, self.extent.tolist(), strict=True):
            corners = lens.rays(np.array([(left, top), (right, top), (left, bottom), (right, bottom)]))
            tangent = float(np.linalg.norm(corners, axis=1).max())  # NaN where a corner has no ray
            out.append(0.99 / (1.0 + 1.02 * tangent**2) if np.isfinite(tangent) else 0.0)
        return np.array(out)[self.camera]

    def ideal(self, photo: IntArray, pixels: FloatArray, lenses: tuple[PixelLens, ...]) -> FloatArray:
        """Return ideal plate coordinates (r, 2) mm, about the principal point, of pixels by other `lenses`."""
        out, camera = np.empty_like(pixels), self.camera[photo]
        for number, lens in enumerate(lenses):
            of = camera == number
            out[of] = ideal_coordinates(lens, pixels[of], self.size)
        return out


def cameras_of_job(job: Path) -> FileCameras:
    """Return the cameras in a job folder. Raises `DeckError` where it is none, `ModelError` where it has none."""
    return FileCameras.read(read_job(job).source, str(job))


def spread_over(rows: IntArray, photo: IntArray, azimuth: FloatArray, most: int) -> BoolArray:
    """Return at most so many rays (r,) of each of `rows`, evenly around it by the azimuths of their photos."""
    order = np.argsort(rows + 0.1 * azimuth)  # these are within half a turn
    count = np.bincount(rows)
    start = np.repeat(np.cumsum(count) - count, count)
    count = np.repeat(count, count)
    rank = np.arange(len(rows)) - start
    kept = np.zeros(len(rows), dtype=bool)
    kept[order] = (count <= most) | (rank * most // count != (rank - 1) * most // count)
    return kept


def _ellipsoid(definition: str) -> Ellipsoid | None:
    """Return the ellipsoid of a definition of PROJ, None of none."""
    words = dict(word.removeprefix("+").split("=") for word in definition.split())
    if not words:
        return None
    if "ellps" in words:
        return Ellipsoid(words["ellps"])
    return Ellipsoid(semi_major_axis=float(words["a"]), inverse_flattening=float(words.get("rf", 0.0)))


def _coefficients(lens: PixelLens) -> list[float]:
    """Return k1 to k4, d1 to d3, p1, p2, zeros where a lens has less."""
    return [*(*lens.k, *(0.0,) * 4)[:4], *(*lens.d, *(0.0,) * 3)[:3], *lens.p]


def _lens(row: list[float], fisheye: bool) -> PixelLens:
    of = dict(zip(_LENS, row, strict=True))
    return PixelLens(
        width=int(of["width"]),
        height=int(of["height"]),
        focal=(of["fx"], of["fy"]),
        centre=(of["cx"], of["cy"]),
        shear=of["shear"],
        k=tuple(of[name] for name in ("k1", "k2", "k3", "k4")),
        d=tuple(of[name] for name in ("d1", "d2", "d3")),
        p=(of["p1"], of["p2"]),
        fisheye=fisheye,
    )
