"""What a comparison found: differences as data."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from decimal import Decimal
from functools import cached_property
from typing import Any, Literal, NamedTuple

from musatpy.listings.rules import Rule

FindingKind = Literal["number", "angle", "text", "overflow", "only in A", "only in B", "order", "column", "section"]


class PagePlace(NamedTuple):
    """Where something stands in a file: page and line of a listing, both from 1; 0 where there are none."""

    page: int = 0
    line: int = 0


class Discrepancy(NamedTuple):
    """One difference that no rule lets pass (a named tuple: two large listings can have a million of them)."""

    kind: FindingKind
    section: str
    row: str = ""  # ids of the row, or its label
    column: str = ""  # heading of the column, or the number of the field
    a: str | None = None  # as printed; None where A has none
    b: str | None = None
    difference: Decimal | None = None  # B minus A
    unit: str = ""  # of the difference: m, arc sec, ... as far as headings say
    last_digits: Decimal | None = None  # the difference in units of the last digit that both print
    sigmas: float | None = None  # the difference in sigmas, of records that have them
    rule: str = "exact"  # that was applied
    place_a: PagePlace = PagePlace()
    place_b: PagePlace = PagePlace()

    @property
    def size(self) -> Any:
        """How much differs, in sigmas where these are known."""
        return abs(self.difference or Decimal(0)) if self.sigmas is None else abs(self.sigmas)


@dataclass(eq=False)
class SectionSummary:
    """One section of the two files: how much was compared, what differs, and the largest difference in each unit.

    `largest` holds passed differences too, so that it shows what the rules let pass.
    """

    title: str
    rows: int = 0  # compared
    passed: int = 0  # differences that a rule lets pass
    overflowed: int = 0  # fields of asterisks in both files
    findings: list[Discrepancy] = field(default_factory=list)
    _largest: dict[tuple[str, bool], Discrepancy] = field(default_factory=dict)  # by unit, and whether in sigmas

    @property
    def different(self) -> int:
        """The number of findings."""
        return len(self.findings)

    @property
    def largest(self) -> tuple[Discrepancy, ...]:
        """The largest difference in each unit, in sigmas where these are known."""
        return tuple(self._largest.values())

    def add(self, finding: Discrepancy, *, passes: bool = False) -> None:
        """Take a difference, which a rule lets pass or not."""
        if passes:
            self.passed += 1
        else:
            self.findings.append(finding)
        if finding.difference is not None:
            key = finding.unit, finding.sigmas is not None
            known = self._largest.get(key)
            if known is None or finding.size > known.size:
                self._largest[key] = finding


@dataclass(eq=False)
class RuleUse:
    """What became of one rule: whether it selected anything, and how many differences it let pass."""

    rule: Rule
    matched: bool = False
    applied: bool = False  # False where a later rule always won
    passed: int = 0

    @property
    def name(self) -> str:
        """The name of the rule."""
        return self.rule.name


@dataclass(frozen=True)
class Difference:
    """The result of a comparison.

    `same` is what a caller asks first; `findings` are the differences that no rule lets pass, in the order of A.
    """

    a: str  # names of the files
    b: str
    sections: tuple[SectionSummary, ...]
    rules: tuple[RuleUse, ...] = ()
    not_compared: tuple[str, ...] = ()  # sections and columns of a listing that a record cannot answer for

    @cached_property
    def findings(self) -> tuple[Discrepancy, ...]:
        """The differences, section by section."""
        return tuple(finding for section in self.sections for finding in section.findings)

    @property
    def same(self) -> bool:
        """True where nothing was found that a rule does not let pass."""
        return not self.findings

    @property
    def counts(self) -> dict[str, int]:
        """Return the number of findings of each kind, and of the rows compared."""
        kinds: Counter[str] = Counter(finding.kind for finding in self.findings)
        return {"rows compared": sum(section.rows for section in self.sections), **kinds}

    @property
    def unused_rules(self) -> tuple[str, ...]:
        """Return the names of the rules that never matched."""
        return tuple(rule.name for rule in self.rules if not rule.matched)
