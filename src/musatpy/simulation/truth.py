"""The truth of a simulation as plain data, for the JSON beside the deck."""

from __future__ import annotations

import dataclasses
import json
from importlib.metadata import version
from typing import Any

import numpy as np

from musatpy.model import ControlKind, CoordinateSystem
from musatpy.simulation.simulate import Simulation
from musatpy.simulation.world import Places
from musatpy.units import DEGREE

_DEGREE_DECIMALS = 11  # finer than the cards: 0.00001 arc second is 3e-9 degrees


def truth_record(simulation: Simulation) -> dict[str, Any]:
    """Return the truth of a simulation: seed, spec, stations, points, water, control errors, blunders, flags.

    Angles in degrees, lengths in metres, plate lengths in millimetres, as `units` in the record says. Everything is
    rounded beyond the precision of the cards, so that the JSON is the same on every machine.
    """
    block, truth = simulation.block, simulation.truth
    spec = dataclasses.asdict(truth.spec)
    return {
        "musatpy": version("musatpy"),
        "units": {"positions": _position_units(simulation), "angles": "degree", "plates": "mm", "errors": "m"},
        "seed": truth.spec.seed,
        "spec": _without_none(spec),
        "index": block.water.index if block.water else None,
        "stations": _stations(simulation),
        "points": _points(simulation),
        "control": _control(simulation),
        "equal_elevations": {
            str(name): round(float(level), 4)
            for name, level in zip(block.equal_elevations.ids, truth.levels, strict=True)
        },
        "air_bases": [
            {"photos": [str(name) for name in block.photos.ids[pair]], "length": round(float(length), 4)}
            for pair, length in zip(block.air_bases.photo, truth.base_lengths, strict=True)
        ],
        "blunders": [
            {"photo": one.photo, "point": one.point, "added": [round(value, 6) for value in one.added]}
            for one in truth.blunders
        ],
        "kept_out": [
            [str(block.photos.ids[block.plates.photo[row]]), str(block.points.ids[block.plates.point[row]])]
            for row in np.flatnonzero(~block.plates.triangulated)
        ],
        "dry": _dry(simulation),
    }


def truth_json(simulation: Simulation) -> str:
    """Return the record as JSON text: keys in order, one station, point or flag per line, a line end at the end."""
    lines = []
    for name, value in truth_record(simulation).items():
        lines.append(f"  {json.dumps(name)}: {_laid_out(value)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _laid_out(value: Any) -> str:
    """Return JSON of one top-level value, its members a line each."""
    if isinstance(value, dict) and value:
        members = [f"    {json.dumps(name)}: {json.dumps(one)}" for name, one in value.items()]
        return "{\n" + ",\n".join(members) + "\n  }"
    if isinstance(value, list) and value:
        return "[\n" + ",\n".join(f"    {json.dumps(one)}" for one in value) + "\n  ]"
    return json.dumps(value)


def _position_units(simulation: Simulation) -> str:
    if simulation.block.options.system == CoordinateSystem.GEOGRAPHIC:
        return "latitude degree, longitude degree, height m"
    return "X, Y, Z m"


def _without_none(value: Any) -> Any:
    """Return nested dicts without the keys that are None: those that the spec does not give."""
    if isinstance(value, dict):
        return {name: _without_none(one) for name, one in value.items() if one is not None}
    if isinstance(value, list | tuple):
        return [_without_none(one) for one in value]
    return value


def _positions(simulation: Simulation, places: Places) -> list[list[float]]:
    """Return positions in the job's system, geographic ones in degrees."""
    if simulation.block.options.system != CoordinateSystem.GEOGRAPHIC:
        return [[round(float(value), 4) for value in row] for row in places.job]
    return [[*_degrees(row[:2]), round(float(row[2]), 4)] for row in places.job]


def _degrees(angles: Any) -> list[float]:
    return [round(float(angle) / DEGREE, _DEGREE_DECIMALS) for angle in angles]


def _stations(simulation: Simulation) -> dict[str, Any]:
    """Return true position, attitude and tide by photo id."""
    truth = simulation.truth
    positions = _positions(simulation, truth.stations)
    rows = zip(simulation.block.photos.ids, positions, truth.attitude, truth.tide, strict=True)
    return {
        str(name): {
            "position": position,
            "attitude": _degrees(attitude),
            "tide": None if np.isnan(tide) else float(tide),
        }
        for name, position, attitude, tide in rows
    }


def _points(simulation: Simulation) -> dict[str, Any]:
    """Return true position and kind by point id."""
    points = simulation.block.points
    rows = zip(points.ids, _positions(simulation, simulation.truth.points), points.bathymetric, strict=True)
    return {
        str(name): {"position": position, "bathymetric": bool(bathymetric)} for name, position, bathymetric in rows
    }


def _control(simulation: Simulation) -> dict[str, Any]:
    """Return kind and actual error (east, north, up, given minus true, before rounding) by point id."""
    block = simulation.block
    rows = zip(block.control.point, block.control.kind, simulation.truth.control_error, strict=True)
    return {
        str(block.points.ids[point]): {
            "kind": ControlKind(kind).name.lower(),
            "error": [round(float(value), 6) for value in error],
        }
        for point, kind, error in rows
    }


def _dry(simulation: Simulation) -> list[list[str]]:
    """Return photo and point of the images of bathymetric points that were above the water at that photo."""
    block, truth = simulation.block, simulation.truth
    dry = block.points.bathymetric[block.plates.point] & ~truth.refracted
    return [
        [str(block.photos.ids[block.plates.photo[row]]), str(block.points.ids[block.plates.point[row]])]
        for row in np.flatnonzero(dry)
    ]
