"""A difference -> JSON, and JUnit XML: what other programs read."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from decimal import Decimal
from xml.etree import ElementTree

from musatpy.errors import Problem, printable
from musatpy.listings.findings import Difference, Finding
from musatpy.listings.render import number_text

SCHEMA_VERSION = "1.0"
_PIECE = 10_000  # differences in one piece of JSON
_KEYS = (
    "kind", "section", "row", "column", "a", "b", "difference", "unit", "last_digits", "sigmas", "rule", "page_a",
    "line_a", "page_b", "line_b",
)  # fmt: skip
_TEMPLATE = "  {\n" + ",\n".join(f'   "{key}": %s' for key in _KEYS) + "\n  }"
_quoted = json.encoder.encode_basestring_ascii
_LISTED = 50  # differences in the text of a failed test; all of them are in the JSON


def json_text(difference: Difference) -> str:
    """Return the whole comparison as JSON; numbers of the files are texts, as they are written there."""
    return "".join(json_parts(difference))


def json_parts(difference: Difference) -> Iterator[str]:
    """Yield what `json_text` returns, in pieces: a million differences need not be in memory as text at once."""
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
                "largest": [dict(zip(_KEYS, _values(finding), strict=True)) for finding in section.largest],
            }
            for section in difference.sections
        ],
    }
    tail = {
        "rules": [
            {"name": rule.name, "matched": rule.matched, "applied": rule.applied, "passed": rule.passed}
            for rule in difference.rules
        ],
        "not_compared": list(difference.not_compared),
    }
    findings = difference.findings
    yield json.dumps(head, indent=1).removesuffix("\n}") + ',\n "findings": ['
    for start in range(0, len(findings), _PIECE):
        yield (",\n" if start else "\n") + ",\n".join(map(_finding_text, findings[start : start + _PIECE]))
    yield ("\n ],\n" if findings else "],\n") + json.dumps(tail, indent=1).removeprefix("{\n") + "\n"


def _finding_text(finding: Finding) -> str:
    """Return a difference as `json.dumps` lays it out with an indent of one, which takes eight times as long."""
    return _TEMPLATE % tuple(
        [
            _quoted(value) if type(value) is str else "null" if value is None else repr(value)
            for value in _values(finding)
        ]
    )


def _values(finding: Finding) -> tuple[str | float | None, ...]:
    """Return the values of a difference, in the order of `_KEYS`."""
    (
        kind, section, row, column, a, b, difference, unit, last_digits, sigmas, rule, place_a, place_b,
    ) = finding  # fmt: skip
    return (
        kind, section, row, column, a, b, None if difference is None else str(difference), unit or None,
        _finite(last_digits), _finite(sigmas), rule, place_a[0] or None, place_a[1] or None, place_b[0] or None,
        place_b[1] or None,
    )  # fmt: skip


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
