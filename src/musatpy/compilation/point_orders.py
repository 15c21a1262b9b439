"""The orders of S-44 that compiled points meet by their own sigmas."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import TextArray
from musatpy.soundings.s44 import NO_ORDER, orders_met, survey_orders

if TYPE_CHECKING:  # it loads the adjustment, which those who read listings need not
    from musatpy.compilation.compiled import Compiled


def order_names() -> list[str]:
    """Return the names of the orders, the strictest first, and that of points that meet none."""
    return [*(order.name for order in survey_orders()), NO_ORDER]


def orders_of_points(compiled: Compiled) -> TextArray:
    """Return the strictest order (k,) that each submerged point meets, empty where there is no depth.

    The datum counts with its sigma.
    """
    depth, covariance = compiled.datum_depth[0], compiled.gathered("covariance").copy()
    covariance[:, 2, 2] += compiled.datum.sigma**2
    rows = compiled.submerged & np.isfinite(depth)
    names = np.array(order_names(), dtype=np.str_)
    orders = np.full(len(depth), "", dtype=names.dtype)
    orders[rows] = names[orders_met(depth[rows], covariance[rows])]
    return orders
