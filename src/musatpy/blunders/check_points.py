"""Check points that do not agree: they take no part in the adjustment, and the search cannot weigh them.

Where nothing else is wrong, their card and their images explain it alike; what the deck gives of them is compared
with where the images put it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from musatpy.blunders.causes import ADVICE, control_card
from musatpy.model import Cause, CauseKind, Solution
from musatpy.statistics import Statistics
from musatpy.statistics.verdict import CHECK_POINT_RISK

_MOST = 3  # check points, the worst first


def check_point_causes(solution: Solution) -> Iterator[Cause]:
    """Yield card and images of each check point beyond its own test, as equal causes."""
    if solution.observed is None:
        return
    statistics, block = Statistics(solution), solution.block
    check = statistics.check_test
    beyond = np.flatnonzero(check.probability < CHECK_POINT_RISK)
    worst = beyond[np.argsort(-check.squares[beyond], kind="stable")][:_MOST]
    for number, place in enumerate(worst.tolist(), 1):
        row, squares = int(check.row[place]), float(check.squares[place])
        point, components = int(block.control.point[row]), int(check.components[place])
        images = block.plates.photo[block.plates.point == point]
        size = -statistics.control.difference[row]  # given minus what the images say
        sigma = np.hypot(statistics.point_sigmas[point], np.nan_to_num(block.control.sigma[row]))
        known = np.isfinite(size)
        card = Cause(
            kind=CauseKind.CONTROL,
            cards=(control_card(block),),
            points=(str(block.points.ids[point]),),
            component="check point",
            size=tuple(size[known].tolist()),
            sigma=tuple(sigma[known].tolist()),
            unit="m",
            parameters=components,
            drop=squares * statistics.check_sigma0**2,
            test=float(np.sqrt(squares / components)),
            group=number,
            advice=ADVICE[CauseKind.CONTROL],
        )
        yield card
        yield replace(
            card,
            kind=CauseKind.IMAGES,
            cards=("PLT",),
            photos=tuple(dict.fromkeys(block.photos.ids[images].tolist())),
            component="",
            size=(),
            sigma=(),
            unit="",
            advice=ADVICE[CauseKind.IMAGES],
        )
