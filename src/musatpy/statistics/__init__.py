"""Solution -> numbers: what the reports print, and nothing that they print is computed anywhere else."""

from musatpy.statistics.analyses import LARGE_RESIDUAL, PLATE_KINDS, PlateStatistics, Statistics, Words
from musatpy.statistics.differences import (
    Analysis,
    DifferenceStatistics,
    difference_statistics,
    elevations,
    metric_components,
    metric_differences,
    position_components,
    rectangular,
)
