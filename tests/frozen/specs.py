"""Specs of simulated blocks of all kinds of cards, by their seeds."""

from __future__ import annotations

import random
from typing import Any

_CONDITIONS = {"temperature": 21.5, "salinity": 35.0}


def spec(seed: int) -> dict[str, Any]:
    """Return the spec of a small block: system, program, water, ties and mistakes by the digits of its seed."""
    rng = random.Random(seed)
    program, refraction = [("IIA", "WATPT"), ("IIA", "RIGOROUS"), ("IIIA", "RIGOROUS"), ("IIA", "NONE")][seed % 4]
    submerged, simultaneous = seed % 3 > 0, program == "IIIA"
    system = ("GEOG", "GEOC", "LOCL")[seed // 4 % 3]
    tables: dict[str, Any] = {
        "title": [f"FROZEN {seed}"],
        "seed": seed,
        "job": {"system": system, "centre": [0.0, 0.0] if system == "LOCL" else [18.34, -64.93]},
        "flight": {
            "strips": 1 + seed // 5 % 2,
            "photos": 2 + seed // 7 % 3,
            "height": rng.choice([900.0, 1500.0, 3000.0]),
            "attitude_scatter": 1.0,
            "interval": 6.0,
            "reverse_alternate": bool(seed % 2),
        },
        "points": {"per_site": 1 + seed % 2, "extra": [{"number": 10}]},
        "control": [
            {"kind": "full", "number": 4, "sigma": 0.1, "error": 0.1, "fixed": seed % 11 == 0},
            {"kind": "vertical", "number": 2, "sigma": 0.1, "error": 0.1},
            {"kind": "check", "number": 2},
        ],
        "stations": {"position_error": 10.0, "attitude_error": 0.3},
        "options": {"program": program, "refraction": refraction},
    }
    if seed % 5 == 1:
        tables["stations"] |= {"position_sigma": 10.0, "attitude_sigma": 1000.0}
    if seed % 6 == 2:
        tables["equal_elevation"] = [{"id": "SHORE", "number": 3, "error": 0.05}]
        tables["air_base"] = [{"photos": ["1", "2"], "sigma": 0.1, "error": 0.1}]
    if simultaneous and seed % 5 == 3:
        tables["distance"] = [{"number": 2, "error": 0.02}]
        tables["height_difference"] = [{"number": 2, "error": 0.02}]
    if seed % 8 == 5:
        tables["blunders"] = {"number": 2}
        tables["options"]["editing"] = rng.choice(["LIST", "EDIT"])
    if program == "IIA":
        tables["options"]["weights"] = {3: "DIAGONAL", 7: "EQUAL"}.get(seed % 13, "FULL")
    if refraction == "WATPT" and seed % 3 == 1:
        tables["options"]["refraction"] = "LEGACY"
    if submerged:
        tables["shoal"] = [{"share": 0.5, "depth": [0.5, 12.0]}]
        tables["water"] = _water(seed, tables["options"])
    if submerged and refraction == "RIGOROUS" and seed % 10 == 6:
        tables["water"].pop("tilt", None)
        tables["wave"] = [{"id": "SW", "period": 6.0, "height": 0.4, "azimuth": 40.0}]
    return tables


def _water(seed: int, options: dict[str, Any]) -> dict[str, Any]:
    """Return the water of a block, and in `options` what of it is unknown."""
    water: dict[str, Any] = {"tide_scatter": 0.2, "group_size": 2 * (seed % 2), "day_size": seed // 2 % 2}
    if seed % 7 < 3:
        water |= {"tide_sigma": 0.1, "index_sigma": 0.0005, "photo_level_error": 0.1}
    if seed % 9 == 4:
        water["conditions"] = _CONDITIONS
        water.pop("index_sigma", None)
    if options["program"] == "IIIA" and seed % 7 == 2:
        options |= {"water_level": "ONE", "water_index": "ADJUST"}
    return water


def toml(tables: dict[str, Any]) -> str:
    """Return tables as TOML: values first, then tables, then arrays of tables."""
    return "\n".join(_lines(tables, ""))


def _lines(table: dict[str, Any], path: str) -> list[str]:
    lines, below = [], []
    for key, value in table.items():
        name = f"{path}.{key}" if path else key
        if isinstance(value, dict):
            below += [f"[{name}]", *_lines(value, name)]
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            below += [line for one in value for line in (f"[[{name}]]", *_lines(one, name))]
        else:
            lines.append(f"{key} = {_value(value)}")
    return lines + below


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return f'"{value}"' if isinstance(value, str) else repr(value)
