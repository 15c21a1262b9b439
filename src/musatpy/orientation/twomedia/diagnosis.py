"""How the unknowns of an orientation depend on one another, and which of them nothing determines, in words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.orientation.twomedia.helmert import Adjusted, Problem
from musatpy.orientation.twomedia.rays import WATER

OF_PHOTO = ("omega", "phi", "kappa", "X0", "Y0", "Z0")
OF_WATER = ("tilt along X", "tilt along Y", "level", "index")
_MOVED = 0.01  # part of a direction, of 1, from which it moves photos or water
_NAMED = 4  # unknowns of a direction
_NAMED_SHARE = 0.3  # of the largest part of a direction, for a part to be named
_ROUNDING = 1e-14  # of the largest eigenvalue, that of the smallest
_FREE = 1e3  # rad, or heights of the stations over the water: the sigma from which a direction is free


@dataclass(frozen=True, kw_only=True, eq=False)
class Direction:
    """A direction of the unknowns: its parts (6 m + 4,), scaled, its eigenvalue, and what it moves in words."""

    parts: FloatArray
    eigenvalue: float
    words: str

    @property
    def moves_photos(self) -> bool:
        """Whether it is not of the water alone."""
        return bool(np.abs(self.parts[:-WATER]).max() > _MOVED)

    @property
    def moves_water(self) -> bool:
        """Whether it moves the plane of water."""
        return bool(np.abs(self.parts[-WATER:-1]).max() > _MOVED)


def inflation(adjusted: Adjusted, unknown: BoolArray) -> FloatArray:
    """Return the variance inflation factors (6 m + 4,) of one solution, NaN for what is held.

    By how much the variance of an unknown grows because the others are not known: diag(N) diag(N^-1).
    """
    N = _scaled(_normals(adjusted, adjusted.normals[0], unknown))
    factors = np.full(len(unknown), np.nan)
    factors[unknown] = np.diagonal(np.linalg.pinv(N, hermitian=True))
    return factors


def weakest(adjusted: Adjusted, unknown: BoolArray, photos: TextArray, count: int = 2) -> list[Direction]:
    """Return the weakest directions of the normals scaled to unit diagonal, the weakest first."""
    N = _scaled(_normals(adjusted, adjusted.normals[0], unknown))
    return _directions(N, unknown, photos)[:count]


def free(problem: Problem, adjusted: Adjusted, photos: TextArray, *, priors: bool) -> list[Direction]:
    """Return the directions of one solution that its conditions, with its `priors` or without, leave free.

    Of what nothing moves the normals are rounding, which a scale of their own would hide: the units are the radian
    and the height of the stations over the water.
    """
    T = adjusted.directions[0]
    information = (T.T * np.square(1.0 / problem.prior)) @ T
    along = adjusted.normals[0] - information
    if priors:
        along = along + information
    units = adjusted.at.units[0, problem.unknown]
    N = _normals(adjusted, along, problem.unknown) * np.outer(units, units)
    directions = _directions(N, problem.unknown, photos)
    rounding = _ROUNDING * directions[-1].eigenvalue
    return [direction for direction in directions if direction.eigenvalue < max(_FREE**-2, rounding)]


def _normals(adjusted: Adjusted, along: FloatArray, unknown: BoolArray) -> FloatArray:
    """Return the normals (u, u) of the unknowns from those along the directions of the steps."""
    inverse = np.linalg.inv(adjusted.directions[0, unknown])
    return np.asarray(inverse.T @ along @ inverse)


def _scaled(N: FloatArray) -> FloatArray:
    """Return normals scaled to unit diagonal, zeros where nothing determines an unknown."""
    diagonal = np.diagonal(N)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, np.inf))
    return N * np.outer(scale, scale)


def _directions(N: FloatArray, unknown: BoolArray, photos: TextArray) -> list[Direction]:
    """Return the eigenvectors of normals (u, u), the weakest first."""
    names = [f"{name} of {photo}" if len(photos) > 1 else name for photo in photos for name in OF_PHOTO]
    names += OF_WATER
    eigenvalues, axes = np.linalg.eigh(N)
    directions = []
    for eigenvalue, axis in zip(eigenvalues, axes.T, strict=True):
        parts = np.zeros(len(unknown))
        parts[unknown] = axis
        size = np.abs(parts)
        order = [row for row in np.argsort(-size)[:_NAMED] if size[row] > _NAMED_SHARE * size.max()]
        words = " with ".join(names[row] for row in order)
        directions.append(Direction(parts=parts, eigenvalue=float(eigenvalue), words=words))
    return directions
