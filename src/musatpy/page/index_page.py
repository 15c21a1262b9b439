"""The index page of a campaign: a row for each job, those that need a look first, with links to what they left."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from musatpy.page.cells import count_of, number_text
from musatpy.page.rendering import render

_NEEDS_A_LOOK = (
    "crashed", "failed", "unusable", "not converged", "rejected", "doubtful", "not run", "accepted",
)  # fmt: skip
_MARKS = {"accepted": "✓", "doubtful": "?", "not run": "…"}
_REFUSED = "✕"


@dataclass(frozen=True, kw_only=True)
class JobRow:
    """What the index says of a job."""

    name: str
    state: str  # of `musatpy.campaign.batch_jobs.State`
    photos: int | None
    points: int | None
    sigma0: float | None
    check_points: int | None
    check_rms: tuple[float | None, ...] | None  # m, by component
    message: str  # why it needs a look
    links: tuple[tuple[str, str], ...]  # what a file is, and where, seen from the page

    @property
    def css(self) -> str:
        """The name of its state in the style."""
        return self.state.replace(" ", "-")

    @property
    def mark(self) -> str:
        """A sign of its state."""
        return _MARKS.get(self.state, _REFUSED)

    @property
    def cells(self) -> tuple[str, ...]:
        """Photos, points, sigma0, check points and their RMS as texts."""
        sizes = ["" if size is None else f"{size:,}" for size in (self.photos, self.points)]
        rms = [number_text(value, 3) or "-" for value in self.check_rms or ()]
        checks = f"{self.check_points:,}" if self.check_points else ""
        return (*sizes, number_text(self.sigma0, 4), checks, ", ".join(rms))


def index_html(title: str, jobs: Sequence[JobRow]) -> str:
    """Return the index of a campaign as HTML. Raises `MusatError` where jinja2 is missing."""
    counts = Counter(job.state for job in jobs)
    states = ", ".join(f"{counts[state]:,} {state}" for state in _NEEDS_A_LOOK if counts[state])
    return render(
        "index.jinja",
        heading=title,
        summary=f"{count_of(len(jobs), 'job')}: {states}",
        jobs=sorted(jobs, key=_order),
    )


def _order(job: JobRow) -> tuple[int, float, str]:
    """Return what comes first: the worst state, the sigma0 that is farthest from 1, the name."""
    sigma0 = job.sigma0 if job.sigma0 and math.isfinite(job.sigma0) else 1.0
    return _NEEDS_A_LOOK.index(job.state), -abs(math.log(sigma0)), job.name
