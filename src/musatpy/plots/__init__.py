"""Pictures of records; of a solution `musatpy.plots.plan(solution)` and the like return figures of matplotlib."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from musatpy.model import Solution

# The pictures of a solution: functions, each made when it is first asked for.
__all__ = [
    "corrections",
    "correlations",
    "gnss",
    "lens",
    "mean_residuals",
    "normalised",
    "plan",
    "profile",
    "redundancy",
    "residuals",
    "sigmas",
    "tides",
]


def __getattr__(name: str) -> Callable[[Solution], Any]:
    if name not in __all__:
        raise AttributeError(f"module 'musatpy.plots' has no attribute '{name}'")
    from musatpy.plots.gallery import drawing_of

    return drawing_of(name)


def __dir__() -> list[str]:
    return list(__all__)
