"""Plate reductions whose data and answers are public, each with its source; nothing comes from this program."""

import numpy as np


def rows(text: str) -> np.ndarray:
    """Return the rows of x and y that a text has."""
    return np.array(text.split(), dtype=float).reshape(-1, 2)


def numbers(text: str) -> list[float]:
    return [float(number) for number in text.split()]


# P. J. Hartzell, Photogrammetry (CIVE6397) labs 1 and 3, github.com/pjhartzell/photo-lab1
# (data/dec_1_027-known.txt, data/dec_1_027-observed.txt, data/dec_1_028-observed.txt, report/report.md, commit
# 0a64b049) and photo-lab3: a mapping camera with 8 marks, two scanned photos read in pixels, y upward.
MARK_IDS = np.array(["1", "2", "3", "4", "5", "6", "7", "8"])
MARKS = rows(
    "-105.997 -105.995  106.004 106.008  -106.000 106.009  106.012 -105.995  -112.000 0.007  112.006 0.007 "
    "0.005 112.007  0.002 -111.998"
)
READ_027 = rows(
    "1346 -19286  19162 -1471  1347 -1472  19164 -19284  842 -10380  19667 -10377  10254 -967  10255 -19789"
)
READ_028 = rows(
    "1347 -19286  19175 -1484  1359 -1472  19163 -19297  850 -10379  19673 -10390  10268 -973  10254 -19796"
)
READ = {"027": READ_027, "028": READ_028}

# report.md: parameters to 10 decimals (shifts of similarity and affine to 4), residuals (transformed minus
# calibrated) to 4, rms of the residuals in x and y.
PARAMETERS = {
    ("027", "SIMILARITY"): [0.0119003453, -0.0000008202, -122.0211, 123.5194],
    ("027", "AFFINE"): [0.0118994263, 0.0000002998, -0.0000013405, 0.0119012647, -122.0170, 123.5343],
    ("027", "PROJECTIVE"): numbers(
        "0.0118997330 0.0000002998 -122.0214372821 -0.0000013405 "
        "0.0119015714 123.5344190674 -0.0000000017 -0.0000000042"
    ),
    ("028", "SIMILARITY"): [0.0119005606, 0.0000079300, -122.1915, 123.5077],
    ("028", "AFFINE"): [0.0119000883, -0.0000084564, 0.0000074035, 0.0119010331, -122.1921, 123.5180],
    ("028", "PROJECTIVE"): numbers(
        "0.0118998130 -0.0000084563 -122.1903423329 0.0000074033 "
        "0.0119007578 123.5157829666 -0.0000000014 0.0000000008"
    ),
}
RESIDUALS = {
    ("027", "SIMILARITY"): rows(
        "-0.0220 0.0033  0.0081 -0.0097  0.0075 -0.0080  0.0093 0.0124  -0.0095 -0.0139  0.0085 0.0064 "
        "-0.0007 -0.0036  -0.0013 0.0131"
    ),
    ("027", "AFFINE"): rows(
        "-0.0092 -0.0003  -0.0047 -0.0062  0.0110 0.0048  0.0058 -0.0004  -0.0008 -0.0090  -0.0001 0.0015 "
        "-0.0056 0.0050  0.0036 0.0044"
    ),
    ("027", "PROJECTIVE"): rows(
        "-0.0049 0.0022  -0.0004 -0.0037  0.0075 0.0041  0.0022 -0.0011  -0.0003 -0.0120  0.0004 -0.0016 "
        "-0.0069 0.0064  0.0024 0.0057"
    ),
    ("028", "SIMILARITY"): rows(
        "-0.0115 -0.0008  0.0095 -0.0086  -0.0070 -0.0081  -0.0000 0.0096  0.0063 -0.0084  0.0046 0.0099 "
        "0.0062 0.0029  -0.0082 0.0036"
    ),
    ("028", "AFFINE"): rows(
        "-0.0026 -0.0003  0.0006 -0.0091  -0.0074 0.0008  0.0005 0.0007  0.0107 -0.0035  0.0002 0.0050 "
        "0.0012 0.0074  -0.0032 -0.0009"
    ),
    ("028", "PROJECTIVE"): rows(
        "-0.0031 0.0009  0.0002 -0.0079  -0.0064 -0.0007  0.0015 -0.0008  0.0112 -0.0029  0.0006 0.0056 "
        "0.0002 0.0071  -0.0043 -0.0011"
    ),
}
# scale x, scale y, non-orthogonality (degrees) of the affine transformations
AFFINITY = {"027": [0.01189943, 0.01190126, -0.0050], "028": [0.01190009, 0.01190104, -0.0051]}

