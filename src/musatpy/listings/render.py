"""A difference -> text for people: section by section, then the largest differences of each section."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from decimal import Decimal
from itertools import groupby

from musatpy.errors import printable
from musatpy.listings.findings import Difference, Finding, SectionSummary

Style = Callable[[str, str], str]  # text, and what it is: "title", "a", "b", "same", "different", "warning"
_TEXT_WIDTH = 38  # of values and labels
_SUMMARY_TITLE = 52
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
