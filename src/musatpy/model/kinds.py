"""The kinds of observations: names, units and tables."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import IntArray
from musatpy.model import extensions
from musatpy.units import ARC_SECOND, MICROMETRE

if TYPE_CHECKING:
    from musatpy.model.block import Block
    from musatpy.model.solution import Solution

ENU = ("East", "North", "Up")
ANGLES = ("X-Tilt", "Y-Tilt", "Heading")
BODY_AXES = ("x axis", "y axis", "z axis")
_NOTHING = np.zeros(0, dtype=np.int64)


class ObservationKind(IntEnum):
    """What was observed, and which table of the block `Observations.row` links to.

    A member is its number; the name of all of its observations; the label of one in a table; the attribute of
    `Block` that holds them (empty: an unknown of the water, observed by its own prior); its components; the unit in
    which they are printed; and that unit in m, rad or mm on the plate.
    """

    _ignore_ = "number name statement"
    PLATE = 0, "plate coordinates", "plate", "plates", ("x", "y"), "um", MICROMETRE
    CONTROL = 1, "control", "control", "control", ENU, "m"
    STATION_POSITION = 2, "station positions", "station", "photos", ENU, "m"
    STATION_ATTITUDE = 3, "station attitudes", "station", "photos", ANGLES, '"', ARC_SECOND
    EQUAL_ELEVATION = 4, "equal elevations", "level", "equal_elevations", ("Up",), "m"  # their members
    AIR_BASE = 5, "air bases", "base", "air_bases", ("length",), "m"
    WATER_LEVEL = 6, "tides", "tide", "", ("level",), "m"  # common corrections, observed as zero; AdjustedWater
    WATER_TILT = 7, "water tilt", "water", "", ("tilt E", "tilt N"), '"', ARC_SECOND  # component only
    WATER_INDEX = 8, "refractive index", "water", "", ("index",), ""
    DISTANCE = 9, "distances", "distance", "distances", ("length",), "m"
    HEIGHT_DIFFERENCE = 10, "height differences", "height", "height_differences", ("diff.",), "m"
    WAVE = 11, "waves", "wave", "", ("height", "length", "azim.", "crest"), "m,rd"  # AdjustedWaves
    LENS = 12, "lens parameters", "lens", "", ("value",), ""  # AdjustedParameters
    ANTENNA = 13, "antenna positions", "antenna", "antenna_positions", ENU, "m"
    LEVER_ARM = 14, "lever arms", "lever", "", ("value",), ""  # AdjustedParameters
    ANTENNA_SHIFT = 15, "antenna shifts", "shift", "", ("value",), ""
    ANTENNA_DRIFT = 16, "antenna drifts", "drift", "", ("value",), ""
    INERTIAL_ATTITUDE = 17, "inertial attitudes", "inert.", "inertial_attitudes", BODY_AXES, '"', ARC_SECOND
    MISALIGNMENT = 18, "misalignment angles", "misal.", "", ("value",), ""  # AdjustedParameters
    PORT = 19, "parameters of ports", "port", "", ("value",), ""
    for number, (name, statement) in enumerate(extensions.stated("OBSERVATIONS").items(), 20):
        locals()[name] = number, *statement

    noun: str
    label: str
    attribute: str
    components: tuple[str, ...]
    unit: str
    factor: float

    def __new__(
        cls, number: int, noun: str = "", label: str = "", table: str = "", components: tuple[str, ...] = (),
        unit: str = "", factor: float = 1.0,
    ) -> ObservationKind:  # fmt: skip
        member = int.__new__(cls, number)
        member._value_ = number
        member.noun, member.label, member.attribute = noun, label, table
        member.components, member.unit, member.factor = components, unit, factor
        return member

    @property
    def is_parameter(self) -> bool:
        """Whether it is a further parameter, observed by its own prior: see `AdjustedParameters`."""
        return self.components == ("value",)

    def links(self, block: Block, row: int) -> tuple[list[str], list[str]]:
        """Return the ids of the photos and of the points that a row of the table names."""
        table, photos, points = getattr(block, self.attribute), block.photos, block.points
        if table is photos:
            return [str(photos.ids[row])], []
        photo, point = (getattr(table, name, _NOTHING)[row : row + 1] for name in ("photo", "point"))
        return photos.ids[photo.reshape(-1)].tolist(), points.ids[point.reshape(-1)].tolist()

    def owners(self, solution: Solution, rows: IntArray) -> list[list[str]]:
        """Return the ids of the photos, then of the points, of observations (r,), or their tide or wave."""
        block, water, ids = solution.block, solution.water, None
        if self.is_parameter and solution.parameters:
            owners = solution.parameters.owners(self)
            return [owners[row] for row in rows.tolist()]
        if not self.attribute:
            if water and self is ObservationKind.WATER_LEVEL:
                ids = water.correction_ids
            elif water and water.waves and self is ObservationKind.WAVE:
                ids = water.waves.ids
            return [[] if ids is None else ids[row].split() for row in rows.tolist()]
        table, photos, points = getattr(block, self.attribute), block.photos, block.points
        if table is photos:
            return [[name] for name in photos.ids[rows].tolist()]
        links = ((getattr(table, "photo", None), photos.ids), (getattr(table, "point", None), points.ids))
        parts = [ids[link[rows]].reshape(len(rows), -1) for link, ids in links if link is not None]
        return [list(row) for row in zip(*(column for part in parts for column in part.T.tolist()), strict=True)]
