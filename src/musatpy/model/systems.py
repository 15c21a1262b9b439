"""How the coordinates and attitudes of a job are stated, in plain words: what a card says."""

from __future__ import annotations

from dataclasses import dataclass

from musatpy.units import AngleUnit


@dataclass(frozen=True, kw_only=True)
class SystemSpec:
    """A statement in plain values, in the words of docs/systems.md. What a kind does not use must be empty."""

    kind: str = "GEOG"
    definition: str = ""  # of a projected system: code, PROJ string or WKT
    geoid: str = ""  # grid file of a projected system with heights above a geoid
    origin: tuple[float, float, float] | None = None  # of a tangent plane: latitude, longitude (rad), height (m)
    false: tuple[float, float, float] | None = None  # m, its coordinates; 0 where not given
    axes: str = "VERT"
    angles: str = "OPK"  # or MATR
    sigmas: str = "LOCL"
    unit: AngleUnit = AngleUnit.DMS  # of angles on cards and in listings; inside they are radians
