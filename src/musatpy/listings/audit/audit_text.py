"""An audit, and a listing beside a newer run, in print and as JSON."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Sequence
from itertools import groupby

from musatpy.listings.audit.against import Pair, SideBySide
from musatpy.listings.audit.misprints import Misprint, text_like
from musatpy.listings.audit.structures import Listing, Printed

_HEADINGS = ("item", "statistic", "listing", "new", "difference")


def audit_text(listing: Listing, findings: Sequence[Misprint]) -> str:
    """Return the audit of a listing: what was found in it, repairs, rows that cannot be read, contradictions."""
    lines = [f"{listing.name}: {_contents(listing)}"]
    if listing.repairs:
        lines += ["", f"Repairs of the text: {len(listing.repairs)}"]
    for repair in listing.repairs:
        outcome = f"read as '{repair.read}'" if repair.read else "left out"
        lines.append(f"{listing.name}:{repair.line}: {repair.kind.value}: '{repair.found}' {outcome}")
    if listing.unreadable:
        lines += ["", f"Rows that cannot be read: {len(listing.unreadable)}"]
        lines += [problem.headline() for problem in listing.unreadable]
    if findings:
        lines += ["", f"Contradictions: {len(findings)}"]
    for finding in findings:
        lines += finding.lines(listing.name)
    state = "inconsistent" if findings else "consistent, as far as it can be read" if listing.unreadable else ""
    return "\n".join([*lines, "", state or "consistent"]) + "\n"


def _contents(listing: Listing) -> str:
    counts = (
        (len(listing.analyses), "analysis", "analyses"),
        (len(listing.plates), "table of plate residuals", "tables of plate residuals"),
        (len(listing.submerged), "table of bathymetric points", "tables of bathymetric points"),
    )
    return (
        ", ".join(f"{count} {noun if count == 1 else plural}" for count, noun, plural in counts if count)
        or "nothing"
    )


def side_text(beside: SideBySide, listed: int) -> str:
    """Return the statistics side by side, those that differ beyond their print marked.

    Of a report with more rows than `listed`, those that differ most are shown.
    """
    lines: list[str] = []
    for heading, group in groupby(beside.pairs, key=lambda pair: pair.key.heading):
        pairs = list(group)
        shown = _largest(pairs, listed)
        lines += ["", heading, ""] if lines else [heading, ""]
        lines += _table([_HEADINGS, *(_row(pair) for pair in shown)])
        if len(shown) < len(pairs):
            lines.append(f"... and {len(pairs) - len(shown)} that differ less")
    differ = sum(not pair.alike for pair in beside.pairs)
    lines += ["", f"{len(beside.pairs)} compared, {differ} differ by more than their rounding (*)"]
    lines.append(f"{len(beside.only_old)} only in the listing, {len(beside.only_new)} only in the new run")
    if beside.several:
        lines.append(f"{len(beside.several)} more than once in one of them, with different numbers: not compared")
    return "\n".join(lines) + "\n"


def _largest(pairs: list[Pair], listed: int) -> list[Pair]:
    """Return the pairs that differ most, in the order of print; an id that differs comes first."""
    size = {id(pair): abs(pair.difference) if pair.difference is not None else 0.0 for pair in pairs}
    ranked = sorted(pairs, key=lambda pair: (pair.difference is not None or pair.alike, -size[id(pair)]))
    kept = {id(pair) for pair in ranked[:listed]}
    return [pair for pair in pairs if id(pair) in kept]


def _row(pair: Pair) -> tuple[str, ...]:
    mark = "" if pair.alike else " *"
    if pair.difference is None or not pair.old.unit:
        new = pair.new.text or f"{pair.new.value:.0f}"
        size = f"{pair.difference:.0f}" if pair.difference is not None else ""
        return pair.key.item, pair.key.statistic, pair.old.text, new, size + mark
    like = Printed(value=pair.old.value or 0.0, half=pair.old.half, text=pair.old.text, line=0)
    new = pair.new.text or text_like(pair.new.value or 0.0, like)
    plain = like._replace(text=like.text.split()[-1])
    difference = f"{text_like(pair.difference, plain)} {pair.old.unit}"
    return pair.key.item, pair.key.statistic, pair.old.text, new, difference + mark


def _table(rows: Sequence[tuple[str, ...]]) -> Iterator[str]:
    """Yield rows with texts on the left and numbers on the right of their columns."""
    marks = [row[-1].endswith(" *") for row in rows]
    cells = [(*row[:-1], row[-1].removesuffix(" *")) for row in rows]
    widths = [max(len(row[column]) for row in cells) for column in range(len(_HEADINGS))]
    for row, mark in zip(cells, marks, strict=True):
        texts = [
            cell.ljust(width) if column < 2 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        yield ("  ".join(texts) + ("  *" if mark else "")).rstrip()


def audit_json(listing: Listing, findings: Sequence[Misprint], beside: SideBySide | None) -> str:
    """Return the same as JSON, a dictionary of lists."""
    record: dict[str, object] = {
        "listing": listing.name,
        "consistent": not findings and not listing.unreadable,
        "repairs": [dataclasses.asdict(repair) for repair in listing.repairs],
        "unreadable": [{"line": problem.line, "message": problem.headline()} for problem in listing.unreadable],
        "contradictions": [dataclasses.asdict(finding) for finding in findings],
    }
    if beside is not None:
        record["compared"] = [_pair_record(pair) for pair in beside.pairs]
        record["only_listing"] = [dataclasses.asdict(key) for key in beside.only_old]
        record["only_new"] = [dataclasses.asdict(key) for key in beside.only_new]
        record["several"] = [dataclasses.asdict(key) for key in beside.several]
    return json.dumps(record, indent=1) + "\n"


def _pair_record(pair: Pair) -> dict[str, object]:
    sides = [side.text if side.value is None else side.value for side in (pair.old, pair.new)]
    return {
        **dataclasses.asdict(pair.key),
        "unit": pair.old.unit,
        "listing": sides[0],
        "new": sides[1],
        "difference": pair.difference,
        "alike": pair.alike,
    }
