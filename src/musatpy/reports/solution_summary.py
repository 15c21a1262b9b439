"""Summary of the solution: observations, unknowns, sigma0, convergence, warnings."""

from __future__ import annotations

from collections.abc import Sequence

from musatpy.reports import analyses, answer
from musatpy.reports.editing import number_text
from musatpy.reports.labels import Content, Labels, Texts, numbers_at, sentences_at
from musatpy.reports.pages import Section
from musatpy.reports.table import Report
from musatpy.reports.text import by_kind, labelled, wrapped
from musatpy.reports.values import at
from musatpy.statistics import Statistics

LISTED_WARNINGS = 10  # of a kind; the record has them all
PLATE_RESIDUALS: Report[Statistics] = Report(
    title="Plate Residuals Of The Job",
    table=analyses.PLATE_STATISTICS,
    expand=("kinds", "total_count", "total_rms"),
    columns=("kinds", "total_count", "total_rms"),
)


def _numbers(content: Content) -> dict[str, Sequence[float | None]]:
    """Return the numbers of the summary by their labels, as a record has them."""
    labels: dict[str, Sequence[float | None]] = {}
    for noun in ("Observations", "Unknowns"):
        counts = at(content, f"solution.{noun.lower()}") or {}
        labels |= {f"{noun}, {kind}": [count] for kind, count in counts.items()}
        labels[f"{noun}, all"] = [sum(count for count in counts.values() if isinstance(count, int | float))]
    for label, name in (
        ("Degrees of freedom", "degrees_of_freedom"),
        ("Weighted sum of squares", "sum_of_squares"),
        ("Sigma0 (standard deviation of unit weight)", "sigma0"),
        ("Sigma0, errors of known water allowed for", "unit_sigma"),
    ):
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
    numbers = {f"Observations, {kind}": str(count) for kind, count in solution.observations.items() if count}
    numbers["Observations, all"] = str(sum(solution.observations.values()))
    numbers |= {f"Unknowns, {kind}": str(count) for kind, count in solution.unknowns.items() if count}
    numbers["Unknowns, all"] = str(sum(solution.unknowns.values()))
    numbers["Degrees of freedom"] = str(solution.degrees_of_freedom)
    numbers["Weighted sum of squares"] = number_text("F18.4", solution.sum_of_squares)
    numbers["Sigma0 (standard deviation of unit weight)"] = number_text("F12.6", solution.sigma0)
    if solution.considered is not None:
        numbers["Sigma0, errors of known water allowed for"] = number_text("F12.6", solution.unit_sigma)
    return [*wrapped([verdict]), "", *labelled(numbers)]
