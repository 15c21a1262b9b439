"""The truth of a simulation as plain data, for the JSON beside the deck."""

from __future__ import annotations

import json
from collections.abc import Iterable
from importlib.metadata import version
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.model import ControlKind, CoordinateSystem
from musatpy.simulation.scene_keys import INDEX_DECIMALS
from musatpy.simulation.simulate import Simulation
from musatpy.simulation.world import TruePlaces
from musatpy.specs import echoed
from musatpy.units import ARC_SECOND, DEGREE

_DEGREE_DECIMALS = 11  # finer than the cards: 0.00001 arc second is 3e-9 degrees


def truth_record(simulation: Simulation) -> dict[str, Any]:
    """Return the truth of a simulation: seed, spec, stations, points, water, control errors, blunders, flags.

    What the deck says wrongly of water, names, flags and so on stands there only where it does. Angles in degrees,
    lengths in metres, plate lengths in millimetres, as `units` in the record says, slopes of the water in arc
    seconds. Everything is rounded beyond the precision of the cards, so that the JSON is the same on every machine.
    """
    block, truth = simulation.block, simulation.truth
    geographic = block.options.system == CoordinateSystem.GEOGRAPHIC
    positions = "latitude degree, longitude degree, height m" if geographic else "X, Y, Z m"
    dry = truth.bathymetric[truth.seen] & ~truth.refracted
    photos, points = block.photos.ids.tolist(), block.points.ids.tolist()
    record = {
        "musatpy": version("musatpy"),
        "units": {"positions": positions, "angles": "degree", "plates": "mm", "errors": "m"},
        "seed": truth.spec.seed,
        "spec": echoed(truth.spec),
        "index": truth.index,
        "stations": {
            name: {"position": position, "attitude": _degrees(attitude), "tide": None if tide != tide else tide}
            for name, position, attitude, tide in zip(
                photos, _positions(simulation, truth.stations), truth.attitude, truth.tide.tolist(), strict=True
            )
        },
        "points": {
            name: {"position": position, "bathymetric": wet}
            for name, position, wet in zip(
                points, _positions(simulation, truth.points), truth.bathymetric.tolist(), strict=True
            )
        },
        "control": {
            points[point]: {"kind": ControlKind(kind).name.lower(), "error": _rounded(error, 6)}
            for point, kind, error in zip(block.control.point, block.control.kind, truth.control_error, strict=True)
        },
        "equal_elevations": {
            str(name): round(float(level), 4)
            for name, level in zip(block.equal_elevations.ids, truth.levels, strict=True)
        },
        "air_bases": [
            {"photos": block.photos.ids[pair].tolist(), "length": round(float(length), 4)}
            for pair, length in zip(block.air_bases.photo, truth.base_lengths, strict=True)
        ],
        "blunders": [
            {"photo": blunder.photo, "point": blunder.point, "added": _rounded(blunder.added, 6)}
            for blunder in truth.blunders
        ],
        "kept_out": [
            [_photo(simulation, row), points[block.plates.point[row]]]
            for row in np.flatnonzero(~block.plates.triangulated).tolist()
        ],
        # images of bathymetric points that were above the water at that photo
        "dry": [[_photo(simulation, row), _seen(simulation, row)] for row in np.flatnonzero(dry).tolist()],
    }
    return record | {name: value for name, value in _wrong(simulation).items() if value}


def truth_json(simulation: Simulation) -> str:
    """Return the record as JSON text: keys in order, one station, point or flag per line, a line end at the end."""
    lines = (f"  {json.dumps(name)}: {_laid_out(value)}" for name, value in truth_record(simulation).items())
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _laid_out(value: Any) -> str:
    """Return JSON of one top-level value, its members a line each."""
    if isinstance(value, dict) and value:
        members = [f"    {json.dumps(name)}: {json.dumps(member)}" for name, member in value.items()]
        return "{\n" + ",\n".join(members) + "\n  }"
    if isinstance(value, list) and value:
        return "[\n" + ",\n".join(f"    {json.dumps(member)}" for member in value) + "\n  ]"
    return json.dumps(value)


def _positions(simulation: Simulation, places: TruePlaces) -> list[list[float]]:
    """Return positions in the job's system, geographic ones in degrees."""
    if simulation.block.options.system != CoordinateSystem.GEOGRAPHIC:
        return [_rounded(row, 4) for row in places.job]
    return [[*_degrees(row[:2]), round(float(row[2]), 4)] for row in places.job]


def _degrees(angles: Any) -> list[float]:
    return [round(float(angle) / DEGREE, _DEGREE_DECIMALS) for angle in angles]


def _rounded(values: Iterable[float], decimals: int) -> list[float]:
    return [round(float(value), decimals) for value in values]


def _photo(simulation: Simulation, row: int) -> str:
    block = simulation.block
    return str(block.photos.ids[block.plates.photo[row]])


def _seen(simulation: Simulation, row: int) -> str:
    """Return the id of the point that a plate measurement really is of."""
    return str(simulation.block.points.ids[simulation.truth.seen[row]])


def _wrong(simulation: Simulation) -> dict[str, Any]:
    """Return what else the deck says wrongly, and what is measured between points."""
    block, truth = simulation.block, simulation.truth
    ids = block.points.ids
    return {
        "water": _water(simulation),
        "tides": {
            str(block.photos.ids[row]): round(float(truth.tide_error[row]), 4)
            for row in np.flatnonzero(truth.tide_error)
        },
        "swapped": [
            {"photo": _photo(simulation, pair[0]), "points": [_seen(simulation, row) for row in pair]}
            for pair in truth.swapped
        ],
        "misnamed": [
            {
                "photo": _photo(simulation, row),
                "point": _seen(simulation, row),
                "name": str(ids[block.plates.point[row]]),
            }
            for row in truth.misnamed
        ],
        "wrong_control": {
            str(ids[block.control.point[row]]): _rounded(truth.gross_control[row], 6)
            for row in np.flatnonzero(truth.gross_control.any(axis=1))
        },
        "distances": _between(ids[block.distances.point], truth.distances),
        "height_differences": _between(ids[block.height_differences.point], truth.height_differences),
    }


def _water(simulation: Simulation) -> dict[str, Any]:
    """Return index and tilt as they are and as the deck has them; empty where they agree and the water is level."""
    card, truth = simulation.block.water, simulation.truth
    if card is None:
        return {}
    on_card = [slope or 0.0 for slope in (card.tilt_east, card.tilt_north)]
    index_on_card = round(card.index, INDEX_DECIMALS)
    if index_on_card == truth.index and not truth.tilt.any() and not any(on_card):
        return {}
    return {
        "index_on_card": index_on_card,
        "tilt": _rounded(truth.tilt / ARC_SECOND, 6),
        "tilt_on_card": [round(slope / ARC_SECOND, 6) for slope in on_card],
        "tilted_about": _rounded(truth.middle, 4),
    }


def _between(names: TextArray, true: FloatArray) -> list[dict[str, Any]]:
    """Return true measurements between points."""
    return [
        {"points": pair.tolist(), "true": round(float(value), 4)} for pair, value in zip(names, true, strict=True)
    ]
