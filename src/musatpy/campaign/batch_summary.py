"""What a batch came to: JSON for machines (`summary.schema.json`), a table for people."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import musatpy
from musatpy.campaign.batch_jobs import Job, Outcome, State
from musatpy.runs import ExitStatus

SCHEMA_VERSION = "1.1"
_HEADINGS = ("Deck", "State", "Photos", "Points", "Sigma0", "Iterations", "Seconds")
_NAME_WIDTH = 60


def summary_json(jobs: Sequence[Job], outcomes: Sequence[Outcome], seconds: float, status: ExitStatus) -> str:
    """Return the summary as JSON text."""
    record = {
        "schema_version": SCHEMA_VERSION,
        "program": {"name": "musatpy", "version": musatpy.__version__},
        "status": int(status),
        "seconds": seconds,
        "counts": counts(outcomes),
        "jobs": [_record(job, outcome) for job, outcome in zip(jobs, outcomes, strict=True)],
    }
    return json.dumps(record, indent=1) + "\n"


def counts(outcomes: Sequence[Outcome]) -> dict[str, int]:
    """Return how many jobs came to each state, and how many were kept from an earlier run."""
    states = Counter(outcome.state for outcome in outcomes)
    kept = sum(outcome.kept for outcome in outcomes)
    return {"jobs": len(outcomes), **{state.value: states[state] for state in State}, "kept": kept}


def _record(job: Job, outcome: Outcome) -> dict[str, Any]:
    data = outcome.as_data()
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


def table(jobs: Sequence[Job], outcomes: Sequence[Outcome]) -> str:
    """Return a row of each job, and below it why it failed."""
    rows = [_row(job, outcome) for job, outcome in zip(jobs, outcomes, strict=True)]
    widths = [max(len(row[n]) for row in [_HEADINGS, *rows]) for n in range(len(_HEADINGS))]
    lines = [_line(_HEADINGS, widths), "  ".join("-" * width for width in widths)]
    for row, outcome in zip(rows, outcomes, strict=True):
        lines.append(_line(row, widths))
        if outcome.message:
            lines.append(f"    {' '.join(outcome.message.split())}")
    return "\n".join(lines) + "\n"


def _row(job: Job, outcome: Outcome) -> tuple[str, ...]:
    name = " ".join(str(job.deck).splitlines())
    return (
        name if len(name) <= _NAME_WIDTH else f"...{name[3 - _NAME_WIDTH :]}",
        f"{outcome.state}, kept" if outcome.kept else str(outcome.state),
        _text(outcome.photos),
        _text(outcome.points),
        "" if outcome.sigma0 is None else f"{outcome.sigma0:.4f}",
        _text(outcome.iterations),
        "" if outcome.state is State.NOT_RUN else f"{outcome.seconds:.1f}",
    )


def _text(value: int | None) -> str:
    return "" if value is None else str(value)


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    """Return a line, its first two cells to the left."""
    cells = [one.ljust(w) if n < 2 else one.rjust(w) for n, (one, w) in enumerate(zip(cells, widths, strict=True))]
    return "  ".join(cells).rstrip()


def verdict(outcomes: Sequence[Outcome]) -> str:
    """Return how many jobs came to what, in a few words."""
    numbers = counts(outcomes)
    parts = [f"{numbers[state]} {state}" for state in State if numbers[state]]
    kept = f" ({numbers['kept']} kept from an earlier run)" if numbers["kept"] else ""
    return f"{numbers['jobs']} {'job' if numbers['jobs'] == 1 else 'jobs'}: {', '.join(parts)}{kept}"
