"""What the problem is: cameras, photos, points, observations, control, water, block, solution."""

from musatpy.model.block import Block
from musatpy.model.cameras import Cameras, Distortion, Fiducials
from musatpy.model.control import AirBases, Control, ControlKind, Distances, EqualElevations, HeightDifferences
from musatpy.model.findings import Action, Blunder, Finding
from musatpy.model.observations import FiducialMeasurements, PlateMeasurements
from musatpy.model.options import (
    CoordinateSystem,
    Datum,
    Editing,
    EllipsoidSpec,
    Initial,
    Options,
    Program,
    Refraction,
    Treatment,
    WaterLevel,
    Weights,
)
from musatpy.model.photos import Photos
from musatpy.model.points import Points
from musatpy.model.reliability import Dependence, ObservationKind, Observations
from musatpy.model.solution import (
    AdjustedStations,
    AdjustedWater,
    BathymetricPoints,
    GroundPoints,
    Iteration,
    PlateResiduals,
    PointStatus,
    Solution,
    WaterPass,
)
from musatpy.model.systems import SystemSpec
from musatpy.model.water import Water, WaterConditions

__all__ = [
    "Action",
    "AdjustedStations",
    "AdjustedWater",
    "AirBases",
    "BathymetricPoints",
    "Block",
    "Blunder",
    "Cameras",
    "Control",
    "ControlKind",
    "CoordinateSystem",
    "Datum",
    "Dependence",
    "Distances",
    "Distortion",
    "Editing",
    "EllipsoidSpec",
    "EqualElevations",
    "FiducialMeasurements",
    "Fiducials",
    "Finding",
    "GroundPoints",
    "HeightDifferences",
    "Initial",
    "Iteration",
    "ObservationKind",
    "Observations",
    "Options",
    "Photos",
    "PlateMeasurements",
    "PlateResiduals",
    "PointStatus",
    "Points",
    "Program",
    "Refraction",
    "Solution",
    "SystemSpec",
    "Treatment",
    "Water",
    "WaterConditions",
    "WaterLevel",
    "WaterPass",
    "Weights",
]
