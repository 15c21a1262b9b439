"""The orders of the IHO standard S-44, and which of them depths and positions meet."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.specs import read_toml

_VERTICAL, _HORIZONTAL = 1.960, 2.448  # sigmas of 95 % in one dimension, and of the longer axis in two
NO_ORDER = "none"


@dataclass(frozen=True, kw_only=True)
class SurveyOrder:
    """Largest uncertainties (m, 95 %) at a depth d: vertical sqrt(a^2 + (b d)^2), horizontal c + e d."""

    name: str
    a: float
    b: float
    c: float
    e: float

    def vertical(self, depth: FloatArray) -> FloatArray:
        """Return the total vertical uncertainty (...) allowed at depths (...), m."""
        return np.hypot(self.a, self.b * np.maximum(depth, 0.0))

    def horizontal(self, depth: FloatArray) -> FloatArray:
        """Return the total horizontal uncertainty (...) allowed at depths (...), m."""
        return np.asarray(self.c + self.e * np.maximum(depth, 0.0))


@lru_cache(maxsize=1)
def survey_orders() -> tuple[SurveyOrder, ...]:
    """Return the orders, the strictest first."""
    table = read_toml(Path(__file__).with_name("s44.toml"))
    return tuple(SurveyOrder(**order) for order in table["order"])


def source() -> str:
    """Return the edition that the orders are of."""
    return str(read_toml(Path(__file__).with_name("s44.toml"))["source"])


def orders_met(depth: FloatArray, covariance: FloatArray) -> IntArray:
    """Return the number (k,) of the strictest order that points meet by their sigmas; that after the last is none.

    depth (k,) m, covariance (k, 3, 3) m2 of east, north, up. The vertical uncertainty is 1.96 sigma of the height,
    the horizontal one 2.45 times the longer half axis of the error ellipse.
    """
    up = _VERTICAL * np.sqrt(covariance[:, 2, 2])
    plan = _HORIZONTAL * np.sqrt(np.linalg.eigvalsh(np.nan_to_num(covariance[:, :2, :2]))[:, -1])
    met = [(up <= order.vertical(depth)) & (plan <= order.horizontal(depth)) for order in survey_orders()]
    return np.asarray(np.argmax([*met, np.ones(len(depth), dtype=bool)], axis=0))


def orders_by_sigmas(depth: FloatArray, plan: FloatArray, up: FloatArray) -> FloatArray:
    """Return the same of points (k,), counted from 1, NaN where nothing is known or there is no depth.

    `plan` (k,) m, the sigma of both directions together, stands for the longer half axis.
    """
    out, known = np.full(len(depth), np.nan), (depth > 0.0) & np.isfinite(plan) & np.isfinite(up)
    square = np.square(np.column_stack([plan, plan, up])[known])
    out[known] = 1 + orders_met(depth[known], square[:, :, None] * np.eye(3))
    return out


def order_names() -> list[str]:
    """Return the names of the orders, the strictest first, and that of points that meet none."""
    return [*(order.name for order in survey_orders()), NO_ORDER]
