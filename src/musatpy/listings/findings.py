"""What a comparison found: differences as data, as text for people (the largest ones), as JSON and JUnit XML."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from functools import cached_property
from typing import Any, Literal, NamedTuple
from xml.etree import ElementTree

from musatpy.errors import Problem, count_of, printable
from musatpy.listings.rules import RuleUse

SCHEMA_VERSION = "1.0"
Style = Callable[[str, str], str]  # text, and what it is: "title", "a", "b", "same", "different", "warning"
_TEXT_WIDTH = 38  # of values and labels
_SUMMARY_TITLE = 52
_LISTED = 50  # differences in the text of a failed test; all of them are in the JSON
_HEADINGS = ("Row", "Column", "A", "B", "Difference", "Unit", "Last digits", "Sigmas", "Rule", "Line A", "Line B")
_RIGHT = {"A", "B", "Difference", "Last digits", "Sigmas", "Line A", "Line B"}
FindingKind = Literal["number", "angle", "text", "overflow", "only in A", "only in B", "order", "column", "section"]


class PagePlace(NamedTuple):
    """Where something stands in a file: page and line of a listing, both from 1; 0 where there are none."""

    page: int = 0
    line: int = 0


class Discrepancy(NamedTuple):
    """One difference that no rule lets pass (a named tuple: two large listings can have a million of them)."""

    kind: FindingKind
    section: str
    row: str = ""  # ids of the row, or its label
    column: str = ""  # heading of the column, or the number of the field
    a: str | None = None  # as printed; None where A has none
    b: str | None = None
    difference: Decimal | None = None  # B minus A
    unit: str = ""  # of the difference: m, arc sec, ... as far as headings say
    last_digits: Decimal | None = None  # the difference in units of the last digit that both print
    sigmas: float | None = None  # the difference in sigmas, of records that have them
    rule: str = "exact"  # that was applied
    place_a: PagePlace = PagePlace()
    place_b: PagePlace = PagePlace()

    @property
    def size(self) -> Any:
        """How much differs, in sigmas where these are known."""
        return abs(self.difference or Decimal(0)) if self.sigmas is None else abs(self.sigmas)


@dataclass(eq=False)
class SectionSummary:
    """One section of the two files: how much was compared, what differs, and the largest difference in each unit.

    `largest` holds passed differences too, so that it shows what the rules let pass.
    """

    title: str
    rows: int = 0  # compared
    passed: int = 0  # differences that a rule lets pass
    overflowed: int = 0  # fields of asterisks in both files
    findings: list[Discrepancy] = field(default_factory=list)
    _largest: dict[tuple[str, bool], Discrepancy] = field(default_factory=dict)  # by unit, and whether in sigmas

    @property
    def different(self) -> int:
        """The number of findings."""
        return len(self.findings)

    @property
    def largest(self) -> tuple[Discrepancy, ...]:
        """The largest difference in each unit, in sigmas where these are known."""
        return tuple(self._largest.values())

    def add(self, finding: Discrepancy, *, passes: bool = False) -> None:
        """Take a difference, which a rule lets pass or not."""
        if passes:
            self.passed += 1
        else:
            self.findings.append(finding)
        if finding.difference is not None:
            key = finding.unit, finding.sigmas is not None
            known = self._largest.get(key)
            if known is None or finding.size > known.size:
                self._largest[key] = finding


@dataclass(frozen=True)
class Difference:
    """The result of a comparison.

    `same` is what a caller asks first; `findings` are the differences that no rule lets pass, in the order of A.
    """

    a: str  # names of the files
    b: str
    sections: tuple[SectionSummary, ...]
    rules: tuple[RuleUse, ...] = ()
    not_compared: tuple[str, ...] = ()  # sections and columns of a listing that a record cannot answer for

    @cached_property
    def findings(self) -> tuple[Discrepancy, ...]:
        """The differences, section by section."""
        return tuple(finding for section in self.sections for finding in section.findings)

    @property
    def same(self) -> bool:
        """True where nothing was found that a rule does not let pass."""
        return not self.findings

    @property
    def counts(self) -> dict[str, int]:
        """Return the number of findings of each kind, and of the rows compared."""
        kinds: Counter[str] = Counter(finding.kind for finding in self.findings)
        return {"rows compared": sum(section.rows for section in self.sections), **kinds}

    @property
    def unused_rules(self) -> tuple[str, ...]:
        """Return the names of the rules that never matched."""
        return tuple(rule.name for rule in self.rules if not rule.matched)


def plain(text: str, kind: str) -> str:
    """Return a text without colours: the style of files."""
    return printable(text)


def render(difference: Difference, *, listed: int = 20, style: Style = plain) -> str:
    """Return the comparison as text: at most `listed` differences of each section, a summary, a verdict.

    What stands in the files is escaped (`printable`); `style` is to do so with what it is given.
    """
    lines = [f"A  {printable(difference.a)}", f"B  {printable(difference.b)}"]
    for section in difference.sections:
        if section.findings:
            lines += ["", style(section.title, "title"), *_table(section.findings, listed, style)]
    lines += _summary(difference.sections, style)
    lines += [style(remark, "warning") for remark in _remarks(difference)]
    return "\n".join([*lines, verdict(difference, style)]) + "\n"


def _remarks(difference: Difference) -> list[str]:
    """Return what was not compared, and which rules were of no use."""
    unmatched = [f"rule never matched: {name}" for name in difference.unused_rules]
    overruled = [rule.name for rule in difference.rules if rule.matched and not rule.applied]
    return [
        *(f"not compared: {note}" for note in difference.not_compared),
        *unmatched,
        *(f"rule never applied, a later one always won: {name}" for name in overruled),
    ]


def verdict(difference: Difference, style: Style = plain) -> str:
    """Return the last line: same or different, with counts."""
    counts = dict(difference.counts)
    tail = f"{count_of(counts.pop('rows compared'), 'row')} compared"
    if passed := sum(section.passed for section in difference.sections):
        tail += f", {count_of(passed, 'difference')} within the rules"
    if difference.same:
        return style(f"same: {tail}", "same")
    kinds = ", ".join(f"{count} {kind}" for kind, count in counts.items())
    return style(f"different: {kinds}; {tail}", "different")


def number_text(value: Decimal | float | None) -> str:
    """Return a difference with its sign, without superfluous digits; empty where there is none."""
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:+.3g}"
    if value == value.to_integral_value() and abs(value) < 10**9:
        return f"{value:+.0f}"
    text = f"{value:+f}" if -12 < value.adjusted() < 9 else f"{value:+.6e}"
    return text if len(text) < 20 else f"{value:+.9g}"


def _table(findings: Sequence[Discrepancy], listed: int, style: Style) -> list[str]:
    """Return the differences of one section below their headings; columns without content are left out."""
    rows = [_row(finding) for finding in findings[:listed]]
    used = [n for n in range(len(_HEADINGS)) if any(row[n] for row in rows)]
    widths = {n: max(len(_HEADINGS[n]), *(len(row[n]) for row in rows)) for n in used}

    def line(cells: Sequence[str], marked: bool) -> str:
        texts = []
        for n in used:
            text = cells[n].rjust(widths[n]) if _HEADINGS[n] in _RIGHT else cells[n].ljust(widths[n])
            kind = {"A": "a", "B": "b"}.get(_HEADINGS[n])
            texts.append(style(text, kind) if marked and kind else text)
        return ("  " + "  ".join(texts)).rstrip()

    lines = [line(_HEADINGS, False), *(line(row, True) for row in rows)]
    if len(findings) > listed:
        lines.append(f"  and {len(findings) - listed} more")
    return lines


def _row(finding: Discrepancy) -> tuple[str, ...]:
    whole = {"order": "(stands elsewhere)", "section": "(section)", "column": "(column)"}.get(finding.kind, "")
    return (
        _cut(finding.row),
        _cut(f"{finding.column} {whole}".strip()),
        _cut(finding.a if finding.a is not None else "-"),
        _cut(finding.b if finding.b is not None else "-"),
        number_text(finding.difference),
        printable(finding.unit),
        _digits(finding.last_digits),
        number_text(finding.sigmas),
        printable(finding.rule),
        str(finding.place_a.line or ""),
        str(finding.place_b.line or ""),
    )


def _digits(value: Decimal | None) -> str:
    if value is None:
        return ""
    return f"{value:+.0f}" if abs(value) < 10**7 else f"{value:+.1e}"


def _summary(sections: Sequence[SectionSummary], style: Style) -> list[str]:
    """Return a line for the largest difference of each section and unit, passed ones too."""
    shown = [section for section in sections if section.different or section.passed]
    if not shown:
        return [""]
    head = f"{'Summary':<{_SUMMARY_TITLE}}  {'Rows':>7}  {'Different':>9}  {'Passed':>7}  Largest difference"
    lines = ["", style(head, "title")]
    for section in shown:
        largest = [_largest(finding) for finding in section.largest] or [""]
        title = printable(section.title)[:_SUMMARY_TITLE]
        lead = f"{title:<{_SUMMARY_TITLE}}  {section.rows:>7}  {section.different:>9}"
        lines.append(f"{lead}  {section.passed:>7}  {largest[0]}".rstrip())
        indent = " " * (_SUMMARY_TITLE + 31)
        lines += [f"{indent}{line}" for line in largest[1:]]
    return [*lines, ""]


def _largest(finding: Discrepancy) -> str:
    sigmas = f" ({finding.sigmas:+.3g} sigmas)" if finding.sigmas is not None else ""
    value = f"{number_text(finding.difference)} {finding.unit}".strip()
    return printable(f"{value}{sigmas}: {finding.row}, {finding.column}")


def _cut(text: str) -> str:
    text = printable(text)
    return text if len(text) <= _TEXT_WIDTH else f"{text[: _TEXT_WIDTH - 3]}..."


def json_text(difference: Difference) -> str:
    """Return the whole comparison as JSON; numbers of listings are texts, as they are written there."""
    head = {
        "schema_version": SCHEMA_VERSION,
        "a": difference.a,
        "b": difference.b,
        "same": difference.same,
        "counts": difference.counts,
        "sections": [
            {
                "title": section.title,
                "rows": section.rows,
                "different": section.different,
                "passed": section.passed,
                "largest": [_entry(finding) for finding in section.largest],
            }
            for section in difference.sections
        ],
        "rules": [
            {"name": rule.name, "matched": rule.matched, "applied": rule.applied, "passed": rule.passed}
            for rule in difference.rules
        ],
        "not_compared": list(difference.not_compared),
    }
    # one difference a line: there may be a million, and an indented one takes eight times as long
    findings = ",\n  ".join(json.dumps(_entry(finding)) for finding in difference.findings)
    return json.dumps(head, indent=1).removesuffix("\n}") + f',\n "findings": [\n  {findings}\n ]\n}}\n'


def _entry(finding: Discrepancy) -> dict[str, Any]:
    """Return what JSON says of a difference."""
    entry = finding._asdict()
    for side in "ab":
        place = entry.pop(f"place_{side}")
        entry |= {f"page_{side}": place.page or None, f"line_{side}": place.line or None}
    return entry | {
        "difference": None if finding.difference is None else str(finding.difference),
        "unit": finding.unit or None,
        "last_digits": _finite(finding.last_digits),
        "sigmas": _finite(finding.sigmas),
    }


def _finite(value: Decimal | float | None) -> float | None:
    if value is None:
        return None
    number = float(value)
    return number if math.isfinite(number) else None


def junit_text(difference: Difference) -> str:
    """Return a test suite of JUnit XML: a test for each section, which fails where something differs."""
    failed = sum(bool(section.findings) for section in difference.sections)
    titles = [section.title for section in difference.sections]
    suite, tests = junit_suite(f"{difference.a} {difference.b}", "musat.diff", titles, failures=failed)
    for test, section in zip(tests, difference.sections, strict=True):
        if section.findings:
            message = count_of(len(section.findings), "difference")
            failure = ElementTree.SubElement(test, "failure", message=message)
            failure.text = "\n".join(_table(section.findings, _LISTED, plain))
    if remarks := _remarks(difference):
        ElementTree.SubElement(suite, "system-err").text = printable("\n".join(remarks))
    return junit_document(suite)


def junit_of_problems(problems: Iterable[Problem], names: tuple[str, str]) -> str:
    """Return a test suite with the one error that the files cannot be compared."""
    suite, (test,) = junit_suite(" ".join(names), "musat.diff", ["comparison"], errors=1)
    error = ElementTree.SubElement(test, "error", message="cannot compare")
    error.text = printable("\n".join(problem.headline() for problem in problems))
    return junit_document(suite)


def junit_suite(
    suite: str, program: str, names: Sequence[str], *, failures: int = 0, errors: int = 0
) -> tuple[ElementTree.Element, list[ElementTree.Element]]:
    """Return a test suite of a program (`musat.diff`), and its tests by their names."""
    counts = {"tests": len(names), "failures": failures, "errors": errors}
    attributes = {"name": printable(suite), **{key: str(count) for key, count in counts.items()}}
    element = ElementTree.Element("testsuite", attributes)
    tests = [{"classname": program, "name": printable(name)} for name in names]
    return element, [ElementTree.SubElement(element, "testcase", test) for test in tests]


def junit_document(suite: ElementTree.Element) -> str:
    """Return a test suite as a file of JUnit XML."""
    ElementTree.indent(suite)
    text = ElementTree.tostring(suite, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'
