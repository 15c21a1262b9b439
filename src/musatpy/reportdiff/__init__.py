"""Listings and records compared number by number, by rules that are data.

difference = compare_files("old.lst", "new.lst", "rules.toml")
difference.same, difference.counts, difference.findings, difference.unused_rules
"""

from __future__ import annotations

from musatpy.reportdiff.files import compare_bytes, compare_files, compare_texts
from musatpy.reportdiff.findings import Difference, Finding, Place, RuleUse, SectionSummary
from musatpy.reportdiff.paper import CannotCompareError
from musatpy.reportdiff.rules import Rules, RulesError, load_rules, parse_rules

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
