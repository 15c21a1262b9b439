"""The figures that say in short how good a run is: page 1 of the listing, its page and `musat diff` have them here.

They are made of a record, or of the same tables of a run.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.errors import count_of
from musatpy.model import Editing, PlateSigma, Program, Refraction, Solution, Verdict, Weights
from musatpy.model.findings import SEARCH_GIVEN_UP, Reason
from musatpy.reports import (
    adjusted_water,
    analyses,
    bathymetric,
    blunders,
    common_errors,
    control,
    job_record,
    statistical_tests,
)
from musatpy.reports.editing import number_text
from musatpy.reports.fields import Each, Field, FieldGroup, Node
from musatpy.reports.table import Content
from musatpy.reports.values import array_of, at
from musatpy.statistics import Statistics
from musatpy.statistics.analyses import DifferenceStatistics, axes_of, difference_statistics
from musatpy.statistics.quality import FAR, chi_square, untested, weakly_tested
from musatpy.statistics.verdict import COMMON_ERRORS, sigma0_doubt
from musatpy.units import MICROMETRE

CONTROL, CHECKS = "control residuals", "check points"
Edited = Callable[[str, float], str]  # a number by an edit descriptor
_GRADES = ("DOUBTFUL", "REJECTED", "FAILED")
VERDICT = FieldGroup[Statistics, Verdict](
    "verdict", "what the run is worth", of=lambda s: s.verdict, fields=(
        Field("grade", "string", "that of the worst reason; FAILED has not converged",
              choices=("ACCEPTED", *_GRADES)),
        Each[Verdict, Reason](
            "reasons", "one row per reason against the answer, the worst first", of=lambda v: v.reasons, fields=(
                Field("grade", "string", "that the reason alone would give", choices=_GRADES),
                Field("concern", "string", "what it is about: convergence, sigma0, control, ..."),
                Field("text", "string", "the reason"),
                Field("section", "string", "how the title of the section of the listing begins where it shows"),
            ),
        ),
        Field("notes", "* string", "worth knowing, and no doubt"),
    ),
)  # fmt: skip


SOLUTION = FieldGroup[Statistics, Solution](
    "solution", "the result in short", of=lambda s: s.solution, fields=(
        Field("converged", "boolean", "whether the limits were reached"),
        Field("reason", "string", "why not converged; empty when converged"),
        Field("warnings", "* string", "ill-determined unknowns and the like"),
        Field("sigma0", "number?", "standard deviation of unit weight, a posteriori"),
        Field("unit_sigma", "number?",
              "the same without what the errors of known water explain: it is tested, and scales the covariances"),
        Field("degrees_of_freedom", "integer", "observations minus unknowns"),
        Field("sum_of_squares", "number?", "weighted, of all residuals"),
        Field("observations", "map", "kind of observation -> number", lambda s: _whole(s.observations)),
        Field("unknowns", "map", "kind of unknown -> number", lambda s: _whole(s.unknowns)),
    ),
)  # fmt: skip
_TABLES: tuple[Node[Statistics], ...] = (
    job_record.part("options", "options", lambda s: s.block.options),
    SOLUTION,
    analyses.PLATE_STATISTICS,
    control.CONTROL,
    bathymetric.BATHYMETRIC,
    adjusted_water.ADJUSTED_WATER,
    statistical_tests.TESTS,
    blunders.FINDINGS,
    *common_errors.RECORD,
)


def _whole(counts: dict[str, int]) -> dict[str, int]:
    return {kind: int(count) for kind, count in counts.items()}


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A figure with what it is."""

    label: str
    value: str
    detail: str = ""  # begins with what parts it from the value
    section: str = ""  # how the title of the section of the listing begins where it is told in full
    numbers: Sequence[float | None] = ()  # the first ones in its text, those that a record has


