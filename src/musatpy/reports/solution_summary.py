"""Summary of the solution: observations, unknowns, sigma0, convergence, warnings."""

from __future__ import annotations

from musatpy.reports import answer, result_record
from musatpy.reports.editing import number_text
from musatpy.reports.origin import Mapped, Origin
from musatpy.reports.pages import Section
from musatpy.reports.table import Column, Report, key
from musatpy.reports.text import by_kind, labelled, wrapped
from musatpy.statistics import PLATE_KINDS, Statistics
from musatpy.units import MICROMETRE

LISTED_WARNINGS = 10  # of a kind; the record has them all
PLATE_RESIDUALS: Report[Statistics] = Report(
    title="Plate Residuals Of The Job",
    path=result_record.PLATE_STATISTICS.name,
    expand=("kinds", "total_count", "total_rms"),
    columns=(
        key("Points", "A16", "kinds", lambda s: PLATE_KINDS),
        Column("Number", "I8", lambda s: s.plates.total_count, "total_count"),
        Column("RMS x\num", "F10.2", lambda s: s.plates.total_rms[:, 0] / MICROMETRE, "total_rms[0]"),
        Column("RMS y\num", "F10.2", lambda s: s.plates.total_rms[:, 1] / MICROMETRE, "total_rms[1]"),
    ),
)
_SUMMARY = {
    "Observations, all": Origin(sum=True, field="solution.observations"),
    "Observations, *": Origin(field="solution.observations.*"),
    "Unknowns, all": Origin(sum=True, field="solution.unknowns"),
    "Unknowns, *": Origin(field="solution.unknowns.*"),
    "Degrees of freedom": Origin(field="solution.degrees_of_freedom"),
    "Weighted sum of squares": Origin(field="solution.sum_of_squares"),
    "Sigma0 (standard deviation of unit weight)": Origin(field="solution.sigma0"),
}
SUMMARY = Mapped(title="Solution Summary", layout="labels", columns=_SUMMARY)
STATED = (
    SUMMARY,
    Mapped(title=answer.ALL_REASONS, layout="texts", table="verdict.reasons", also=("verdict.notes",)),
    PLATE_RESIDUALS,
    Mapped(title="Warnings", layout="texts", table="solution.warnings"),
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
