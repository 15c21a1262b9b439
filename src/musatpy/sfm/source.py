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
from musatpy.reduction.pixel_lens import CorrectedLens, PixelLens
from musatpy.sfm.block import (
    Placement,
    corrected_lens,
    ideal_coordinates,
    is_reduced,
    lens_of,
    lens_parameters,
    pixels_of,
    stretch,
)
from musatpy.sfm.model import Model, ModelError

_PLACES = 25  # in which lenses are compared, in x and in y
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
        arrays = {
            "program": np.array([self.program]),
            "lenses": np.array(list(map(_row, self.lenses)), dtype=float).reshape(-1, len(_LENS)),
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
            scale, *similarity = source["placement"].tolist()
            return cls(
                program=str(source["program"][0]),
                lenses=tuple(
                    _lens(row, bool(fisheye))
                    for row, fisheye in zip(source["lenses"].tolist(), source["fisheye"].tolist(), strict=True)
                ),
                placement=Placement(
                    scale=scale,
                    rotation=np.array(similarity[:9]).reshape(3, 3),
                    shift=np.array(similarity[9:]),
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
        if not values:
            return lens
        if is_reduced(lens):
            return corrected_lens(dict(values), lens, self.size)
        return lens_of(lens_parameters(lens, self.size) | dict(values), lens, self.size)

    def fitted(self, camera: int, lens: CorrectedLens) -> tuple[PixelLens, float]:
        """Return the lens of the file's kind that comes nearest to one, and by how many pixels it misses.

        By least squares over the extent of images. Denominators stay, which nothing tells from numerators, and no
        lens gets a shear or a fourth coefficient that the file has not.
        """
        from scipy.optimize import least_squares  # which only this needs

        ticks = np.linspace(self.extent[camera, 0], self.extent[camera, 1], _PLACES)
        pixels = np.stack(np.meshgrid(*ticks.T), axis=-1).reshape(-1, 2)
        rays, row = lens.rays(pixels), np.array(_row(lens), dtype=float)
        common = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", *(("k4",) if lens.fisheye else ("p1", "p2")))
        free = np.isin(_LENS, common) | (np.isin(_LENS, ("shear", "k4")) & (row != 0.0))

        def off(values: FloatArray) -> FloatArray:
            row[free] = values
            return (_lens(row.tolist(), lens.fisheye).pixels(rays) - pixels).ravel()

        miss = off(least_squares(off, row[free], x_scale="jac").x)
        return _lens(row.tolist(), lens.fisheye), float(np.linalg.norm(miss.reshape(-1, 2), axis=1).max())

    def pixels_of(self, camera: int, xy: FloatArray) -> FloatArray:
        """Return the pixels (k, 2) of plate coordinates (k, 2) of the job, mm."""
        lens = self.lenses[camera]
        if self.held or is_reduced(lens):
            return lens.pixels(xy / (lens.focal[1] * self.size * np.array([1.0, -1.0])))
        return pixels_of(lens, xy, self.size)

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
        # others have nothing in their format that is within such a radius of the middle of the points
        among = X.sum(axis=0) / max(len(X), 1)
        radius, away = np.linalg.norm(X - among, axis=1).max(initial=0.0), np.linalg.norm(C - among, axis=1)
        some = np.flatnonzero(along @ [*among, 1.0] + radius >= np.sqrt(self._cosines) * (away - radius))
        X = np.vstack([X.T, np.ones(len(X)), np.square(X).sum(axis=1)])
        parts = [(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros((0, 2)))]
        for photos in np.array_split(some, 1 + len(some) * len(x) // _PAIRS):
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

    def stretch(self, photo: IntArray, pixels: FloatArray) -> FloatArray:
        """Return how many times larger than on the photos errors of pixels (r, 2) are among ideal coordinates."""
        out, camera = np.ones_like(pixels), self.camera[photo]
        for number, lens in enumerate(self.lenses):
            if is_reduced(lens):
                out[camera == number] = stretch(lens, pixels[camera == number])
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


def _row(lens: PixelLens) -> list[float]:
    """Return `_LENS` of a lens, zeros where it has less."""
    coefficients = *(*lens.k, *(0.0,) * 4)[:4], *(*lens.d, *(0.0,) * 3)[:3], *lens.p
    return [lens.width, lens.height, *lens.focal, *lens.centre, lens.shear, *coefficients]


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
