"""Kinds of observations from outside: modules that the environment variable MUSATPY_EXTENSIONS names.

The variable is read when the model is first imported, so that commands, Python and the workers of a batch know the
same kinds. Such a module states, beside `musatpy.model.tables` importing nothing of the program:

- `OBSERVATIONS`: names of members of `ObservationKind`, and what these say but for their number;
- `CAUSES`: members of `CauseKind` of the same names;
- `TABLES`: attributes of `Block`, and the classes of these tables;
- `CARDS`: the folder with the formats of their cards;
- `KINDS`: the name of the module with the kinds themselves, imported by the adjustment alone.
"""

from __future__ import annotations

import os
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from musatpy.errors import MusatError

VARIABLE = "MUSATPY_EXTENSIONS"
_STATED = ("OBSERVATIONS", "CAUSES", "TABLES", "CARDS", "KINDS")


def stated(name: str) -> dict[str, Any]:
    """Return what all extensions state under a name that is a mapping."""
    return {key: value for module in _modules() for key, value in getattr(module, name).items()}


def card_folders() -> list[Path]:
    """Return the folders with formats of cards."""
    return [Path(module.CARDS) for module in _modules()]


def kind_modules() -> list[str]:
    """Return the names of the modules with kinds of observations."""
    return [module.KINDS for module in _modules()]


@cache
def _modules() -> list[ModuleType]:
    """Return the extensions. Raises `MusatError` for one that cannot be imported or lacks a statement."""
    modules = []
    for name in dict.fromkeys(os.environ.get(VARIABLE, "").replace(",", " ").split()):
        try:
            module = import_module(name)
        except ImportError as error:
            raise MusatError(f"{VARIABLE}: {name} cannot be imported: {error}") from error
        if lacking := [each for each in _STATED if not hasattr(module, each)]:
            missing = f"does not state {', '.join(lacking)} (or was imported before musatpy.model)"
            raise MusatError(f"{VARIABLE}: {name} {missing}")
        modules.append(module)
    return modules
