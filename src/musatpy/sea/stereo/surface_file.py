"""The file of an estimated surface (JSON, `surface.schema.json`): all that is needed to use it, sigmas included."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

import musatpy
from musatpy.arrays import FloatArray
from musatpy.errors import SeaError, SystemsError
from musatpy.geometry.crs import own_ellipsoid
from musatpy.geometry.projected import Projected
from musatpy.records.json_files import read_json
from musatpy.sea.stereo.estimate import SurfaceFit
from musatpy.sea.stereo.fourier import PER_WAVE, FourierSurface
from musatpy.sea.stereo.grid import GridSurface, bandwidth

VERSION = "1.1"
_TABLES = {
    "fourier": ("area", "parameters", "covariance"),
    "grid": ("x", "y", "curvature", "known", "coefficients", "normal"),
}
_LEAST_NODES = 4


def dumps(fit: SurfaceFit, surface_map: Projected | None = None) -> str:
    """Return the file of an estimate; `surface_map` is that of its axes on the ellipsoid."""
    fitted, model = fit.fitted, "fourier" if isinstance(fit.fitted, FourierSurface) else "grid"
    record = {
        "schema_version": VERSION,
        "program": {"name": "musatpy", "version": musatpy.__version__},
        "units": {"length": "m", "angle": "rad"},
        "model": model,
        "points": int(fit.kept.sum()),
        "rejected": len(fit.rejected),
        "sigma0": fit.sigma0,
        "map": None if surface_map is None else surface_map.definition,
        "origin": fitted.origin.tolist(),
        model: {name: (1 * np.asarray(getattr(fitted, name))).tolist() for name in _TABLES[model]},  # truth is 0, 1
    }
    return json.dumps(record, indent=1) + "\n"


def load_surface(path: Path) -> FourierSurface | GridSurface:
    """Return the surface of a file. Raises `SeaError` where it is none, and `OSError`."""
    record = read_json(path)
    try:
        if str(record["schema_version"]).split(".")[0] != VERSION.split(".")[0]:
            message = f"is of version {record['schema_version']}, and this program reads {VERSION}"
            raise SeaError.of(message, file=path)
        if record["model"] not in _TABLES:
            raise ValueError(f"unknown model '{record['model']}'")
        fitted = _surface(record)
        np.linalg.cholesky(fitted.covariance)  # one that is not positive has no sigmas
        sigma = np.sqrt(np.diag(fitted.covariance))
        if not np.allclose((fitted.covariance - fitted.covariance.T) / sigma / sigma[:, None], 0.0, atol=1e-6):
            raise ValueError("covariance is not symmetric")
        return fitted
    except KeyError as error:
        raise SeaError.of(f"is no file of a surface: no {error}", file=path) from error
    except (TypeError, ValueError) as error:
        raise SeaError.of(f"is no file of a surface: {error}", file=path) from error


def load_map(path: Path) -> Projected | None:
    """Return the map of the axes of a surface, None of one that is not on the ellipsoid.

    Raises `SeaError` where the file is no surface, and `OSError`.
    """
    try:
        definition = json.loads(path.read_text(encoding="utf-8")).get("map")
        return None if definition is None else Projected(definition, own_ellipsoid(definition))
    except (ValueError, AttributeError, TypeError, SystemsError) as error:
        raise SeaError.of(f"is no file of a surface: {error}", file=path) from error


def _array(table: dict[str, Any], name: str, *shape: int) -> FloatArray:
    values = np.array(table[name], dtype=float)
    if values.shape != shape or not np.isfinite(values).all():
        raise ValueError(f"{name} is not {' by '.join(map(str, shape))} numbers")
    return values


def _surface(record: dict[str, Any]) -> FourierSurface | GridSurface:
    """Return the surface of a record. Raises `KeyError`, `TypeError` and `ValueError` where it is none."""
    table, origin = record[record["model"]], _array(record, "origin", 2)
    if record["model"] == "fourier":
        count = len(table["parameters"])
        if count % PER_WAVE != 1:
            raise ValueError(f"{count} parameters are no level and waves")
        shapes: dict[str, tuple[int, ...]] = {"parameters": (count,), "covariance": (count, count), "area": (2, 2)}
        return FourierSurface(
            origin=origin, **{name: _array(table, name, *shape) for name, shape in shapes.items()}
        )
    nx, ny = len(table["x"]), len(table["y"])
    shapes = {"x": (nx,), "y": (ny,), "coefficients": (nx * ny,), "normal": (bandwidth(ny) + 1, nx * ny)}
    arrays = {name: _array(table, name, *shape) for name, shape in shapes.items()}
    for name in ("x", "y"):
        step = np.diff(arrays[name])
        if len(step) < _LEAST_NODES - 1 or not (step > 0.0).all() or np.ptp(step) > 1e-6 * step[0]:
            raise ValueError(f"{name} are not evenly spaced nodes, {_LEAST_NODES} or more")
    known = _array(table, "known", nx - 1, ny - 1) > 0.0
    return GridSurface(origin=origin, known=known, curvature=float(table["curvature"]), **arrays)