def content_of(statistics: Statistics) -> Content:
    """Return what `headline` needs of a run, in the shape of a record."""
    content: dict[str, Any] = {table.name: table.held(statistics) for table in _TABLES}
    if content["tests"] is None:  # a record has no test without those of the observations
        total: Node[Statistics] = {table.name: table for table in statistical_tests.TESTS.fields}[
            "check_points_total"
        ]
        content["tests"] = {"check_points_total": total.json(statistics)}
    return content


def headline(content: Content, edited: Edited = number_text) -> Iterator[Figure]:
    """Yield the figures of a record or of `content_of` a run, their numbers `edited` for print or for a page."""
    yield _sigma0(content, edited)
    yield from _plates(content, edited)
    for what, section in ((CONTROL, "Control Residuals"), (CHECKS, "Check Points")):
        yield from _differences(content, what, section, edited)
    total = at(content, "tests.check_points_total")
    if total:
        numbers = [total[name] for name in ("factor", "low", "high")]
        factor, low, high = (edited("F12.3", number) for number in numbers)
        outside = statistical_tests.outside(numbers[0], numbers[1], total["accepted"])
        yield Figure(
            label="Check points, chi-square over components",
            value=factor,
            detail=f", by chance {low} to {high} (95 %){outside and f': {outside}'}",
            section="Statistics: Check Points",
            numbers=numbers,
        )
    yield from _depths(content, edited)
    hidden = at(content, "tests.hidden_errors")
    if hidden:
        weak = sum(hidden["weak"])
        yield Figure(
            label="Points weakly checked",
            value=f"{weak} of {len(hidden['weak'])}",
            detail=f": an undetected error may move them by more than {FAR:.0f} sigmas",
            section=statistical_tests.HIDDEN,
            numbers=[weak],
        )
    yield _blunders(content)
    yield from _common_errors(content, edited)


def _sigma0(content: Content, edited: Edited) -> Figure:
    options, solution = content["options"], content["solution"]
    value, unit_sigma, freedom = (solution[name] for name in ("sigma0", "unit_sigma", "degrees_of_freedom"))
    equal = options["program"] == Program.IIA and options["weights"] == Weights.EQUAL
    if value is None:
        text, detail = "not finite", ": nothing can be tested"
    else:
        text, detail = edited("F12.4", value), ""
        if at(content, "adjusted_water.considered.sigma"):
            detail = f", {edited('F12.4', unit_sigma)} with the errors of known water allowed for"
        if freedom <= 0:
            detail += ", not tested: there is no redundancy"
        elif options["plate_sigma_is"] != PlateSigma.KNOWN or equal:
            detail += ", not tested: the sigmas of the plates are estimated by it"
        else:
            test = chi_square(unit_sigma**2 * freedom, freedom)
            low, high = (edited("F8.3", math.sqrt(limit)) for limit in (test.low, test.high))
            doubt = edited("F8.3", sigma0_doubt(freedom))
            outside = statistical_tests.outside(test.factor, test.low, test.accepted)
            detail += f", by chance {low} to {high} (95 %), at most {doubt} (99.9 %){outside and f': {outside}'}"
    return Figure(label="Sigma0", value=text, detail=detail, section="Statistics: Sigma0", numbers=[value])


def _plates(content: Content, edited: Edited) -> Iterator[Figure]:
    statistics = content["plate_statistics"]
    count, rms = statistics["total_count"][0], statistics["total_rms"][0]
    if count:
        numbers = [value / MICROMETRE for value in rms]
        yield Figure(
            label="RMS of plate residuals, x and y",
            value=f"{' and '.join(edited('F12.2', number) for number in numbers)} um",
            detail=f" of {count} images",
            section="Plate Residuals Of The Job",
            numbers=numbers,
        )


def differences(content: Content, what: str) -> dict[str, DifferenceStatistics]:
    """Return adjusted less given coordinates (m) of `CONTROL` that took part, or of `CHECKS`, by component."""
    table = content["control"]
    check = array_of("string", table["kind"]) == "check"
    used = array_of("3 boolean", table["used"]) & ~array_of("boolean", table["fixed"])[:, None]
    shown = check[:, None] if what == CHECKS else used & ~check[:, None]
    values = np.where(shown, array_of("3 number?", table["difference"]), np.nan)
    axes = axes_of(content["options"]["system"])
    return {
        axis: difference_statistics(column, table["point"]) for axis, column in zip(axes, values.T, strict=True)
    }


