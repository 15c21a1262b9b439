"""The profiles of a compilation: readings along lines between points of a model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from musatpy.arrays import FloatArray, IntArray
from musatpy.compilation.compiled import Compiled
from musatpy.geometry.plan import Plan
from musatpy.model.compilation import IN_PROFILE
from musatpy.surfaces.profiles import Profile, profile


@dataclass(frozen=True, kw_only=True, eq=False)
class CompiledProfile:
    """A profile of a model, its values depths below the sounding datum; None with the `reason` why there is none.

    rows (k,) are its readings among all points of the compilation, position (k, 3) and sigma (k,) of the depth
    theirs.
    """

    name: str
    model: str
    step: float
    rows: IntArray
    profile: Profile | None
    position: FloatArray
    sigma: FloatArray
    reason: str = ""


def profiles_of(compiled: Compiled) -> list[CompiledProfile]:
    """Return the profiles of a deck."""
    specs, models = compiled.deck.profiles, compiled.deck.models.ids
    return [_profile_of(compiled, row, str(models[specs.model[row]])) for row in range(len(specs.ids))]


def _profile_of(compiled: Compiled, row: int, model: str) -> CompiledProfile:
    specs, stages = compiled.deck.profiles, compiled.deck.stages
    ids, kind = stages.ids[compiled.rows], stages.kind[compiled.rows]
    here = compiled.model_ids == model
    position, (depth, sigma) = compiled.gathered("position"), compiled.datum_depth
    known = np.isfinite(position).all(axis=1)
    rows = np.flatnonzero(here & known & (kind == IN_PROFILE) & (ids == specs.ids[row]))
    ends = [
        np.flatnonzero(here & known & (ids == end) & (kind != IN_PROFILE))
        for end in (specs.start[row], specs.end[row])
    ]

    def done(result: Profile | None, reason: str = "") -> CompiledProfile:
        order = rows if result is None else rows[result.rows]
        return CompiledProfile(
            name=str(specs.ids[row]), model=model, step=float(specs.step[row]), rows=order, profile=result,
            position=position[order], sigma=sigma[order], reason=reason,
        )  # fmt: skip

    for end, name in zip(ends, (specs.start[row], specs.end[row]), strict=True):
        if not len(end):
            return done(None, f"its end {name} has no position in the model")
    if len(rows) < 2:
        return done(None, f"it has {len(rows)} readings with a position, and needs two")
    system, used = compiled.run.map_system, np.concatenate([*ends, rows])
    xy = (position[used] if system is None else Plan.about(system, position[used]).places(position[used]))[:, :2]
    if not np.linalg.norm(xy[1] - xy[0]) > 0.0:
        return done(None, "its ends are in one place")
    spike = float(specs.spike[row])
    return done(
        profile(
            xy[2:], depth[rows], xy[0], xy[1], spike=spike if np.isfinite(spike) else np.inf,
            tolerance=float(specs.tolerance[row]),
        )
    )  # fmt: skip
