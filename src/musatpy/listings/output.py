"""A difference -> text for people: the largest differences of each section; and JSON and JUnit XML for programs."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Sequence
from decimal import Decimal
from itertools import groupby
from typing import Any
from xml.etree import ElementTree

from musatpy.errors import Problem, printable
from musatpy.listings.findings import Difference, Finding, SectionSummary

SCHEMA_VERSION = "1.0"
Style = Callable[[str, str], str]  # text, and what it is: "title", "a", "b", "same", "different", "warning"
_TEXT_WIDTH = 38  # of values and labels
_SUMMARY_TITLE = 52
_LISTED = 50  # differences in the text of a failed test; all of them are in the JSON
_HEADINGS = ("Row", "Column", "A", "B", "Difference", "Unit", "Last digits", "Sigmas", "Rule", "Line A", "Line B")
_RIGHT = {"A", "B", "Difference", "Last digits", "Sigmas", "Line A", "Line B"}


def plain(text: str, kind: str) -> str:
    """Return a text without colours: the style of files."""
    return printable(text)


def render(difference: Difference, *, listed: int = 20, style: Style = plain) -> str:
    """Return the comparison as text: at most `listed` differences of each section, a summary, a verdict.

    What stands in the files is escaped (`printable`); `style` is to do so with what it is given.
    """
    lines = [f"A  {printable(difference.a)}", f"B  {printable(difference.b)}"]
    for title, group in groupby(difference.findings, key=lambda finding: finding.section):
        lines += ["", style(title, "title"), *_table(list(group), listed, style)]
    lines += _summary(difference.sections, style)
    for note in difference.not_compared:
        lines.append(style(f"not compared: {note}", "warning"))
    for name in difference.unused_rules:
        lines.append(style(f"rule never matched: {name}", "warning"))
    for rule in difference.rules:
        if rule.matched and not rule.applied:
            lines.append(style(f"rule never applied, a later one always won: {rule.name}", "warning"))
    return "\n".join([*lines, verdict(difference, style)]) + "\n"


def verdict(difference: Difference, style: Style = plain) -> str:
    """Return the last line: same or different, with counts."""
    counts = dict(difference.counts)
    rows = counts.pop("rows compared")
    passed = sum(section.passed for section in difference.sections)
    tail = f"{_count(rows, 'row')} compared"
    if passed:
        tail += f", {_count(passed, 'difference')} within the rules"
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


def _table(findings: Sequence[Finding], listed: int, style: Style) -> list[str]:
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


def _row(finding: Finding) -> tuple[str, ...]:
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


def _largest(finding: Finding) -> str:
    sigmas = f" ({finding.sigmas:+.3g} sigmas)" if finding.sigmas is not None else ""
    value = f"{number_text(finding.difference)} {finding.unit}".strip()
    return printable(f"{value}{sigmas}: {finding.row}, {finding.column}")


def _cut(text: str) -> str:
    text = printable(text)
    return text if len(text) <= _TEXT_WIDTH else f"{text[: _TEXT_WIDTH - 3]}..."


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


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


def _entry(finding: Finding) -> dict[str, Any]:
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
    found: dict[str, list[Finding]] = {section.title: [] for section in difference.sections}
    for finding in difference.findings:
        found[finding.section].append(finding)
    failed = sum(map(bool, found.values()))
    suite = _suite(f"{difference.a} {difference.b}", tests=len(found), failures=failed, errors=0)
    for title, failures in found.items():
        test = ElementTree.SubElement(suite, "testcase", classname="musat.diff", name=printable(title))
        if failures:
            message = f"{len(failures)} differences" if len(failures) > 1 else "1 difference"
            lines = [_line(finding) for finding in failures[:_LISTED]]
            lines += [f"and {len(failures) - _LISTED} more"] if len(failures) > _LISTED else []
            ElementTree.SubElement(test, "failure", message=message).text = printable("\n".join(lines))
    notes = [f"not compared: {note}" for note in difference.not_compared]
    notes += [f"rule never matched: {name}" for name in difference.unused_rules]
    if notes:
        ElementTree.SubElement(suite, "system-err").text = printable("\n".join(notes))
    return _document(suite)


def junit_of_problems(problems: Iterable[Problem], names: tuple[str, str]) -> str:
    """Return a test suite with the one error that the files cannot be compared."""
    suite = _suite(" ".join(names), tests=1, failures=0, errors=1)
    test = ElementTree.SubElement(suite, "testcase", classname="musat.diff", name="comparison")
    error = ElementTree.SubElement(test, "error", message="cannot compare")
    error.text = printable("\n".join(problem.headline() for problem in problems))
    return _document(suite)


def _suite(name: str, **counts: int) -> ElementTree.Element:
    attributes = {"name": printable(name), **{key: str(count) for key, count in counts.items()}}
    return ElementTree.Element("testsuite", attributes)


def _document(suite: ElementTree.Element) -> str:
    ElementTree.indent(suite)
    text = ElementTree.tostring(suite, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def _line(finding: Finding) -> str:
    where = ", ".join(part for part in (finding.row, finding.column) if part)
    line = f"{finding.kind}: {where}: A {finding.a or '-'}, B {finding.b or '-'}"
    if finding.difference is not None:
        line += f", difference {number_text(finding.difference)} {finding.unit}".rstrip()
    if finding.sigmas is not None:
        line += f", {finding.sigmas:+.3g} sigmas"
    return f"{line} [{finding.rule}]"
