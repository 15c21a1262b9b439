"""Solution -> numbers: what the reports print, and nothing that they print is computed anywhere else."""

from musatpy.statistics.analyses import LARGE_RESIDUAL, PLATE_KINDS, PlateStatistics, Statistics, Words
from musatpy.statistics.differences import (
    Analysis,
    DifferenceStatistics,
    difference_statistics,
    metric_components,
    position_components,
)
from musatpy.statistics.gates import elevations, metric_differences, rectangular
