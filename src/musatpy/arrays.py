"""The arrays of the program by what they hold."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
TextArray = NDArray[np.str_]
DateArray = NDArray[np.datetime64]
ComplexArray = NDArray[np.complex128]
ByteArray = NDArray[np.uint8]
