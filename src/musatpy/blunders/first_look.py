"""What explains the misfit of a run in the linear model at its own answer, where there is no time for a search."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from musatpy.adjustment.job import prepared
from musatpy.adjustment.wavy_water import Sea
from musatpy.blunders.causes import cause_of
from musatpy.blunders.competition import Rival
from musatpy.blunders.explanation import sensible
from musatpy.blunders.hypotheses import hypotheses
from musatpy.blunders.linear_model import linear_model
from musatpy.blunders.scene import Effort, ones, scene_of, search_block
from musatpy.model import Cause, Initial, Solution

_NEARLY = 0.5  # of the squares that the best explains
_MOST = 3


def first_look(solution: Solution, sea: Sea | None) -> tuple[Cause, ...]:
    """Return the hypotheses that explain most, each taken alone, of a linear model at the answer of a run.

    It takes one factorisation. Raises `AdjustmentError` and `SingularNormalsError`.
    """
    block, stations, photos = solution.block, solution.stations, solution.block.photos
    observed = [
        np.asarray(np.isfinite(sigma).any(axis=1))[:, None]
        for sigma in (photos.position_sigma, photos.attitude_sigma)
    ]
    at_answer = replace(
        block,
        options=replace(block.options, initial=Initial.GIVEN),
        photos=replace(
            photos,
            position=np.where(observed[0], photos.position, stations.position),
            attitude=np.where(observed[1], photos.attitude, stations.attitude),
        ),
    )
    job, state = prepared(search_block(at_answer, sea), None, sea)
    scene = scene_of(job, state, Effort(left=math.inf))
    model = linear_model(scene, ones(scene), state)
    options = [option for option in hypotheses(model) if sensible(option) and option.parameters]
    best = max((option.squares for option in options), default=0.0)
    if not best > 0.0:
        return ()
    rest = max(model.squares - best, 0.0) / max(solution.degrees_of_freedom - 1, 1)
    sigma0 = float(np.sqrt(max(rest, 1.0)))
    near = [option for option in options if option.squares >= _NEARLY * best][:_MOST]
    return tuple(
        cause_of(block, sigma0, Rival(hypothesis=option, drop=option.squares, group=1, rank=number))
        for number, option in enumerate(near, 1)
    )
