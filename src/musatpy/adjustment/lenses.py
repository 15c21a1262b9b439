"""The lenses of a simultaneous adjustment: focal length, principal point, distortion and affinity as unknowns.

With m a measured place, u = (x, y) the ideal one about the principal point (collinearity), A = (1 + b1, b2; 0, 1)
and d the distortion (`reduction.distortion`), the residual of an image is

    side MEASURED    u + d(z) - z,   z = A (m - p)        polynomials of bundle adjustments (Brown 1971)
    side IDEAL       p + A w - m,    w = u + d(u)         polynomials of computer vision

The place that is predicted for an image is m plus that.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Any, Self

import numpy as np

from musatpy.adjustment.parameters import CameraParameters
from musatpy.arrays import FloatArray, IntArray, TextArray
from musatpy.model import (
    GRID_PLACES,
    LENS_PARAMETERS,
    LENS_UNITS,
    AdjustedParameters,
    Block,
    DistortionGrid,
    ObservationKind,
    ReductionOptions,
)
from musatpy.model.tables import taken
from musatpy.reduction.distortion import Lens, Side
from musatpy.reduction.refined_block import lens_of

_F, _XP, _YP, _B1, _B2 = (LENS_PARAMETERS.index(name) for name in ("F", "XP", "YP", "B1", "B2"))
_COEFFICIENTS = slice(3, 8)  # k1, k2, k3, p1, p2


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraLenses(CameraParameters):
    """What is known of the lenses of c cameras, parameters in the order of `LENS_PARAMETERS`; millimetres."""

    lenses: tuple[Lens, ...]  # (c,) about the principal point, with what is no parameter
    sign: float  # of polynomials: -1 where they are corrections
    ids: TextArray  # (c,)
    extent: FloatArray  # (c, 2) how far images lie from the principal point at most, in x and y

    @classmethod
    def of(cls, block: Block) -> Self:
        """Return the lenses of a block. Raises `DeckError` where the cards of a camera contradict each other."""
        options, cameras = block.reduction or ReductionOptions(), block.cameras
        table = block.lens_unknowns.of(LENS_PARAMETERS)
        sign = -1.0 if options.polynomials is options.polynomials.CORRECTION else 1.0
        given = np.zeros((cameras.count, len(LENS_PARAMETERS)))
        given[:, _F], given[:, _XP : _YP + 1] = cameras.focal_length, cameras.principal_point
        lenses = []
        for camera in range(cameras.count):
            estimated = camera in table.camera  # images of others are ideal already
            lens = lens_of(block, camera, options) if estimated else None
            lens = lens or Lens(centre=np.zeros(2), side=Side(options.side.value))
            given[camera, _COEFFICIENTS] = sign * np.concatenate([lens.k[1:], lens.p[:2]])
            lenses.append(replace(lens, centre=np.zeros(2)))
        known = cls.of_cards(
            block, LENS_PARAMETERS, LENS_UNITS, given, partial(_effect, block),
            lenses=tuple(lenses), sign=sign, ids=cameras.ids, extent=np.zeros((cameras.count, 2)),
        )  # fmt: skip
        return replace(known, extent=image_reach(block, known.held[:, _XP : _YP + 1])[1])

    def places(
        self, values: FloatArray, photo: IntArray, measured: FloatArray, ideal: FloatArray, p: FloatArray
    ) -> FloatArray:
        """Return the predicted places (..., 2) of images with ideal places (..., 2) about p (..., 2).

        At `values` (x,) of the unknown parameters.
        """
        xy, table = np.empty_like(ideal), self.table(values)
        for camera, rays in self._by_camera(photo):
            lens, A = self._lens(table[camera], camera)
            u = ideal[rays]
            if lens.side is Side.MEASURED:
                z = (measured[rays] - p[rays]) @ A.T
                xy[rays] = measured[rays] + u + lens.distortion(z) - z
            else:
                xy[rays] = p[rays] + (u + lens.distortion(u)) @ A.T
        return xy

    def partials(
        self,
        values: FloatArray,
        photo: IntArray,
        measured: FloatArray,
        ideal: FloatArray,
        f: FloatArray,
        p: FloatArray,
    ) -> tuple[FloatArray | None, FloatArray]:
        """Return the partials of `places` by the ideal places (..., 2, 2), and by the unknown ones (..., 2, x).

        Of images with ideal places (..., 2) about p (..., 2), of focal length f (...). The first are None where all
        are unit matrices.
        """
        by_lens, table = np.zeros((len(values), *ideal.shape)), self.table(values)  # one after the other: fast
        by_ideal = np.broadcast_to(np.eye(2), (*ideal.shape, 2)).copy()
        owner, parameter = np.nonzero(self.unknown)
        for camera, rays in self._by_camera(photo):
            lens, A = self._lens(table[camera], camera)
            u = ideal[rays]
            by_f = u / f[rays][..., None]
            if lens.side is Side.MEASURED:
                off = measured[rays] - p[rays]
                z = off @ A.T
                by_z = lens.distortion_partials(z) - np.eye(2)
                by_coefficients, by_p = lens.coefficient_partials(z), -by_z @ A
                by_b = by_z[..., :1] * off[..., None, :]
            else:
                by_u = A @ (np.eye(2) + lens.distortion_partials(u))
                by_ideal[rays] = by_u
                by_f = (by_u @ by_f[..., None])[..., 0]
                by_coefficients, by_p = A @ lens.coefficient_partials(u), np.broadcast_to(np.eye(2), by_u.shape)
                by_b = (u + lens.distortion(u))[..., None, :] * np.array([[1.0], [0.0]])
            parts = (np.moveaxis(part, -1, 0) for part in (by_p, self.sign * by_coefficients, by_b))
            of = [by_f, *chain.from_iterable(parts)]
            for column in np.flatnonzero(owner == camera).tolist():
                by_lens[column][rays] = of[parameter[column]]
        bent = any(lens.side is Side.IDEAL for lens in self.lenses)
        return by_ideal if bent else None, np.moveaxis(by_lens, 0, -1)

    def changes(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what `values` (x,) add to focal lengths (n,) and principal points (n, 2) of the photos."""
        change = (self.table(values) - self.held)[self.camera]
        return change[:, _F], change[:, _XP : _YP + 1]

    def cameras(self) -> tuple[FloatArray, FloatArray]:
        """Return the given focal lengths (n,) and principal points (n, 2) of the photos."""
        held = self.held[self.camera]
        return held[:, _F], held[:, _XP : _YP + 1]

    def ideal(self, values: FloatArray, photo: IntArray, measured: FloatArray, p: FloatArray) -> FloatArray:
        """Return the ideal places (..., 2) of measured ones, both with the principal points p (..., 2)."""
        out, table = np.empty_like(measured), self.table(values)
        for camera, rays in self._by_camera(photo):
            lens, A = self._lens(table[camera], camera)
            across = A if lens.side is Side.MEASURED else np.linalg.inv(A)
            out[rays] = p[rays] + lens.apply((measured[rays] - p[rays]) @ across.T)
        return out

    def grid(self, adjusted: AdjustedParameters) -> DistortionGrid | None:
        """Return what lenses do to their plates, as far as images go; None where no distortion was unknown."""
        rows = np.flatnonzero(adjusted.kind == ObservationKind.LENS)
        values, covariance = adjusted.value[rows], adjusted.covariance[np.ix_(rows, rows)]
        owner, parameter = np.nonzero(self.unknown)
        bends = parameter >= _COEFFICIENTS.start
        cameras = np.unique(owner[bends & np.isin(owner, np.flatnonzero(self.extent[:, 0]))])
        if not len(cameras):
            return None
        ticks = np.linspace(-1.0, 1.0, GRID_PLACES)
        unit = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
        place = (unit * self.extent[cameras][:, None]).reshape(-1, 2)
        camera, photo = (
            np.repeat(each, len(unit)) for each in (cameras, [(self.camera == row).argmax() for row in cameras])
        )
        table, nowhere = self.table(values)[camera], np.zeros_like(place)
        ideal = self.ideal(values, photo, place, nowhere)
        by_ideal, by_lens = self.partials(values, photo, place, ideal, table[:, _F], nowhere)
        own = np.equal.outer(camera, owner) & bends
        by_unknown = by_lens * own[:, None]
        if by_ideal is not None:
            by_unknown = np.linalg.solve(by_ideal, by_unknown)
        sigma: FloatArray = np.sqrt(np.einsum("gip,pq,giq->gi", by_unknown, covariance, by_unknown))
        sigma[np.isin(camera, owner[bends & ~adjusted.determined[rows]])] = np.nan
        return DistortionGrid(camera=self.ids[camera], place=place, distortion=place - ideal, sigma=sigma)

    def _by_camera(self, photo: IntArray) -> Iterator[tuple[int, Any]]:
        """Yield each camera and its rays: all at once of one camera, which makes no copies."""
        if len(self.lenses) == 1:
            yield 0, ...
            return
        camera = self.camera[photo]
        for number in np.unique(camera).tolist():
            yield number, camera == number

    def _lens(self, values: FloatArray, camera: int) -> tuple[Lens, FloatArray]:
        """Return the distortion and the affinity of a camera with `values` (10,)."""
        fixed, coefficients = self.lenses[camera], self.sign * values[_COEFFICIENTS]
        lens = replace(
            fixed,
            k=np.concatenate([fixed.k[:1], coefficients[:3]]),
            p=np.concatenate([coefficients[3:], fixed.p[2:]]),
        )
        return lens, np.array([[1.0 + values[_B1], values[_B2]], [0.0, 1.0]])


