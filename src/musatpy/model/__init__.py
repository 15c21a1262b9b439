"""What the problem is: cameras, photos, points, observations, control, water, block, solution."""

from musatpy.model.block import Block
from musatpy.model.cameras import Cameras, Distortion, Fiducials
from musatpy.model.control import AirBases, Control, ControlKind, EqualElevations
from musatpy.model.observations import FiducialMeasurements, PlateMeasurements
from musatpy.model.options import (
    CoordinateSystem,
    EllipsoidSpec,
    Initial,
    Options,
    Program,
    Refraction,
    Weights,
)
from musatpy.model.photos import Photos
from musatpy.model.points import Points
from musatpy.model.solution import (
    AdjustedStations,
    BathymetricPoints,
    GroundPoints,
    Iteration,
    PlateResiduals,
    PointStatus,
    Solution,
    WaterPass,
)
from musatpy.model.water import Water

__all__ = [
    "AdjustedStations",
    "AirBases",
    "BathymetricPoints",
    "Block",
    "Cameras",
    "Control",
    "ControlKind",
    "CoordinateSystem",
    "Distortion",
    "EllipsoidSpec",
    "EqualElevations",
    "FiducialMeasurements",
    "Fiducials",
    "GroundPoints",
    "Initial",
    "Iteration",
    "Options",
    "Photos",
    "PlateMeasurements",
    "PlateResiduals",
    "PointStatus",
    "Points",
    "Program",
    "Refraction",
    "Solution",
    "Water",
    "WaterPass",
    "Weights",
]
