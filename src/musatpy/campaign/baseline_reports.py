"""What a check of a baseline found: text for people, JSON, and JUnit XML, where each deck is a test."""

from __future__ import annotations

import json
from typing import Any
from xml.etree import ElementTree

from musatpy.campaign.baselines import Check, Checked
from musatpy.errors import printable
from musatpy.listings.machine import json_text
from musatpy.listings.render import Style, plain, render

SCHEMA_VERSION = "1.0"


def check_text(check: Check, listed: int, style: Style = plain) -> str:
    """Return what differs of each deck, a row of each deck, and a verdict."""
    width = max(len(printable(name)) for name in (*(one.name for one in check.decks), *check.unknown))
    lines = []
    for one in check.decks:
        if one.differences and one.state == "different":
            lines += [style(one.name, "title"), _differences(one, listed, style)]
    for one in check.decks:
        notes = printable(f"  ({'; '.join(one.notes)})") if one.notes else ""
        lines.append(
            f"{printable(one.name):<{width}}  {style(one.state, 'same' if one.same else 'different')}{notes}"
        )
    lines += [
        f"{printable(name):<{width}}  {style('not in the baseline', 'different')}  (musat baseline save adds it)"
        for name in check.unknown
    ]
    lines += [style(f"rule never matched: {name}", "warning") for name in check.unused_rules]
    states = {one.state for one in check.decks}
    if check.work is not None and not check.decks_same and states != {"failed"}:
        hint = "; musat baseline accept takes them over" if "different" in states else ""
        lines.append(printable(f"new results: {check.work}{hint}"))
    return "\n".join([*lines, style(_verdict(check), "same" if check.same else "different")]) + "\n"


def _differences(one: Checked, listed: int, style: Style) -> str:
    """Return the differences of the files of a deck."""
    return "\n".join(render(found, listed=listed, style=style) for found in one.differences if not found.same)


def _verdict(check: Check) -> str:
    """Return how many decks came to what, and which version of the program the baseline is of."""
    states = [*(one.state for one in check.decks), *["not in the baseline"] * len(check.unknown)]
    counts = ", ".join(f"{states.count(state)} {state}" for state in dict.fromkeys(states))
    return f"{'same' if check.same else 'DIFFERENT'}: {counts}; saved by musatpy {', '.join(check.versions)}"


def check_json(check: Check) -> str:
    """Return a check as JSON; differences are those of `musat diff --json`, rules of each included."""
    record = {
        "schema_version": SCHEMA_VERSION,
        "same": check.same,
        "decks": [_record(check, one) for one in check.decks],
        "unknown_decks": list(check.unknown),
        "unused_rules": list(check.unused_rules),
    }
    return json.dumps(record, indent=1) + "\n"


def _record(check: Check, one: Checked) -> dict[str, Any]:
    entry = check.baseline.entries[one.name]
    return {
        "deck": one.name,
        "state": one.state,
        "notes": list(one.notes),
        "saved_status": entry.status,
        "status": int(one.outcome.state.status),
        "saved_by_version": entry.version,
        "saved_sha256": entry.deck_sha256,
        "sha256": one.outcome.deck_sha256,
        "saved_inputs": entry.inputs,
        "inputs": one.outcome.inputs,
        "differences": [json.loads(json_text(found)) for found in one.differences],
    }


def check_junit(check: Check) -> str:
    """Return a test suite of JUnit XML, each deck a test: a failure where it differs, an error without results."""
    states = [*(one.state for one in check.decks), *["different"] * len(check.unknown)]
    counts = {"tests": len(states), "failures": states.count("different"), "errors": states.count("failed")}
    attributes = {
        "name": printable(str(check.baseline.folder)),
        **{key: str(value) for key, value in counts.items()},
    }
    suite = ElementTree.Element("testsuite", attributes)
    for one in check.decks:
        seconds = f"{one.outcome.seconds:.3f}"
        test = ElementTree.SubElement(
            suite, "testcase", classname="musat.baseline", name=printable(one.name), time=seconds
        )
        if one.same:
            continue
        kind, message = ("error", "no results") if one.state == "failed" else ("failure", "different")
        text = "\n".join(
            [*one.notes, *(str(problem) for problem in one.outcome.problems), _differences(one, 50, plain)]
        )
        ElementTree.SubElement(test, kind, message=message).text = printable(text)
    for name in check.unknown:
        test = ElementTree.SubElement(suite, "testcase", classname="musat.baseline", name=printable(name))
        ElementTree.SubElement(test, "failure", message="not in the baseline")
    ElementTree.indent(suite)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(suite, encoding="unicode")}\n'