def ideal_plates(block: Block) -> Block:
    """Return the block with ideal plate coordinates by what its cards say of lenses.

    Parameters with a sigma stay, about these coordinates.
    """
    table = block.lens_unknowns.of(LENS_PARAMETERS)
    if not table.count:
        return block
    lenses, plates, cameras = CameraLenses.of(block), block.plates, block.cameras
    xy = lenses.ideal(lenses.given, plates.photo, plates.xy, lenses.cameras()[1][plates.photo])
    focal, principal = lenses.held[:, _F], lenses.held[:, _XP : _YP + 1]
    known = np.isfinite(table.sigma)
    return replace(
        block,
        plates=replace(plates, xy=xy),
        cameras=replace(cameras, focal_length=focal, principal_point=principal),
        distortion=taken(block.distortion, ~np.isin(block.distortion.camera, table.camera)),
        lens_unknowns=replace(taken(table, known), value=np.full(np.count_nonzero(known), np.nan)),
    )


def _effect(block: Block, table: FloatArray) -> FloatArray:
    """Return what (c, 10) mm one unit of a parameter does to the image farthest from the principal point."""
    r, f = image_reach(block, table[:, _XP : _YP + 1])[0], table[:, _F]
    unit = np.ones_like(r)
    return np.stack([r / f, unit, unit, r**3, r**5, r**7, 3.0 * r**2, 3.0 * r**2, r, r], axis=1)


def image_reach(block: Block, principal_point: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far (c,) mm images of cameras lie from principal points (c, 2), and in x and y (c, 2)."""
    camera = block.photos.camera[block.plates.photo]
    off = block.plates.xy - principal_point[camera]
    reach, extent = np.zeros(len(principal_point)), np.zeros(principal_point.shape)
    np.fmax.at(reach, camera, np.linalg.norm(off, axis=1))
    for column in range(2):
        np.fmax.at(extent[:, column], camera, np.abs(off[:, column]))
    return reach, extent
