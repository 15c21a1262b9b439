"""How observations of each kind are named and in what unit they are stated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from musatpy.model import ObservationKind
from musatpy.units import ARC_SECOND, MICROMETRE

if TYPE_CHECKING:
    from musatpy.statistics.analyses import Statistics

ENU = ("East", "North", "Up")
ANGLES = ("X-Tilt", "Y-Tilt", "Heading")


@dataclass(frozen=True, eq=False)
class Kind:
    """How observations of one kind are printed: name, what they belong to, component names, unit."""

    name: str
    owner: Callable[[Statistics, int], str]
    components: tuple[str, ...]
    unit: str
    factor: float = 1.0


def _plate(s: Statistics, row: int) -> str:
    plates = s.block.plates
    return f"{s.block.photos.ids[plates.photo[row]]:<8} {s.block.points.ids[plates.point[row]]:<8}"


def _photo(s: Statistics, row: int) -> str:
    return str(s.block.photos.ids[row])


def _ends(table: str) -> Callable[[Statistics, int], str]:
    def owner(s: Statistics, row: int) -> str:
        first, second = getattr(s.block, table).point[row]
        return f"{s.block.points.ids[first]:<8} {s.block.points.ids[second]:<8}"

    return owner


def _base(s: Statistics, row: int) -> str:
    first, second = s.block.air_bases.photo[row]
    return f"{s.block.photos.ids[first]:<8} {s.block.photos.ids[second]:<8}"


def _tide(s: Statistics, row: int) -> str:
    water = s.solution.water
    return str(water.correction_ids[row]) if water else ""


def _wave(s: Statistics, row: int) -> str:
    water = s.solution.water
    return str(water.waves.ids[row]) if water and water.waves else ""


KINDS = {
    ObservationKind.PLATE: Kind("plate", _plate, ("x", "y"), "um", MICROMETRE),
    ObservationKind.CONTROL: Kind(
        "control", lambda s, row: str(s.block.points.ids[s.block.control.point[row]]), ENU, "m"
    ),
    ObservationKind.STATION_POSITION: Kind("station", _photo, ENU, "m"),
    ObservationKind.STATION_ATTITUDE: Kind("station", _photo, ANGLES, '"', ARC_SECOND),
    ObservationKind.EQUAL_ELEVATION: Kind(
        "level", lambda s, row: str(s.block.points.ids[s.block.equal_elevations.point[row]]), ("Up",), "m"
    ),
    ObservationKind.AIR_BASE: Kind("base", _base, ("length",), "m"),
    ObservationKind.WATER_LEVEL: Kind("tide", _tide, ("level",), "m"),
    ObservationKind.WATER_TILT: Kind("water", lambda s, row: "", ("tilt E", "tilt N"), '"', ARC_SECOND),
    ObservationKind.WATER_INDEX: Kind("water", lambda s, row: "", ("index",), ""),
    ObservationKind.DISTANCE: Kind("distance", _ends("distances"), ("length",), "m"),
    ObservationKind.HEIGHT_DIFFERENCE: Kind("height", _ends("height_differences"), ("diff.",), "m"),
    ObservationKind.WAVE: Kind("wave", _wave, ("height", "length", "azim.", "crest"), "m,rd"),
}
