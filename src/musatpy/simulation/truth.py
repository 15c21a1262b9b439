"""The truth of a simulation as plain data, for the JSON beside the deck."""

from __future__ import annotations

import json
from collections.abc import Iterable
from importlib.metadata import version
from typing import Any

import numpy as np

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
    block, truth, plates = simulation.block, simulation.truth, simulation.block.plates
    geographic = block.options.system == CoordinateSystem.GEOGRAPHIC
    photos, points = block.photos.ids.tolist(), block.points.ids.tolist()
    # photo and point of each image, as it is and as the deck has it
    seen, named = (
        [[photos[photo], points[point]] for photo, point in zip(plates.photo, of, strict=True)]
        for of in (truth.seen, plates.point)
    )
    wet = truth.bathymetric.tolist()
    kinds = [ControlKind(kind).name.lower() for kind in block.control.kind]
    record = {
        "musatpy": version("musatpy"),
        "units": {
            "positions": "latitude degree, longitude degree, height m" if geographic else "X, Y, Z m",
            "angles": "degree",
            "plates": "mm",
            "errors": "m",
        },
        "seed": truth.spec.seed,
        "spec": echoed(truth.spec),
        "index": truth.index,
        "stations": {
            name: {"position": position, "attitude": _degrees(attitude), "tide": None if tide != tide else tide}
            for name, position, attitude, tide in zip(
                photos, _positions(truth.stations, geographic), truth.attitude, truth.tide.tolist(), strict=True
            )
        },
        "points": {
            name: {"position": position, "bathymetric": is_wet}
            for name, position, is_wet in zip(points, _positions(truth.points, geographic), wet, strict=True)
        },
        "control": {
            points[point]: {"kind": kind, "error": _rounded(error, 6)}
            for point, kind, error in zip(block.control.point, kinds, truth.control_error, strict=True)
        },
        "equal_elevations": dict(zip(block.equal_elevations.ids.tolist(), _rounded(truth.levels, 4), strict=True)),
        "air_bases": [
            {"photos": [photos[photo] for photo in pair], "length": length}
            for pair, length in zip(block.air_bases.photo, _rounded(truth.base_lengths, 4), strict=True)
        ],
        "blunders": [
            {"photo": blunder.photo, "point": blunder.point, "added": _rounded(blunder.added, 6)}
            for blunder in truth.blunders
        ],
        "kept_out": [named[row] for row in np.flatnonzero(~plates.triangulated)],
        # images of bathymetric points that were above the water at that photo
        "dry": [seen[row] for row in np.flatnonzero(truth.bathymetric[truth.seen] & ~truth.refracted)],
    }
    return record | {name: value for name, value in _wrong(simulation, seen, named).items() if value}


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


def _positions(places: TruePlaces, geographic: bool) -> list[list[float]]:
    """Return positions in the job's system, geographic ones in degrees."""
    if not geographic:
        return [_rounded(row, 4) for row in places.job]
    return [[*_degrees(row[:2]), round(float(row[2]), 4)] for row in places.job]


def _degrees(angles: Any) -> list[float]:
    return [round(float(angle) / DEGREE, _DEGREE_DECIMALS) for angle in angles]


def _rounded(values: Iterable[float], decimals: int) -> list[float]:
    return [round(float(value), decimals) for value in values]


def _wrong(simulation: Simulation, seen: list[list[str]], named: list[list[str]]) -> dict[str, Any]:
    """Return what else the deck says wrongly, and what is measured between points."""
    block, truth = simulation.block, simulation.truth
    photos, points = block.photos.ids.tolist(), block.points.ids.tolist()
    wrong: dict[str, Any] = {
        "water": _water(simulation),
        "tides": {photos[row]: round(float(truth.tide_error[row]), 4) for row in np.flatnonzero(truth.tide_error)},
        "swapped": [
            {"photo": seen[first][0], "points": [seen[first][1], seen[second][1]]}
            for first, second in truth.swapped
        ],
        "misnamed": [
            {"photo": seen[row][0], "point": seen[row][1], "name": named[row][1]} for row in truth.misnamed
        ],
        "wrong_control": {
            points[block.control.point[row]]: _rounded(truth.gross_control[row], 6)
            for row in np.flatnonzero(truth.gross_control.any(axis=1))
        },
    }
    wrong["parameters"] = [
        {"kind": true.kind.label, "of": true.owner, "parameter": true.name, "value": float(f"{true.value:.12g}")}
        for true in truth.parameters
    ]
    for name in ("distances", "height_differences"):
        ends, true = getattr(block, name).point, _rounded(getattr(truth, name), 4)
        wrong[name] = [
            {"points": [points[end] for end in pair], "true": value} for pair, value in zip(ends, true, strict=True)
        ]
    return wrong


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
