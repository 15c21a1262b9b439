"""The index page of a batch (`musat batch --html`)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

from musatpy.campaign.batch_jobs import Job, Outcome

_NAMES = {".html": "page", ".lst": "listing", ".json": "record"}


def index_page(title: str, folder: Path, jobs: Sequence[Job], outcomes: Sequence[Outcome]) -> bytes:
    """Return the index of jobs as an HTML page in a folder. Raises `MusatError` where jinja2 is missing."""
    from musatpy.page.index_page import JobRow, index_html

    rows = [
        JobRow(
            name=str(job.deck),
            state=str(outcome.state),
            photos=outcome.photos,
            points=outcome.points,
            sigma0=outcome.sigma0,
            check_points=outcome.check_points,
            check_rms=outcome.check_rms,
            message=" ".join(outcome.message.split()),
            links=_links(folder, job, outcome),
        )
        for job, outcome in zip(jobs, outcomes, strict=True)
    ]
    return index_html(title, rows).encode()


def _links(folder: Path, job: Job, outcome: Outcome) -> tuple[tuple[str, str], ...]:
    """Return what a job left to be looked at, and where, seen from a folder."""
    files = {Path(name).suffix: name for name in outcome.outputs if Path(name).stem == job.deck.stem}
    return tuple(
        (what, quote(Path(os.path.relpath(job.folder / files[suffix], folder)).as_posix()))
        for suffix, what in _NAMES.items()
        if suffix in files
    )
