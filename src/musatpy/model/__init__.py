"""What the problem is: cameras, photos, points, observations, control, water, block, solution."""

from musatpy.model.block import (
    AirBases,
    Block,
    Cameras,
    Control,
    ControlKind,
    Distances,
    Distortion,
    EqualElevations,
    FiducialMeasurements,
    Fiducials,
    HeightDifferences,
    Photos,
    PlateMeasurements,
    Points,
)
from musatpy.model.findings import Cause, Concern, Finding, Grade, Reason, Verdict
from musatpy.model.gnss import AntennaLines, AntennaPositions, ExposureTimes, LeverArms
from musatpy.model.inertial import MISALIGNMENT_ANGLES, InertialAttitudes, InertialConvention, Misalignments
from musatpy.model.kinds import Action, CauseKind, ObservationKind
from musatpy.model.lenses import (
    LENS_PARAMETERS,
    LENS_UNITS,
    PORT_PARAMETERS,
    PORT_SIZES,
    PORT_UNITS,
    LensUnknowns,
    Ports,
)
from musatpy.model.options import (
    CauseSearch,
    CoordinateSystem,
    Datum,
    Editing,
    EllipsoidSpec,
    Initial,
    Options,
    Order,
    OrientationMethod,
    OrientationSpec,
    PlaneTreatment,
    PlateSigma,
    Program,
    RecordContent,
    Refraction,
    SystemSpec,
    Treatment,
    WaterLevel,
    Weights,
)
from musatpy.model.parameters import GRID_PLACES, TIES, AdjustedParameters, DistortionGrid
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
from musatpy.model.solution import (
    AdjustedStations,
    AdjustedWater,
    AdjustedWaves,
    BathymetricPoints,
    ConsideredWater,
    Departure,
    Dependence,
    GroundPoints,
    HeldParameters,
    Iteration,
    LevelPairs,
    Observations,
    OtherFlags,
    PlateResiduals,
    PointStatus,
    Solution,
    StationPairs,
    WaterPass,
    WaterPrecision,
)
from musatpy.model.water import INDEX_RANGE, Water, WaterConditions, WaveOrigin, Waves, WaveShape
