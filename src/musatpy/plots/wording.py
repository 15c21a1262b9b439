"""Numbers in sentences and legends."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray

_SMALLEST = 5e-5  # what does not print as zero


def counted(number: int, noun: str, many: str = "") -> str:
    """Return a number with its noun, in the plural where it needs it."""
    return f"{number:,} {noun}" if number == 1 else f"{number:,} {many or f'{noun}s'}"


def measure(value: float, unit: str) -> str:
    """Return a value to three figures and four decimals at most, with its unit."""
    if abs(value) < _SMALLEST:
        return f"0 {unit}".rstrip()
    digits = np.clip(2 - np.floor(np.log10(abs(value))), 0, 4) if np.isfinite(value) else 0
    return f"{value:.{int(digits)}f} {unit}".rstrip()


def rms(values: FloatArray) -> float:
    """Return the root mean square of what is known of values, NaN of nothing."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(np.square(known)))) if len(known) else np.nan
