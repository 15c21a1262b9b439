"""What a batch came to: JSON for machines (`summary.schema.json`), a table and an index page for people."""

from __future__ import annotations

import json
import math
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from textwrap import wrap
from typing import Any
from urllib.parse import quote

import musatpy
from musatpy.campaign.batch_jobs import BatchJob, JobOutcome, JobState
from musatpy.errors import count_of
from musatpy.runs import ExitStatus

SCHEMA_VERSION = "1.1"
_HEADINGS = ("Deck", "State", "Photos", "Points", "Sigma0", "Iterations", "Seconds")
_WIDTH, _LEAST_NAME = 120, 20  # of the table, and of a name in it
_LINKS = {".html": "page", ".lst": "listing", ".json": "record"}
_NEEDS_A_LOOK = (  # first
    JobState.CRASHED, JobState.FAILED, JobState.UNUSABLE, JobState.NOT_CONVERGED, JobState.REJECTED,
    JobState.DOUBTFUL, JobState.NOT_RUN, JobState.ACCEPTED,
)  # fmt: skip


def summary_json(
    jobs: Sequence[BatchJob], outcomes: Sequence[JobOutcome], seconds: float, status: ExitStatus
) -> str:
    """Return the summary as JSON text."""
    record = {
        "schema_version": SCHEMA_VERSION,
        "program": {"name": "musatpy", "version": musatpy.__version__},
        "status": int(status),
        "seconds": seconds,
        "counts": _counts(outcomes),
        "jobs": [_record(job, outcome) for job, outcome in zip(jobs, outcomes, strict=True)],
    }
    return json.dumps(record, indent=1) + "\n"


def _counts(outcomes: Sequence[JobOutcome]) -> dict[str, int]:
    """Return how many jobs came to each state, and how many were kept from an earlier run."""
    states = Counter(outcome.state for outcome in outcomes)
    kept = sum(outcome.kept for outcome in outcomes)
    return {"jobs": len(outcomes), **{state.value: states[state] for state in JobState}, "kept": kept}


def _record(job: BatchJob, outcome: JobOutcome) -> dict[str, Any]:
    data = asdict(outcome)
    data.pop("fingerprint")
    sigma0 = outcome.sigma0
    return {
        "deck": str(job.deck),
        "folder": str(job.folder),
        "options": job.options.as_data(),
        "status": int(outcome.state.status),
        **data,
        "sigma0": sigma0 if sigma0 is not None and math.isfinite(sigma0) else None,
    }


def table(jobs: Sequence[BatchJob], outcomes: Sequence[JobOutcome]) -> str:
    """Return a row of each job, and below it why it failed, in lines of 120 characters; of names the end."""
    rows = [_HEADINGS, *(_row(job, outcome) for job, outcome in zip(jobs, outcomes, strict=True))]
    first, *widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    widths.insert(0, min(first, max(_LEAST_NAME, _WIDTH - sum(widths) - 2 * len(widths))))

    def line(cells: Sequence[str]) -> str:
        """Return a line, names and states to the left, numbers to the right."""
        name = cells[0] if len(cells[0]) <= widths[0] else f"...{cells[0][3 - widths[0] :]}"
        places = (
            cell.ljust(w) if n < 2 else cell.rjust(w)
            for n, (cell, w) in enumerate(zip([name, *cells[1:]], widths, strict=True))
        )
        return "  ".join(places).rstrip()

    lines = [line(rows[0]), "  ".join("-" * width for width in widths)]
    for row, outcome in zip(rows[1:], outcomes, strict=True):
        lines += [line(row), *wrap(outcome.reason, _WIDTH, initial_indent="    ", subsequent_indent="    ")]
    return "\n".join(lines) + "\n"


def _row(job: BatchJob, outcome: JobOutcome) -> tuple[str, ...]:
    photos, points, iterations = (
        "" if number is None else str(number) for number in (outcome.photos, outcome.points, outcome.iterations)
    )
    return (
        " ".join(str(job.deck).splitlines()),
        f"{outcome.state}, kept" if outcome.kept else str(outcome.state),
        photos,
        points,
        "" if outcome.sigma0 is None else f"{outcome.sigma0:.4f}",
        iterations,
        "" if outcome.state is JobState.NOT_RUN else f"{outcome.seconds:.1f}",
    )


def verdict(outcomes: Sequence[JobOutcome]) -> str:
    """Return how many jobs came to what, in a few words."""
    numbers = _counts(outcomes)
    parts = [f"{numbers[state]} {state}" for state in JobState if numbers[state]]
    kept = f" ({numbers['kept']} kept from an earlier run)" if numbers["kept"] else ""
    return f"{count_of(numbers['jobs'], 'job')}: {', '.join(parts)}{kept}"


def index_page(title: str, folder: Path, jobs: Sequence[BatchJob], outcomes: Sequence[JobOutcome]) -> bytes:
    """Return an HTML page in a folder with a row for each job, with links, what needs a look first (`--html`).

    That is the worst state, and of it the sigma0 that is farthest from 1. Raises `MusatError` without jinja2.
    """
    from musatpy.page.page_tables import number_text
    from musatpy.page.rendering import render

    def order(row: tuple[BatchJob, JobOutcome]) -> tuple[int, float, str]:
        job, outcome = row
        sigma0 = outcome.sigma0 if outcome.sigma0 and math.isfinite(outcome.sigma0) else 1.0
        return _NEEDS_A_LOOK.index(outcome.state), -abs(math.log(sigma0)), str(job.deck)

    counts = Counter(outcome.state for outcome in outcomes)
    states = ", ".join(f"{counts[state]:,} {state}" for state in _NEEDS_A_LOOK if counts[state])
    rows = sorted(zip(jobs, outcomes, strict=True), key=order)
    return render(
        "index.jinja",
        heading=title,
        summary=f"{len(jobs):,} job{'s' * (len(jobs) != 1)}: {states}",
        jobs=[(job.deck, outcome, _links(folder, job, outcome)) for job, outcome in rows],
        number=number_text,
    ).encode()


def _links(folder: Path, job: BatchJob, outcome: JobOutcome) -> tuple[tuple[str, str], ...]:
    """Return what a job left to be looked at, and where, seen from a folder."""
    files = {Path(name).suffix: name for name in outcome.outputs if Path(name).stem == job.deck.stem}
    return tuple(
        (what, quote(Path(os.path.relpath(job.folder / files[suffix], folder)).as_posix()))
        for suffix, what in _LINKS.items()
        if suffix in files
    )
