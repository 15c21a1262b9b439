"""The kinds of observations and unknowns: names, units and tables, and what may be wrong with them."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from musatpy.arrays import IntArray
from musatpy.model import extensions
from musatpy.model.gnss import AntennaLines, AntennaPositions, ExposureTimes, LeverArms
from musatpy.model.inertial import InertialAttitudes, InertialConvention, Misalignments
from musatpy.model.lenses import LensUnknowns, Ports
from musatpy.model.tables import empty
from musatpy.units import ARC_SECOND, MICROMETRE

if TYPE_CHECKING:
    from musatpy.model.block import Block
    from musatpy.model.solution import Solution

ENU = ("East", "North", "Up")
ANGLES = ("X-Tilt", "Y-Tilt", "Heading")
BODY_AXES = ("x axis", "y axis", "z axis")
CONTROL_CARD, STATION_CARD = "CTG/CTX", "STA/STX"  # the card of geographic jobs, and that of all others
_POSITION = "east north up"
_SCALES = {"um": MICROMETRE, "arc sec": ARC_SECOND}  # of units, in those inside
_NOTHING = np.zeros(0, dtype=np.int64)
Kind = TypeVar("Kind")


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


class Action(StrEnum):
    """What was done, or with LIST would be done."""

    KEPT_OUT = "kept out"  # flag N on the plate card
    RENAMED = "renamed"  # the plate card gets the name of the point whose image it is
    NOT_KNOWN = "not held"  # control: the component is not known any more; stations: not observed
    DROPPED = "dropped"  # the card, or the point on it, is not there any more
    FLAGGED = "flag B set"
    UNFLAGGED = "flag B taken"
    NONE = "none"  # why, says the note


class CauseKind(StrEnum):
    """What may be wrong, the cheaper to check first: a card is read again sooner than plates are measured again.

    A member is its name as a cause; its name in the list of blunders (empty: it never stands there), and what EDIT
    does; the cards to read again; the component of the card that is wrong; the unit of its size (None: it has no
    size), and the axes of that, if it has several; and what to check.
    """

    _ignore_ = "member statement"
    # fmt: off
    VERTICAL = (
        "height of a control card", "vertical control", Action.NOT_KNOWN, CONTROL_CARD, "height", "m", "",
        "read the height on the control card again: digits, sign, unit, sigma")
    HORIZONTAL = (
        "position of a control card", "horizontal control", Action.NOT_KNOWN, CONTROL_CARD, "position", "m",
        "east north",
        "read the position on the control card again: digits, sign, sigma, the name of the point")
    CONTROL = (
        "control card", "", Action.NONE, CONTROL_CARD, "", "m", _POSITION,
        "read the control card again: digits, unit, sigma, the name of the point")
    EXCHANGED_CONTROL = (
        "exchanged control cards", "", Action.NONE, CONTROL_CARD, "", None, "",
        "each point lies where the other card says: exchange the names on the two control cards")
    UNIT = "unit of length", "", Action.NONE, "", "", "", "", ""  # whose, and of what length, says `blunders`
    TIDE = (
        "tide card", "tide", Action.KEPT_OUT, "TID", "", "m", "",
        "read the tide card again: sign, datum, time of the exposure")
    TIDES = (
        "tides of several photos", "", Action.NONE, "TID", "all photos", "m", "",
        "read the tides again: datum, sign, time zone; no single image can be blamed")
    FOCAL_LENGTH = (
        "focal length", "", Action.NONE, "CAM", "focal length", "mm", "",
        "compare the camera card with the calibration; a common error of the heights of observed stations looks "
        "alike")
    PRINCIPAL_POINT = (
        "principal point", "", Action.NONE, "CAM", "", "mm", "",
        "compare the camera card with the calibration, signs and plate axes too")
    DISTORTION = (
        "radial distortion", "", Action.NONE, "DST RED CAL", "at the farthest image", "mm", "",
        "compare the distortion with the calibration: its sign, side, unit, and whether the plates have it still")
    INDEX = "refractive index", "", Action.NONE, "WTR", "", "", "", "read the water card again"
    ELEVATION = (
        "equal elevation", "equal elevation", Action.DROPPED, "EQL", "", "m", "",
        "is the point on the shore line? read the names on the card again")
    DISTANCE = (
        "distance", "distance", Action.DROPPED, "DIS", "", "m", "",
        "read the distance card again: names and digits")
    HEIGHT_DIFFERENCE = (
        "height difference", "height difference", Action.DROPPED, "HDF", "", "m", "",
        "read the height difference card again: names, digits, sign")
    AIR_BASE = (
        "air base", "air base", Action.DROPPED, "BAS", "", "m", "",
        "read the air base card again: photos and digits")
    ANTENNA = (
        "antenna position", "antenna position", "dropped", "GNS/GNX", "position", "m", _POSITION,
        "read the card of the antenna position again: digits, the name of the photo; was the receiver locked?")
    ANTENNA_TIMES = (
        "times of antenna positions", "", Action.NONE, "GNT GNS/GNX", "", "sec", "",
        "all positions of the line are off along the flight: compare the clocks of receiver and camera")
    LEVER_ARM_SIGN = (
        "sign of a lever arm", "", Action.NONE, "LVR", "", "m", "x y z",
        "reverse the sign, or read how the axes of the lever arm were defined")
    ANTENNA_LINES = (
        "exchanged antenna positions", "", Action.NONE, "GNS/GNX", "", None, "",
        "each position lies where another card says: read the lines and photos on these cards again")
    INERTIAL_ATTITUDE = (
        "inertial attitude", "inertial attitude", Action.DROPPED, "INS", "angles", "arc sec", "x y z",
        "read the card of the inertial attitude again: photo, digits, signs; is it that of another exposure?")
    INERTIAL_CONVENTION = (
        "convention of inertial attitudes", "", Action.NONE, "INO INS MIS", "angles", None, "",
        "read the cards of the inertial unit again: the verdict says how they would fit")
    ATTITUDE = (
        "attitude card", "station attitude", Action.NOT_KNOWN, "ATT", "angles", "arc sec", "omega phi kappa",
        "read the attitude card again: digits, signs, sigmas")
    POSITION = (
        "station card", "station position", Action.NOT_KNOWN, STATION_CARD, "position", "m", _POSITION,
        "read the station card again: digits, sigmas, the name of the photo")
    STATION = (
        "station and attitude cards", "", Action.NONE, f"{STATION_CARD} ATT", "", "m", _POSITION,
        "read station and attitude cards again: the name of the photo, digits, sigmas")
    START = (
        "start values of a station", "", Action.NONE, f"{STATION_CARD} ATT", "", "m", "",
        "read the card again: the given values, from which the run starts, are far from what the images say")
    LABELS = "exchanged photo labels", "", Action.NONE, "", "", None, "", ""  # of which cards, says `blunders`
    FLAG = (
        "flag of a submerged point", "", Action.NONE, "PLT", "", "m", "",
        "look whether the point is submerged, and at the flag B of its plate cards")
    DRY_FLAG = "missing flag", "not flagged submerged", Action.FLAGGED, "PLT", "", "m", "", ""  # m below water
    WET_FLAG = "wrong flag", "flagged submerged", Action.UNFLAGGED, "PLT", "", "m", "", ""  # m above it
    NAME = (
        "name of an image", "misnamed image", Action.RENAMED, "PLT", "", "um", "",
        "compare the name on the plate card with the plate")
    EXCHANGED_IMAGES = (
        "exchanged images of a point", "", Action.NONE, "PLT", "", None, "",
        "each fits the other photo: exchange the photo ids on the two plate cards")
    AXES = "axes", "", Action.NONE, "", "", None, "", ""  # which, says `blunders`
    IMAGE = (
        "image", "plate measurement", Action.KEPT_OUT, "PLT", "", "um", "x y",
        "read the plate card again, then measure the image again: name, digits, sign")
    IMAGES = (
        "all images of a point", "", Action.NONE, "PLT", "", None, "",
        "read the plate cards of the point again, then measure its images: is it one point on all of them?")
    # fmt: on
    for member, statement in extensions.stated("CAUSES").items():
        locals()[member] = statement

    listed: str
    action: Action
    cards: str
    component: str
    unit: str
    sized: bool
    axes: tuple[str, ...]
    advice: str

    def __new__(
        cls, name: str, listed: str = "", action: Action = Action.NONE, cards: str = "", component: str = "",
        unit: str | None = None, axes: str = "", advice: str = "",
    ) -> CauseKind:  # fmt: skip
        member = str.__new__(cls, name)
        member._value_ = name
        member.listed, member.action, member.cards, member.component = listed, Action(action), cards, component
        member.unit, member.sized = unit or "", unit is not None
        member.axes, member.advice = tuple(axes.split()), advice
        return member

    @property
    def scale(self) -> float:
        """The unit of its size, in that of what is computed."""
        return _SCALES.get(self.unit, 1.0)


NAMED_BY_COMPONENT = (  # of a card, or of several
    CauseKind.ANTENNA_LINES, CauseKind.ANTENNA_TIMES, CauseKind.AXES, CauseKind.CONTROL, CauseKind.LABELS,
    CauseKind.LEVER_ARM_SIGN, CauseKind.PRINCIPAL_POINT, CauseKind.START, CauseKind.TIDES,
)  # fmt: skip


def with_tables_from_outside(kind: type[Kind]) -> type[Kind]:
    """Return a class with the tables of extensions among its attributes."""
    for name, table in extensions.stated("TABLES").items():
        kind.__annotations__[name] = table
        setattr(kind, name, field(default_factory=partial(empty, table)))
    return kind


@dataclass(frozen=True, kw_only=True, eq=False)
class TablesOfKinds:
    """What a block has of kinds that most jobs are without."""

    lens_unknowns: LensUnknowns = field(default_factory=partial(empty, LensUnknowns))
    ports: Ports = field(default_factory=partial(empty, Ports))
    lever_arms: LeverArms = field(default_factory=partial(empty, LeverArms))
    antenna_lines: AntennaLines = field(default_factory=partial(empty, AntennaLines))
    antenna_positions: AntennaPositions = field(default_factory=partial(empty, AntennaPositions))
    exposure_times: ExposureTimes = field(default_factory=partial(empty, ExposureTimes))
    inertial_convention: InertialConvention | None = None  # None: no card
    inertial_attitudes: InertialAttitudes = field(default_factory=partial(empty, InertialAttitudes))
    misalignments: Misalignments = field(default_factory=partial(empty, Misalignments))