def _differences(content: Content, what: str, section: str, edited: Edited) -> Iterator[Figure]:
    found = differences(content, what)
    sizes, numbers = [of.size for of in found.values()], [of.rms for of in found.values()]
    if any(sizes):
        yield Figure(
            label=f"RMS of {what}, {', '.join(found)}",
            value=f"{', '.join(edited('F12.3', number) or '-' for number in numbers)} m",
            detail=f" of {', '.join(map(str, sizes))} points",
            section=section,
            numbers=[number for number in numbers if not math.isnan(number)],
        )


def _depths(content: Content, edited: Edited) -> Iterator[Figure]:
    """Yield the sigmas of depths, where the run knew of the water."""
    table = at(content, "bathymetric_points")
    if not table or content["options"]["refraction"] == Refraction.NONE:
        return
    depths, sigmas = (array_of("number?", table[name]) for name in ("depth", "depth_sigma"))
    known = np.isfinite(sigmas)
    if count := int(known.sum()):
        numbers = [float(np.median(sigmas[known])), float(sigmas[known].max())]
        low, high = (edited("F12.2", float(depth)) for depth in (depths[known].min(), depths[known].max()))
        yield Figure(
            label="Sigma of depths, median and largest",
            value=f"{' and '.join(edited('F12.3', number) for number in numbers)} m",
            detail=f" of {count_of(count, 'point')}, {low} to {high} m deep",
            section=bathymetric.DEPTHS.title,
            numbers=numbers,
        )


def _blunders(content: Content) -> Figure:
    findings = content["findings"]
    value, detail, section = "none were found", "", ""
    if content["options"]["editing"] == Editing.NONE:
        value = "not looked for"
    elif any(warning.startswith(SEARCH_GIVEN_UP) for warning in content["solution"]["warnings"]):
        value = "the search was given up"
    elif findings:
        actions = Counter(finding["action"] for finding in findings)
        value, section = str(len(findings)), "Blunders"
        detail = f": {', '.join(f'{action} {count}' for action, count in actions.items())}"
    return Figure(label="Blunders", value=value, detail=detail, section=section, numbers=[len(findings)])


def _common_errors(content: Content, edited: Edited) -> Iterator[Figure]:
    """Yield the parameters whose errors no test finds, or large ones alone."""
    table = at(content, "common_errors.parameters")
    if not table:
        return

    def moved(what: str) -> FloatArray:
        """Return how far (h, 3) errors move the stations, points and depths that they move most."""
        return np.stack([array_of("number?", table[f"{noun}_{what}"]) for noun in common_errors.MOVED], axis=1)

    reference, believed = (array_of("number?", table[name]) for name in ("reference", "believed"))
    without_test = untested(array_of("boolean", table["tested"]), moved("sigmas"), reference, believed)
    for label, rows, error, shift, sigmas in (
        ("Common errors without test", without_test, "reference", "shift", "sigmas"),
        (
            "Common errors weakly tested",
            weakly_tested(moved("hidden_sigmas")),
            "smallest",
            "hidden",
            "hidden_sigmas",
        ),
    ):
        if len(rows):
            row, *others = rows.tolist()
            kind = int(np.nanargmax(moved(sigmas)[row]))
            noun = common_errors.MOVED[kind]
            size = f"{edited('F12.4', table[error][row])} {table['unit'][row]}".rstrip()
            text = f": {size} moves {noun} {table[noun][row]} by {edited('F12.3', moved(shift)[row, kind])} m, "
            text += f"{edited('F12.1', moved(sigmas)[row, kind])} sigmas"
            if others:
                text += f"; also {'; '.join(table['parameter'][other] for other in others)}"
            yield Figure(label=label, value=table["parameter"][row], detail=text, section=COMMON_ERRORS)
