"""Model points, which a plotter without stage output leaves: their rays rebuilt from the mark and its y-parallax.

The operator has removed the x-parallax: at the height of the mark both straight rays have its X, and lie to both
sides of it by half the y-parallax. Where that was not read the rays are those to the mark, which a submerged point
has not (ETL-0306, section 5, takes them so). Where the loop of the plotter goes through the water the mark is the
true point, the rays are those to its refracted images, and a y-parallax is what the operator saw beside these.
"""

from __future__ import annotations

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.compilation.loop import Loop
from musatpy.compilation.stereomodels import Stereomodel


def stages_of(loop: Loop, place: FloatArray, parallax: FloatArray) -> FloatArray:
    """Return the stages (k, 2, 2) mm of model points (k, 3) m with y-parallaxes (k,) mm, NaN where not read."""
    stages = loop.stages(place)
    xy, along = stages.xy, stages.by_mark[..., 1]
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    half = 0.5 * np.nan_to_num(parallax)[:, None] * [-1.0, 1.0]
    return np.asarray(xy + half[..., None] * along)


def lost_without_parallax(stereo: Stereomodel, true: FloatArray) -> float:
    """Return by how much (m) points (k, 3) in the water of the model are off at most by rays to a shared point."""
    loop = Loop(stereo=stereo)
    shared = np.repeat(stereo.half_way(loop.stages(true).xy)[:, None], 2, axis=1)
    off = loop.mark(stereo.images(shared)) - true
    return float(np.linalg.norm(off, axis=1).max(initial=0.0))
