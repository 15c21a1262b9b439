"""A difference -> JSON, and JUnit XML: what other programs read."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterable
from decimal import Decimal
from xml.etree import ElementTree

from musatpy.errors import Problem, printable
from musatpy.listings.findings import Difference, Finding
from musatpy.listings.render import number_text

SCHEMA_VERSION = "1.0"
_LISTED = 50  # differences in the text of a failed test; all of them are in the JSON


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


def _entry(finding: Finding) -> dict[str, str | float | None]:
    """Return what JSON says of a difference."""
    return {
        "kind": finding.kind,
        "section": finding.section,
        "row": finding.row,
        "column": finding.column,
        "a": finding.a,
        "b": finding.b,
        "difference": None if finding.difference is None else str(finding.difference),
        "unit": finding.unit or None,
        "last_digits": _finite(finding.last_digits),
        "sigmas": _finite(finding.sigmas),
        "rule": finding.rule,
        "page_a": finding.place_a.page or None,
        "line_a": finding.place_a.line or None,
        "page_b": finding.place_b.page or None,
        "line_b": finding.place_b.line or None,
    }


def _finite(value: Decimal | float | None) -> float | None:
    if value is None:
        return None
    number = float(value)
    return number if math.isfinite(number) else None


def junit_text(difference: Difference) -> str:
    """Return a test suite of JUnit XML: a test for each section, which fails where something differs."""
    by_section: dict[str, list[Finding]] = defaultdict(list)
    for finding in difference.findings:
        by_section[finding.section].append(finding)
    titles = list(dict.fromkeys(section.title for section in difference.sections))
    suite = _suite(f"{difference.a} {difference.b}", tests=len(titles), failures=len(by_section), errors=0)
    for title in titles:
        test = ElementTree.SubElement(suite, "testcase", classname="musat.diff", name=printable(title))
        failures = by_section.get(title)
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
