"""The file of an estimated surface (JSON, `surface.schema.json`): all that is needed to use it, sigmas included."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import musatpy
from musatpy.arrays import FloatArray
from musatpy.errors import Problem, SeaError, SystemsError
from musatpy.geometry.crs import own_ellipsoid
from musatpy.geometry.projected import Projected
from musatpy.records.json_files import read_json
from musatpy.sea.stereo.estimate import SurfaceFit
from musatpy.sea.stereo.fourier import PER_WAVE, FourierSurface
from musatpy.sea.stereo.grid import GridSurface, bandwidth

VERSION = "1.1"
_LEAST_NODES = 4


def dumps(fit: SurfaceFit, surface_map: Projected | None = None) -> str:
    """Return the file of an estimate; `surface_map` is that of its axes on the ellipsoid."""
    fitted = fit.fitted
    record: dict[str, Any] = {
        "schema_version": VERSION,
        "program": {"name": "musatpy", "version": musatpy.__version__},
        "units": {"length": "m", "angle": "rad"},
        "model": "fourier" if isinstance(fitted, FourierSurface) else "grid",
        "points": int(fit.kept.sum()),
        "rejected": len(fit.rejected),
        "sigma0": fit.sigma0,
        "map": None if surface_map is None else surface_map.definition,
        "origin": fitted.origin.tolist(),
    }
    if isinstance(fitted, FourierSurface):
        record["fourier"] = {
            "area": fitted.area.tolist(),
            "parameters": fitted.parameters.tolist(),
            "covariance": fitted.covariance.tolist(),
        }
    else:
        record["grid"] = {
            "x": fitted.x.tolist(),
            "y": fitted.y.tolist(),
            "curvature": fitted.curvature,
            "known": fitted.known.astype(int).tolist(),
            "coefficients": fitted.coefficients.tolist(),
            "normal": fitted.normal.tolist(),
        }
    return json.dumps(record, indent=1) + "\n"


def load_surface(path: Path) -> FourierSurface | GridSurface:
    """Return the surface of a file. Raises `SeaError` where it is none, and `OSError`."""
    record = read_json(path)
    try:
        if str(record["schema_version"]).split(".")[0] != VERSION.split(".")[0]:
            message = f"is of version {record['schema_version']}, and this program reads {VERSION}"
            raise SeaError([Problem(file=str(path), message=message)])
        if record["model"] not in _MODELS:
            raise ValueError(f"unknown model '{record['model']}'")
        fitted: FourierSurface | GridSurface = _MODELS[record["model"]](record)
        np.linalg.cholesky(fitted.covariance)  # one that is not positive has no sigmas
        sigma = np.sqrt(np.diag(fitted.covariance))
        if not np.allclose((fitted.covariance - fitted.covariance.T) / sigma / sigma[:, None], 0.0, atol=1e-6):
            raise ValueError("covariance is not symmetric")
        return fitted
    except KeyError as error:
        raise SeaError([Problem(file=str(path), message=f"is no file of a surface: no {error}")]) from error
    except (TypeError, ValueError) as error:
        raise SeaError([Problem(file=str(path), message=f"is no file of a surface: {error}")]) from error


def load_map(path: Path) -> Projected | None:
    """Return the map of the axes of a surface, None of one that is not on the ellipsoid.

    Raises `SeaError` where the file is no surface, and `OSError`.
    """
    try:
        definition = json.loads(path.read_text(encoding="utf-8")).get("map")
        return None if definition is None else Projected(definition, own_ellipsoid(definition))
    except (ValueError, AttributeError, TypeError, SystemsError) as error:
        raise SeaError([Problem(file=str(path), message=f"is no file of a surface: {error}")]) from error


def _array(table: dict[str, Any], name: str, *shape: int) -> FloatArray:
    values = np.array(table[name], dtype=float)
    if values.shape != shape or not np.isfinite(values).all():
        raise ValueError(f"{name} is not {' by '.join(map(str, shape))} numbers")
    return values


def _fourier(record: dict[str, Any]) -> FourierSurface:
    table = record["fourier"]
    count = len(table["parameters"])
    if count % PER_WAVE != 1:
        raise ValueError(f"{count} parameters are no level and waves")
    return FourierSurface(
        origin=_array(record, "origin", 2),
        parameters=_array(table, "parameters", count),
        covariance=_array(table, "covariance", count, count),
        area=_array(table, "area", 2, 2),
    )


def _grid(record: dict[str, Any]) -> GridSurface:
    table = record["grid"]
    nx, ny = len(table["x"]), len(table["y"])
    for name, count in (("x", nx), ("y", ny)):
        step = np.diff(_array(table, name, count))
        if count < _LEAST_NODES or not (step > 0.0).all() or np.ptp(step) > 1e-6 * step[0]:
            raise ValueError(f"{name} are not evenly spaced nodes, {_LEAST_NODES} or more")
    return GridSurface(
        origin=_array(record, "origin", 2),
        x=_array(table, "x", nx),
        y=_array(table, "y", ny),
        coefficients=_array(table, "coefficients", nx * ny),
        normal=_array(table, "normal", bandwidth(ny) + 1, nx * ny),
        known=_array(table, "known", nx - 1, ny - 1) > 0.0,
        curvature=float(table["curvature"]),
    )


_MODELS: dict[str, Callable[[dict[str, Any]], FourierSurface | GridSurface]] = {"fourier": _fourier, "grid": _grid}
