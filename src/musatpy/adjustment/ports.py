"""The flat ports of a simultaneous adjustment: cameras behind planes of glass, known or unknown.

A camera without a port has one that bends nothing: all photos go through the same lines.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Self

import numpy as np

from musatpy.adjustment.lenses import image_reach
from musatpy.adjustment.parameters import CameraParameters
from musatpy.arrays import FloatArray, IntArray
from musatpy.geometry import collinearity
from musatpy.model import PORT_PARAMETERS, PORT_SIZES, PORT_UNITS, Block
from musatpy.refraction import port
from musatpy.units import DEGREE

_NO_PORT = (1.0, 0.0, 1.0, 1.0, 0.0, 0.0)
_INSIDE = np.array([1e-3, 1e-3, 1.0, 1.0, DEGREE, DEGREE])  # m, 1, rad
_RANGE = 1.0  # m from the glass, of a point whose image tells of effects


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraPorts(CameraParameters):
    """What is known of the ports of c cameras, in the order and units of `PORT_PARAMETERS`."""

    @classmethod
    def of(cls, block: Block) -> Self:
        """Return the ports of a block."""
        held = np.tile(_NO_PORT, (block.cameras.count, 1))
        sizes = [getattr(block.ports, name) for name in PORT_SIZES]
        held[block.ports.camera] = np.column_stack([*sizes, block.ports.tilt / DEGREE])
        return cls.of_cards(block, PORT_PARAMETERS, PORT_UNITS, held, partial(_effect, block))

    def vectors(self, values: FloatArray, photo: IntArray, v: FloatArray, M: FloatArray) -> FloatArray:
        """Return the vectors (..., 3) of `view` alone."""
        u = port.direction(np.einsum("...ij,...j->...i", M, v), self._ports(values, photo))
        return np.einsum("...ji,...j->...i", M, u)

    def view(
        self, values: FloatArray, photo: IntArray, v: FloatArray, M: FloatArray, dM: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return in which directions (..., 3) of working axes points at v (..., 3) from their stations are seen.

        And the partials by v and by the attitude (..., 3, 3), while M that takes them to the photo is held, and by
        all parameters of the ports (..., 3, 6). M (..., 3, 3), dM (..., 3, 3, 3): rotations, by the attitude.
        """
        u, by_point, by_port = port.seen(np.einsum("...ij,...j->...i", M, v), self._ports(values, photo))
        back = np.swapaxes(M, -1, -2)
        by_point = back @ by_point
        by_attitude = by_point @ np.einsum("...aij,...j->...ia", dM, v)
        return (back @ u[..., None])[..., 0], by_point @ M, by_attitude, back @ (by_port * _INSIDE)

    def axis_points(self, values: FloatArray, photo: IntArray, v: FloatArray, M: FloatArray) -> FloatArray:
        """Return where (..., 3), from stations, rays to points at v (..., 3) cross the axes of ports."""
        p = np.einsum("...ij,...j->...i", M, v)
        return np.einsum("...ji,...j->...i", M, port.axis_point(p, self._ports(values, photo)))

    def axis_partials(
        self, values: FloatArray, photo: IntArray, v: FloatArray, M: FloatArray, dM: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the partials of `axis_points` by v, by the attitude (..., 3, 3), and by the ports (..., 3, 6)."""
        p, ports = np.einsum("...ij,...j->...i", M, v), self._ports(values, photo)
        back, (by_point, by_port) = np.swapaxes(M, -1, -2), port.axis_partials(p, ports)
        turned = np.einsum("...aij,...i->...ja", dM, port.axis_point(p, ports))
        by_attitude = back @ by_point @ np.einsum("...aij,...j->...ia", dM, v) + turned
        return back @ by_point @ M, by_attitude, back @ (by_port * _INSIDE)

    def rays(
        self, values: FloatArray, photo: IntArray, camera: FloatArray, direction: FloatArray, M: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return where rays of directions (..., 3) in the housing leave the glass, and directions outside."""
        origin, w = port.ray(np.einsum("...ij,...j->...i", M, direction), self._ports(values, photo))
        back = np.swapaxes(M, -1, -2)
        return camera + (back @ origin[..., None])[..., 0], (back @ w[..., None])[..., 0]

    def _ports(self, values: FloatArray, photo: IntArray) -> port.Port:
        return _ports(self.table(values).take(self.camera.take(photo), axis=0))


def without_ports(block: Block) -> Block:
    """Return the block with the images of cameras that stand outside: good enough for first values."""
    if not block.ports.count:
        return block
    ports, plates, cameras, of = CameraPorts.of(block), block.plates, block.cameras, block.photos.camera
    camera, level = of[block.plates.photo], np.eye(3)
    f, pp = cameras.focal_length[camera], cameras.principal_point[camera]
    outside = ports.rays(ports.given, plates.photo, np.zeros(3), collinearity.ray(plates.xy, level, f, pp), level)
    return replace(block, plates=replace(plates, xy=collinearity.image(outside[1], level, f, pp)))


def _ports(table: FloatArray) -> port.Port:
    """Return ports (...) of parameters (..., 6)."""
    inside = table * _INSIDE
    distance, thickness, glass, water = np.moveaxis(inside[..., :4], -1, 0)
    return port.Port(distance=distance, thickness=thickness, glass=glass, water=water, tilt=inside[..., 4:])


def _effect(block: Block, table: FloatArray) -> FloatArray:
    """Return what (c, 6) mm one unit of a parameter does to the image of a point at `_RANGE` in the corner."""
    ports, level, cameras = _ports(table), np.eye(3), block.cameras
    reach, f = image_reach(block, cameras.principal_point)[0], cameras.focal_length
    corner = np.column_stack([reach, reach]) / np.sqrt(2.0)
    origin, w = port.ray(collinearity.image_vector(corner, f, np.zeros(2)), ports)
    u, _, by_port = port.seen(origin + _RANGE * w, ports)
    _, by_u = collinearity.image_by_vector(u, level, f, np.zeros(2))
    return np.linalg.norm(by_u @ (by_port * _INSIDE), axis=1)
