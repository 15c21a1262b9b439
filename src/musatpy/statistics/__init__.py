"""Solution -> numbers: what the reports print, and nothing that they print is computed anywhere else."""

from musatpy.statistics.analyses import (
    LARGE_RESIDUAL,
    PLATE_KINDS,
    Analysis,
    DifferenceStatistics,
    Statistics,
    Words,
    difference_statistics,
)
from musatpy.statistics.gates import metric_differences
