"""What a check of a baseline found: text for people, JSON, and JUnit XML, where each deck is a test."""

from __future__ import annotations

import json
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
        if deck.differences and not deck.same:
            lines += [style(deck.name, "title"), _rendered(deck, listed, style)]
    for deck in check.decks:
        notes = printable(f"  ({'; '.join(deck.notes)})") if deck.notes else ""
        state = style(deck.state, "same" if deck.same else "different")
        lines.append(f"{printable(deck.name):<{width}}  {state}{notes}")
    for name in check.unknown:
        unknown = style("not in the baseline", "different")
        lines.append(f"{printable(name):<{width}}  {unknown}  (musat baseline save adds it)")
    lines += [style(f"rule never matched: {name}", "warning") for name in check.unused_rules]
    states = [deck.state for deck in check.decks]
    if check.work is not None and not check.decks_same and {*states} != {"failed"}:
        hint = "; musat baseline accept takes them over" if "different" in states else ""
        lines.append(printable(f"new results: {check.work}{hint}"))
    ended = [*states, *["not in the baseline"] * len(check.unknown)]
    counts = ", ".join(f"{ended.count(state)} {state}" for state in dict.fromkeys(ended))
    versions = ", ".join(sorted({check.baseline.entries[deck.name].version for deck in check.decks}))
    verdict = f"{'same' if check.same else 'DIFFERENT'}: {counts}; saved by musatpy {versions}"
    return "\n".join([*lines, style(verdict, "same" if check.same else "different")]) + "\n"


def _rendered(deck: Checked, listed: int, style: Style) -> str:
    """Return the differences of the files of a deck."""
    different = (difference for difference in deck.differences if not difference.same)
    return "\n".join(render(difference, listed=listed, style=style) for difference in different)


def check_json(check: Check) -> str:
    """Return a check as JSON; differences are those of `musat diff --json`, rules of each included."""
    entries = check.baseline.entries
    decks = [
        {
            "deck": deck.name,
            "state": deck.state,
            "notes": list(deck.notes),
            "saved_status": entries[deck.name].status,
            "status": int(deck.outcome.state.status),
            "saved_by_version": entries[deck.name].version,
            "saved_sha256": entries[deck.name].deck_sha256,
            "sha256": deck.outcome.deck_sha256,
            "saved_inputs": entries[deck.name].inputs,
            "inputs": deck.outcome.inputs,
            "differences": [json.loads(json_text(difference)) for difference in deck.differences],
        }
        for deck in check.decks
    ]
    record = {
        "schema_version": SCHEMA_VERSION,
        "same": check.same,
        "decks": decks,
        "unknown_decks": list(check.unknown),
        "unused_rules": list(check.unused_rules),
    }
    return json.dumps(record, indent=1) + "\n"


def check_junit(check: Check) -> str:
    """Return a test suite of JUnit XML, each deck a test: a failure where it differs, an error without results."""
    kinds = {"failed": ("error", "no results"), "different": ("failure", "different")}
    states = [deck.state for deck in check.decks]
    suite = ElementTree.Element("testsuite", name=printable(str(check.baseline.folder)))
    suite.set("tests", str(len(states) + len(check.unknown)))
    suite.set("failures", str(states.count("different") + len(check.unknown)))
    suite.set("errors", str(states.count("failed")))
    for deck in check.decks:
        test = _junit_case(suite, deck.name)
        test.set("time", f"{deck.outcome.seconds:.3f}")
        if not deck.same:
            kind, message = kinds[deck.state]
            problems = [str(problem) for problem in deck.outcome.problems]
            text = "\n".join([*deck.notes, *problems, _rendered(deck, 50, plain)])
            ElementTree.SubElement(test, kind, message=message).text = printable(text)
    for name in check.unknown:
        ElementTree.SubElement(_junit_case(suite, name), "failure", message="not in the baseline")
    ElementTree.indent(suite)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(suite, encoding="unicode")}\n'


def _junit_case(suite: ElementTree.Element, name: str) -> ElementTree.Element:
    return ElementTree.SubElement(suite, "testcase", classname="musat.baseline", name=printable(name))
