"""Listings and records compared number by number, by rules that are data.

difference = compare_files("old.lst", "new.lst", "rules.toml")
difference.same, difference.counts, difference.findings, difference.unused_rules
"""

from __future__ import annotations

from musatpy.listings.files import compare_bytes, compare_files, compare_texts
from musatpy.listings.findings import Difference, Finding, Place, RuleUse, SectionSummary
from musatpy.listings.lines import CannotCompareError
from musatpy.listings.rules import Rules, RulesError, load_rules, parse_rules

__all__ = [
    "CannotCompareError",
    "Difference",
    "Finding",
    "Place",
    "RuleUse",
    "Rules",
    "RulesError",
    "SectionSummary",
    "compare_bytes",
    "compare_files",
    "compare_texts",
    "load_rules",
    "parse_rules",
]
