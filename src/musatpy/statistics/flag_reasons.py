"""Reasons of the verdict that are about flags of submerged points, and about the datum of the water."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from musatpy.arrays import IntArray
from musatpy.model import Concern, Grade, PointStatus, Reason
from musatpy.statistics.flags import refracts, squares_choose
from musatpy.statistics.gates import named

if TYPE_CHECKING:
    from musatpy.statistics.analyses import Statistics

FLAGS = "Flags Against Heights"
_NAMED = 5  # points with their heights


def flags(statistics: Statistics) -> Iterator[Reason]:
    """Yield that points contradict their flags, and that so many do that water and control may be of two datums."""
    if not statistics.solution.converged:
        return
    tests = statistics.flags
    below, above = tests.doubted_of(False), tests.doubted_of(True)
    if datum := _datum(statistics):
        yield Reason(grade=Grade.REJECTED, concern=Concern.DATUM, text=datum, section=FLAGS)
    for rows, without, side, flag in (
        (below, "not flagged as submerged (B)", "below the water of all", "with"),
        (above, "flagged as submerged (B)", "above the water of all", "without"),
    ):
        if len(rows):
            text = (
                f"{_who(statistics, rows)} {without}, and up to {tests.wrong_side[rows].max():.2f} m "
                f"({tests.sigmas[rows].max():.1f} sigmas) {side} photos: {_heights(statistics, rows, flag)}"
            )
            yield Reason(grade=Grade.DOUBTFUL, concern=Concern.FLAGS, text=text, section=FLAGS)
    if (len(below) or len(above)) and not datum:
        yield from _offset(statistics)


def straight(statistics: Statistics) -> Iterator[Reason]:
    """Yield that submerged points were adjusted as if there were no water."""
    block = statistics.block
    wet = block.points.bathymetric & (statistics.solution.points.status != PointStatus.NOT_DETERMINED)
    if wet.any() and not refracts(block):
        text = (
            f"refraction NONE: {_many(int(wet.sum()), 'point')} flagged as submerged adjusted as if there were no "
            "water; about a quarter of their depth is missing"
        )
        yield Reason(grade=Grade.DOUBTFUL, concern=Concern.REFRACTION, text=text, section="Options")


def flag_notes(statistics: Statistics) -> Iterator[str]:
    """Yield the points near the water whose flags their heights neither confirm nor contradict."""
    tests = statistics.flags
    rows = np.flatnonzero(tests.near & ~tests.flagged)
    if len(rows):
        text = (
            f"{_who(statistics, rows)} not flagged as submerged, and below the water of some photos, or of all by"
        )
        yield f"{text} less than {tests.limit:.1f} sigmas"
    rows = np.flatnonzero(tests.near & tests.flagged)
    if len(rows):
        text = f"{_who(statistics, rows)} flagged as submerged, and above the water of all photos"
        yield f"{text} by less than {tests.limit:.1f} sigmas"


def _datum(statistics: Statistics) -> str:
    """Return the reason to reject heights of two datums; empty where they are not, or other flags end it."""
    tests = statistics.flags
    if not tests.is_of_the_whole(statistics.solution.other_flags):
        return ""
    counts = [
        f"{len(rows)} of {_many(int((tests.flagged == flagged).sum()), 'point')} {what} the water"
        for flagged, what in ((True, "flagged as submerged are above"), (False, "without the flag are below"))
        if len(rows := tests.doubted_of(flagged))
    ]
    return f"{', '.join(counts)}: {_apart(statistics) or 'no one offset between tides and control explains it'}"


def _offset(statistics: Statistics) -> Iterator[Reason]:
    """Yield the offset between tides and control that would end what a few points contradict."""
    apart = _apart(statistics)
    if apart:
        text = f"if the flags are right, {apart}"
        yield Reason(grade=Grade.DOUBTFUL, concern=Concern.DATUM, text=text, section=FLAGS)


def _apart(statistics: Statistics) -> str:
    """Return the offset in words; empty where there is none, or nothing bounds it."""
    least, most = statistics.flags.offset
    if not (np.isfinite(least) and np.isfinite(most)) or least > most:
        return ""
    sizes = sorted((abs(least), abs(most)))
    side = "low" if least > 0.0 else "high"
    return (
        f"tides and control may be {sizes[0]:.1f} to {sizes[1]:.1f} m apart in height, the tides too {side}: read "
        "the datum of both again"
    )


def _heights(statistics: Statistics, rows: IntArray, flag: str) -> str:
    """Return both heights of points in words, and the squares of both adjustments where these differ."""
    tests, ids, texts = statistics.flags, statistics.block.points.ids, []
    for row in rows[:_NAMED].tolist():
        other = tests.other_height[row]
        name = f"{ids[tests.point[row]]} at " if len(rows) > 1 else "at "
        texts.append(
            f"{name}{tests.height[row]:.3f} m" + (f", {other:.3f} m {flag} it" if np.isfinite(other) else "")
        )
    text, solution = "; ".join(texts), statistics.solution
    if solution.other_flags is not None and squares_choose(solution):
        squares = solution.sum_of_squares, solution.other_flags.sum_of_squares
        text += f"; v'Pv {squares[0]:.1f}, with the other flags {squares[1]:.1f}"
    return text


def _who(statistics: Statistics, rows: IntArray) -> str:
    ids = statistics.block.points.ids[statistics.flags.point[rows]]
    return f"{named('point', ids)} {'is' if len(ids) == 1 else 'are'}"


def _many(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"
