"""The order of the photos of a strip, from the points that they have in common."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from musatpy.arrays import IntArray, TextArray
from musatpy.orientation.twomedia.oriented import OrientationError

FEWEST = 5  # points that three photos on end must have in common, at least
BLOCK = "a block, or branches, is not for STRIP: musat run adjusts it with IIIA, from nothing by OP2 COMPUTE"
_ASTRAY = 0.25  # of the photos that have more in common with the next but one than with the next: no strip


def strip_order(photo: IntArray, point: IntArray, ids: TextArray) -> IntArray:
    """Return the photos (m,) in the order of the strip, from the end that comes first in `ids` (m,).

    photo and point (n,) of the images. Raises `OrientationError` where there are gaps or branches.
    """
    shows = np.zeros((len(ids), int(point.max()) + 1), dtype=np.float32)
    shows[photo, point] = 1.0
    common = shows @ shows.T
    np.fill_diagonal(common, 0.0)
    parts = _parts(common >= FEWEST)
    if parts.max() > 0:
        texts = [", ".join(_shortened(ids[parts == part])) for part in range(parts.max() + 1)]
        raise OrientationError(
            f"STRIP: a gap: no photos of these have {FEWEST} points in common: {' | '.join(texts)}"
        )
    laplacian = np.diag(common.sum(axis=1)) - common
    _, vectors = eigh(laplacian.astype(float), subset_by_index=[1, 1])
    order = np.argsort(vectors[:, 0], kind="stable")
    order = order if order[0] <= order[-1] else order[::-1]
    _require_strip(shows, common, order, ids)
    return np.asarray(order)


def _require_strip(shows: np.ndarray, common: np.ndarray, order: IntArray, ids: TextArray) -> None:
    """Raise `OrientationError` for photos on end that are not those of one strip."""
    next_one, next_but_one = common[order[:-2], order[1:-1]], common[order[:-2], order[2:]]
    if np.mean(next_but_one > next_one) > _ASTRAY:
        raise OrientationError(f"STRIP: {BLOCK}")
    three = (shows[order[:-2]] * shows[order[1:-1]] * shows[order[2:]]).sum(axis=1)
    if len(gaps := np.flatnonzero(three < FEWEST)):
        texts = [f"{', '.join(ids[order[gap : gap + 3]])}: {int(three[gap])}" for gap in gaps[:8]]
        raise OrientationError(
            f"STRIP: three photos on end need {FEWEST} points that all of them show; gaps at {'; '.join(texts)}"
        )


def _parts(linked: np.ndarray) -> IntArray:
    """Return the number of the connected part (m,) of each photo."""
    number = np.arange(len(linked))
    while True:
        lowest = np.where(linked, number[None], len(linked)).min(axis=1)
        lower = np.minimum(number, lowest)
        lower = lower[lower]
        if np.array_equal(lower, number):
            return np.asarray(np.unique(number, return_inverse=True)[1])
        number = lower


def _shortened(ids: TextArray) -> list[str]:
    names = [str(name) for name in ids]
    return names if len(names) <= 6 else [*names[:3], "...", *names[-2:]]
