"""The ORI card: photos and treatments of the water that its method can have."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.errors import Problem
from musatpy.formats.draft import Draft, single
from musatpy.model import OrientationSpec


def faults(draft: Draft) -> Iterator[Problem]:
    """Yield what the method cannot have of photos, tides and the index of the water."""
    spec = single(draft.rows["orientation"], OrientationSpec())
    if spec is None:
        return
    measured, tides = (np.unique(draft.photo[role]) for role in ("plates", "tides"))
    ids = draft.photo_ids
    index = draft.rows["water"]["water.index"]
    known = float(index[0]) if len(index) and np.isfinite(index[0]) else np.nan
    names = [str(ids[photo]) for photo in measured if photo >= 0]
    control = bool((draft.point["control"] >= 0).any())
    for field, message in spec.faults(names, set(ids[tides[tides >= 0]].tolist()), known, control):
        yield draft.problem("orientation", 0, message, path=f"orientation.{field}")
