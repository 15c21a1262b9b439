"""The kinds of observations and of global unknowns, one file each; whoever deals with all loops over these.

A new kind is a file here, with a line in these lists, and a member of `model.ObservationKind`.
"""

from musatpy.adjustment.kinds.air_bases import AirBase
from musatpy.adjustment.kinds.control import Control
from musatpy.adjustment.kinds.distances import Distance
from musatpy.adjustment.kinds.equal_elevations import EqualElevation
from musatpy.adjustment.kinds.height_differences import HeightDifference
from musatpy.adjustment.kinds.kind import Kind, OfWater, Rows, Unknown
from musatpy.adjustment.kinds.measured import MeasuredKind, kept_axes
from musatpy.adjustment.kinds.prior import Prior
from musatpy.adjustment.kinds.stations import StationAttitude, StationPosition
from musatpy.adjustment.kinds.water_index import WaterIndex
from musatpy.adjustment.kinds.water_level import WaterLevel
from musatpy.adjustment.kinds.water_tilt import WaterTilt
from musatpy.adjustment.kinds.waves import Wave

AIR_BASE, DISTANCE, HEIGHT_DIFFERENCE = AirBase(), Distance(), HeightDifference()
WATER_INDEX = WaterIndex()
# in the order of `ObservationKind`
KINDS: tuple[Kind, ...] = (
    Control(),
    StationPosition(),
    StationAttitude(),
    EqualElevation(),
    AIR_BASE,
    WaterLevel(),
    WaterTilt(),
    WATER_INDEX,
    DISTANCE,
    HEIGHT_DIFFERENCE,
    Wave(),
)
DIRECT = tuple(kind for kind in KINDS if kind.direct)
MEASURED = tuple(kind for kind in KINDS if isinstance(kind, MeasuredKind))
PRIORS = tuple(kind for kind in KINDS if isinstance(kind, Prior))
UNKNOWNS = tuple(kind for kind in KINDS if isinstance(kind, Unknown))
WATER = tuple(kind for kind in KINDS if isinstance(kind, OfWater))
SEARCHED = tuple(kind for kind in KINDS if kind.searched)

__all__ = [
    "AIR_BASE",
    "DIRECT",
    "DISTANCE",
    "HEIGHT_DIFFERENCE",
    "KINDS",
    "MEASURED",
    "PRIORS",
    "SEARCHED",
    "UNKNOWNS",
    "WATER",
    "WATER_INDEX",
    "Kind",
    "Rows",
    "Unknown",
    "kept_axes",
]
