"""The index page of a batch (`musat batch --html`): a row for each job, with links, what needs a look first."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

from musatpy.campaign.batch_jobs import Job, Outcome, State

_NAMES = {".html": "page", ".lst": "listing", ".json": "record"}
_NEEDS_A_LOOK = (
    State.CRASHED, State.FAILED, State.UNUSABLE, State.NOT_CONVERGED, State.REJECTED, State.DOUBTFUL, State.NOT_RUN,
    State.ACCEPTED,
)  # fmt: skip


def index_page(title: str, folder: Path, jobs: Sequence[Job], outcomes: Sequence[Outcome]) -> bytes:
    """Return the index of jobs as an HTML page in a folder. Raises `MusatError` where jinja2 is missing."""
    from musatpy.page.cells import count_of, number_text
    from musatpy.page.rendering import render

    counts = Counter(outcome.state for outcome in outcomes)
    states = ", ".join(f"{counts[state]:,} {state}" for state in _NEEDS_A_LOOK if counts[state])
    rows = sorted(zip(jobs, outcomes, strict=True), key=_order)
    return render(
        "index.jinja",
        heading=title,
        summary=f"{count_of(len(jobs), 'job')}: {states}",
        jobs=[(job.deck, outcome, _links(folder, job, outcome)) for job, outcome in rows],
        number=number_text,
    ).encode()


def _order(row: tuple[Job, Outcome]) -> tuple[int, float, str]:
    """Return what comes first: the worst state, the sigma0 that is farthest from 1, the name."""
    job, outcome = row
    sigma0 = outcome.sigma0 if outcome.sigma0 and math.isfinite(outcome.sigma0) else 1.0
    return _NEEDS_A_LOOK.index(outcome.state), -abs(math.log(sigma0)), str(job.deck)


def _links(folder: Path, job: Job, outcome: Outcome) -> tuple[tuple[str, str], ...]:
    """Return what a job left to be looked at, and where, seen from a folder."""
    files = {Path(name).suffix: name for name in outcome.outputs if Path(name).stem == job.deck.stem}
    return tuple(
        (what, quote(Path(os.path.relpath(job.folder / files[suffix], folder)).as_posix()))
        for suffix, what in _NAMES.items()
        if suffix in files
    )
