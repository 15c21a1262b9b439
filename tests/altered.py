"""Blocks, solutions and their parts with something changed: for tests that spoil one thing."""

from collections.abc import Callable
from dataclasses import is_dataclass, replace
from typing import Any, TypeVar

import numpy as np

Whole = TypeVar("Whole")


def altered(whole: Whole, **parts: Any) -> Whole:
    """Return a frozen dataclass with other values: a dict changes a part, a function makes one of the old one."""

    def value(old: Any, new: Any) -> Any:
        if isinstance(new, dict) and is_dataclass(old):
            return altered(old, **new)
        return new(old) if callable(new) else new

    changes = {name: value(getattr(whole, name), new) for name, new in parts.items()}
    return replace(whole, **changes)


def with_options(block: Whole, **options: Any) -> Whole:
    """Return a block, or a solution, with other options."""
    return (
        altered(block, block={"options": options}) if hasattr(block, "block") else altered(block, options=options)
    )


def put(at: Any, value: Any) -> Callable[[np.ndarray], np.ndarray]:
    """Return what puts other values in some places of an array."""

    def changed(array: np.ndarray) -> np.ndarray:
        copy = np.array(array)
        copy[at] = value
        return copy

    return changed


def added(at: Any, value: Any) -> Callable[[np.ndarray], np.ndarray]:
    """Return what adds something in some places of an array."""
    return lambda array: put(at, array[at] + value)(array)
