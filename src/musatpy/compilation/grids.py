"""Grids of posts over the bottom of a compilation: depths and their sigmas, empty where there is no surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.compilation.datums import Datum
from musatpy.compilation.joined_surfaces import Surface
from musatpy.errors import CollocationError, CompilationError, Problem
from musatpy.model.compilation import GridSpecs
from musatpy.sea.interpolation.correlation import SignalKind
from musatpy.sea.interpolation.interpolate import InterpolationOptions, interpolate
from musatpy.sea.interpolation.prediction import CrossValidation, Observed, Trend
from musatpy.surfaces.tin import Tin

_MOST = 250_000  # posts: with listing and layers 270 MB and 34 s of a busy processor
_MOST_COLLOCATED = 2000  # points: their covariances are factorised some dozen times
_FAMILIES = (SignalKind.GAUSSIAN, SignalKind.EXPONENTIAL)  # of a bottom: smooth, or rough


@dataclass(frozen=True, kw_only=True, eq=False)
class PostGrid:
    """Posts at multiples of a spacing (m) on the map of the job, rows from `south`, columns from `west` (m).

    depth and sigma (rows, columns) m, NaN where there is no surface. `surface` is one on the same map.
    """

    name: str
    spacing: float
    west: float
    south: float
    depth: FloatArray
    sigma: FloatArray
    surface: Surface
    validation: CrossValidation | None = None  # of the points, left out in groups, where posts are predicted

    @property
    def empty(self) -> int:
        """Number of posts without a depth."""
        return int(np.count_nonzero(np.isnan(self.depth)))

    def coordinates(self, datum: Datum) -> FloatArray:
        """Return coordinates (p, 3) of the job of all posts, row by row, depths below a datum."""
        rows, columns = self.depth.shape
        x, y = np.meshgrid(
            self.west + self.spacing * np.arange(columns), self.south + self.spacing * np.arange(rows)
        )
        return self.surface.below(np.column_stack([x.ravel(), y.ravel()]), np.nan_to_num(self.depth.ravel()), datum)


def grids_of(
    specs: GridSpecs, surfaces: Sequence[Surface], corner_unit: float, lines: IntArray | None = None
) -> tuple[PostGrid, ...]:
    """Return the grids of posts on surfaces; corners count in `corner_unit` of the job's coordinates.

    There are none without a surface. Raises `CompilationError` for a grid of no posts, or of too many.
    """
    networks = [surface for surface in surfaces if surface.tin is not None]
    if not networks:
        return ()
    return tuple(
        _grid(
            str(specs.ids[row]),
            float(specs.spacing[row]),
            np.stack([specs.first[row], specs.second[row]]) * corner_unit,
            networks,
            collocated=bool(specs.collocated[row]),
            line=None if lines is None else int(lines[row]),
        )
        for row in range(len(specs.ids))
    )


def _grid(
    name: str,
    spacing: float,
    corners: FloatArray,
    surfaces: Sequence[Surface],
    *,
    collocated: bool,
    line: int | None,
) -> PostGrid:
    """Return a grid between corners (2, 2) of the job, over all of the surfaces where these are NaN."""
    if np.isfinite(corners).all():
        places = surfaces[0].places(corners)
    else:
        places = np.concatenate([surface.tin.xy for surface in surfaces if surface.tin])
    first = np.ceil(places.min(axis=0) / spacing - 1e-9)
    columns, rows = (np.floor(places.max(axis=0) / spacing + 1e-9) - first + 1.0).clip(0.0)
    if rows * columns > _MOST or not rows * columns:
        message = f"grid {name} has {rows * columns:.3g} posts: give another spacing (1 to {_MOST:,} posts)"
        raise CompilationError([Problem(message=message, line=line, card="GRD", field="spacing")])
    x, y = np.meshgrid(first[0] + np.arange(columns), first[1] + np.arange(rows))
    posts = spacing * np.column_stack([x.ravel(), y.ravel()])
    depth, sigma = np.full(len(posts), np.nan), np.full(len(posts), np.nan)
    validations = []
    for surface in surfaces:
        assert surface.tin is not None
        at = surface.tin.at(posts)
        new = np.isnan(depth) & np.isfinite(at.value)
        depth[new], sigma[new] = at.value[new], at.sigma[new]
        if collocated and new.any():
            depth[new], sigma[new], validation = _predicted(name, surface.tin, posts[new])
            validations.append(validation)
    shape = (int(rows), int(columns))
    return PostGrid(
        name=name,
        spacing=spacing,
        west=float(first[0]) * spacing,
        south=float(first[1]) * spacing,
        depth=depth.reshape(shape),
        sigma=sigma.reshape(shape),
        surface=surfaces[0],
        validation=_joined(validations) if validations else None,
    )


def _predicted(name: str, tin: Tin, posts: FloatArray) -> tuple[FloatArray, FloatArray, CrossValidation]:
    """Return depths (p,) at posts (p, 2) by collocation of the points of a network, sigmas, and its validation.

    A plane and a signal, whose covariance is the better of two families by the restricted likelihood; what points
    err by is their sigmas. Sigmas of depths are larger by what points that were left out say. Raises
    `CompilationError`.
    """
    if len(tin.z) > _MOST_COLLOCATED:
        message = f"grid {name}: {len(tin.z)} points are too many for a collocation ({_MOST_COLLOCATED} at most)"
        raise CompilationError([Problem(message=message)])
    observed = Observed(place=tin.xy, value=tin.z, sigma=tin.sigma)
    options = InterpolationOptions(trend=Trend.PLANE, families=_FAMILIES, free_noise=False, reject=False)
    try:
        found = interpolate(observed, options)
    except CollocationError as error:
        message = f"grid {name}: {error.problems[0].message}"
        raise CompilationError([Problem(message=message)]) from error
    prediction = found.collocation.predict(posts)
    return prediction.value, found.factor * prediction.sigma, found.grouped


def _joined(parts: Sequence[CrossValidation]) -> CrossValidation:
    return CrossValidation(
        error=np.concatenate([part.error for part in parts]), sigma=np.concatenate([part.sigma for part in parts])
    )
