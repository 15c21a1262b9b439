"""Summary of the solution: observations, unknowns, sigma0, convergence, warnings."""

from __future__ import annotations

from collections.abc import Sequence

from musatpy.reports import analyses, answer, iterations
from musatpy.reports.editing import number_text
from musatpy.reports.pages import Section, by_kind, labelled, wrapped
from musatpy.reports.table import Content, Labels, Report, Texts, numbers_at, sentences_at
from musatpy.reports.values import at
from musatpy.statistics import Statistics

LISTED_WARNINGS = 10  # of a kind; the record has them all
PLATE_RESIDUALS = Report(
    "Plate Residuals Of The Job",
    analyses.PLATE_STATISTICS,
    "kinds total_count total_rms",
    expand=("kinds", "total_count", "total_rms"),
)


_EDITS = {  # of what is no whole number
    "Weighted sum of squares": "F18.4",
    "Sigma0 (standard deviation of unit weight)": "F12.6",
    "Sigma0, errors of known water allowed for": "F12.6",
}


def _numbers(content: Content) -> dict[str, Sequence[float | None]]:
    """Return the numbers of the summary by their labels, as a record has them."""
    labels: dict[str, Sequence[float | None]] = {}
    for noun in ("Observations", "Unknowns"):
        counts = at(content, f"solution.{noun.lower()}") or {}
        labels |= {f"{noun}, {kind}": [count] for kind, count in counts.items()}
        labels[f"{noun}, all"] = [sum(count for count in counts.values() if isinstance(count, int | float))]
    labels["Degrees of freedom"] = numbers_at(content, "solution.degrees_of_freedom")
    for label, name in zip(_EDITS, ("sum_of_squares", "sigma0", "unit_sigma"), strict=True):
        labels[label] = numbers_at(content, f"solution.{name}")
    return labels


SUMMARY = Labels("Solution Summary", _numbers)
STATED = (
    SUMMARY,
    Texts(answer.ALL_REASONS, lambda r: sentences_at(r, "verdict.reasons", "verdict.notes"), "verdict"),
    PLATE_RESIDUALS,
    Texts("Warnings", lambda r: sentences_at(r, "solution.warnings"), "solution"),
)


def sections(statistics: Statistics) -> list[Section]:
    """Return the summary, the plate residuals of the whole job, and the warnings where there are any."""
    solution = statistics.solution
    sections = [
        Section(title="Solution Summary", lines=_lines(statistics)),
        *answer.all_reasons(statistics),
        PLATE_RESIDUALS.section(statistics),
    ]
    if solution.warnings:
        lines = [line for kind in by_kind(solution.warnings, shown=LISTED_WARNINGS) for line in kind]
        sections.append(Section(title="Warnings", lines=lines))
    return sections


def _lines(statistics: Statistics) -> list[str]:
    solution = statistics.solution
    verdict = "CONVERGED" if solution.converged else f"NOT CONVERGED: {solution.reason}"
    values = {name: value for name, (value,) in iterations.SOLUTION.raw(statistics).items()}
    lines = {}
    for label, (number,) in _numbers({"solution": values}).items():
        *_, considered = _EDITS
        is_said = label != considered or solution.considered is not None
        if number is not None and is_said and (number or not label.startswith(("Observations, ", "Unknowns, "))):
            lines[label] = number_text(_EDITS[label], number) if label in _EDITS else str(int(number))
    return [*wrapped([verdict]), "", *labelled(lines)]