# Lab 3 (data/image_27_obs.txt, image_27_fid.txt, prep_coords/image_27_corrected.txt, data/image_28_fid.txt,
# image_28_corrected.txt; constants in prep_coords/correct_coords.py, commit e749a832): the same camera and photos.
# Coordinates after the affine transformation, and after principal point, radial and decentring distortion at the
# measured radius, and refraction by the ARDC formula; the corrected ones count from the principal point.
FOCAL_LENGTH = 153.358
PRINCIPAL_POINT = np.array([-0.006, 0.006])
K = np.array([0.8878e-4, -0.1528e-7, 0.5256e-12, 0.0])
P = np.array([0.1346e-6, 0.1224e-7, 0.0])
CAMERA_HEIGHT, GROUND_HEIGHT = 1860.0, 1100.0
POINT_IDS = np.array(["100", "101", "102", "103", "104", "105"])
POINTS_027 = np.array(
    [[9460, -2292], [17400, -1661], [10059, -10883], [19158, -10412], [11844, -17253], [17842, -18028]], dtype=float
)
FIDUCIAL_027 = rows(
    "-9.44911 96.24392  85.03252 103.74297  -2.32393 -6.00065  105.94909 -0.40735  18.91463 -81.81410 "
    "90.28716 -91.04562"
)
CORRECTED_027 = rows(
    "-9.44429 96.23698  85.03348 103.73356  -2.31770 -6.00605  105.95042 -0.41348  18.91919 -81.81806 "
    "90.28894 -91.04979"
)
FIDUCIAL_028 = rows(
    "-105.38348 98.76240  -10.13100 109.69921  -95.02818 -4.84160  10.32895 4.01881  -72.54326 -79.78035 "
    "-1.41131 -86.93623"
)
CORRECTED_028 = rows(
    "-105.38075 98.75658  -10.12664 109.69317  -95.02486 -4.84779  10.33388 4.01240  -72.54037 -79.78819 "
    "-1.40630 -86.94086"
)
# Distances between the marks 1-2, 3-4, 5-6, 7-8 by their calibrated coordinates.
DISTANCES = np.linalg.norm(MARKS[1::2] - MARKS[::2], axis=1)

# Noobeed software, example "Interior Orientation Report", noobeed.com/nb_ex_ph_or_io_95.htm: affine, 4 marks,
# readings in pixels of a 4096 by 4096 scan.
NOOBEED_MARKS = np.array([[-110.022, -0.255], [0.256, -110.021], [-0.254, 110.024], [110.015, 0.258]])
NOOBEED_READ = np.array([[227.5, 2038.5], [2062.5, 205.5], [2061.5, 3873.5], [3895.5, 2041.5]])
NOOBEED_SIGMAS = (0.3, 0.003)  # px of the readings, mm of the marks
NOOBEED_LINEAR = [0.059988375432533, -0.000122683929039, 0.000090795180294, 0.059990480540713]
NOOBEED_SHIFT = [-123.432, -122.551]
# variance-covariance of a, b, c, d, Cx, Cy: the rows of a and c to 15 decimals
NOOBEED_COVARIANCE_A = numbers(
    "0.000000000115148 -0.000000000000063 -0.000000000000060 0.0 -0.000000237278428 0.000000000122739"
)
NOOBEED_COVARIANCE_C = numbers(
    "-0.000000000000060 0.0 0.000000000115156 -0.000000000000063 0.000000000122739 -0.000000237294194"
)

# U.S. Geological Survey, Reports of Calibration of Aerial Mapping Cameras OSL/2985 (2003), OSL/3030 (2004),
# OSL/3221 (2006), Wild RC30 with Universal Aviogon /4-S: focal length (mm), K0 K1 K2, P1 P2, and the symmetric
# radial and the decentring distortion in whole micrometres at these field angles. In these reports the polynomial
# is the correction: the tabulated distortion has the opposite sign.
FIELD_ANGLES = np.array([7.5, 15.0, 22.7, 30.0, 35.0, 40.0])
USGS = {
    "OSL/2985": (
        153.743,
        [0.2616e-4, -0.2295e-8, 0.1454e-13],
        [-0.3015e-7, 0.1668e-7],
        [-1, -1, -1, -1, 0, 1],
        [0, 0, 0, 0, 0, 1],
    ),
    "OSL/3030": (
        153.247,
        [0.3285e-4, -0.5215e-8, 0.1642e-12],
        [-0.1218e-7, -0.4426e-7],
        [-1, -1, -1, 0, 1, 1],
        [0, 0, 0, 0, 1, 1],
    ),
    "OSL/3221": (
        153.527,
        [0.6404e-4, -0.3587e-8, -0.9784e-13],
        [-0.5780e-7, 0.1873e-7],
        [-1, -2, -3, -3, -1, 3],
        [0, 0, 0, 0, 1, 1],
    ),
}
