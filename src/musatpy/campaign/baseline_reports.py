"""What a check of a baseline found: text for people, JSON, and JUnit XML, where each deck is a test."""

from __future__ import annotations

import json
from typing import Any
from xml.etree import ElementTree

from musatpy.campaign.baselines import Check, Checked
from musatpy.errors import printable
from musatpy.listings.output import Style, json_text, plain, render

SCHEMA_VERSION = "1.0"


def check_text(check: Check, listed: int, style: Style = plain) -> str:
    """Return what differs of each deck, a row of each deck, and a verdict."""
    width = max(len(printable(name)) for name in (*(deck.name for deck in check.decks), *check.unknown))
    lines = []
    for deck in check.decks:
        if deck.differences and deck.state == "different":
            lines += [style(deck.name, "title"), _differences(deck, listed, style)]
    for deck in check.decks:
        notes = printable(f"  ({'; '.join(deck.notes)})") if deck.notes else ""
        lines.append(
            f"{printable(deck.name):<{width}}  {style(deck.state, 'same' if deck.same else 'different')}{notes}"
        )
    lines += [
        f"{printable(name):<{width}}  {style('not in the baseline', 'different')}  (musat baseline save adds it)"
        for name in check.unknown
    ]
    lines += [style(f"rule never matched: {name}", "warning") for name in check.unused_rules]
    states = {deck.state for deck in check.decks}
    if check.work is not None and not check.decks_same and states != {"failed"}:
        hint = "; musat baseline accept takes them over" if "different" in states else ""
        lines.append(printable(f"new results: {check.work}{hint}"))
    return "\n".join([*lines, style(_verdict(check), "same" if check.same else "different")]) + "\n"


def _differences(deck: Checked, listed: int, style: Style) -> str:
    """Return the differences of the files of a deck."""
    return "\n".join(
        render(difference, listed=listed, style=style) for difference in deck.differences if not difference.same
    )


def _verdict(check: Check) -> str:
    """Return how many decks came to what, and which version of the program the baseline is of."""
    states = [*(deck.state for deck in check.decks), *["not in the baseline"] * len(check.unknown)]
    counts = ", ".join(f"{states.count(state)} {state}" for state in dict.fromkeys(states))
    return f"{'same' if check.same else 'DIFFERENT'}: {counts}; saved by musatpy {', '.join(check.versions)}"


def check_json(check: Check) -> str:
    """Return a check as JSON; differences are those of `musat diff --json`, rules of each included."""
    record = {
        "schema_version": SCHEMA_VERSION,
        "same": check.same,
        "decks": [_record(check, deck) for deck in check.decks],
        "unknown_decks": list(check.unknown),
        "unused_rules": list(check.unused_rules),
    }
    return json.dumps(record, indent=1) + "\n"


def _record(check: Check, deck: Checked) -> dict[str, Any]:
    entry = check.baseline.entries[deck.name]
    return {
        "deck": deck.name,
        "state": deck.state,
        "notes": list(deck.notes),
        "saved_status": entry.status,
        "status": int(deck.outcome.state.status),
        "saved_by_version": entry.version,
        "saved_sha256": entry.deck_sha256,
        "sha256": deck.outcome.deck_sha256,
        "saved_inputs": entry.inputs,
        "inputs": deck.outcome.inputs,
        "differences": [json.loads(json_text(difference)) for difference in deck.differences],
    }


def check_junit(check: Check) -> str:
    """Return a test suite of JUnit XML, each deck a test: a failure where it differs, an error without results."""
    states = [*(deck.state for deck in check.decks), *["different"] * len(check.unknown)]
    counts = {"tests": len(states), "failures": states.count("different"), "errors": states.count("failed")}
    attributes = {
        "name": printable(str(check.baseline.folder)),
        **{key: str(value) for key, value in counts.items()},
    }
    suite = ElementTree.Element("testsuite", attributes)
    for deck in check.decks:
        seconds = f"{deck.outcome.seconds:.3f}"
        test = ElementTree.SubElement(
            suite, "testcase", classname="musat.baseline", name=printable(deck.name), time=seconds
        )
        if deck.same:
            continue
        kind, message = ("error", "no results") if deck.state == "failed" else ("failure", "different")
        text = "\n".join(
            [*deck.notes, *(str(problem) for problem in deck.outcome.problems), _differences(deck, 50, plain)]
        )
        ElementTree.SubElement(test, kind, message=message).text = printable(text)
    for name in check.unknown:
        test = ElementTree.SubElement(suite, "testcase", classname="musat.baseline", name=printable(name))
        ElementTree.SubElement(test, "failure", message="not in the baseline")
    ElementTree.indent(suite)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(suite, encoding="unicode")}\n'
