"""An error that the tides of several photos have in common: all of them, those of a group, those of a day.

Baarda's test of the alternative that all these observations are off by the same amount: with c their common shift,
w = c'Pv / (sigma0 sqrt(c'P Qvv P c)), where c'P Qvv P c = c'Pc - (A'Pc)' N^-1 (A'Pc) takes one solution of the
normal equations.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from musatpy.adjustment.kinds.water import level_corrections
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import Factor
from musatpy.adjustment.unknowns import LEVEL, State
from musatpy.adjustment.water_surface import tide_groups
from musatpy.arrays import BoolArray, IntArray
from musatpy.model import Block

_CHECKED = 1e-6  # of c'Pc; less says nothing of the shift


@dataclass(frozen=True, kw_only=True, eq=False)
class CommonTide:
    """A common error of the tides of some photos."""

    name: str  # empty: all photos
    photo: IntArray  # (k,)
    test: float
    size: float  # m, given minus true


def common_tides(
    block: Block, network: Network, state: State, factor: Factor, taken: BoolArray, sigma0: float
) -> Iterator[CommonTide]:
    """Yield the tests of all groups of photos with known tides; photos that are `taken` (n,) belong to none."""
    q = network.pattern.size
    correction = level_corrections(network, state)
    for name, photo in tide_groups(block, (network.water.level_weight > 0.0) & ~taken):
        weight = network.water.level_weight[photo]
        column = np.zeros(q * network.photos + network.border.size)
        column[photo * q + LEVEL] = weight
        total = float(weight.sum())
        checked = total - float(column @ factor.solve(column))
        if checked > _CHECKED * total:
            pull = float(weight @ correction[photo])
            yield CommonTide(
                name=name, photo=photo, test=abs(pull) / np.sqrt(checked) / sigma0, size=-pull / checked
            )
