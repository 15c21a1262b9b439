"""WATPNT as printed in 1983 (ETL-0306, section 4.2.2): binary interpolation of the refraction angle, ray by ray."""

import math


def incidence_distance(
    height: float, depth: float, distance: float, index: float, tolerance: float = 1e-6
) -> float:
    """Return Q, the horizontal distance from the camera to the water point, to `tolerance` metres.

    The maximum of the refraction angle is asin(1/n), its minimum 0.
    """
    low, high = 0.0, math.asin(1.0 / index)
    while True:
        theta = 0.5 * (low + high)
        incidence = math.asin(min(1.0, index * math.sin(theta)))
        q = height * math.tan(incidence)
        excess = q + depth * math.tan(theta) - distance
        if abs(excess) < tolerance:
            return q
        if excess > 0.0:
            high = theta
        else:
            low = theta
