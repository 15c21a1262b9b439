"""Packages of the extras of the program, loaded when they are needed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from musatpy.errors import MissingPackageError


def package(extra: str, name: str, use: str) -> Any:
    """Return a module of a package of an extra; `use` is what needs it, with its verb.

    Raises `MissingPackageError` where it is not installed.
    """
    try:
        return import_module(name)
    except ImportError as error:
        raise MissingPackageError(use, name.partition(".")[0], extra) from error
