"""The experiment as Okamoto (1982) ran it: Tables 4 to 8, Photogrammetric Engineering and Remote Sensing.

The paper states flying heights, bases, overlap, direction of the waves, index, number of check points, wave lengths
and phases. It does not state the camera stations, nor how check points and origin lie exactly. What stands here
under INFERRED was found by fitting the printed tables; what was deduced from them leaves no doubt. Heights are up
here, Z of the paper points down: the mirror image, with the same errors.
"""

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.refraction.waves import Harmonic, sinusoidal
from musatpy.sea.experiment import Experiment
from musatpy.units import DEGREE

INDEX = 1.333
AZIMUTH = 30.0 * DEGREE
LONG, LONGER, SHORT = 10, 15, 4  # periods, s
DEPTHS = (5, 10, 20)
FLYING_HEIGHTS = (500, 1500)  # H + h, m
SPACING = {500: 33.0, 1500: 100.0}  # deduced: an eighth of the bases of 264 and 800 m
INTERVAL = {500: 3.0, 1500: 9.0}  # s between exposures: the base at 90 m/s, in whole seconds as the phases have it
ROWS, COLUMNS = 11, 21
# Table -> periods of the waves
WAVES = {4: (LONG,), 5: (LONGER,), 6: (SHORT,), 7: (LONG, SHORT), 8: (LONGER, SHORT)}

# Tables 1 to 3: wave length (m) by period and depth, as printed
LENGTH = {
    LONG: {5: 68.0, 10: 92.0, 20: 121.0},
    LONGER: {5: 103.0, 10: 144.0, 20: 197.0},
    SHORT: {5: 22.0, 10: 25.0, 20: 25.0},
}
# Speed (m/s) that the phases printed in Tables 4 to 8 moved at: that of Tables 1 to 3 in whole m/s, 5 for 5.6
SPEED = {
    LONG: {5: 7.0, 10: 9.0, 20: 12.0},
    LONGER: {5: 7.0, 10: 10.0, 20: 13.0},
    SHORT: {5: 5.0, 10: 6.0, 20: 6.0},
}
# Phases 1Xw (m) of Tables 4 to 8 by period and depth, as printed: where the wave crosses its mean
PHASE = {
    LONG: {5: 17.0, 10: 23.0, 20: 30.0},
    LONGER: {5: 26.0, 10: 36.0, 20: 49.0},
    SHORT: {5: 5.0, 10: 6.0, 20: 6.0},
}
# INFERRED: camera stations (m), height above the origin of the paper
STATIONS = {
    500: np.array([[30.0, -30.0, 25.0], [310.0, 15.0, -10.0]]),
    1500: np.array([[130.0, -40.0, -30.0], [880.0, 15.0, 45.0]]),
}
# INFERRED where they are not half the printed height: 0.55, 0.47, 1.30 and the second 0.15
AMPLITUDE = {
    LONG: {5: 0.55, 10: 0.49, 20: 0.47},
    LONGER: {5: 1.30, 10: 1.14, 20: 1.00},
    SHORT: {5: 0.14, 10: 0.15, 20: 0.15},
}


def second_phase(period: int, depth: int, flying_height: int, simultaneous: bool) -> float:
    """Return 2Xw (m), as printed."""
    moved = 0.0 if simultaneous else SPEED[period][depth] * INTERVAL[flying_height]
    return PHASE[period][depth] + moved


def check_points(flying_height: int) -> FloatArray:
    """Return the check points (231, 3) m, on the bottom, in the order of their numbers, deduced from the tables."""
    row, column = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    spacing = SPACING[flying_height]
    return np.stack(
        [row * spacing, (column - COLUMNS // 2) * spacing, np.full(row.shape, -float(flying_height))], axis=1
    )


def sea(periods: tuple[int, ...], depth: int, flying_height: int, simultaneous: bool) -> Harmonic:
    """Return the waves of one case, about their mean level, time 0 and `INTERVAL` being those of the exposures."""
    length = np.array([LENGTH[period][depth] for period in periods])
    first = np.array([PHASE[period][depth] for period in periods])
    speed = np.array([0.0 if simultaneous else SPEED[period][depth] for period in periods])
    return sinusoidal(
        amplitude=[AMPLITUDE[period][depth] for period in periods],
        length=length,
        azimuth=AZIMUTH,
        speed=speed,
        # eq. 1, Z down: Z = A sin(-k (X - Xw)) is a height of A sin(k (X - Xw)), its crest a quarter beyond Xw
        crest=first + length / 4.0,
        level=depth - float(flying_height),
    )


def experiment(table: int, flying_height: int, depth: int, simultaneous: bool) -> Experiment:
    """Return one case of Tables 4 to 8: flying height 500 or 1500 m above the bottom, depth 5, 10 or 20 m."""
    surface = sea(WAVES[table], depth, flying_height, simultaneous)
    return Experiment(
        cameras=STATIONS[flying_height],
        times=np.array([0.0, INTERVAL[flying_height]]),
        points=check_points(flying_height),
        index=INDEX,
        surface=surface,
        level=surface.level,
    )
