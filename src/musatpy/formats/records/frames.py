"""Coordinates and attitudes of a file <-> those of the model: axes, order of rotations, units of sigmas."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from musatpy.errors import DeckError
from musatpy.formats.records.layout import OPTION_OF_ELLIPSOID, FileSpec
from musatpy.geometry import collinearity
from musatpy.geometry.collinearity import AngleForm, attitude_from_matrix, attitude_matrix
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.systems import radii
from musatpy.model import CoordinateSystem, EllipsoidSpec

if TYPE_CHECKING:
    from musatpy.systems import Statement

Array = NDArray[Any]


_FORMS = {"omega-phi-kappa": AngleForm.OMEGA_PHI_KAPPA, "phi-omega-kappa": AngleForm.PHI_OMEGA_KAPPA}


def matrix_of(kind: str, values: Array) -> Array:
    """Return M, ground to photo, (k, 3, 3), of the attitudes (k, 3) rad or (k, 9) of a file.

    `kind` is one of `records.layout.ATTITUDES`. The order of angles is that of their names.
    """
    if kind in _FORMS:
        return collinearity.matrix_of(values, _FORMS[kind])
    M = values.reshape(-1, 3, 3)
    return np.swapaxes(M, -1, -2) if kind == "matrix photo to ground" else M


def values_of_matrix(kind: str, M: Array) -> Array:
    """Return the attitudes (k, 3) rad or (k, 9) of a file: the inverse of `matrix_of`."""
    if kind in _FORMS:
        return collinearity.angles_of(M, _FORMS[kind])
    return (np.swapaxes(M, -1, -2) if kind == "matrix photo to ground" else M).reshape(-1, 9)


class JobFrame:
    """The coordinates of a job as the files of a family have them.

    Without a system (no options are known) the coordinates of a rectangular file are taken as they are. With a
    statement, which must not be geographic or local, every file has coordinates of its system, and attitudes along
    its axes, or along those of the statement where the files of the family have them in the local vertical.
    """

    def __init__(
        self,
        system: CoordinateSystem | None,
        ellipsoid: EllipsoidSpec | None,
        statement: Statement | None = None,
    ) -> None:
        self.system = system
        self.local = system in (None, CoordinateSystem.LOCAL)
        self.geographic = system is CoordinateSystem.GEOGRAPHIC
        self.statement = statement
        self._ellipsoid = ellipsoid

    @property
    def ellipsoid(self) -> Ellipsoid:
        """The ellipsoid of the job; raises `DeckError` where none is given or it is not known."""
        spec = self._ellipsoid
        if spec is None:
            raise DeckError.of(f"a {self.system} job needs an ellipsoid: {OPTION_OF_ELLIPSOID}")
        try:
            return Ellipsoid.of(spec)
        except ValueError as error:
            raise DeckError.of(error) from error

    def has_vertical(self, file: FileSpec) -> bool:
        """Return whether the third axis of a file is vertical, so that horizontal control can stand there."""
        if self.statement is not None:
            return self.statement.system.plane_alone and self.statement.system.height_alone
        return self.local or (self.geographic and not file.rectangular)

    def joins_control(self, file: FileSpec) -> bool:
        """Return whether the parts of a control point must be joined before it is one of the job."""
        return self.statement is not None or (file.rectangular and self.geographic)

    # --- positions (k, 3) ---

    def position(self, file: FileSpec, values: Array) -> Array:
        """Return positions of the job's system of those of a file. Raises `SystemsError` where it has none."""
        if self.statement is not None:
            from musatpy.systems.blocks import level_of

            level = level_of(self.statement.system, values)
            return level if self.geographic else self._whole(level, self.ellipsoid.geocentric)
        if self.geographic and file.rectangular:
            return self._whole(values, self.ellipsoid.geographic)
        return self._swapped(file, values)

    def file_position(self, file: FileSpec, values: Array) -> Array:
        """Return positions of a file of those of the job's system. Raises `SystemsError` where it has none."""
        if self.statement is not None:
            from musatpy.systems.blocks import coordinates_of

            level = values if self.geographic else self._whole(values, self.ellipsoid.geographic)
            return coordinates_of(self.statement.system, level)
        if self.geographic and file.rectangular:
            return self._whole(values, self.ellipsoid.geocentric)
        return self._swapped(file, values)

    def _swapped(self, file: FileSpec, values: Array) -> Array:
        return values[:, [1, 0, 2]] if self.geographic and file.longitude_first else values

    @staticmethod
    def _whole(values: Array, function: Any) -> Array:
        """Return function(values) of the rows that have all components, NaN in others."""
        whole = ~np.isnan(values).any(axis=1)
        result = np.full(values.shape, np.nan)
        if whole.any():
            result[whole] = function(values[whole])
        return result

    # --- sigmas (k, 3), metres east, north, up in the model ---

    def radii(self, geographic: Array) -> Array:
        """Return metres per radian of longitude and latitude, and 1, (k, 3), at geographic positions."""
        level = np.column_stack([geographic[:, :2], np.nan_to_num(geographic[:, 2])])  # a height moves them little
        of_latitude, of_longitude = radii(self.ellipsoid, level)
        return np.stack([of_longitude, of_latitude, np.ones_like(of_latitude)], axis=-1)

    # --- attitudes ---

    def attitude(self, file: FileSpec, values: Array, position: Array | None) -> Array:
        """Return attitudes (k, 3) of the model, at positions (k, 3) of the job, of those of a file.

        Raises `DeckError` where positions are needed and None are given.
        """
        M = matrix_of(file.attitude, values)
        return attitude_from_matrix(M @ np.swapaxes(self._axes(file, position), -1, -2))

    def file_attitude(self, file: FileSpec, values: Array, position: Array | None) -> Array:
        """Return attitudes of a file of those of the model, at positions of the job; raises as `attitude`."""
        return values_of_matrix(file.attitude, attitude_matrix(values) @ self._axes(file, position))

    def _axes(self, file: FileSpec, position: Array | None) -> Array:
        """Return (k, 3, 3) or (3, 3): rows east, north, up in the axes that attitudes of the file refer to."""
        statement = self.statement
        if self.local or (file.vertical_attitude and (statement is None or not statement.turned)):
            return np.eye(3)
        if position is None or (statement is not None and np.isnan(position).any()):
            message = f"{file.title}: attitudes in the axes of the file need a position on the same row in this job"
            raise DeckError.of(message)
        level = position if self.geographic else self.ellipsoid.geographic(position)
        if statement is None:
            return self.ellipsoid.frame(level)
        axes = statement.reference(level) if file.vertical_attitude else statement.system.axes(level)
        return np.swapaxes(axes, -1, -2)
