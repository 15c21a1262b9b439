"""The water of a job: one refractive index; its level is the tide of each photo."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Water:
    """Refractive index of water relative to air, and its sigma (None where not given)."""

    index: float = 1.340  # sea water; fresh water is 1.3333 (docs/theory.md, Errata)
    sigma: float | None = None
