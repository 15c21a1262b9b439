"""What the problem is: cameras, photos, points, observations, control, water, block, solution."""

from musatpy.model.adjusted_waves import AdjustedWaves
from musatpy.model.block import Block
from musatpy.model.cameras import Cameras, Distortion, Fiducials
from musatpy.model.control import AirBases, Control, ControlKind, Distances, EqualElevations, HeightDifferences
from musatpy.model.findings import Action, Cause, Finding
from musatpy.model.kinds import Blunder, CauseKind, ObservationKind
from musatpy.model.observations import FiducialMeasurements, PlateMeasurements
from musatpy.model.options import (
    CoordinateSystem,
    Datum,
    Editing,
    EllipsoidSpec,
    Initial,
    Options,
    Order,
    PlateSigma,
    Program,
    Refraction,
    Treatment,
    WaterLevel,
    Weights,
)
from musatpy.model.orientation import OrientationMethod, OrientationSpec, PlaneTreatment
from musatpy.model.photos import Photos
from musatpy.model.points import Points
from musatpy.model.reduction import (
    Atmosphere,
    ComparatorSpec,
    CrossMeasurements,
    Curvature,
    DistortionSide,
    Lenses,
    MarkDistances,
    Plates,
    Polynomials,
    ReductionOptions,
    Refused,
    ReseauCrosses,
    Transformation,
)
from musatpy.model.reliability import ConsideredWater, Dependence, Observations
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
from musatpy.model.verdict import Concern, Grade, Reason, Verdict
from musatpy.model.water import INDEX_RANGE, Water, WaterConditions
from musatpy.model.waves import WaveOrigin, Waves, WaveShape

__all__ = [
    "INDEX_RANGE",
    "Action",
    "AdjustedStations",
    "AdjustedWater",
    "AdjustedWaves",
    "AirBases",
    "Atmosphere",
    "BathymetricPoints",
    "Block",
    "Blunder",
    "Cameras",
    "Cause",
    "CauseKind",
    "ComparatorSpec",
    "Concern",
    "ConsideredWater",
    "Control",
    "ControlKind",
    "CoordinateSystem",
    "CrossMeasurements",
    "Curvature",
    "Datum",
    "Dependence",
    "Distances",
    "Distortion",
    "DistortionSide",
    "Editing",
    "EllipsoidSpec",
    "EqualElevations",
    "FiducialMeasurements",
    "Fiducials",
    "Finding",
    "Grade",
    "GroundPoints",
    "HeightDifferences",
    "Initial",
    "Iteration",
    "Lenses",
    "MarkDistances",
    "ObservationKind",
    "Observations",
    "Options",
    "Order",
    "OrientationMethod",
    "OrientationSpec",
    "Photos",
    "PlaneTreatment",
    "PlateMeasurements",
    "PlateResiduals",
    "PlateSigma",
    "Plates",
    "PointStatus",
    "Points",
    "Polynomials",
    "Program",
    "Reason",
    "ReductionOptions",
    "Refraction",
    "Refused",
    "ReseauCrosses",
    "Solution",
    "SystemSpec",
    "Transformation",
    "Treatment",
    "Verdict",
    "Water",
    "WaterConditions",
    "WaterLevel",
    "WaterPass",
    "WaveOrigin",
    "WaveShape",
    "Waves",
    "Weights",
]
