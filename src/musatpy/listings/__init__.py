"""Listings and records compared number by number, by rules that are data.

difference = compare_files("old.lst", "new.lst", "rules.toml")
difference.same, difference.counts, difference.findings, difference.unused_rules
"""

from __future__ import annotations

from decimal import localcontext
from pathlib import Path

from musatpy.listings.findings import Difference, Discrepancy, PagePlace, SectionSummary
from musatpy.listings.lines import CannotCompareError, text_of
from musatpy.listings.rules import EXACTLY, Rules, RulesError, RuleUse, load_rules, parse_rules, rounding_rules
from musatpy.listings.weighing import compare_listings


def compare_files(a: str | Path, b: str | Path, rules: Rules | str | Path | None = None) -> Difference:
    """Return what differs between two files: listings (any text with numbers), records (any JSON), or one of each.

    A file is JSON where its name ends so. `rules` is a rule file, or rules that were loaded; without rules every
    number and word must be the same. Raises `CannotCompareError` for files that cannot be compared, `RulesError`
    for a wrong rule file (both are `ProblemsError`s with every reason), and `OSError`.
    """
    loaded = rules if isinstance(rules, Rules) else load_rules(rules) if rules is not None else Rules()
    return compare_bytes(Path(a).read_bytes(), Path(b).read_bytes(), loaded, names=(str(a), str(b)))


def compare_bytes(
    a: bytes, b: bytes, rules: Rules | None = None, names: tuple[str, str] = ("A", "B")
) -> Difference:
    """Return what `compare_files` does of the contents of two files; their names say which are JSON."""
    texts = text_of(a, names[0]), text_of(b, names[1])
    rules, json = rules or Rules(), [name.lower().endswith(".json") for name in names]
    with localcontext(EXACTLY):
        if all(json):
            from musatpy.listings.records import compare_records

            return compare_records(*texts, rules, names)
        if any(json):
            from musatpy.listings.printed import compare_with_record

            return compare_with_record(*texts, rules, names, listing=json.index(False))
        return compare_listings(*texts, rules, names)


def compare_texts(a: str, b: str, rules: Rules | None = None, names: tuple[str, str] = ("A", "B")) -> Difference:
    """Return what `compare_files` does of two texts; their names say which are JSON."""
    return compare_bytes(a.encode(), b.encode(), rules, names)
